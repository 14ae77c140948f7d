#pragma once
#include <memory>
#include <vector>

#include "field/field.hpp"

namespace gantry::field {

// A tag in front of one antenna for a while.
struct Visit {
    std::uint16_t antenna = 1;
    Steady from{}, to{};       // from min() to max(): it stands there
    std::uint64_t number = 0;  // tells the visits of one tag apart
    double rssi_dbm = -55;     // mean, in the middle of the visit
    bool stands() const { return from == Steady::min(); }
};

// Where a tag is and when. What moves tags in a new way is another Path.
class Path {
public:
    virtual ~Path() = default;
    // Appends the visits that overlap [from, to), in order.
    virtual void visits(Steady from, Steady to, std::vector<Visit>& out) = 0;
};

std::unique_ptr<Path> stand(std::uint16_t antenna, double rssi_dbm);
// `key`: the tag's own number, from which all of its chances come.
std::unique_ptr<Path> come_and_go(const TrafficSpec& traffic, std::uint16_t antennas, std::uint64_t key,
                                  Steady start);

// The mean strength at which this antenna hears this tag when nobody says: -45 to -65 dBm.
double usual_rssi(std::uint64_t key, std::uint16_t antenna);

}  // namespace gantry::field
