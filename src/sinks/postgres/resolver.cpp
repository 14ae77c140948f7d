#include "sinks/postgres/resolver.hpp"

#include <arpa/inet.h>
#include <netdb.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <condition_variable>
#include <mutex>
#include <thread>

#include <fmt/format.h>

#include "base/text.hpp"

namespace gantry::sinks::postgres {

namespace {

Result<std::vector<std::string>> look_up(const std::string& host) {
    addrinfo hints{};
    hints.ai_family = AF_UNSPEC;
    hints.ai_socktype = SOCK_STREAM;
    addrinfo* found = nullptr;
    if (int error = getaddrinfo(host.c_str(), nullptr, &hints, &found); error != 0)
        return fail(fmt::format("there is no address of {}: {}", printable(host), gai_strerror(error)));
    std::vector<std::string> out;
    for (auto* each = found; each != nullptr; each = each->ai_next) {
        std::array<char, NI_MAXHOST> text{};
        if (getnameinfo(each->ai_addr, each->ai_addrlen, text.data(), text.size(), nullptr, 0,
                        NI_NUMERICHOST) != 0)
            continue;
        if (std::ranges::find(out, std::string_view(text.data())) == out.end()) out.emplace_back(text.data());
    }
    freeaddrinfo(found);
    if (out.empty()) return fail(fmt::format("there is no address of {}", printable(host)));
    return out;
}

bool is_address(const std::string& host) {
    in6_addr any{};
    return inet_pton(AF_INET, host.c_str(), &any) == 1 || inet_pton(AF_INET6, host.c_str(), &any) == 1;
}

}  // namespace

struct Resolver::Lookup {
    std::mutex mutex;
    std::condition_variable_any done;
    std::optional<Result<std::vector<std::string>>> answer;
};

Result<std::vector<std::string>> Resolver::addresses(const std::string& host,
                                                     const sink::Patience& patience) {
    if (is_address(host)) return std::vector{host};
    auto& lookup = running_[host];
    if (lookup == nullptr) {
        lookup = std::make_shared<Lookup>();
        std::thread([host, lookup] {
            auto answer = look_up(host);
            std::lock_guard lock(lookup->mutex);
            lookup->answer = std::move(answer);
            lookup->done.notify_all();
        }).detach();
    }
    std::unique_lock lock(lookup->mutex);
    bool known = lookup->done.wait_until(lock, patience.stop, patience.until,
                                         [&] { return lookup->answer.has_value(); });
    if (!known) return fail(fmt::format("no answer in time: what is the address of {}?", printable(host)));
    auto answer = std::move(*lookup->answer);
    lock.unlock();
    running_.erase(host);  // `lookup` is gone with it: next time it is asked anew
    return answer;
}

}  // namespace gantry::sinks::postgres
