#pragma once
#include <string>
#include <string_view>
#include <vector>

#include "presence/presence.hpp"

namespace gantry::presence::testing {

inline constexpr Now start{Steady{} + 10h, Wall{} + std::chrono::years{56}};

inline event::TagId tag_of(std::string_view name) {
    return event::TagId(as_bytes(name));
}

// A transition as a line: "2s lost A Z reader_offline", "5s moved A Y from Z".
std::string to_line(const Transition& transition);

// A play of lines "0s see A in Z by r1", "0s see A in Z by r1 x3", "1s online r1", "2s offline r1",
// "9s end". Zones are Z and Y, with the rules of both given; readers r1, r2 and r3 are offline at first.
// Returns the transitions as lines, in order of their time. With `every_deadline` time_passed is called at
// each deadline, without it only at the end: both must tell the same story.
std::string play(const Rules& z, const Rules& y, std::string_view script, bool every_deadline);

// Plays both ways and compares with `expected`, one transition a line.
void expect_story(const Rules& rules, std::string_view script, std::string_view expected);
void expect_story(const Rules& z, const Rules& y, std::string_view script, std::string_view expected);

}  // namespace gantry::presence::testing
