#pragma once
#include <cstdint>
#include <optional>

#include "field/scenario.hpp"

namespace gantry::field {

// Times of a scene count from its start.
using SceneTime = std::chrono::nanoseconds;

// Where a tag is on its way.
struct Whereabouts {
    Vec offset;              // from its own place
    double gone = 0;         // metres it has come since it set out
    std::uint64_t pass = 0;  // how often it had gone all the way before
};

// How one tag of a group moves. Computed from the time alone.
class Motion {
public:
    // `number`: its place in the group; `chance`: from which its own pace comes.
    Motion(const MotionSpec& spec, std::uint32_t number, std::uint64_t chance);
    std::optional<Whereabouts> at(SceneTime time) const;  // nothing: it is not there

private:
    const MotionSpec* spec_;
    SceneTime starts_{}, lasts_{};
};

double length_of(const MotionSpec& motion);

}  // namespace gantry::field
