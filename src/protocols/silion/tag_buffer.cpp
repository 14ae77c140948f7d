#include "protocols/silion/tag_buffer.hpp"

#include <algorithm>
#include <utility>

#include "wire/cursor.hpp"

namespace gantry::silion {

static constexpr std::uint8_t max_reads = 254;  // one byte; a new record begins before it can wrap

static std::int8_t dbm(std::int16_t tenths) {
    int rounded = (tenths + (tenths < 0 ? -5 : 5)) / 10;
    return static_cast<std::int8_t>(std::clamp(rounded, -128, 127));
}

static std::uint8_t protocol(event::Technology technology) {
    return technology == event::Technology::epc_gen2      ? 5
           : technology == event::Technology::iso18000_6b ? 3
                                                          : 0;
}

bool TagBuffer::add(std::uint8_t antenna, const AirSighting& sighting) {
    Key key{sighting.tag, antenna};
    auto open = open_.find(key);
    if (open != open_.end() && open->second >= first_) {
        auto& record = records_[open->second - first_];
        if (record.reads < max_reads) {
            ++record.reads;
            record.rssi = dbm(sighting.rssi);
            return false;
        }
    }
    if (std::exchange(no_place_, false)) {
        ++dropped_;
        return false;
    }
    if (records_.size() >= capacity_) {
        records_.pop_front();
        ++first_;
        ++dropped_;
        if (closed_ > 0) --closed_;
    }
    Record record;
    record.tag = sighting.tag;
    record.antenna = antenna;
    record.reads = 1;
    record.protocol = protocol(sighting.technology);
    record.rssi = dbm(sighting.rssi);
    records_.push_back(std::move(record));
    open_[key] = first_ + records_.size() - 1;
    return true;
}

void TagBuffer::set_bank(Bytes bank) {
    records_.back().bank = std::move(bank);
}

void TagBuffer::close_batch() {
    closed_ = records_.size();
    open_.clear();
}

static void write_record(wire::Writer& out, std::uint8_t antenna, std::uint8_t reads, std::int8_t rssi,
                         std::uint8_t protocol, const event::TagId& tag, ByteView bank) {
    out.u8(antenna);
    out.u8(reads);
    out.u8(static_cast<std::uint8_t>(rssi));
    out.u8(protocol);
    out.u8(tag.size);
    out.bytes(tag.view());
    out.u8(bank.size());
    out.bytes(bank);
}

TagBuffer::Segment TagBuffer::take(std::size_t max) {
    Segment segment;
    wire::Writer out(segment.data);
    auto count = out.hole(2);
    while (closed_ > 0) {
        auto& record = records_.front();
        // One record always goes, or it would block the rest for ever.
        if (segment.tags > 0 && out.written() + 6 + record.tag.size + record.bank.size() > max) break;
        write_record(out, record.antenna, record.reads, record.rssi, record.protocol, record.tag,
                     record.bank);
        ++segment.tags;
        segment.reads += record.reads;
        records_.pop_front();
        ++first_;
        --closed_;
    }
    out.patch_big_endian(count, segment.tags, 2);
    return segment;
}

void TagBuffer::overflow() {
    no_place_ = records_.empty();
    dropped_ += clear();
}

std::size_t TagBuffer::clear() {
    auto lost = records_.size();
    first_ += lost;
    records_.clear();
    open_.clear();
    closed_ = 0;
    return lost;
}

Bytes single_tag(std::uint8_t antenna, const AirSighting& sighting) {
    Bytes data;
    wire::Writer out(data);
    out.u16(1);
    write_record(out, antenna, 1, dbm(sighting.rssi), protocol(sighting.technology), sighting.tag, {});
    return data;
}

}  // namespace gantry::silion
