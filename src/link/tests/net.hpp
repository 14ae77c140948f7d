#pragma once
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <string>
#include <thread>

#include "link/link.hpp"
#include "testkit/eventually.hpp"
#include "testkit/peer.hpp"

// What the tests of this module share.
namespace gantry::link {

using testkit::eventually;
using testkit::Peer;

inline const Endpoint any_port{"127.0.0.1", 0};

// A port that no other program gets. A Listener may take it and leave it again; else who dials is refused.
struct HeldPort {
    int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    Endpoint endpoint = any_port;

    HeldPort() {
        int on = 1;
        ::setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
        sockaddr_in address{};
        address.sin_family = AF_INET;
        address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        socklen_t size = sizeof address;
        EXPECT_EQ(::bind(fd, reinterpret_cast<sockaddr*>(&address), size), 0);
        EXPECT_EQ(::getsockname(fd, reinterpret_cast<sockaddr*>(&address), &size), 0);
        endpoint.port = ntohs(address.sin_port);
    }
    ~HeldPort() { ::close(fd); }
    HeldPort(const HeldPort&) = delete;
    HeldPort& operator=(const HeldPort&) = delete;
};

}  // namespace gantry::link
