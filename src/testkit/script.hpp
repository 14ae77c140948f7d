#pragma once
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "reader/party.hpp"

namespace gantry::testkit {

// A dialog with one party on virtual time, as data: bytes as a manual prints them, one step a line. Because
// it is data it can be played again with silence, and again with garbage, in place of each thing the peer
// says.
struct Step {
    enum class Kind { sends, gets, waits, does } kind;
    std::string hex = {};
    std::chrono::microseconds time{};
    std::function<void(Party&, Now)> action = {};
};
Step sends(std::string_view hex);                    // the party must have said exactly this
Step gets(std::string_view hex);                     // the peer says this
Step waits(std::chrono::microseconds time);          // deadlines on the way are kept
Step does(std::function<void(Party&, Now)> action);  // anything else: a commit, a job, a look inside
using Script = std::vector<Step>;

inline constexpr Now script_start{Steady{} + std::chrono::hours{1}, Wall{} + std::chrono::years{56}};

// Plays the script from the start and returns the time reached. Differences are test failures.
Now play(Party& party, std::span<const Step> script);

// Time goes on and nothing arrives: true when the party finishes within 1,000 deadlines.
bool ends_in_silence(Party& party, Now now);

// Plays the script once per `gets` with silence, and once with garbage, in its place; neither may crash, hang
// (a deadline that does not move on) or grow the output without end.
void survives_every_reply_missing(const std::function<std::unique_ptr<Party>()>& make, const Script& script);

}  // namespace gantry::testkit
