#include <algorithm>

#include "link/link.hpp"

namespace gantry::link {

std::chrono::milliseconds Backoff::next() {
    auto wait = first_;
    for (unsigned i = 0; i < tries_ && wait < most_; ++i)
        wait *= 2;
    wait = std::min(wait, most_);
    if (wait < most_) ++tries_;

    // splitmix64: many readers that lost their power together must not come back in step.
    state_ += 0x9E3779B97F4A7C15ULL;
    auto mixed = state_;
    mixed = (mixed ^ (mixed >> 30)) * 0xBF58476D1CE4E5B9ULL;
    mixed = (mixed ^ (mixed >> 27)) * 0x94D049BB133111EBULL;
    mixed ^= mixed >> 31;
    auto quarter = wait.count() / 4;
    auto jitter = static_cast<std::int64_t>(mixed % static_cast<std::uint64_t>(2 * quarter + 1)) - quarter;
    return wait + std::chrono::milliseconds(jitter);
}

}  // namespace gantry::link
