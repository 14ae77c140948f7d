#pragma once
#include <gtest/gtest.h>
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

}  // namespace gantry::link
