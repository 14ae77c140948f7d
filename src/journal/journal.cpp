#include "journal/journal.hpp"

#include <algorithm>

#include <fmt/format.h>
#include <unistd.h>

#include "base/failpoint.hpp"
#include "base/text.hpp"
#include "journal/files.hpp"
#include "journal/journal_impl.hpp"
#include "journal/schema.hpp"
#include "journal/stored.hpp"
#include "journal/upkeep.hpp"

namespace gantry::journal {

namespace {
constexpr std::uint64_t least_size = 512 * 1024;
constexpr std::int64_t cache_kib = 8192;
// Kept on the disk when the log is emptied, so that deleting still works when the disk is full.
constexpr std::int64_t kept_log_bytes = 4 << 20;

// SQLite deletes a log that has no database: with it would go the newest of what was moved away.
StoreResult<void> refuse_orphaned_log(const std::filesystem::path& path) {
    auto log = beside(path, log_suffix).string();
    if (size_of(path) != 0 || size_of(log) == 0) return {};
    auto name = path.filename().string();
    return tl::unexpected(StoreError{
        StoreError::Kind::corrupt,
        {fmt::format("{} holds the newest data of a store, but {} is not there", log, path.string()),
         fmt::format("put {0} back beside {0}-wal, or move {0}-wal and {0}-shm to where {0} is", name)}});
}

// With no log all pages must be in the file. SQLite would notice only when it needs one that is gone, and the
// next write may fill up the file with nothing.
StoreResult<void> refuse_shortened(Database& db) {
    if (size_of(beside(db.path(), log_suffix)) != 0) return {};
    auto pages = db.number("PRAGMA page_count");
    if (!pages) return tl::unexpected(pages.error());
    auto there = size_of(db.path());
    if (there >= static_cast<std::uint64_t>(*pages) * page_size) return {};
    return tl::unexpected(damaged(
        db.path(), fmt::format("it has {} pages, and the file ends after {}", *pages, there / page_size)));
}
}  // namespace

bool Batch::empty() const {
    return events.empty() && reads.empty() && presence.empty() && presence_deleted.empty() && marks.empty() &&
           cursors.empty() && dead_letters.empty() && dead_letters_deleted.empty() && jobs.empty() &&
           reading.empty();
}

void Batch::clear() {
    events.clear();
    reads.clear();
    presence.clear();
    presence_deleted.clear();
    marks.clear();
    cursors.clear();
    dead_letters.clear();
    dead_letters_deleted.clear();
    jobs.clear();
    reading.clear();
}

Journal::Journal(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Journal::~Journal() = default;

StoreResult<std::unique_ptr<Journal>> Journal::open(const Options& options) {
    if (auto whole = refuse_orphaned_log(options.path); !whole) return tl::unexpected(whole.error());
    // The file is made here, not by SQLite, because of its mode. Only when it is not there: closing any
    // descriptor of a file drops the locks that other connections of this process hold on it.
    if (auto made = make_private_file(options.path); made && *made)
        static_cast<void>(sync_directory(directory_of(options.path)));
    auto impl = std::make_unique<Impl>(options);
    impl->options.max_size = std::max(impl->options.max_size, least_size);
    if (auto connected = impl->connect(); !connected) return tl::unexpected(connected.error());
    auto state = impl->read_state();
    if (!state) return tl::unexpected(state.error());
    impl->state = std::move(*state);
    if (auto loaded = impl->load_names(); !loaded) return tl::unexpected(loaded.error());
    return std::unique_ptr<Journal>(new Journal(std::move(impl)));
}

StoreResult<void> Journal::Impl::connect() {
    statements = {};
    db = {};
    auto opened = Database::open(options.path, Database::Access::write);
    if (!opened) return tl::unexpected(opened.error());
    db = std::move(*opened);
    if (auto whole = refuse_shortened(db); !whole) return whole;
    // Of a file that is still empty: its pages can be given back in slices.
    if (size_of(options.path) == 0)
        if (auto set = db.run("PRAGMA auto_vacuum=INCREMENTAL"); !set) return set;
    auto settings = fmt::format(
        "PRAGMA page_size={}; PRAGMA journal_mode=WAL; PRAGMA synchronous={}; PRAGMA cache_size=-{}; "
        "PRAGMA journal_size_limit={}; PRAGMA secure_delete=OFF",
        journal::page_size, failpoint("store_synchronous_normal") ? "NORMAL" : "FULL", cache_kib,
        kept_log_bytes);
    if (auto set = db.run(settings); !set) return set;
    // Some file systems (network shares) cannot share memory between programs, and with that have no log.
    auto log = db.number("SELECT count(*) FROM pragma_journal_mode WHERE journal_mode = 'wal'");
    if (!log) return tl::unexpected(log.error());
    if (*log != 1)
        return tl::unexpected(
            StoreError{StoreError::Kind::other,
                       {fmt::format("the file system of {} cannot hold the store: no write-ahead log",
                                    options.path.string()),
                        "put gateway.data_dir on a local disk"}});
    if (auto limited = db.run(fmt::format("PRAGMA max_page_count={}", options.max_size / page_size));
        !limited)
        return limited;
    if (auto migrated = migrate(db, migrations()); !migrated) return migrated;
    // What the log holds may be only in the page cache, if the process before this one died after a sync that
    // failed. It is written again, into the file, and synced, before anyone is told that it is safe.
    if (auto safe = db.checkpoint(true); !safe) return safe;
    return prepare();
}

StoreResult<void> Journal::Impl::prepare() {
    struct {
        Statement& statement;
        const char* sql;
    } all[] = {
        {statements.read_point, "INSERT INTO read_points VALUES(?1, ?2, ?3, ?4, ?5)"},
        {statements.generation, "INSERT OR REPLACE INTO generations VALUES(?1, ?2, ?3)"},
        {statements.tag,
         "INSERT INTO tags VALUES(?1, ?2, ?3, nullif(?4, ''), nullif(?5, ''), nullif(?6, ''), ?7, ?8, ?9)"},
        {statements.event, "INSERT INTO event_rows VALUES(?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11)"},
        {statements.details,
         "INSERT INTO event_details VALUES(?1, nullif(?2, ''), nullif(?3, ''), nullif(?4, ''), nullif(?5, "
         "''), ?6, "
         "nullif(?7, x''), ?8, ?9, nullif(?10, ''), ?11, ?12, nullif(?13, ''), ?14, nullif(?15, x''), "
         "nullif(?16, x''))"},
        {statements.batch, "INSERT INTO read_batches VALUES(?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8)"},
        {statements.presence,
         "INSERT OR REPLACE INTO presence VALUES(?1, ?2, ?3, ?4, nullif(?5, ''), ?6, ?7, ?8, ?9, ?10, ?11, "
         "?12, ?13, "
         "?14, ?15, ?16, ?17)"},
        {statements.presence_delete, "DELETE FROM presence WHERE id = ?1"},
        {statements.mark, "INSERT OR REPLACE INTO marks VALUES(?1, ?2, ?3, ?4)"},
        {statements.cursor, "INSERT OR REPLACE INTO cursors VALUES(?1, ?2)"},
        {statements.state,
         "UPDATE state SET gateway_id = ?1, epoch = ?2, next_seq = ?3, last_commit_us = ?4, next_tag = ?5, "
         "max_presence = ?6, untold = ?7, untold_since_us = ?8, sum = ?9 WHERE id = 1 AND next_seq = ?10"},
        {statements.job, "INSERT OR REPLACE INTO jobs VALUES(?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10)"},
        {statements.reading, "INSERT OR REPLACE INTO reading VALUES(?1, ?2)"},
        {statements.erase_jobs,
         "DELETE FROM jobs WHERE ended_us IS NOT NULL AND (ended_us < ?1 OR id + ?2 <= (SELECT max(id) FROM "
         "jobs)) AND id < (SELECT max(id) FROM jobs)"},
        {statements.dead_letter,
         "INSERT OR REPLACE INTO dead_letters VALUES(NULL, ?1, ?2, ?3, ?4, ?5, ?6, ?7)"},
        {statements.dead_letter_delete, "DELETE FROM dead_letters WHERE sink = ?1 AND seq = ?2"},
        {statements.old_dead_letters,
         "DELETE FROM dead_letters WHERE id IN (SELECT id FROM dead_letters ORDER BY id LIMIT 1000) AND "
         "time_us < ?1"},
        {statements.excess_dead_letters,
         // Numbers have gaps, so rows are counted; but only once there may be too many.
         "DELETE FROM dead_letters WHERE id IN (SELECT id FROM dead_letters ORDER BY id LIMIT CASE WHEN "
         "(SELECT max(id) FROM dead_letters) - (SELECT min(id) FROM dead_letters) >= ?1 "
         "THEN max(0, (SELECT count(*) FROM dead_letters) - ?1) ELSE 0 END)"},
        {statements.read_mark, "SELECT mark, sum FROM marks WHERE id = ?1"},
        {statements.pages, "PRAGMA page_count"},
        {statements.free_pages, "PRAGMA freelist_count"},
    };
    for (auto& [statement, sql] : all) {
        auto prepared = db.prepare(sql);
        if (!prepared) return tl::unexpected(prepared.error());
        statement = std::move(*prepared);
    }
    return {};
}

StoreResult<State> Journal::Impl::read_state() {
    auto row = db.prepare(select_state);
    if (!row) return tl::unexpected(row.error());
    State read;
    switch (row->step()) {
        case Step::failed:
            return failed("read");
        case Step::done:
            return tl::unexpected(damaged(options.path, "its state is missing"));
        case Step::row:
            if (!take(*row, read).sound())
                return tl::unexpected(damaged(options.path, "its state fails its checksum"));
            break;
    }
    row->reset();
    auto last = db.number(
        "SELECT max(ifnull((SELECT max(seq) FROM event_rows), 0), ifnull((SELECT last_seq FROM read_batches "
        "ORDER "
        "BY first_seq DESC LIMIT 1), 0))");
    if (!last) return tl::unexpected(last.error());
    if (*last >= static_cast<std::int64_t>(read.next_seq))
        return tl::unexpected(damaged(options.path, "it holds events beyond its last number"));
    return read;
}

StoreResult<void> Journal::Impl::load_names() {
    auto rows = db.prepare(fmt::format("{} ORDER BY id", select_read_points));
    if (!rows) return tl::unexpected(rows.error());
    Step step;
    ReadPoint point;
    ReadPointId id = 0;
    while ((step = rows->step()) == Step::row) {
        if (!take(*rows, id, point).sound() || id != read_points.size() + 1)
            return tl::unexpected(damaged(
                options.path, fmt::format("read point {} is not as it was stored", read_points.size() + 1)));
        read_point(point);
    }
    if (step == Step::failed) return failed("read");
    stored_read_points = read_points.size();

    auto marks = db.prepare(fmt::format("{} ORDER BY id", select_marks));
    if (!marks) return tl::unexpected(marks.error());
    MarkRow mark;
    while ((step = marks->step()) == Step::row) {
        // A damaged row keeps its place, so that the next mark of its reader mends it.
        if (!take(*marks, mark).sound()) ++damaged_marks;
        next_mark = std::max(next_mark, mark.id + 1);
        mark_ids.try_emplace(mark.reader, mark.id);
    }
    if (step == Step::failed) return failed("read");

    auto stored = db.prepare("SELECT sink, seq FROM cursors");
    if (!stored) return tl::unexpected(stored.error());
    while ((step = stored->step()) == Step::row)
        cursors[std::string(stored->text(0))] = static_cast<Seq>(stored->number(1));
    if (step == Step::failed) return failed("read");
    return {};
}

StoreResult<void> Journal::reopen() {
    auto& impl = *impl_;
    impl.broken = true;  // until all of this has worked: there may be no connection at all
    if (auto whole = refuse_orphaned_log(impl.options.path); !whole) return whole;
    if (auto connected = impl.connect(); !connected) return connected;
    auto state = impl.read_state();
    if (!state) return tl::unexpected(state.error());
    auto points = impl.db.number("SELECT count(*) FROM read_points");
    if (!points) return tl::unexpected(points.error());
    if (static_cast<std::size_t>(*points) > impl.read_points.size())
        return tl::unexpected(
            StoreError{StoreError::Kind::other,
                       {fmt::format("another gateway has written into {}", impl.options.path.string()),
                        "stop one of the two"}});
    impl.stored_read_points = static_cast<std::size_t>(*points);
    if (state->next_seq > impl.state.next_seq) impl.stored_below = state->next_seq;
    impl.state = std::move(*state);
    impl.forget_tags();
    impl.broken = false;
    return {};
}

std::string Journal::gateway_id() const {
    return impl_->state.gateway_id;
}

StoreResult<void> Journal::set_gateway_id(std::string_view id) {
    auto& impl = *impl_;
    if (id == impl.state.gateway_id) return {};
    if (id.empty() || id.size() > 255 || !is_utf8(id) || id.find('\0') != std::string_view::npos)
        return tl::unexpected(StoreError{StoreError::Kind::other,
                                         {fmt::format("\"{}\" cannot be the gateway's id", printable(id)),
                                          "use 1 to 255 bytes of UTF-8 text"}});
    auto next = impl.state;
    next.gateway_id = id;
    return impl.change_ids(std::move(next));
}

StoreResult<void> Journal::raise_epoch(std::uint64_t epoch, Seq next_seq) {
    auto& impl = *impl_;
    if (epoch <= impl.state.epoch)
        return tl::unexpected(
            StoreError{StoreError::Kind::other,
                       {fmt::format("the epoch {} is not higher than {}, which was used before", epoch,
                                    impl.state.epoch),
                        {}}});
    auto next = impl.state;
    next.epoch = epoch;
    next.next_seq = std::max(next.next_seq, next_seq);
    return impl.change_ids(std::move(next));
}

std::string Journal::id_prefix() const {
    return impl_->state.id_prefix();
}
Seq Journal::last_seq() const {
    return impl_->state.next_seq - 1;
}
Wall Journal::last_commit() const {
    return from_us(impl_->state.last_commit_us);
}
std::uint64_t Journal::max_presence_id() const {
    return impl_->state.max_presence;
}
std::optional<Seq> Journal::cursor(std::string_view sink) const {
    auto it = impl_->cursors.find(sink);
    if (it == impl_->cursors.end()) return {};
    return it->second;
}

std::vector<std::string> Journal::sinks_with_cursor() const {
    std::vector<std::string> out;
    for (auto& [sink, seq] : impl_->cursors)
        out.push_back(sink);
    return out;
}

StoreResult<Bytes> Journal::mark(std::string_view reader) const {
    auto& impl = *impl_;
    auto damage = [&](std::string_view which) {
        return tl::unexpected(damaged(impl.options.path,
                                      fmt::format("what came last from {} is not known: {}", reader, which)));
    };
    auto it = impl.mark_ids.find(std::string(reader));
    if (it == impl.mark_ids.end()) {
        // Of a damaged row the name, too, may be wrong.
        if (impl.damaged_marks != 0) return damage("a row of marks is not as it was stored");
        return Bytes{};
    }
    auto& statement = impl.statements.read_mark;
    auto step = statement.bind(1, it->second).step();
    if (step == Step::failed) {
        auto error = impl.db.error("read");
        statement.reset();
        return tl::unexpected(std::move(error));
    }
    Bytes mark;
    bool good = step == Step::row;
    if (good) {
        auto blob = statement.blob(0);
        good = statement.number(1) == checksum_mark(reader, blob);
        mark.assign(blob.begin(), blob.end());
    }
    statement.reset();
    if (!good) return damage("its mark is not as it was stored");
    return mark;
}

Untold Journal::untold() const {
    auto& state = impl_->state;
    return {state.untold, from_us(state.untold_since_us)};
}

ReadPointId Journal::read_point(std::string_view reader, std::string_view antenna, std::string_view zone) {
    return impl_->read_point({std::string(reader), std::string(antenna), std::string(zone)});
}

StoreResult<void> Journal::load_presence(const std::function<void(const PresenceRow&)>& each) {
    auto& impl = *impl_;
    auto rows = impl.db.prepare(select_presence);
    if (!rows) return tl::unexpected(rows.error());
    PresenceRow row;
    Step step;
    while ((step = rows->step()) == Step::row) {
        if (!take(*rows, row).sound())
            return tl::unexpected(
                damaged(impl.options.path, fmt::format("presence row {} is not as it was stored", row.id)));
        each(row);
    }
    if (step == Step::failed) return impl.failed("read");
    return {};
}

StoreResult<void> Journal::try_to_append() {
    auto& impl = *impl_;
    if (auto shape = expect_shape(impl.db, migrations()); !shape) return shape;
    Transaction never_committed(impl.db);
    auto tried = never_committed.begin_write();
    if (tried)
        tried = impl.db.run(fmt::format(
            "UPDATE state SET sum = sum; "
            "INSERT INTO event_rows(seq, type, time_us, sum) VALUES({0}, 0, 0, 0); "
            "INSERT INTO event_details(seq, user) VALUES({0}, zeroblob(100)); "
            "INSERT INTO read_batches SELECT {0} + n, {0} + n, 0, 0, 0, 0, 0, zeroblob(3900) FROM numbers "
            "ORDER BY n LIMIT 8; "
            "INSERT INTO tags(id, technology, tag, sum) VALUES({1}, 0, x'', 0); "
            "INSERT OR REPLACE INTO generations VALUES({1}, {0}, 0); "
            "INSERT OR REPLACE INTO presence(id, state, tag, technology, zone_key, antenna_number, reads, "
            "first_seen_us, last_seen_us, first_is_new, sum) VALUES({2}, 0, x'', 0, '', 0, 0, 0, 0, 0, 0); "
            "INSERT INTO read_points SELECT {3}, '', '', '', 0; "
            "INSERT INTO marks SELECT ifnull(max(id), 0) + 1, '', x'', 0 FROM marks; "
            "INSERT INTO jobs(id, reader, op, detail, state, text, created_us, deadline_us, sum) "
            "SELECT ifnull(max(id), 0) + 1, '', '', '', '', '', 0, 0, 0 FROM jobs; "
            "INSERT OR REPLACE INTO reading VALUES('', 1); INSERT OR REPLACE INTO cursors VALUES('', 0); "
            "INSERT OR REPLACE INTO dead_letters VALUES(NULL, '', 0, 0, 0, '', '', 0)",
            impl.state.next_seq, impl.state.next_tag, impl.state.max_presence + 1,
            impl.read_points.size() + 1));
    if (tried) return {};
    if (impl.db.read_only() && ::access(impl.options.path.c_str(), W_OK) == 0)
        return tl::unexpected(damaged(impl.options.path, "it says that it may only be read"));
    if (tried.error().kind != StoreError::Kind::corrupt) return {};
    return tried;
}

std::uint64_t Journal::Impl::used_bytes() const {
    auto read = [](Statement& statement) {
        std::uint64_t value =
            statement.step() == Step::row ? static_cast<std::uint64_t>(statement.number(0)) : 0;
        statement.reset();
        return value;
    };
    auto& writable = const_cast<Statements&>(statements);
    auto pages = read(writable.pages), free = read(writable.free_pages);
    return (pages - std::min(pages, free)) * page_size;
}

Journal::Size Journal::size() const {
    auto& path = impl_->options.path;
    return {impl_->used_bytes(), size_of(path) + size_of(beside(path, log_suffix))};
}

std::string Journal::check() const {
    auto checked = check_store(impl_->options.path);
    if (!checked) return checked.error().error.text();
    return fmt::format("{}", fmt::join(checked->problems, "\n"));
}

}  // namespace gantry::journal
