#pragma once
#include "protocols/harting/device_state.hpp"

// What a virtual reader tells about itself: the records of [0x66] and [0x6E] (sections 4 and 5).
namespace gantry::harting {

struct InfoRow {
    std::uint8_t mode;
    void (*append)(const ReaderState& reader, Bytes& out);
};
std::span<const InfoRow> info_rows();
std::span<const InfoRow> diagnostic_rows();

// The data of the two forms of a keepalive message.
Bytes keepalive_flags(const ReaderState& reader);
Bytes keepalive_records(const ReaderState& reader);

}  // namespace gantry::harting
