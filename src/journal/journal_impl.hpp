#pragma once
#include <map>
#include <span>
#include <string>
#include <vector>

#include <boost/unordered/unordered_flat_map.hpp>

#include "journal/records.hpp"
#include "journal/rows.hpp"
#include "journal/sqlite.hpp"
#include "journal/tag_dictionary.hpp"

namespace gantry::journal {

// Behind Journal: the connection with its statements, and in memory what every commit needs. Memory follows
// the disk: it changes only after a commit, or is thrown away when a commit fails.
struct Journal::Impl {
    struct Statements {
        Statement read_point, generation, tag, event, details, batch, presence, presence_delete, mark, cursor,
            state;
        Statement job, reading, erase_jobs;
        Statement dead_letter, dead_letter_delete, old_dead_letters, excess_dead_letters;
        Statement read_mark;
        Statement pages, free_pages;
    };

    explicit Impl(Options given) : options(std::move(given)) {}

    // journal.cpp
    StoreResult<void> connect();
    StoreResult<void> prepare();
    StoreResult<State> read_state();
    StoreResult<void> load_names();
    StoreResult<void> change_ids(State next);  // ids.cpp
    std::uint64_t used_bytes() const;

    // commit.cpp
    StoreResult<void> check_order(const Batch& batch) const;
    StoreResult<void> write(const Batch& batch);
    StoreResult<void> write_read_points();
    StoreResult<void> write_event(const event::Event& event);
    StoreResult<void> write_details(const event::Event& event);
    StoreResult<void> write_reads(std::span<const Read> reads);
    StoreResult<void> write_presence(const PresenceRow& row);
    StoreResult<void> write_state(const State& next, Seq expected);
    StoreError why_full(StoreError error);
    StoreResult<void> begin_generation(Seq first_seq, std::int64_t time_us);
    StoreResult<std::uint32_t> tag_offset(const TagKey& tag);
    bool generation_due(std::int64_t time_us) const;
    ReadPointId read_point(const ReadPoint& point);
    void after_write();
    void forget_tags();
    tl::unexpected<StoreError> failed(std::string_view doing) const {
        return tl::unexpected(db.error(doing));
    }

    // jobs.cpp
    StoreResult<void> write_jobs(const Batch& batch);
    StoreResult<void> erase_jobs(std::int64_t cutoff_us);

    // dead_letters.cpp
    StoreResult<void> write_dead_letters(const Batch& batch);
    StoreResult<std::uint64_t> erase_dead_letters(std::int64_t cutoff_us);

    // retain.cpp
    StoreResult<Retained> retain_slice(Wall now);
    Seq delivered() const;
    bool may_delete_delivered() const;
    StoreResult<Seq> old_until(const char* sql, std::int64_t cutoff_us, std::int64_t now_us, Seq up_to,
                               Seq& scanned, bool& more);
    StoreResult<Seq> oldest_slice();
    struct Dropped {
        std::uint64_t events = 0;
        std::uint64_t telling = 0;  // of them: overflow events of the store's own
        std::uint64_t told = 0;     // events that these told of
        std::int64_t since_us = 0, told_since_us = 0;
    };
    StoreResult<Dropped> count_dropped(Seq beyond, Seq up_to);
    StoreResult<std::uint64_t> erase_rows(Seq up_to);
    StoreResult<std::uint64_t> erase_batches(Seq up_to);
    StoreResult<bool> erase_tags();
    StoreResult<Seq> oldest_seq();

    Options options;
    Database db;
    Statements statements;
    bool broken = false;  // an I/O error, or a reopen() that failed: nothing is written before one that works

    State state;  // as stored
    // After a reopen() that found the commit of an unknown end on the disk: events below are stored already.
    Seq stored_below = 0;

    std::vector<ReadPoint> read_points;  // id - 1 is the place
    std::size_t stored_read_points = 0;
    boost::unordered_flat_map<std::string, ReadPointId> read_point_ids;
    boost::unordered_flat_map<std::string, std::int64_t> mark_ids;  // by reader
    std::int64_t next_mark = 1;
    std::size_t damaged_marks = 0;  // found at open(): whose they are is not sure
    std::map<std::string, Seq, std::less<>> cursors;

    TagDictionary tags;
    std::uint64_t first_tag = 0;  // of the generation that `tags` holds; 0: a new one is due
    Seq generation_seq = 0;
    std::int64_t generation_us = 0;
    Bytes records;  // kept for its memory

    bool shrinking = false;                     // space was short and is not yet comfortable
    bool was_full = false;                      // a commit found no room since the last retain()
    bool nothing_to_drop = false;               // there should be room, and drop_oldest found no event
    Seq rows_scanned = 0, batches_scanned = 0;  // up to here all are old or stamped in the future
};

}  // namespace gantry::journal
