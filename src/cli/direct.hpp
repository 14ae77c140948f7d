#pragma once
#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "gateway/config.hpp"
#include "reader/driver.hpp"

namespace gantry::cli {

// One reader without a gateway: a link of our own, with the driver of its make. Nothing is stored, so reads
// that the reader would delete once they are acknowledged are never acknowledged.
class DirectReader {
public:
    struct Options {
        gateway::Address address;
        Settings settings;     // the make's own
        std::string name;      // a reader that dials in must be called so; empty: the first is taken
        std::string model;     // empty: what the reader says
        bool reading = false;  // does it read tags meanwhile?
        // Asked now and then while open() and run() wait; true ends the wait, and takes the job back.
        std::function<bool()> interrupted = {};
    };
    struct Status {
        bool connected = false;
        std::string ended;  // why it is not, if it was
        std::string name, peer;
        std::optional<Described> described;
        Counters counters{};
        std::uint64_t reads = 0;  // tag reads reported
        bool stalled = false;
        // A serial line is there without anybody at its other end: false until a message has come over it.
        bool answered = false;
    };
    static constexpr std::string_view nobody_answers =
        "nobody answers on the line: is the reader on, and are cable and baud rate right?";

    // Waits for the link, and for a reader that dials in for its name.
    static Result<std::unique_ptr<DirectReader>> open(Options options, std::chrono::milliseconds timeout);
    virtual ~DirectReader() = default;

    // Waits until the job has ended. `timed_out` when the reader was not heard of by then.
    virtual JobResult run(const Job& job, std::chrono::milliseconds timeout) = 0;
    // Waits until the reader has said who it is, or the link has ended.
    virtual Status wait_described(std::chrono::milliseconds timeout) = 0;
    virtual Status status() = 0;
    virtual const gateway::Address& address() const = 0;
};

}  // namespace gantry::cli
