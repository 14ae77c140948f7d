#pragma once
#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace gantry {

using namespace std::chrono_literals;
using Steady = std::chrono::steady_clock::time_point;           // for timers and order
using Wall = std::chrono::sys_time<std::chrono::microseconds>;  // for people; UTC

// The two clocks as read together. Below `link` no code reads a clock: time is an argument.
struct Now {
    Steady steady{};
    Wall wall{};
};

inline Now operator+(Now now, std::chrono::microseconds d) {
    return {now.steady + d, now.wall + d};
}

// RFC 3339, UTC, microseconds: 2026-11-21T23:04:00.123456Z. Years 0000 to 9999; others are clamped.
inline constexpr std::size_t rfc3339_size = 27;
char* write_rfc3339(Wall time, char* out);  // writes exactly rfc3339_size characters, returns one past them
std::string to_rfc3339(Wall time);

// Accepts Z or a numeric offset and 0 to 9 digits of fraction (cut to microseconds).
std::optional<Wall> parse_rfc3339(std::string_view text);

// "250us", "500ms", "2s", "5min" or "5m", "1h", "30d", and decimals such as "1.5s". Nothing when it is none
// of these.
std::optional<std::chrono::microseconds> parse_duration(std::string_view text);
// The shortest exact form: "2s", "1500ms", "1h".
std::string to_text(std::chrono::microseconds duration);
// For people, one or two units: "4 min", "2 h 10 min", "0.3 s".
std::string approximate(std::chrono::microseconds duration);

inline std::int64_t to_us(Wall time) {
    return time.time_since_epoch().count();
}
inline Wall from_us(std::int64_t us) {
    return Wall{std::chrono::microseconds{us}};
}

}  // namespace gantry
