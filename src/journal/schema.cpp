#include "journal/schema.hpp"

#include <algorithm>
#include <array>
#include <iterator>

#include <fmt/format.h>

#include "base/failpoint.hpp"
#include "base/text.hpp"
#include "journal/records.hpp"

namespace gantry::journal {

namespace {
constexpr std::int64_t application_id = 0x474E5452;  // "GNTR", in the header of the file

// Every row that a user's data hangs on has a checksum in `sum` (checksum.hpp), which the views leave alone.
constexpr std::array steps = {
    Migration{1, R"(
CREATE TABLE state(
    id INTEGER PRIMARY KEY CHECK(id = 1),
    gateway_id TEXT NOT NULL,
    epoch INTEGER NOT NULL,          -- raised by a restore
    next_seq INTEGER NOT NULL,
    last_commit_us INTEGER NOT NULL, -- 0: none yet
    next_tag INTEGER NOT NULL,
    max_presence INTEGER NOT NULL,   -- the highest id ever used
    sum INTEGER);
INSERT INTO state VALUES(1, 'gw-' || lower(hex(randomblob(6))), 0, 1, 0, 1, 0, NULL);

CREATE TABLE read_points(
    id INTEGER PRIMARY KEY, reader TEXT NOT NULL, antenna TEXT NOT NULL, zone TEXT NOT NULL, sum INTEGER NOT NULL);

-- A tag may have several rows: events refer to the one that was newest when they were stored. A generation is a range
-- of rows that only events from first_seq on refer to; an older one can go when those events are gone.
CREATE TABLE tags(
    id INTEGER PRIMARY KEY, technology INTEGER NOT NULL, tag BLOB NOT NULL,
    epc TEXT, gs1 TEXT, link TEXT, sum INTEGER NOT NULL);
CREATE TABLE generations(first_tag INTEGER PRIMARY KEY, first_seq INTEGER NOT NULL, time_us INTEGER NOT NULL);

CREATE TABLE event_rows(
    seq INTEGER PRIMARY KEY, type INTEGER NOT NULL, time_us INTEGER NOT NULL, read_point INTEGER, tag INTEGER,
    rssi INTEGER, reads INTEGER, first_seen_us INTEGER, last_seen_us INTEGER, reader_time_us INTEGER,
    sum INTEGER NOT NULL);
-- What only few events have.
CREATE TABLE event_details(
    seq INTEGER PRIMARY KEY, "from" TEXT, "to" TEXT, reason TEXT, text TEXT, code INTEGER, bytes BLOB, input INTEGER,
    state INTEGER, scope TEXT, count INTEGER, since_us INTEGER, "by" TEXT, possible_repeat INTEGER, user BLOB);

CREATE TABLE read_batches(
    first_seq INTEGER PRIMARY KEY, last_seq INTEGER NOT NULL, time_us INTEGER NOT NULL, last_time_us INTEGER NOT NULL,
    first_tag INTEGER NOT NULL, count INTEGER NOT NULL, sum INTEGER NOT NULL, records BLOB NOT NULL);
CREATE TABLE numbers(n INTEGER PRIMARY KEY);
INSERT INTO numbers WITH RECURSIVE c(n) AS (SELECT 0 UNION ALL SELECT n + 1 FROM c WHERE n < 159) SELECT n FROM c;

CREATE TABLE presence(
    id INTEGER PRIMARY KEY, state INTEGER NOT NULL, tag BLOB NOT NULL, technology INTEGER NOT NULL, epc TEXT,
    zone_key TEXT NOT NULL, read_point INTEGER, antenna_number INTEGER NOT NULL, rssi INTEGER, reads INTEGER NOT NULL,
    first_seen_us INTEGER NOT NULL, last_seen_us INTEGER NOT NULL, first_is_new INTEGER NOT NULL,
    readers BLOB, -- NULL: only the read point's
    sum INTEGER NOT NULL);
CREATE TABLE marks(id INTEGER PRIMARY KEY, reader TEXT NOT NULL, mark BLOB NOT NULL, sum INTEGER NOT NULL);
CREATE TABLE cursors(sink TEXT PRIMARY KEY, seq INTEGER NOT NULL) WITHOUT ROWID;
)"},
    Migration{
        2,
        R"(
-- What was dropped because the store was full, and no stored event tells yet.
ALTER TABLE state ADD COLUMN untold INTEGER NOT NULL DEFAULT 0;
ALTER TABLE state ADD COLUMN untold_since_us INTEGER NOT NULL DEFAULT 0;
)",
        {.loses = "SELECT untold, 'dropped events that no event has told of yet' FROM state",
         .forget = "UPDATE state SET untold = 0, untold_since_us = 0",
         .drop = "ALTER TABLE state DROP COLUMN untold; ALTER TABLE state DROP COLUMN untold_since_us"}},
    Migration{
        3,
        R"(
ALTER TABLE event_details ADD COLUMN tid BLOB;
CREATE TABLE jobs(
    id INTEGER PRIMARY KEY, reader TEXT NOT NULL, op TEXT NOT NULL, detail TEXT NOT NULL, state TEXT NOT NULL,
    text TEXT NOT NULL, created_us INTEGER NOT NULL, deadline_us INTEGER NOT NULL, ended_us INTEGER,
    sum INTEGER NOT NULL);
-- Readers that somebody has stopped, and those that were started again.
CREATE TABLE reading(reader TEXT PRIMARY KEY, reading INTEGER NOT NULL) WITHOUT ROWID;
)",
        {.loses = "SELECT count(*), 'TIDs that came with reads' FROM event_details WHERE tid IS NOT NULL "
                  "UNION ALL SELECT count(*), 'jobs' FROM jobs "
                  "UNION ALL SELECT count(*), 'readers that somebody stopped' FROM reading WHERE reading = 0",
         .forget = "UPDATE event_details SET tid = NULL WHERE tid IS NOT NULL",
         .drop = "ALTER TABLE event_details DROP COLUMN tid; DROP TABLE jobs; DROP TABLE reading"}},
    Migration{
        4,
        R"(
-- Events that a destination will not take.
CREATE TABLE dead_letters(
    id INTEGER PRIMARY KEY, sink TEXT NOT NULL, seq INTEGER NOT NULL, time_us INTEGER NOT NULL,
    tries INTEGER NOT NULL, reason TEXT NOT NULL, event TEXT NOT NULL, sum INTEGER NOT NULL, UNIQUE(sink, seq));
)",
        {.loses = "SELECT count(*), 'dead letters' FROM dead_letters", .drop = "DROP TABLE dead_letters"}},
    Migration{
        5,
        R"(
-- Of Gen2 tags, where the reader says them; XPC_W1 in the upper half of xpc.
ALTER TABLE tags ADD COLUMN pc INTEGER;
ALTER TABLE tags ADD COLUMN xpc INTEGER;
ALTER TABLE presence ADD COLUMN pc INTEGER;
ALTER TABLE presence ADD COLUMN xpc INTEGER;
)",
        {.loses =
             "SELECT count(*), 'rows of tags with PC or XPC' FROM tags WHERE pc IS NOT NULL OR xpc IS NOT "
             "NULL",
         .forget = "UPDATE tags SET pc = NULL, xpc = NULL WHERE pc IS NOT NULL OR xpc IS NOT NULL; "
                   "UPDATE presence SET pc = NULL, xpc = NULL WHERE pc IS NOT NULL OR xpc IS NOT NULL",
         .drop = "ALTER TABLE tags DROP COLUMN pc; ALTER TABLE tags DROP COLUMN xpc; "
                 "ALTER TABLE presence DROP COLUMN pc; ALTER TABLE presence DROP COLUMN xpc"}},
    Migration{
        6,
        R"(
-- Events up to last_seq keep the ids that begin with this gateway id and epoch; numbers then went on at next_seq.
CREATE TABLE earlier_ids(
    last_seq INTEGER PRIMARY KEY, next_seq INTEGER NOT NULL, gateway_id TEXT NOT NULL, epoch INTEGER NOT NULL,
    sum INTEGER NOT NULL);
)",
        {.loses =
             "SELECT (SELECT count(*) FROM event_rows WHERE seq <= x.last) + (SELECT ifnull(sum(count), 0) "
             "FROM read_batches WHERE last_seq <= x.last), 'ids of events from before a restore or a "
             "change of gateway.id (the events get new ones)' "
             "FROM (SELECT max(last_seq) AS last FROM earlier_ids) x",
         .drop = "DROP TABLE earlier_ids"}},
};

// A number of a packed record in plain SQL: the place of each byte among all bytes, found with instr.
std::string packed(RecordLayout::Place place) {
    static const std::string all_bytes = [] {
        Bytes bytes(256);
        for (std::size_t i = 0; i < bytes.size(); ++i)
            bytes[i] = static_cast<std::uint8_t>(i);
        return "x'" + to_hex(bytes) + "'";
    }();
    std::string out = "(";
    for (std::size_t i = 0; i < place.size; ++i) {
        auto weight = std::uint64_t{1} << (8 * (place.size - 1 - i));
        out += fmt::format("{}(instr({}, substr(b.records, n.n * {} + {}, 1)) - 1) * {}", i == 0 ? "" : " + ",
                           all_bytes, RecordLayout::size, place.at + i + 1, weight);
    }
    return out + ")";
}

std::string time_text(std::string_view us) {
    return fmt::format(
        "strftime('%Y-%m-%dT%H:%M:%S.', {0} / 1000000, 'unixepoch') || "
        "substr(1000000 + {0} % 1000000, 2) || 'Z'",
        us);
}

std::string type_text(std::string_view type) {
    auto out = fmt::format("CASE {}", type);
    for (auto& [number, name] : event::all_types())
        out += fmt::format(" WHEN {} THEN '{}'", static_cast<int>(number), name);
    return out + " END";
}

std::string technology_text(std::string_view technology) {
    auto out = fmt::format("CASE {}", technology);
    for (auto& [number, name] : event::all_technologies())
        out += fmt::format(" WHEN {} THEN '{}'", static_cast<int>(number), name);
    return out + " END";
}

// As event::TagWords in hex.
std::string pc_text(std::string_view pc) {
    return fmt::format("CASE WHEN {0} IS NOT NULL THEN printf('%04X', {0}) END", pc);
}
std::string xpc_text(std::string_view xpc) {
    return fmt::format(
        "CASE WHEN {0} & 65535 <> 0 THEN printf('%08X', {0}) "
        "WHEN {0} IS NOT NULL THEN printf('%04X', {0} >> 16) END",
        xpc);
}

// Of the event that has the number `seq`.
std::string id_prefix_sql(std::string_view seq) {
    constexpr std::string_view prefix =
        "gateway_id || ':' || CASE WHEN epoch > 0 THEN epoch || ':' ELSE '' END";
    return fmt::format(
        "ifnull((SELECT {0} FROM earlier_ids WHERE last_seq >= {1} ORDER BY last_seq LIMIT 1), (SELECT {0} "
        "FROM "
        "state))",
        prefix, seq);
}

StoreResult<void> put_view(Database& db, const std::string& name, const std::string& sql) {
    auto stored = db.prepare("SELECT sql FROM sqlite_master WHERE type = 'view' AND name = ?1");
    if (!stored) return tl::unexpected(stored.error());
    stored->bind(1, std::string_view(name));
    switch (stored->step()) {
        case Step::failed:
            return tl::unexpected(db.error("read"));
        case Step::row:
            if (stored->text(0) == sql) return {};
            break;
        case Step::done:
            break;
    }
    stored->reset();
    return db.run("DROP VIEW IF EXISTS " + name + "; " + sql);
}

tl::unexpected<StoreError> refuse(std::string what, std::string hint) {
    return tl::unexpected(StoreError{StoreError::Kind::other, {std::move(what), std::move(hint)}});
}
// Every column of every table, a line each.
StoreResult<std::vector<std::string>> shape_of(Database& db) {
    auto rows = db.prepare(
        "SELECT m.name || '.' || c.name || ' ' || c.type || ' ' || c.\"notnull\" || ' ' || c.pk || ' ' || "
        "ifnull(c.dflt_value, '-') FROM sqlite_master m JOIN pragma_table_info(m.name) c WHERE m.type = "
        "'table' "
        "UNION ALL SELECT name || ' ' || wr FROM pragma_table_list WHERE schema = 'main' AND type = 'table' "
        "AND name NOT LIKE 'sqlite_%' "
        "UNION ALL SELECT name || ' on ' || tbl_name FROM sqlite_master WHERE type = 'index' ORDER BY 1");
    if (!rows) return tl::unexpected(rows.error());
    std::vector<std::string> lines;
    Step step;
    while ((step = rows->step()) == Step::row)
        lines.emplace_back(rows->text(0));
    if (step == Step::failed) return tl::unexpected(db.error("read"));
    return lines;
}
}  // namespace

std::span<const Migration> migrations() {
    return steps;
}
int schema_version() {
    return steps.back().version;
}

// Only functions that SQLite also runs for programs that do not trust a file's schema: no json_object.
std::string events_view() {
    auto rows = fmt::format(
        R"(CREATE VIEW events AS
SELECT 1 AS schema, {0} || e.seq AS id, e.seq AS seq, {1} AS type, {2} AS time,
 nullif(p.reader, '') AS reader, nullif(p.antenna, '') AS antenna, nullif(p.zone, '') AS zone,
 {3} AS technology, nullif(hex(t.tag), '') AS tag, t.epc AS epc, t.gs1 AS gs1, t.link AS link,
 {8} AS pc, {9} AS xpc,
 e.rssi / 10.0 AS rssi_dbm, e.reads AS reads, {4} AS first_seen, {5} AS last_seen, {6} AS reader_time,
 d."from" AS "from", d."to" AS "to", d.reason AS reason, d.code AS code, d.text AS text,
 CASE WHEN d.bytes IS NOT NULL THEN hex(d.bytes) END AS bytes, d.input AS input, d.state AS state, d.scope AS scope,
 d.count AS count, {7} AS since, d."by" AS "by", d.possible_repeat AS possible_repeat,
 CASE WHEN d.user IS NOT NULL OR d.tid IS NOT NULL THEN '{{' ||
  substr(CASE WHEN d.tid IS NOT NULL THEN ',"tid":"' || hex(d.tid) || '"' ELSE '' END ||
         CASE WHEN d.user IS NOT NULL THEN ',"user":"' || hex(d.user) || '"' ELSE '' END, 2) || '}}'
 END AS data
FROM event_rows e LEFT JOIN read_points p ON p.id = e.read_point LEFT JOIN tags t ON t.id = e.tag
 LEFT JOIN event_details d ON d.seq = e.seq)",
        id_prefix_sql("e.seq"), type_text("e.type"), time_text("e.time_us"), technology_text("t.technology"),
        time_text("e.first_seen_us"), time_text("e.last_seen_us"), time_text("e.reader_time_us"),
        time_text("d.since_us"), pc_text("t.pc"), xpc_text("t.xpc"));
    auto seq = fmt::format("(b.first_seq + {})", packed(RecordLayout::seq));
    auto reader_time = fmt::format("nullif({}, 0)", packed(RecordLayout::reader_time));
    auto reads = fmt::format(
        R"(
UNION ALL
SELECT 1, {0} || {1}, {1}, 'tag.read', {2}, nullif(p.reader, ''), nullif(p.antenna, ''), nullif(p.zone, ''),
 {3}, nullif(hex(t.tag), ''), t.epc, t.gs1, t.link, {10}, {11},
 (nullif({4}, 0) - 32768) / 10.0, nullif({5}, 0), NULL, NULL, {6},
 NULL, NULL, NULL, NULL, NULL, NULL, NULL, NULL, NULL, NULL, NULL, NULL, nullif({7} & 1, 0), NULL
FROM read_batches b CROSS JOIN numbers n ON n.n < b.count LEFT JOIN read_points p ON p.id = {8}
 LEFT JOIN tags t ON t.id = b.first_tag + {9})",
        id_prefix_sql("b.first_seq"), seq,
        time_text(fmt::format("(b.time_us + {})", packed(RecordLayout::time))),
        technology_text("t.technology"), packed(RecordLayout::rssi), packed(RecordLayout::reads),
        time_text(reader_time), packed(RecordLayout::flags), packed(RecordLayout::read_point),
        packed(RecordLayout::tag), pc_text("t.pc"), xpc_text("t.xpc"));
    return rows + reads;
}

std::string present_tags_view() {
    return fmt::format(
        R"(CREATE VIEW present_tags AS
SELECT nullif(hex(r.tag), '') AS tag, r.epc AS epc, nullif(p.zone, '') AS zone, nullif(p.reader, '') AS reader,
 nullif(p.antenna, '') AS antenna, {} AS first_seen, {} AS last_seen, r.reads AS reads, r.rssi / 10.0 AS rssi_dbm,
 {} AS pc, {} AS xpc
FROM presence r LEFT JOIN read_points p ON p.id = r.read_point WHERE r.state IN (1, 2))",
        time_text("r.first_seen_us"), time_text("r.last_seen_us"), pc_text("r.pc"), xpc_text("r.xpc"));
}

StoreResult<int> stored_version(Database& db, int known) {
    auto application = db.number("PRAGMA application_id");
    if (!application) return tl::unexpected(application.error());
    auto version = db.number("PRAGMA user_version");
    if (!version) return tl::unexpected(version.error());
    auto tables = db.number("SELECT count(*) FROM sqlite_master");
    if (!tables) return tl::unexpected(tables.error());
    if (*application != application_id && (*tables != 0 || *version != 0))
        return tl::unexpected(
            StoreError{StoreError::Kind::foreign,
                       {fmt::format("{} is an SQLite file of another program", db.path().string()),
                        "choose another data directory"}});
    if (*version > known)
        return refuse(fmt::format("the store {} has version {}, this program knows versions up to {}",
                                  db.path().string(), *version, known),
                      fmt::format("use the newer gantry that wrote it, or let that one bring it back with "
                                  "`gantry store downgrade --to {}`",
                                  known));
    return static_cast<int>(*version);
}

namespace {
StoreResult<void> run_steps(Database& db, std::span<const Migration> missing) {
    for (auto& step : missing) {
        auto sql = fmt::format("{}; PRAGMA user_version={}; PRAGMA application_id={}", step.sql, step.version,
                               application_id);
        if (auto done = db.run(sql); !done) {
            auto error = done.error();
            error.error.what =
                fmt::format("the store could not be brought to version {}, it is as it was: {}", step.version,
                            error.error.what);
            return tl::unexpected(error);
        }
        die_at("migration_step");
    }
    // The views belong to the program, not to a version: a new event type shows without a migration.
    if (auto put = put_view(db, "events", events_view()); !put) return put;
    return put_view(db, "present_tags", present_tags_view());
}
}  // namespace

StoreResult<void> migrate(Database& db, std::span<const Migration> all) {
    auto done_before = all.size();
    auto migrated = [&]() -> StoreResult<void> {
        Transaction transaction(db);
        if (auto begun = transaction.begin_write(); !begun) return begun;
        auto version = stored_version(db, all.back().version);
        if (!version) return tl::unexpected(version.error());
        auto is_done = [&](auto& step) { return step.version <= *version; };
        done_before = static_cast<std::size_t>(std::ranges::count_if(all, is_done));
        if (auto ran = run_steps(db, all.subspan(done_before)); !ran) return ran;
        die_at("migration_commit");
        return transaction.commit();
    }();
    if (migrated || migrated.error().kind != StoreError::Kind::other || done_before == all.size())
        return migrated;
    // Is it the step, or is the version a wrong one?
    auto shape = expect_shape(db, all.first(done_before));
    return !shape && shape.error().kind == StoreError::Kind::corrupt ? shape : migrated;
}

StoreResult<void> expect_shape(Database& db, std::span<const Migration> all) {
    auto right = Database::open(":memory:", Database::Access::write);
    if (!right) return tl::unexpected(right.error());
    for (auto& step : all)
        if (auto made = right->run(step.sql); !made) return made;
    auto expected = shape_of(*right);
    if (!expected) return tl::unexpected(expected.error());
    auto found = shape_of(db);
    if (!found) return tl::unexpected(found.error());
    std::vector<std::string> odd;
    std::ranges::set_symmetric_difference(*expected, *found, std::back_inserter(odd));
    if (odd.empty()) return {};
    auto table = odd.front().substr(0, odd.front().find_first_of(". "));
    return tl::unexpected(damaged(
        db.path(), fmt::format("the definition of the table {} is not as it was stored", printable(table))));
}

StoreResult<void> expect_current_schema(Database& db) {
    auto version = stored_version(db, schema_version());
    if (!version) return tl::unexpected(version.error());
    if (*version != schema_version())
        return refuse(fmt::format("the store {} has version {}, this program reads version {}",
                                  db.path().string(), *version, schema_version()),
                      "start the gateway once: it brings the store to the new version");
    return {};
}

}  // namespace gantry::journal
