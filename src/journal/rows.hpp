#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "journal/checksum.hpp"
#include "journal/journal.hpp"

// What a row of a table holds beside its columns' plain values: checksums, and lists packed into a blob.
// Writer and readers share it.
namespace gantry::journal {

// What tells one row of `tags` from another. PC and XPC of a tag hardly ever change, so in such a row they
// cost an event nothing.
struct TagKey {
    const event::TagId& tag;
    event::Technology technology{};
    std::uint16_t pc = 0;  // this and the next as in Event
    std::uint32_t xpc = 0;
};
TagKey tag_key(const event::Event& event);
TagKey tag_key(const Observation& seen);

// A row of `tags`.
struct TagRow {
    std::uint64_t id = 0;
    event::TagId tag;
    event::Technology technology{};
    std::uint16_t pc = 0;
    std::uint32_t xpc = 0;
    std::string epc, gs1, link;
};
TagRow describe(std::uint64_t id, const TagKey& key);
// The names of an EPC; empty when the bytes are none or the technology has none.
std::string epc_of(const event::TagId& tag, event::Technology technology);

// A row of `state`.
struct State {
    std::string gateway_id;
    std::uint64_t epoch = 0;
    Seq next_seq = 1;
    std::int64_t last_commit_us = 0;
    std::uint64_t next_tag = 1;
    std::uint64_t max_presence = 0;
    std::uint64_t untold = 0;  // Journal::untold()
    std::int64_t untold_since_us = 0;

    std::string id_prefix() const;
};

struct ReadPoint {
    std::string reader, antenna, zone;
    friend bool operator==(const ReadPoint&, const ReadPoint&) = default;
};

// SQLite's integers end at 2^63 - 1.
std::int64_t storable(std::uint64_t number);

bool has_tag(const event::Event& event);      // else its row names none
bool has_details(const event::Event& event);  // else it has no row in event_details

// The read point and the tag go in by number (0: none), names by the checksums of their own rows.
std::uint32_t checksum(const event::Event& event, ReadPointId read_point, std::uint64_t tag);
std::uint32_t checksum(const TagRow& row);
std::uint32_t checksum(const State& state);
std::uint32_t checksum(ReadPointId id, const ReadPoint& point);
std::uint32_t checksum(const PresenceRow& row, ReadPointId read_point);
std::uint32_t checksum(const JobRow& row);
std::uint32_t checksum(const DeadLetter& row);
std::uint32_t checksum_mark(std::string_view reader, ByteView mark);

// Each name with its length before it (two bytes, big-endian).
Bytes pack_names(const std::vector<std::string>& names);
std::optional<std::vector<std::string>> unpack_names(ByteView packed);

}  // namespace gantry::journal
