#include "base/time.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>

#include <fmt/format.h>

namespace gantry {

using namespace std::chrono;

static char* write_digits(char* out, unsigned value, int digits) {
    for (int i = digits - 1; i >= 0; --i) {
        out[i] = static_cast<char>('0' + value % 10);
        value /= 10;
    }
    return out + digits;
}

char* write_rfc3339(Wall time, char* out) {
    static constexpr Wall first = sys_days{year{0} / 1 / 1};
    static constexpr Wall last = sys_days{year{9999} / 12 / 31} + days{1} - microseconds{1};
    time = std::clamp(time, first, last);
    auto day = floor<days>(time);
    year_month_day date{day};
    auto since_midnight = static_cast<std::uint64_t>((time - day).count());
    auto seconds = static_cast<unsigned>(since_midnight / 1'000'000);
    out = write_digits(out, static_cast<unsigned>(static_cast<int>(date.year())), 4);
    *out++ = '-';
    out = write_digits(out, static_cast<unsigned>(date.month()), 2);
    *out++ = '-';
    out = write_digits(out, static_cast<unsigned>(date.day()), 2);
    *out++ = 'T';
    out = write_digits(out, seconds / 3600, 2);
    *out++ = ':';
    out = write_digits(out, seconds / 60 % 60, 2);
    *out++ = ':';
    out = write_digits(out, seconds % 60, 2);
    *out++ = '.';
    out = write_digits(out, static_cast<unsigned>(since_midnight % 1'000'000), 6);
    *out++ = 'Z';
    return out;
}

std::string to_rfc3339(Wall time) {
    std::string out(rfc3339_size, '\0');
    write_rfc3339(time, out.data());
    return out;
}

// Reads exactly `digits` decimal digits at the front of `text` and removes them; -1 when they are not there.
static int take_digits(std::string_view& text, std::size_t digits) {
    if (text.size() < digits) return -1;
    int value = 0;
    for (char c : text.substr(0, digits)) {
        if (c < '0' || c > '9') return -1;
        value = value * 10 + (c - '0');
    }
    text.remove_prefix(digits);
    return value;
}

static bool take(std::string_view& text, std::string_view any_of) {
    if (text.empty() || any_of.find(text.front()) == std::string_view::npos) return false;
    text.remove_prefix(1);
    return true;
}

std::optional<Wall> parse_rfc3339(std::string_view text) {
    int y = take_digits(text, 4);
    if (y < 0 || !take(text, "-")) return {};
    int mo = take_digits(text, 2);
    if (mo < 0 || !take(text, "-")) return {};
    int d = take_digits(text, 2);
    if (d < 0 || !take(text, "Tt ")) return {};
    int h = take_digits(text, 2);
    if (h < 0 || !take(text, ":")) return {};
    int mi = take_digits(text, 2);
    if (mi < 0 || !take(text, ":")) return {};
    int s = take_digits(text, 2);
    year_month_day date{year{y}, month{static_cast<unsigned>(mo)},
                        day{static_cast<unsigned>(std::max(d, 0))}};
    if (s < 0 || !date.ok() || h > 23 || mi > 59 || s > 60) return {};
    std::int64_t us = 0;
    if (take(text, ".")) {
        std::int64_t unit = 100'000;
        if (text.empty() || text.front() < '0' || text.front() > '9') return {};
        while (!text.empty() && text.front() >= '0' && text.front() <= '9') {
            us += (text.front() - '0') * unit;
            unit /= 10;
            text.remove_prefix(1);
        }
    }
    minutes offset{0};
    if (!take(text, "Zz")) {
        bool negative = !text.empty() && text.front() == '-';
        if (!take(text, "+-")) return {};
        int oh = take_digits(text, 2);
        if (oh < 0 || !take(text, ":")) return {};
        int om = take_digits(text, 2);
        if (om < 0 || oh > 23 || om > 59) return {};
        offset = minutes{oh * 60 + om} * (negative ? -1 : 1);
    }
    if (!text.empty()) return {};
    return Wall{sys_days{date}} + hours{h} + minutes{mi} + seconds{s} + microseconds{us} - offset;
}

namespace {
struct Unit {
    std::string_view name;
    std::int64_t us;
};
constexpr std::array units = {Unit{"d", 86'400'000'000},
                              Unit{"h", 3'600'000'000},
                              Unit{"min", 60'000'000},
                              Unit{"m", 60'000'000},
                              Unit{"s", 1'000'000},
                              Unit{"ms", 1'000},
                              Unit{"us", 1}};
}  // namespace

std::optional<microseconds> parse_duration(std::string_view text) {
    double number = 0;
    auto [end, error] =
        std::from_chars(text.data(), text.data() + text.size(), number, std::chars_format::fixed);
    if (error != std::errc{} || !(number >= 0)) return {};
    std::string_view name(end, static_cast<std::size_t>(text.data() + text.size() - end));
    for (auto& unit : units) {
        if (name != unit.name) continue;
        double us = number * static_cast<double>(unit.us);
        if (us > 3.2e15) return {};  // a hundred years is a slip, not a setting
        return microseconds{std::llround(us)};
    }
    return {};
}

std::string to_text(microseconds duration) {
    if (duration.count() == 0) return "0s";
    for (auto& unit : units)
        if (unit.name != "m" && duration.count() % unit.us == 0)
            return fmt::format("{}{}", duration.count() / unit.us, unit.name);
    return fmt::format("{}us", duration.count());
}

std::string approximate(microseconds duration) {
    auto us = std::max<std::int64_t>(duration.count(), 0);
    if (us < 10'000'000) return fmt::format("{:.1f} s", static_cast<double>(us) / 1e6);
    auto s = us / 1'000'000;
    if (s < 120) return fmt::format("{} s", s);
    if (s < 7200) return fmt::format("{} min", s / 60);
    if (s < 172'800) return fmt::format("{} h {} min", s / 3600, s / 60 % 60);
    return fmt::format("{} d", s / 86'400);
}

}  // namespace gantry
