#include "reader/clock_watch.hpp"

#include <algorithm>
#include <utility>

namespace gantry {

static constexpr std::chrono::seconds seen_live{1};  // so long at the pace of our own clock

std::optional<std::chrono::microseconds> ClockWatch::look(std::int64_t time_us, Steady now) {
    using std::chrono::microseconds;
    Read read{microseconds(time_us) - std::chrono::duration_cast<microseconds>(now.time_since_epoch()),
              time_us, now};
    auto before = std::exchange(last_, read);
    if (before && time_us + microseconds(step).count() < before->time_us) {
        auto by = read.ahead - ahead_.value_or(before->ahead);
        first_ = read;
        if (ahead_) ahead_ = read.ahead;
        return by;
    }
    if (ahead_) {
        if (read.ahead <= *ahead_ + step) {
            ahead_ = std::max(*ahead_, read.ahead);  // clocks drift
            return {};
        }
        return read.ahead - std::exchange(*ahead_, read.ahead);
    }
    if (!first_ || std::chrono::abs(read.ahead - first_->ahead) > seen_live)
        first_ = read;
    else if (now - first_->at >= seen_live)
        ahead_ = read.ahead;
    return {};
}

std::optional<std::chrono::microseconds> ClockWatch::look(std::span<const Observation> reads, Now now) {
    std::chrono::microseconds by{};
    for (auto& each : reads)
        if (each.reader_time_us != 0) by += look(each.reader_time_us, now.steady).value_or(by.zero());
    auto whole = std::chrono::round<std::chrono::seconds>(by);
    // Of a reader that sends no date the day is guessed, and the guess may change.
    auto days = std::chrono::round<std::chrono::days>(whole);
    if (std::chrono::abs(whole - days) <= step) return {};
    return whole;
}

}  // namespace gantry
