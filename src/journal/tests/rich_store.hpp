#pragma once
#include "journal/sqlite.hpp"
#include "journal/tests/fixtures.hpp"

// A store with something in every table, for tests of what is done with a whole store.
namespace gantry::journal::tests {

// `commits` of ten events and ten reads each, all with what the first schema version had a place for.
inline void fill(Journal& journal, int commits, Wall time = start_time) {
    for (int i = 0; i < commits; ++i) {
        auto batch = next_batch(journal, time);
        auto point = journal.read_point("dock-1", i % 2 == 0 ? "Ant0" : "Ant1", "dock");
        for (int each = 0; each < 10; ++each) {
            auto& event = add_tag_event(batch, batch.next_seq % 50, time);
            if (each % 3 == 0) event.reason = "why";
            if (each % 5 == 0) event.user = {1, 2, 3};
            add_read(batch, batch.next_seq % 50, point, time);
        }
        PresenceRow row;
        row.id = batch.next_seq;
        row.tag = tag_number(row.id);
        row.zone = "dock";
        row.reader = "dock-1";
        row.first_seen = row.last_seen = time;
        batch.presence.push_back(row);
        batch.marks = {{"dock-1", {static_cast<std::uint8_t>(i)}}};
        batch.cursors = {{"broker", batch.next_seq - 1}};
        auto done = journal.commit(batch);
        if (!done) throw std::runtime_error(done.error().error.text());
    }
}

inline JobRow job_number(std::uint64_t id) {
    JobRow job;
    job.id = id;
    job.reader = "dock-1";
    job.op = "gpio.get";
    job.state = "done";
    job.created = job.deadline = start_time;
    job.ended = start_time;
    return job;
}

// And what later versions added.
inline void add_newer(Journal& journal) {
    auto batch = next_batch(journal);
    add_tag_event(batch, 1).tid = {0xE2, 0x80};
    add_tag_event(batch, 2).tid = {0xE2, 0x81};
    batch.jobs = {job_number(1), job_number(2), job_number(3)};
    batch.reading = {{"dock-2", false}};
    batch.dead_letters = {
        {.sink = "broker", .seq = 7, .time = start_time, .reason = "too long", .event = "{}"}};
    batch.events.back().pc = 0x3000;
    auto& row = batch.presence.emplace_back();
    row.id = 1'000'000;
    row.tag = tag_number(1);
    row.pc = 0x3000;
    row.xpc = 0x08000000;
    auto done = journal.commit(batch);
    if (!done) throw std::runtime_error(done.error().error.text());
}

inline std::vector<std::string> described(const std::filesystem::path& path) {
    std::vector<std::string> all;
    auto reader = Reader::open(path);
    if (!reader) throw std::runtime_error(reader.error().error.text());
    auto prefixes = (*reader)->id_prefixes();
    if (!prefixes) throw std::runtime_error(prefixes.error().error.text());
    for (auto& event : read_all(path))
        all.push_back(prefixes->of(event.seq) + describe(event));
    return all;
}

// As any SQLite program reads it.
inline std::vector<std::string> ids_in_view(const std::filesystem::path& path) {
    auto db = Database::open(path, Database::Access::read);
    if (!db) throw std::runtime_error(db.error().error.text());
    auto rows = db->prepare("SELECT id FROM events ORDER BY seq");
    std::vector<std::string> ids;
    while (rows->step() == Step::row)
        ids.emplace_back(rows->text(0));
    return ids;
}

inline void run_sql(const std::filesystem::path& path, const std::string& sql) {
    auto db = Database::open(path, Database::Access::write);
    if (!db) throw std::runtime_error(db.error().error.text());
    if (auto done = db->run(sql); !done) throw std::runtime_error(done.error().error.text());
}

inline std::int64_t sql_number(const std::filesystem::path& path, const std::string& sql) {
    auto db = Database::open(path, Database::Access::read);
    if (!db) throw std::runtime_error(db.error().error.text());
    auto number = db->number(sql);
    if (!number) throw std::runtime_error(number.error().error.text());
    return *number;
}

}  // namespace gantry::journal::tests
