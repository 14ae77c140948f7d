#pragma once
#include <cstdint>
#include <string>

#include "base/time.hpp"

namespace gantry::journal {

// An event that a sink's destination will not take, with the reason: kept beside the events, and longer than
// they are, so that it can be offered again.
struct DeadLetter {
    std::string sink;
    std::uint64_t seq = 0;  // of the event; a sink has one dead letter of it at most
    Wall time{};            // when it was refused last
    std::uint64_t tries = 1;
    std::string reason;  // the destination's words: hostile
    std::string event;   // as JSON, native shape
};

// Of all sinks. Beyond this number the oldest go, and Retained says how many.
inline constexpr std::uint64_t max_dead_letters = 100'000;

}  // namespace gantry::journal
