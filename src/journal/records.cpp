#include "journal/records.hpp"

#include <algorithm>

namespace gantry::journal {

namespace {
using Layout = RecordLayout;

constexpr std::int64_t last_time_us = 253'402'300'799'999'999;  // the end of the year 9999

constexpr std::uint64_t limit(Layout::Place place) {
    return std::uint64_t{1} << (8 * place.size);
}

void put(Bytes& out, Layout::Place place, std::uint64_t value) {
    for (std::size_t i = place.size; i-- > 0;)
        out.push_back(static_cast<std::uint8_t>(value >> (8 * i)));
}

std::uint64_t get(ByteView record, Layout::Place place) {
    std::uint64_t value = 0;
    for (std::size_t i = 0; i < place.size; ++i)
        value = value << 8 | record[place.at + i];
    return value;
}
}  // namespace

std::int64_t storable_us(Wall time) {
    return std::clamp<std::int64_t>(to_us(time), 0, last_time_us);
}

bool fits_record(const Read& read) {
    auto reader_time = read.observation.reader_time_us;
    return read.read_point < limit(Layout::read_point) && reader_time >= 0 &&
           static_cast<std::uint64_t>(reader_time) < limit(Layout::reader_time);
}

std::size_t plan_batch(std::span<const Read> reads, BatchHead& head) {
    head.first_seq = reads.front().seq;
    auto low = storable_us(reads.front().time), high = low;
    std::size_t count = 0;
    for (auto& read : reads.first(std::min(reads.size(), max_records))) {
        auto time = storable_us(read.time);
        auto new_low = std::min(low, time), new_high = std::max(high, time);
        if (!fits_record(read) || static_cast<std::uint64_t>(new_high - new_low) >= limit(Layout::time) ||
            read.seq - head.first_seq >= limit(Layout::seq))
            break;
        low = new_low;
        high = new_high;
        head.last_seq = read.seq;
        ++count;
    }
    head.time_us = low;
    head.last_time_us = high;
    head.count = static_cast<std::uint32_t>(count);
    return count;
}

void pack(const Read& read, std::uint32_t tag_offset, const BatchHead& head, Bytes& out) {
    auto& o = read.observation;
    put(out, Layout::seq, read.seq - head.first_seq);
    put(out, Layout::time, static_cast<std::uint64_t>(storable_us(read.time) - head.time_us));
    put(out, Layout::read_point, read.read_point);
    put(out, Layout::tag, tag_offset);
    put(out, Layout::flags, read.possible_repeat ? 1 : 0);
    // Observation::no_rssi is the lowest number, which is 0 here.
    put(out, Layout::rssi, static_cast<std::uint64_t>(o.rssi + 32768));
    put(out, Layout::reads, o.reads);
    put(out, Layout::reader_time, static_cast<std::uint64_t>(o.reader_time_us));
}

Record unpack(ByteView record, const BatchHead& head) {
    Record out;
    out.seq = head.first_seq + get(record, Layout::seq);
    out.time_us = head.time_us + static_cast<std::int64_t>(get(record, Layout::time));
    out.read_point = static_cast<ReadPointId>(get(record, Layout::read_point));
    out.tag = head.first_tag + get(record, Layout::tag);
    out.possible_repeat = (get(record, Layout::flags) & 1) != 0;
    if (auto rssi = get(record, Layout::rssi); rssi != 0)
        out.rssi = static_cast<std::int16_t>(static_cast<std::int32_t>(rssi) - 32768);
    out.reads = static_cast<std::uint16_t>(get(record, Layout::reads));
    out.reader_time_us = static_cast<std::int64_t>(get(record, Layout::reader_time));
    return out;
}

std::uint32_t checksum(const BatchHead& head, ByteView records) {
    return Checksum{}
        .add(head.first_seq)
        .add(head.last_seq)
        .add(head.time_us)
        .add(head.last_time_us)
        .add(head.first_tag)
        .add(std::uint64_t{head.count})
        .add(records)
        .value();
}

}  // namespace gantry::journal
