#pragma once
#include <string>
#include <vector>

#include "sinks/postgres/schema.hpp"

namespace gantry::sinks::postgres {

// Where a section's events go and how that is reached, checked and without defaults left open.
struct Target {
    struct Host {
        std::string name;  // or an address, or the directory of a Unix socket; empty: libpq's own directory
        std::string port;
        std::string sslmode;
        std::string shown() const;
        bool is_directory() const { return name.empty() || name.front() == '/'; }
    };
    std::vector<Host> hosts;  // tried in turn
    Parameters parameters;    // what all hosts share
    std::string warning;      // said once in the log; empty: nothing to say
    Names names;
    bool present_tags = false;
    std::string gateway;
    std::chrono::milliseconds lock_timeout{};
};

Result<Target> make_target(const sink::Options& options);

}  // namespace gantry::sinks::postgres
