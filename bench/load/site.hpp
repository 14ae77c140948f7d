#pragma once
#include <filesystem>
#include <memory>
#include <string>

#include "bench/load/child.hpp"
#include "bench/temp_dir.hpp"

namespace gantry::bench {

// A gateway of its own, in a directory of its own, that takes Silion readers r-1, r-2, … on loopback.
class Site {
public:
    // `more`: sections for its configuration.
    Site(std::string program, bool tag_read, const std::string& more = {});

    // Throws Failure, with the end of the gateway's log, when it does not get ready.
    void start();
    // Throws Failure when it does not end well.
    void stop();

    std::uint16_t port() const { return port_; }
    int pid() const { return gateway_->pid(); }
    std::filesystem::path store() const { return dir_.path() / "data" / "gantry.db"; }
    double ready_ms() const { return ready_ms_; }  // from the start of the process to its line "ready"

private:
    std::string log_end() const;

    std::string program_;
    TempDir dir_;
    std::unique_ptr<Child> gateway_;
    std::uint16_t port_ = 0;
    double ready_ms_ = 0;
};

}  // namespace gantry::bench
