#pragma once
#include "field/path.hpp"

namespace gantry::field {

// How an antenna hears a tag that is in front of it. Tags do not disturb one another yet: a model of
// collisions would take all visits of a round at once.
class Radio {
public:
    explicit Radio(double reads_per_second_per_tag);
    // Appends what is heard of one visit in [from, to): once in each period of the tag, at a time within the
    // period that differs from one to the next. `key` is the tag's. Power changes only how strong that is,
    // and whether it is heard at all.
    void hear(const Visit& visit, double power_dbm, std::uint64_t key, const event::TagId& id,
              event::Technology technology, Steady from, Steady to, std::vector<AirSighting>& out) const;

    // The rule at PlacedTag::rssi_dbm.
    static bool answers(const Visit& visit, double power_dbm);
    static bool can_write(const Visit& visit, double power_dbm);

private:
    std::chrono::nanoseconds period_;
};

}  // namespace gantry::field
