#pragma once
#include <sys/socket.h>

#include "link/link.hpp"

// What the files of this module share about sockets.
namespace gantry::link {

// Room for an address of either family.
struct SocketAddress {
    sockaddr_storage storage{};
    socklen_t size = sizeof(sockaddr_storage);

    const sockaddr* get() const { return reinterpret_cast<const sockaddr*>(&storage); }
    sockaddr* get() { return reinterpret_cast<sockaddr*>(&storage); }
    friend bool operator==(const SocketAddress& a, const SocketAddress& b);
};

SocketAddress address_of(const sockaddr* address, socklen_t size);
SocketAddress local_address(int fd);
SocketAddress peer_address(int fd);
// IPv4 mapped into IPv6 comes out as IPv4.
Endpoint to_endpoint(const SocketAddress& address);
// A numeric host needs no name service. An empty host is all addresses, IPv6 first.
std::vector<SocketAddress> numeric_addresses(const Endpoint& endpoint);

// Small frames go out at once, and a peer that vanished is noticed (reliability: half-open links).
void tune(int fd);
Socket make_socket(int fd, const SocketAddress& peer);

// errno for people: "connection refused", "no free file descriptors".
std::string describe_errno(int error);

}  // namespace gantry::link
