#pragma once
#include <optional>
#include <span>

#include "base/time.hpp"
#include "reader/observation.hpp"

namespace gantry {

// Notices that a reader's clock was set, by the times that come with its reads. Those that lay in its memory
// for a while look as if it had gone back, and what follows them as if it had gone forward: so it counts only
// what is ahead of all that came before it, once reads have come as they happen, or is before its
// predecessor.
class ClockWatch {
public:
    static constexpr std::chrono::seconds step{5};  // a smaller one is none

    // In the order in which the reader sent them; times of 0 are none. By how much the clock was set, in
    // whole seconds; never by whole days.
    std::optional<std::chrono::microseconds> look(std::span<const Observation> reads, Now now);

private:
    std::optional<std::chrono::microseconds> look(std::int64_t time_us, Steady now);

    struct Read {
        std::chrono::microseconds ahead;  // the reader's time less ours, which begins anywhere
        std::int64_t time_us;
        Steady at;
    };
    std::optional<Read> first_, last_;                // first_: from which on they may come as they happen
    std::optional<std::chrono::microseconds> ahead_;  // of reads that came as they happened, at its most
};

}  // namespace gantry
