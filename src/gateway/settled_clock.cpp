#include "gateway/settled_clock.hpp"

#include <algorithm>

namespace gantry::gateway {

SettledClock::SettledClock(Wall last_commit, Now now) : believed_(difference(now)) {
    if (last_commit != Wall{}) believed_ = std::min(believed_, difference({now.steady, last_commit}));
}

SettledClock::Difference SettledClock::difference(Now now) {
    return now.wall.time_since_epoch() - std::chrono::floor<Difference>(now.steady.time_since_epoch());
}

Wall SettledClock::look(Now now) {
    auto ahead = difference(now);
    bool settled = ahead <= believed_ + drift;
    if (!settled && !doubted_since_) doubted_since_ = now.steady;
    if (settled || now.steady - *doubted_since_ >= doubt) {
        believed_ = ahead;
        doubted_since_.reset();
    }
    return Wall{std::chrono::floor<Difference>(now.steady.time_since_epoch()) + believed_};
}

}  // namespace gantry::gateway
