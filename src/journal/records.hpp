#pragma once
#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "journal/checksum.hpp"
#include "journal/journal.hpp"

// The reads of one commit lie packed in blobs: records of a fixed size, numbers big-endian, each counted from
// a base that is a column beside the blob.
namespace gantry::journal {

// A row with its blob fills one page and never needs a second: the view takes numbers out of the blob one by
// one, and SQLite would read the whole of a longer one each time.
inline constexpr std::size_t page_size = 4096;
inline constexpr std::size_t max_records = 160;  // the view joins with the numbers 0 to 159

// The places of a record's numbers. The view `events` reads the same places.
struct RecordLayout {
    struct Place {
        std::size_t at, size;
    };
    static constexpr Place seq{0, 3};           // from first_seq
    static constexpr Place time{3, 4};          // microseconds from time_us
    static constexpr Place read_point{7, 3};    // id
    static constexpr Place tag{10, 3};          // id from first_tag
    static constexpr Place flags{13, 1};        // 1: possible_repeat
    static constexpr Place rssi{14, 2};         // tenths of a dBm + 32768; 0: not said
    static constexpr Place reads{16, 2};        //
    static constexpr Place reader_time{18, 7};  // microseconds since 1970; 0: not said
    static constexpr std::size_t size = 25;
};

// What stands beside a blob.
struct BatchHead {
    Seq first_seq = 0, last_seq = 0;
    std::int64_t time_us = 0, last_time_us = 0;  // the earliest and the latest of the reads
    std::uint64_t first_tag = 0;
    std::uint32_t count = 0;
};

struct Record {
    Seq seq = 0;
    std::int64_t time_us = 0;
    ReadPointId read_point = 0;
    std::uint64_t tag = 0;
    bool possible_repeat = false;
    event::Rssi rssi;
    std::uint16_t reads = 0;
    std::int64_t reader_time_us = 0;
};

// Whether the numbers of a read have room in a record; what has not is stored as a row.
bool fits_record(const Read& read);
// How many of `reads` (the first fits a record) can share one blob: they must fit too, and seq and time must
// be near enough. Sets all of `head` but first_tag.
std::size_t plan_batch(std::span<const Read> reads, BatchHead& head);
void pack(const Read& read, std::uint32_t tag_offset, const BatchHead& head, Bytes& out);
Record unpack(ByteView record, const BatchHead& head);

std::uint32_t checksum(const BatchHead& head, ByteView records);

// Times outside 1970 to 9999 come from broken clocks; the store keeps the nearest time that the views can
// print.
std::int64_t storable_us(Wall time);

}  // namespace gantry::journal
