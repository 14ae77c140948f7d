#pragma once
#include <unordered_map>

#include "protocols/harting/device_state.hpp"

// How a virtual reader reads by itself, in buffered read, notification and scan mode: antenna by antenna, a
// tag once in its valid time (CFG12), with the data that CFG11 asks for.
namespace gantry::harting {

class Reading {
public:
    explicit Reading(ReaderState& reader) : reader_(reader) {}

    // Something has changed that it depends on: the mode, the configuration, the trigger, the antennas.
    void refresh(Steady now);
    void forget();  // [0x33] and RF reset: all tags are new again
    // If a stay on an antenna is over by now: appends what is to be reported, and there may be more to do.
    bool step(Steady now, std::vector<TagRecord>& out);
    std::optional<Steady> deadline() const;

private:
    using Times = std::unordered_map<event::TagId, Steady, event::TagIdHash>;

    void hear(const AirSighting& sighting, std::uint16_t antenna);
    bool is_quiet(const AirSighting& sighting, std::uint16_t antenna);
    bool read_blocks(const AirAccess& access, TagRecord& record) const;
    std::optional<event::TagId> identity_of(const AirSighting& sighting, std::uint16_t antenna) const;
    void shrink(Times& times, Steady now) const;

    ReaderState& reader_;
    bool active_ = false;
    Steady slot_start_{};
    std::size_t turn_ = 0;
    std::vector<AirSighting> heard_;
    struct Found {
        event::TagId identity;
        TagRecord record;
    };
    std::vector<Found> cycle_;
    std::array<Times, antenna_count> reported_;  // with an antenna pool all in the first
    Times answered_;                             // Gen2 sessions S2 and S3: when the tag answered last
};

}  // namespace gantry::harting
