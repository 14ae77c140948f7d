#pragma once
#include <array>
#include <optional>

#include "protocols/harting/device_config.hpp"

// The digital lines of a virtual reader: outputs 1 and 2 and relay 1, and the inputs as a trigger.
namespace gantry::harting {

// An output state as [0x72] and CFG2 code it.
enum class OutputMode : std::uint8_t { unchanged = 0, on = 1, off = 2, flash = 3 };

class Outputs {
public:
    void restart() { lines_ = {}; }
    // `time` zero or 0xFFFF x 100 ms: until told otherwise (no source says which of the two it is).
    void set(std::size_t line, OutputMode mode, std::uint8_t frequency, std::uint16_t time, Steady now);
    // An antenna has read a tag: CFG9 says which outputs that drives, CFG2 how and for how long.
    void on_read(std::uint16_t antenna, const Setup& setup, Steady now);

    void time_passed(Steady now);  // lines whose time is over are idle again
    std::optional<Steady> deadline() const;

    bool level(std::size_t line, const Setup& setup, Steady now) const;  // flashing: as it is just now
    OutputMode mode(std::size_t line, const Setup& setup, Steady now) const;

private:
    struct Line {
        OutputMode mode = OutputMode::unchanged;
        std::uint8_t frequency = 0;  // 8, 4, 2, 1 Hz
        std::optional<Steady> until = {};
    };
    std::array<Line, output_count> lines_{};
};

// CFG10: reading depends on input 1.
class Trigger {
public:
    struct Change {
        bool begun = false, timed_out = false;
    };
    void restart(const Setup& setup, bool input_1, Steady now);
    Change input_changed(const Setup& setup, bool input_1, Steady now);
    Change time_passed(const Setup& setup, Steady now);
    std::optional<Steady> deadline(const Setup& setup) const {
        return setup.triggered && on_ ? ends_at_ : std::nullopt;
    }
    bool reads(const Setup& setup) const { return !setup.triggered || on_; }
    // STATUS of an input event in a record: bit 0 reading is on, bit 1 the hold time is over.
    std::uint8_t status(const Setup& setup) const {
        return static_cast<std::uint8_t>((reads(setup) ? 1u : 0u) | (timed_out_ ? 2u : 0u));
    }

private:
    bool on_ = false, timed_out_ = false;
    std::optional<Steady> ends_at_;
};

}  // namespace gantry::harting
