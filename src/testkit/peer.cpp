#include "testkit/peer.hpp"

#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include <utility>

#include <gtest/gtest.h>

namespace gantry::testkit {

Peer::Peer(int fd) : fd_(fd) {
    timeval patience{10, 0};
    ::setsockopt(fd_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    ::setsockopt(fd_, SOL_SOCKET, SO_SNDTIMEO, &patience, sizeof patience);
}

Peer Peer::to(std::uint16_t port) {
    Peer peer(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
    EXPECT_TRUE(peer.connect(port));
    return peer;
}

Peer Peer::to(const std::filesystem::path& unix_socket) {
    Peer peer(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
    auto address = unix_address(unix_socket);
    EXPECT_EQ(::connect(peer.fd_, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
    return peer;
}

Peer::Peer(Peer&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}

Peer& Peer::operator=(Peer&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
}

bool Peer::connect(std::uint16_t port) const {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    return ::connect(fd_, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0;
}

bool Peer::send(std::string_view text) const {
    while (!text.empty()) {
        auto size = ::send(fd_, text.data(), text.size(), MSG_NOSIGNAL);
        if (size <= 0) return false;
        text.remove_prefix(static_cast<std::size_t>(size));
    }
    return true;
}

std::string Peer::receive(std::size_t size) const {
    std::string text(size, '\0');
    std::size_t have = 0;
    while (have < size) {
        auto got = ::recv(fd_, text.data() + have, size - have, 0);
        if (got <= 0) break;
        have += static_cast<std::size_t>(got);
    }
    text.resize(have);
    return text;
}

std::string Peer::until(std::string_view mark) const {
    std::string text;
    char byte = 0;
    while (!text.ends_with(mark) && ::recv(fd_, &byte, 1, 0) == 1)
        text += byte;
    return text;
}

std::string Peer::rest() const {
    std::string text;
    char piece[4096];
    for (auto size = ::recv(fd_, piece, sizeof piece, 0); size > 0;
         size = ::recv(fd_, piece, sizeof piece, 0))
        text.append(piece, static_cast<std::size_t>(size));
    return text;
}

bool Peer::at_end() const {
    char byte = 0;
    return ::recv(fd_, &byte, 1, 0) == 0;
}

void Peer::shutdown() const {
    ::shutdown(fd_, SHUT_WR);
}

void Peer::close() {
    if (fd_ >= 0) ::close(std::exchange(fd_, -1));
}

void Peer::reset() {
    linger now{1, 0};
    ::setsockopt(fd_, SOL_SOCKET, SO_LINGER, &now, sizeof now);
    close();
}

sockaddr_un unix_address(const std::filesystem::path& path) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    path.string().copy(address.sun_path, sizeof address.sun_path - 1);
    return address;
}

}  // namespace gantry::testkit
