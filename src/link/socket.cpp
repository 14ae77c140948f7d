#include "link/socket.hpp"

#include <arpa/inet.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <string>
#include <system_error>
#include <utility>

namespace gantry::link {

Socket::Socket(Socket&& other) noexcept
    : fd_(std::exchange(other.fd_, -1)),
      peer_(std::move(other.peer_)),
      peer_host_(std::move(other.peer_host_)) {}

Socket& Socket::operator=(Socket&& other) noexcept {
    if (this == &other) return *this;
    if (fd_ >= 0) ::close(fd_);
    fd_ = std::exchange(other.fd_, -1);
    peer_ = std::move(other.peer_);
    peer_host_ = std::move(other.peer_host_);
    return *this;
}

Socket::~Socket() {
    if (fd_ >= 0) ::close(fd_);
}

std::string Socket::local_host() const {
    auto address = local_address(fd_);
    bool is_ip =
        address.size != 0 && (address.storage.ss_family == AF_INET || address.storage.ss_family == AF_INET6);
    return is_ip ? to_endpoint(address).host : std::string();
}

int Socket::release() {
    return std::exchange(fd_, -1);
}

bool operator==(const SocketAddress& a, const SocketAddress& b) {
    return a.size == b.size && std::memcmp(&a.storage, &b.storage, a.size) == 0;
}

SocketAddress address_of(const sockaddr* address, socklen_t size) {
    SocketAddress out;
    out.size = std::min(size, static_cast<socklen_t>(sizeof out.storage));
    std::memcpy(&out.storage, address, out.size);
    return out;
}

SocketAddress local_address(int fd) {
    SocketAddress out;
    if (::getsockname(fd, out.get(), &out.size) != 0) out.size = 0;
    return out;
}

SocketAddress peer_address(int fd) {
    SocketAddress out;
    if (::getpeername(fd, out.get(), &out.size) != 0) out.size = 0;
    return out;
}

Endpoint to_endpoint(const SocketAddress& address) {
    char host[NI_MAXHOST] = "", port[NI_MAXSERV] = "";
    if (::getnameinfo(address.get(), address.size, host, sizeof host, port, sizeof port,
                      NI_NUMERICHOST | NI_NUMERICSERV) != 0) {
        return {"unknown", 0};
    }
    Endpoint out{host, static_cast<std::uint16_t>(std::stoul(port))};
    constexpr std::string_view mapped = "::ffff:";
    if (out.host.starts_with(mapped) && out.host.find('.') != std::string::npos) {
        out.host.erase(0, mapped.size());
    }
    return out;
}

std::vector<SocketAddress> numeric_addresses(const Endpoint& endpoint) {
    addrinfo hints{};
    hints.ai_socktype = SOCK_STREAM;
    hints.ai_flags = AI_NUMERICHOST | AI_NUMERICSERV | AI_PASSIVE;
    addrinfo* found = nullptr;
    auto port = std::to_string(endpoint.port);
    std::vector<SocketAddress> out;
    if (::getaddrinfo(endpoint.host.empty() ? nullptr : endpoint.host.c_str(), port.c_str(), &hints,
                      &found) != 0) {
        return out;
    }
    for (auto* each = found; each != nullptr; each = each->ai_next) {
        auto where = each->ai_family == AF_INET6 ? out.begin() : out.end();
        out.insert(where, address_of(each->ai_addr, each->ai_addrlen));
    }
    ::freeaddrinfo(found);
    return out;
}

void tune(int fd) {
    auto set = [fd](int level, int name, int value) { ::setsockopt(fd, level, name, &value, sizeof value); };
    set(IPPROTO_TCP, TCP_NODELAY, 1);
    set(SOL_SOCKET, SO_KEEPALIVE, 1);
    set(IPPROTO_TCP, TCP_KEEPIDLE, 30);
    set(IPPROTO_TCP, TCP_KEEPINTVL, 10);
    set(IPPROTO_TCP, TCP_KEEPCNT, 3);
    set(IPPROTO_TCP, TCP_USER_TIMEOUT, 30'000);
}

Socket make_socket(int fd, const SocketAddress& peer) {
    auto endpoint = to_endpoint(peer);
    return {fd, to_text(endpoint), endpoint.host};
}

std::string describe_errno(int error) {
    switch (error) {
        case ECONNREFUSED:
            return "connection refused";
        case ECONNRESET:
            return "connection reset";
        case ETIMEDOUT:
            return "no answer";
        case EHOSTUNREACH:
        case ENETUNREACH:
            return "there is no way to that network";
        case EMFILE:
        case ENFILE:
            return "no free file descriptors";
        default:
            return std::system_category().message(error);
    }
}

std::uint64_t raise_file_limit() {
    rlimit limit{};
    if (::getrlimit(RLIMIT_NOFILE, &limit) != 0) return 0;
    if (limit.rlim_cur < limit.rlim_max) {
        auto raised = limit;
        raised.rlim_cur = limit.rlim_max;
        if (::setrlimit(RLIMIT_NOFILE, &raised) == 0) limit = raised;
    }
    return limit.rlim_cur;
}

}  // namespace gantry::link
