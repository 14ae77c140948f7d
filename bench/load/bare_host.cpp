#include "bench/load/bare_host.hpp"

#include <arpa/inet.h>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <vector>

#include <fmt/format.h>

#include "bench/load/outcome.hpp"
#include "bench/tag_frame.hpp"

namespace gantry::bench {

using namespace std::chrono_literals;

namespace {
constexpr std::size_t head_size = 10;

// Frames that lie whole in `bytes` and want an answer; `used` is where the last whole one ends.
std::size_t frames_to_answer(ByteView bytes, std::size_t& used) {
    std::size_t wanted = 0;
    for (used = 0; bytes.size() - used >= head_size;) {
        const auto* head = bytes.data() + used;
        std::size_t size = head_size + head[1] + (static_cast<std::size_t>(head[2]) << 8 | head[3]) +
                           ((head[5] & 2) != 0 ? 2 : 0);
        if (bytes.size() - used < size) break;
        wanted += head[5] & 1u;
        used += size;
    }
    return wanted;
}

class Server {
public:
    Server(int listener, BareHost::Work work) : listener_(listener), work_(work) {
        epoll_ = ::epoll_create1(EPOLL_CLOEXEC);
        add(listener);
    }

    std::uint64_t serve(std::uint32_t connections) {
        std::array<epoll_event, 256> events{};
        for (std::uint32_t ended = 0; ended < connections;) {
            int count = ::epoll_wait(epoll_, events.data(), static_cast<int>(events.size()), -1);
            for (int i = 0; i < count; ++i) {
                int fd = events[static_cast<std::size_t>(i)].data.fd;
                if (fd == listener_) {
                    accept_one();
                } else if (!receive(fd)) {
                    ::close(fd);
                    ++ended;
                }
            }
        }
        return bytes_;
    }

private:
    void add(int fd) {
        epoll_event event{};
        event.events = EPOLLIN;
        event.data.fd = fd;
        ::epoll_ctl(epoll_, EPOLL_CTL_ADD, fd, &event);
    }

    void accept_one() {
        int fd = ::accept4(listener_, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC);
        if (fd >= 0) add(fd);
    }

    bool receive(int fd) {
        auto got = ::recv(fd, buffer_.data(), buffer_.size(), 0);
        if (got < 0 && errno == EAGAIN) return true;
        if (got <= 0) return false;
        bytes_ += static_cast<std::uint64_t>(got);
        if (work_ == BareHost::Work::acknowledge)
            answer(fd, ByteView(buffer_).first(static_cast<std::size_t>(got)));
        return true;
    }

    void answer(int fd, ByteView bytes) {
        if (parts_.size() <= static_cast<std::size_t>(fd)) parts_.resize(static_cast<std::size_t>(fd) + 1);
        auto& part = parts_[static_cast<std::size_t>(fd)];
        if (!part.empty()) {
            part.insert(part.end(), bytes.begin(), bytes.end());
            bytes = part;
        }
        std::size_t used = 0;
        for (auto wanted = frames_to_answer(bytes, used); wanted > 0; --wanted)
            if (::send(fd, answer_.data(), answer_.size(), MSG_NOSIGNAL) < 0) return;
        Bytes rest(bytes.begin() + static_cast<std::ptrdiff_t>(used), bytes.end());
        part = std::move(rest);
    }

    int listener_;
    BareHost::Work work_;
    int epoll_ = -1;
    std::uint64_t bytes_ = 0;
    Bytes buffer_ = Bytes(64 << 10);
    Bytes answer_ = acknowledgement();
    std::vector<Bytes> parts_;  // by descriptor: the beginning of a frame that has not come whole
};
}  // namespace

BareHost::BareHost(Work work, std::uint32_t connections) {
    int listener = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    auto* any = reinterpret_cast<sockaddr*>(&address);
    if (listener < 0 || ::bind(listener, any, size) != 0 || ::listen(listener, SOMAXCONN) != 0 ||
        ::getsockname(listener, any, &size) != 0)
        throw Failure(fmt::format("cannot listen on loopback: {}", std::strerror(errno)));
    port_ = ntohs(address.sin_port);
    child_ = std::make_unique<Child>([&](int out) {
        auto bytes = fmt::format("bytes {}\n", Server(listener, work).serve(connections));
        if (::write(out, bytes.data(), bytes.size()) < 0) throw Failure("nobody listens any more");
    });
    ::close(listener);
}

std::uint64_t BareHost::bytes_received() {
    auto line = child_->line("bytes ", 60s);
    std::uint64_t bytes = 0;
    std::from_chars(line.data() + 6, line.data() + line.size(), bytes);
    return bytes;
}

}  // namespace gantry::bench
