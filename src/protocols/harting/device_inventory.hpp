#pragma once
#include <deque>

#include "protocols/harting/device_state.hpp"

// [0xB0] 0x01 of a virtual reader: asks the tags antenna by antenna, and answers in pieces (section 6.1).
namespace gantry::harting {

class HostInventory {
public:
    struct Order {
        std::vector<std::uint16_t> antennas;
        bool tells_antennas = false;
    };
    void begin(Order order) {
        order_ = std::move(order);
        left_.clear();
    }
    std::chrono::microseconds takes(const ReaderState& reader) const {
        return reader.round * std::max<std::size_t>(1, order_.antennas.size());
    }
    // The time is over: what it has found.
    Status finish(ReaderState& reader, Steady now, Bytes& data);
    // MORE: what did not fit into the last reply.
    Status more(ReaderState& reader, Bytes& data);
    void forget() { left_.clear(); }

private:
    Status give(ReaderState& reader, Bytes& data);

    Order order_;
    std::deque<TagRecord> left_;
    bool warned_ = false;
};

// The tags that a command of the host reaches now, with the antenna that hears each best; strongest first.
struct Present {
    std::uint16_t antenna = 1;
    AirSighting sighting;
};
std::vector<Present> present_tags(const ReaderState& reader, Steady now);

}  // namespace gantry::harting
