#pragma once
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "base/error.hpp"
#include "link/device_host.hpp"
#include "passing_air.hpp"

namespace gantry::ledger {

// How many readers of each kind, and how they work. Readers count from 1 over all kinds, in this order.
struct FleetOptions {
    std::uint32_t silion = 0;        // dial, ask for acknowledgement
    std::uint32_t silion_plain = 0;  // dial, do not
    std::uint32_t harting = 0;       // listen; acknowledge by clearing the buffer or a notification
    std::uint32_t caen = 0;          // listen
    std::uint32_t dagprog = 0;       // a pseudo-terminal each
    std::string connect;             // HOST:PORT that the silion readers dial
    std::string pty_dir;             // where the pseudo-terminals are linked
    double rate = 100;               // reads a second of each reader, of a dagprog unit `dagprog_rate`
    double dagprog_rate = 2;         // tags that come sooner after each other disturb each other
    std::uint64_t count = 0;         // reads of each reader; 0: until told to stop
};

// What a reader knows of its reads. Those of readers that are acknowledged come in the order of their
// numbers, so 1 to `acknowledged` are.
struct Figures {
    std::uint32_t reader = 0;
    std::string make, name, place;  // where it listens; empty: it dials
    bool acknowledges = false;      // reads wait in it until the host has acknowledged them
    bool connected = false;
    std::uint64_t generated = 0;
    std::uint64_t acknowledged = 0;
    std::uint64_t sent = 0;
    std::uint64_t dropped = 0;  // its own memory was full, or was emptied by somebody
    std::uint64_t connects = 0;
};
std::string to_json(const std::vector<Figures>& all);

class Fleet {
public:
    static Result<std::unique_ptr<Fleet>> make(const FleetOptions& options);

    std::vector<Figures> figures();
    void set_rate(double reads_per_second);  // not of the dagprog units
    void begin();                            // until then nothing is read
    void stop();                             // no more reads pass
    // After stop(): everything that waited for an acknowledgement has it.
    bool drained();

private:
    struct Member {
        Figures fixed;
        std::unique_ptr<PassingAir> air;
        std::unique_ptr<link::DeviceHost> host;
    };
    struct Kind;

    explicit Fleet(const FleetOptions& options) : options_(options), loop_("fleet") {}
    Result<void> add(const Kind& kind);

    const FleetOptions options_;
    link::Loop loop_;
    std::vector<Member> members_;
};

}  // namespace gantry::ledger
