#include "protocols/harting/device_clock.hpp"

#include "wire/cursor.hpp"

namespace gantry::harting {

using std::chrono::days;

// 2000-01-01: what it begins with is not published.
static constexpr Wall epoch{std::chrono::sys_days{std::chrono::year{2000} / 1 / 1}};

void ReaderClock::start(Now now, bool true_time) {
    base_ = now.steady;
    base_time_ = true_time ? now.wall : epoch;
    timezone_ = 0;
}

Wall ReaderClock::time_at(Steady at) const {
    return base_time_ + std::chrono::duration_cast<std::chrono::microseconds>(at - base_);
}

static std::optional<std::chrono::milliseconds> time_of_day(ByteView timer) {
    wire::Reader in(timer);
    auto hour = in.u8("hour"), minute = in.u8("minute");
    auto milliseconds = in.u16("milliseconds");
    if (hour > 23 || minute > 59 || milliseconds > 59'999) return {};
    return std::chrono::hours{hour} + std::chrono::minutes{minute} + std::chrono::milliseconds{milliseconds};
}

bool ReaderClock::set_timer(ByteView timer, Steady now) {
    auto time = time_of_day(timer);
    if (!time) return false;
    base_time_ = std::chrono::floor<days>(time_at(now)) + *time;
    base_ = now;
    return true;
}

bool ReaderClock::set_date_and_timer(ByteView date, ByteView timer, Steady now) {
    auto time = time_of_day(timer);
    if (!time || date[0] > 99 || date[1] > 99) return false;
    std::chrono::year_month_day day{std::chrono::year{date[0] * 100 + date[1]}, std::chrono::month{date[2]},
                                    std::chrono::day{date[3]}};
    if (!day.ok()) return false;
    base_time_ = std::chrono::sys_days{day} + *time;
    base_ = now;
    timezone_ = date[4];
    return true;
}

void ReaderClock::append_timer(Steady now, Bytes& out) const {
    auto time = time_at(now);
    auto passed = time - std::chrono::floor<days>(time);
    auto minutes = std::chrono::floor<std::chrono::minutes>(passed);
    wire::Writer writer(out);
    writer.u8(static_cast<std::uint64_t>(minutes.count() / 60));
    writer.u8(static_cast<std::uint64_t>(minutes.count() % 60));
    writer.u16(
        static_cast<std::uint64_t>(std::chrono::floor<std::chrono::milliseconds>(passed - minutes).count()));
}

void ReaderClock::append_date(Steady now, Bytes& out) const {
    std::chrono::year_month_day day{std::chrono::floor<days>(time_at(now))};
    auto year = static_cast<unsigned>(static_cast<int>(day.year()));
    wire::Writer writer(out);
    writer.u8(year / 100);
    writer.u8(year % 100);
    writer.u8(static_cast<unsigned>(day.month()));
    writer.u8(static_cast<unsigned>(day.day()));
    writer.u8(timezone_);
}

}  // namespace gantry::harting
