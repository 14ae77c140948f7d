#include "field/radio.hpp"

#include <algorithm>
#include <cmath>

#include "field/hash.hpp"

namespace gantry::field {

using std::chrono::nanoseconds;

static constexpr double fading_db = 1.5;     // either way, from read to read
static constexpr double edge_loss_db = 9.0;  // at the ends of a visit against its middle

// The power that a visit's strength is said for, and what a tag needs.
static constexpr double usual_power_dbm = 27.0;
static constexpr double answer_dbm = -75.0, write_dbm = -72.0;

Radio::Radio(double reads_per_second_per_tag)
    : period_(static_cast<std::int64_t>(1e9 / std::clamp(reads_per_second_per_tag, 0.001, 100'000.0))) {}

static std::int64_t floor_div(std::int64_t a, std::int64_t b) {
    return a / b - (a % b < 0 ? 1 : 0);
}

static double mean_strength(const Visit& visit, double power_dbm) {
    return visit.rssi_dbm + (power_dbm - usual_power_dbm);
}
bool Radio::answers(const Visit& visit, double power_dbm) {
    return power_dbm >= usual_power_dbm || mean_strength(visit, power_dbm) >= answer_dbm;
}
bool Radio::can_write(const Visit& visit, double power_dbm) {
    return mean_strength(visit, power_dbm) >= write_dbm;
}

static std::int16_t strength(const Visit& visit, double power_dbm, Steady at, std::uint64_t chance) {
    auto dbm = mean_strength(visit, power_dbm) + fading_db * (2 * fraction(chance) - 1);
    if (!visit.stands()) {
        auto middle = std::chrono::duration<double>(visit.to - visit.from) / 2;
        auto off = std::chrono::duration<double>(at - visit.from) - middle;
        auto part = off / middle;
        dbm -= edge_loss_db * part * part;
    }
    return static_cast<std::int16_t>(std::lround(std::clamp(dbm, -120.0, 20.0) * 10));
}

void Radio::hear(const Visit& visit, double power_dbm, std::uint64_t key, const event::TagId& id,
                 event::Technology technology, Steady from, Steady to, std::vector<AirSighting>& out) const {
    if (!answers(visit, power_dbm)) return;
    // Periods count from the start of the visit; of a tag that stands there, from the clock's own zero.
    auto zero = visit.stands() ? Steady{} : visit.from;
    from = std::max(from, visit.from);
    to = std::min(to, visit.to);
    if (from >= to) return;
    auto first = floor_div((from - zero).count(), period_.count());
    auto last = floor_div((to - zero).count(), period_.count());
    for (auto n = first; n <= last; ++n) {
        auto chance = hash_of({key, visit.number, visit.antenna, static_cast<std::uint64_t>(n)});
        auto within = static_cast<std::int64_t>(static_cast<double>(period_.count()) * fraction(chance));
        auto at = zero + n * period_ + nanoseconds(within);
        if (at < from || at >= to) continue;
        out.push_back({id, technology, strength(visit, power_dbm, at, mix(chance)), at});
    }
}

}  // namespace gantry::field
