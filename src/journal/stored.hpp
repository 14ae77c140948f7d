#pragma once
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "journal/records.hpp"
#include "journal/rows.hpp"
#include "journal/sqlite.hpp"

// Rows as they come out of their tables, and whether they are as they were stored. Whoever reads a table uses
// its SELECT here, with a WHERE behind it.
namespace gantry::journal {

struct RowSum {
    std::int64_t stored = 0;
    std::optional<std::uint32_t> right;  // what the row's members give; nothing: they cannot be read at all
    bool sound() const { return right && stored == std::int64_t{*right}; }
};

extern const std::string_view select_state, select_read_points, select_tags, select_events, select_batches,
    select_presence, select_marks, select_jobs, select_dead_letters, select_earlier_ids;

RowSum take(const Statement& row, State& into);
RowSum take(const Statement& row, ReadPointId& id, ReadPoint& into);
RowSum take(const Statement& row, TagRow& into);
// All but what its read point and its tag say; 0: it has none.
RowSum take(const Statement& row, event::Event& into, ReadPointId& read_point, std::uint64_t& tag);
RowSum take(const Statement& row, BatchHead& into, ByteView& records);  // valid until the next step
RowSum take(const Statement& row, PresenceRow& into);
struct MarkRow {
    std::int64_t id = 0;
    std::string reader;
    Bytes mark;
};
RowSum take(const Statement& row, MarkRow& into);
RowSum take(const Statement& row, JobRow& into);
RowSum take(const Statement& row, DeadLetter& into);
// Events up to last_seq have the ids of before; numbers then went on at next_seq.
struct EarlierIds {
    Seq last_seq = 0, next_seq = 0;
    std::string gateway_id;
    std::uint64_t epoch = 0;
};
std::uint32_t checksum(const EarlierIds& row);
RowSum take(const Statement& row, EarlierIds& into);

// All tables whose rows have a checksum, for whoever goes through the whole store.
struct SummedTable {
    std::string_view name, key;   // of its rows; an integer
    std::string_view row_name;    // "event", for "event 12 is not as it was stored"
    std::string_view select;      // its columns, the key first
    std::string_view key_in_sql;  // as the SELECT calls it
    RowSum (*sum)(const Statement& row);
};
std::span<const SummedTable> summed_tables();

}  // namespace gantry::journal
