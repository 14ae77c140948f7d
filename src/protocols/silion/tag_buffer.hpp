#pragma once
#include <deque>
#include <unordered_map>

#include "reader/air.hpp"

namespace gantry::silion {

// The RAM of a virtual reader: what was read and not yet sent. Reads of one tag at one antenna are gathered
// into one record until the batch is closed.
class TagBuffer {
public:
    explicit TagBuffer(std::size_t capacity) : capacity_(capacity) {}

    // Returns true when this tag has no open record at the antenna yet: its bank data may be set then.
    bool add(std::uint8_t antenna, const AirSighting& sighting);
    void set_bank(Bytes bank);  // of the record that add() opened last
    void close_batch();         // what was gathered may be sent now
    bool ready() const { return closed_ > 0; }
    // Takes closed records, as many as fit into `max` bytes, as the data segment of a tag frame.
    struct Segment {
        Bytes data;
        std::uint32_t tags = 0;
        std::uint64_t reads = 0;
    };
    Segment take(std::size_t max);
    std::size_t clear();  // returns how many records were lost
    // Newer records have pushed all of these out; where there are none, the next one finds no place.
    void overflow();

    std::size_t size() const { return records_.size(); }
    std::uint64_t dropped() const { return dropped_; }  // the oldest, when the buffer was full

private:
    struct Record {
        event::TagId tag;
        std::uint8_t antenna = 0, reads = 0, protocol = 0;
        std::int8_t rssi = 0;
        Bytes bank;
    };
    struct Key {
        event::TagId tag;
        std::uint8_t antenna;
        friend bool operator==(const Key&, const Key&) = default;
    };
    struct KeyHash {
        std::size_t operator()(const Key& key) const { return event::TagIdHash{}(key.tag) + key.antenna; }
    };

    std::size_t capacity_;
    std::deque<Record> records_;
    std::size_t closed_ = 0;                                // of these, from the front
    std::uint64_t first_ = 0;                               // number of the front record
    std::unordered_map<Key, std::uint64_t, KeyHash> open_;  // numbers of the records of this batch
    std::uint64_t dropped_ = 0;
    bool no_place_ = false;
};

// One frame's record, as sent at once when a tag is first seen.
Bytes single_tag(std::uint8_t antenna, const AirSighting& sighting);

}  // namespace gantry::silion
