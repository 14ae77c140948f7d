#pragma once
#include <optional>

#include "base/time.hpp"

namespace gantry::gateway {

// The wall clock as the age of what is stored is judged by: a clock that is set ahead by mistake, or comes up
// wrong, must not empty the store. It goes on with the steady clock; what the wall clock is ahead of that
// counts when it has been so for a day. Going back counts at once: it deletes nothing.
class SettledClock {
public:
    static constexpr std::chrono::hours doubt{24};
    static constexpr std::chrono::seconds drift{60};  // less is a clock that is being trimmed

    // `last_commit`: the newest time in the store; the epoch where there is none.
    SettledClock(Wall last_commit, Now now);
    Wall look(Now now);

private:
    using Difference = std::chrono::microseconds;
    static Difference difference(Now now);

    Difference believed_;  // wall clock less steady clock
    std::optional<Steady> doubted_since_;
};

}  // namespace gantry::gateway
