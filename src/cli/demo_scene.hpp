#pragma once
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "field/field.hpp"
#include "gateway/gateway.hpp"
#include "journal/journal.hpp"
#include "link/device_host.hpp"

namespace gantry::cli {

// What the demo did, counted on both sides.
struct DemoBooks {
    struct Reads {
        std::uint64_t sent = 0, stored = 0;
        std::optional<std::uint64_t> acknowledged = {};  // nothing: the protocol has no acknowledgement
    };
    std::size_t readers = 0;
    std::map<std::string, Reads> makes;
    std::uint64_t lost = 0;  // reads acknowledged, and not stored for that reader
    std::chrono::microseconds lasted{};
    std::map<std::string, std::uint64_t> events;  // of this run, by type
};

// What the state of a virtual reader says it sent. One whose tag records count several reads counts both; for
// the others a tag is a read.
std::uint64_t reads_sent(const wire::Fields& state);

// The gateway and the virtual readers of the demo, in one process, joined by TCP on loopback.
class DemoScene {
public:
    static Result<std::unique_ptr<DemoScene>> start(const std::filesystem::path& directory);
    ~DemoScene();

    gateway::Gateway& gateway() { return *gateway_; }
    std::size_t size() const { return readers_.size(); }
    // Events before this one are of an earlier run in the same directory.
    journal::Seq begins_after() const { return begins_after_; }
    const std::filesystem::path& directory() const { return gateway_->config().data_dir; }
    // Pulls a cable now and then; what just happened, for people, or nothing.
    std::string tell_story();
    // Switches the readers off, stops the gateway and counts.
    DemoBooks end();

private:
    struct DemoReader {
        std::string name, make;
        std::string place;   // where the gateway finds it: its address, or its line
        bool dials = false;  // else the gateway dials it
        std::unique_ptr<link::DeviceHost> host;
    };
    DemoScene() = default;
    // Those that listen come first, for the gateway's configuration says where; the others need the gateway.
    Result<void> add_readers(bool dials, const std::filesystem::path& directory);
    std::string configuration() const;

    field::Field field_;
    std::unique_ptr<gateway::Gateway> gateway_;
    std::unique_ptr<link::Loop> loop_;
    std::vector<DemoReader> readers_;
    Now started_{};
    journal::Seq begins_after_ = 0;
    Steady next_chapter_{};
    std::size_t chapter_ = 0;
};

}  // namespace gantry::cli
