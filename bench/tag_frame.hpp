#pragma once
#include <cstdint>

#include "base/bytes.hpp"
#include "event/event.hpp"

// The frames that every benchmark uses: Silion tag uploads with EPC-96 tags, CRC and the wish for an
// acknowledgement (silion.md sections 2 and 5).
namespace gantry::bench {

// An SGTIN-96 of its own for every number.
event::TagId tag_of(std::uint32_t number);

struct TagFrame {
    std::uint32_t first_tag = 0;  // records carry this tag and those after it
    std::uint16_t records = 20;
    std::int8_t rssi = -50;  // dBm, of all records
    bool crc = true;
};
Bytes tag_frame(std::string_view reader, const TagFrame& what);
// Gives all records of a frame made by tag_frame another signal strength and computes its CRC anew.
void set_rssi(Bytes& frame, std::string_view reader, std::int8_t rssi);

Bytes heartbeat_frame(std::string_view reader, std::uint32_t count);
// What a host answers to a frame of tag_frame with a CRC.
Bytes acknowledgement();

}  // namespace gantry::bench
