#pragma once
#include <limits>

#include "event/event.hpp"
#include "reader/bank.hpp"

namespace gantry {

// One tag record as a reader reported it: fixed size, no heap. A codec's walker emits these on the hot path.
struct Observation {
    static constexpr std::int16_t no_rssi = std::numeric_limits<std::int16_t>::min();
    static constexpr std::uint32_t no_xpc = std::numeric_limits<std::uint32_t>::max();

    event::TagId tag;
    event::Technology technology = event::Technology::unknown;
    std::uint16_t antenna = 0;    // as the make counts; Plugin::antenna_name gives the name; 0xFFFF: not said
    std::int16_t rssi = no_rssi;  // tenths of a dBm
    std::uint16_t reads = 1;      // reads behind this record, at least 1
    std::uint16_t data_size = 0;  // memory bank data that came with it...
    std::uint32_t data_offset = 0;    // ...in Report::data
    Bank data_bank = Bank::user;      // where they are from: user or tid
    std::uint8_t tid_size = 0;        // the first of them are the TID all the same
    std::uint16_t pc = 0;             // Gen2: the PC word; 0: not said
    std::uint32_t xpc = no_xpc;       // Gen2: XPC_W1 above XPC_W2; 0: the tag sends none; no_xpc: not said
    std::int64_t reader_time_us = 0;  // the reader's own clock, UTC microseconds since 1970; 0: not said

    static constexpr std::uint16_t no_antenna = 0xFFFF;
};
static_assert(sizeof(Observation) == 96);  // many of them are on their way at a time

}  // namespace gantry
