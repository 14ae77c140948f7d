#pragma once
#include <cstdint>
#include <memory>

#include "bench/load/child.hpp"

namespace gantry::bench {

// The other end of the loopback with nothing behind it, in a process of its own: one thread, one epoll.
class BareHost {
public:
    enum class Work {
        count,        // takes bytes until all connections have ended
        acknowledge,  // answers each tag frame that wants it, without a look at its tags, and stores nothing
    };
    BareHost(Work work, std::uint32_t connections);

    std::uint16_t port() const { return port_; }
    std::uint64_t bytes_received();  // waits until all connections have ended

private:
    std::unique_ptr<Child> child_;
    std::uint16_t port_ = 0;
};

}  // namespace gantry::bench
