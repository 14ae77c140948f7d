#include "field/path.hpp"

#include <algorithm>

#include "field/hash.hpp"

namespace gantry::field {

namespace {

using std::chrono::nanoseconds;

// What a chance is for, so that chances of one tag are independent.
enum Purpose : std::uint64_t { mean = 1, away, visits_made, stay, antenna_of, first_away };

class Standing : public Path {
public:
    Standing(std::uint16_t antenna, double rssi_dbm) {
        visit_ = {antenna, Steady::min(), Steady::max(), 0, rssi_dbm};
    }
    void visits(Steady, Steady, std::vector<Visit>& out) override { out.push_back(visit_); }

private:
    Visit visit_;
};

nanoseconds between(std::chrono::milliseconds least, std::chrono::milliseconds most, std::uint64_t hash) {
    auto low = std::max(nanoseconds(least), nanoseconds{});
    auto span = std::max(nanoseconds(most) - low, nanoseconds{});
    return low + nanoseconds(static_cast<std::int64_t>(static_cast<double>(span.count()) * fraction(hash)));
}

// One pass after another: some antennas, then away. A pass is computed from its number alone; where it starts
// is found by going on, or back, from the pass that was looked at last.
class ComingAndGoing : public Path {
public:
    ComingAndGoing(const TrafficSpec& traffic, std::uint16_t antennas, std::uint64_t key, Steady start)
        : traffic_(traffic), antennas_(std::max<std::uint16_t>(antennas, 1)), key_(key) {
        traffic_.pool.clear();
        // Nothing may take no time at all, or the search for a pass would not end.
        traffic_.stay_min = std::max(traffic_.stay_min, std::chrono::milliseconds{1});
        start_ = start + between({}, traffic_.away_max, hash_of({key_, first_away}));
    }

    void visits(Steady from, Steady to, std::vector<Visit>& out) override {
        while (pass_ > 0 && start_ > from)
            start_ -= length(--pass_);
        for (auto next = length(pass_); start_ + next <= from; next = length(pass_)) {
            start_ += next;
            ++pass_;
        }
        auto pass_start = start_;
        for (auto pass = pass_; pass_start < to; pass_start += length(pass++))
            append(pass, pass_start, from, to, out);
    }

private:
    std::uint32_t visits_in(std::uint64_t pass) const {
        auto most = std::max<std::uint32_t>(traffic_.visits_max, 1);
        return 1 + static_cast<std::uint32_t>(hash_of({key_, visits_made, pass}) % most);
    }
    nanoseconds stay_on(std::uint64_t pass, std::uint32_t visit) const {
        return between(traffic_.stay_min, traffic_.stay_max, hash_of({key_, stay, pass, visit}));
    }
    nanoseconds length(std::uint64_t pass) const {
        auto sum = between(traffic_.away_min, traffic_.away_max, hash_of({key_, away, pass}));
        for (std::uint32_t visit = 0; visit < visits_in(pass); ++visit)
            sum += stay_on(pass, visit);
        return sum;
    }
    void append(std::uint64_t pass, Steady at, Steady from, Steady to, std::vector<Visit>& out) const {
        auto antenna = hash_of({key_, antenna_of, pass}) % antennas_;
        for (std::uint32_t visit = 0; visit < visits_in(pass); ++visit, antenna = (antenna + 1) % antennas_) {
            auto end = at + stay_on(pass, visit);
            auto number = static_cast<std::uint16_t>(antenna + 1);
            if (at < to && end > from)
                out.push_back({number, at, end, hash_of({pass, visit}), usual_rssi(key_, number)});
            at = end;
        }
    }

    TrafficSpec traffic_;
    std::uint16_t antennas_;
    std::uint64_t key_;
    std::uint64_t pass_ = 0;  // the pass looked at last, and its start
    Steady start_{};
};

}  // namespace

double usual_rssi(std::uint64_t key, std::uint16_t antenna) {
    return -65.0 + 20.0 * fraction(hash_of({key, mean, antenna}));
}

std::unique_ptr<Path> stand(std::uint16_t antenna, double rssi_dbm) {
    return std::make_unique<Standing>(antenna, rssi_dbm);
}

std::unique_ptr<Path> come_and_go(const TrafficSpec& traffic, std::uint16_t antennas, std::uint64_t key,
                                  Steady start) {
    return std::make_unique<ComingAndGoing>(traffic, antennas, key, start);
}

}  // namespace gantry::field
