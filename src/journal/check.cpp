// Whether a store is as it was stored. Reads in slices, each in a transaction of its own: a slice sees one
// state of the store, and the gateway's log is never held for long (but by SQLite's own check of the pages).
#include <algorithm>
#include <limits>
#include <unordered_set>

#include <fmt/format.h>

#include "base/text.hpp"
#include "journal/files.hpp"
#include "journal/ids.hpp"
#include "journal/schema.hpp"
#include "journal/stored.hpp"
#include "journal/upkeep.hpp"

namespace gantry::journal {

namespace {
constexpr std::int64_t slice_rows = 4096;
constexpr std::int64_t slice_batches = 256;

class Check {
public:
    Check(Database& db, const Progress& progress) : db_(db), progress_(progress) {}

    StoreResult<Checked> run() {
        using Part = StoreResult<void> (Check::*)();
        for (auto part : {&Check::head, &Check::pages, &Check::views, &Check::tables, &Check::numbers}) {
            auto done = (this->*static_cast<Part>(part))();
            if (done) continue;
            if (done.error().kind != StoreError::Kind::corrupt) return tl::unexpected(done.error());
            // What SQLite cannot read is one problem; the other parts may find more.
            problem(done.error().error.what);
        }
        return std::move(out_);
    }

private:
    void problem(std::string text) {
        std::ranges::replace(text, '\n', ' ');
        if (std::ranges::find(out_.problems, text) != out_.problems.end()) return;
        ++out_.problem_count;
        if (out_.problems.size() < Checked::most_problems) out_.problems.push_back(std::move(text));
    }
    tl::unexpected<StoreError> failed() const { return tl::unexpected(db_.error("read")); }
    StoreResult<void> go_on(std::uint64_t looked_at, std::uint64_t all) const {
        if (!progress_ || progress_(looked_at, all)) return {};
        return tl::unexpected(
            StoreError{StoreError::Kind::other, {"stopped before the end of the check", {}}});
    }
    StoreResult<std::int64_t> number(std::string_view sql) const { return db_.number(sql); }

    StoreResult<void> head();
    StoreResult<void> pages();
    StoreResult<void> views();
    StoreResult<void> tables();
    StoreResult<void> table(const SummedTable& table);
    StoreResult<void> numbers();
    struct Slice;
    StoreResult<void> slice(Seq from, Slice& slice);
    StoreResult<void> rows(Slice& slice);
    StoreResult<void> batches(Slice& slice);
    StoreResult<void> batch(const Statement& row, Slice& slice);
    void account(Slice& slice);
    StoreResult<bool> is_there(Statement& find, std::unordered_set<std::uint64_t>& known, std::uint64_t id);

    Database& db_;
    const Progress& progress_;
    Checked out_;
    Seq end_ = 0;  // the last number when the check began
    std::vector<EarlierIds> earlier_;
    Statement select_rows_, select_batches_, find_tag_, find_point_;
};

StoreResult<void> Check::head() {
    auto version = number("PRAGMA user_version");
    if (!version) return tl::unexpected(version.error());
    out_.version = static_cast<int>(*version);
    out_.bytes = size_of(db_.path());
    auto prefixes = read_id_prefixes(db_);
    if (!prefixes) return tl::unexpected(prefixes.error());
    out_.id_prefix = prefixes->newest();
    auto next = number("SELECT next_seq FROM state");
    if (!next) return tl::unexpected(next.error());
    out_.last_seq = end_ = static_cast<Seq>(*next) - 1;
    return {};
}

StoreResult<void> Check::pages() {
    auto rows = db_.prepare(fmt::format("PRAGMA integrity_check({})", Checked::most_problems));
    if (!rows) return tl::unexpected(rows.error());
    Step step;
    while ((step = rows->step()) == Step::row)
        if (rows->text(0) != "ok") problem(std::string(rows->text(0)));
    if (step == Step::failed) return failed();
    if (auto shape = expect_shape(db_, migrations()); !shape) {
        if (shape.error().kind != StoreError::Kind::corrupt) return shape;
        problem(shape.error().error.what);
    }
    auto count = number("SELECT count(*) FROM numbers WHERE n BETWEEN 0 AND 159");
    if (!count) return tl::unexpected(count.error());
    if (*count != static_cast<std::int64_t>(max_records))
        problem("the table `numbers` has not all of its rows: the view `events` leaves out reads");
    return {};
}

StoreResult<void> Check::views() {
    struct View {
        const char* name;
        std::string sql;
    };
    for (auto& [name, sql] : {View{"events", events_view()}, View{"present_tags", present_tags_view()}}) {
        auto stored = db_.prepare("SELECT sql FROM sqlite_master WHERE type = 'view' AND name = ?1");
        if (!stored) return tl::unexpected(stored.error());
        auto step = stored->bind(1, std::string_view(name)).step();
        if (step == Step::failed) return failed();
        if (step == Step::done || stored->text(0) != sql) {
            problem(fmt::format(
                "the view `{}` is not as this program makes it; a start of the gateway mends it", name));
            continue;
        }
        stored->reset();
        auto rows = db_.prepare(fmt::format("SELECT * FROM {} LIMIT 100", name));
        if (!rows) return tl::unexpected(rows.error());
        while ((step = rows->step()) == Step::row) {
        }
        if (step == Step::failed) return failed();
    }
    return {};
}

// Events and reads come with the numbers.
StoreResult<void> Check::tables() {
    auto beyond = db_.prepare("SELECT sink, seq FROM cursors WHERE seq >= (SELECT next_seq FROM state)");
    if (!beyond) return tl::unexpected(beyond.error());
    while (beyond->step() == Step::row)
        problem(fmt::format("the cursor of {} is at {}, where no event was yet", printable(beyond->text(0)),
                            beyond->number(1)));
    for (auto& each : summed_tables()) {
        if (each.name == "event_rows" || each.name == "read_batches") continue;
        auto done = table(each);
        if (done) continue;
        if (done.error().kind != StoreError::Kind::corrupt) return done;
        problem(done.error().error.what);
    }
    return {};
}

StoreResult<void> Check::table(const SummedTable& table) {
    auto slice = db_.prepare(
        fmt::format("{0} WHERE {1} > ?1 ORDER BY {1} LIMIT {2}", table.select, table.key_in_sql, slice_rows));
    if (!slice) return tl::unexpected(slice.error());
    std::int64_t after = std::numeric_limits<std::int64_t>::min(), seen = slice_rows;
    while (seen == slice_rows) {
        seen = 0;
        slice->bind(1, after);
        Step step;
        while ((step = slice->step()) == Step::row) {
            ++seen;
            after = slice->number(0);
            if (!table.sum(*slice).sound())
                problem(fmt::format("{} {} is not as it was stored", table.row_name, after));
        }
        if (step == Step::failed) return failed();
        slice->reset();
        if (auto on = go_on(0, end_); !on) return on;
    }
    return {};
}

// Numbers from `from` to `to`, as one state of the store has them.
struct Check::Slice {
    Seq from = 0, to = 0;
    Seq first_row = 0, first_batch = 0;        // of the tables; below them everything may have been deleted
    std::vector<Seq> seqs;                     // that are there
    std::vector<std::pair<Seq, Seq>> unknown;  // ranges of reads that are damaged
    std::unordered_set<std::uint64_t> tags, points;  // that are known to be there
};

StoreResult<void> Check::numbers() {
    struct {
        Statement& statement;
        std::string sql;
    } all[] = {
        {select_rows_, fmt::format("{} WHERE e.seq >= ?1 AND e.seq <= ?2 ORDER BY e.seq LIMIT {}",
                                   select_events, slice_rows)},
        {select_batches_,
         fmt::format("{} WHERE first_seq >= ifnull((SELECT first_seq FROM read_batches WHERE first_seq <= ?1 "
                     "ORDER BY first_seq DESC LIMIT 1), ?1) AND first_seq <= ?2 AND last_seq >= ?1 ORDER BY "
                     "first_seq LIMIT {}",
                     select_batches, slice_batches)},
        {find_tag_, "SELECT 1 FROM tags WHERE id = ?1"},
        {find_point_, "SELECT 1 FROM read_points WHERE id = ?1"},
    };
    for (auto& [statement, sql] : all) {
        auto prepared = db_.prepare(sql);
        if (!prepared) return tl::unexpected(prepared.error());
        statement = std::move(*prepared);
    }
    auto earlier = read_earlier_ids(db_);
    if (!earlier) return tl::unexpected(earlier.error());
    earlier_ = std::move(*earlier);
    auto orphans = number("SELECT count(*) FROM event_details WHERE seq NOT IN (SELECT seq FROM event_rows)");
    if (!orphans) return tl::unexpected(orphans.error());
    if (*orphans != 0) problem(fmt::format("{} rows of event_details belong to no event", *orphans));
    for (Seq from = 1; from <= end_;) {
        Slice part;
        auto done = slice(from, part);
        select_rows_.reset();
        select_batches_.reset();
        if (!done) return done;
        account(part);
        from = part.to + 1;
        if (auto on = go_on(part.to, end_); !on) return on;
    }
    return {};
}

StoreResult<void> Check::slice(Seq from, Slice& slice) {
    slice.from = from;
    slice.to = end_;
    Transaction transaction(db_);
    if (auto begun = transaction.begin_read(); !begun) return begun;
    auto first_row = number("SELECT ifnull(min(seq), 9223372036854775807) FROM event_rows");
    if (!first_row) return tl::unexpected(first_row.error());
    auto first_batch = number("SELECT ifnull(min(first_seq), 9223372036854775807) FROM read_batches");
    if (!first_batch) return tl::unexpected(first_batch.error());
    slice.first_row = static_cast<Seq>(*first_row);
    slice.first_batch = static_cast<Seq>(*first_batch);
    if (auto done = rows(slice); !done) return done;
    return batches(slice);
}

StoreResult<void> Check::rows(Slice& slice) {
    std::int64_t seen = 0;
    select_rows_.bind(1, storable(slice.from)).bind(2, storable(slice.to));
    Step step;
    while ((step = select_rows_.step()) == Step::row) {
        event::Event event;
        ReadPointId point = 0;
        std::uint64_t tag = 0;
        if (!take(select_rows_, event, point, tag).sound())
            problem(fmt::format("event {} is not as it was stored", event.seq));
        auto known = is_there(find_tag_, slice.tags, tag);
        if (!known) return tl::unexpected(known.error());
        if (!*known) problem(fmt::format("the tag of event {} is missing", event.seq));
        known = is_there(find_point_, slice.points, point);
        if (!known) return tl::unexpected(known.error());
        if (!*known) problem(fmt::format("the read point of event {} is missing", event.seq));
        slice.seqs.push_back(event.seq);
        if (++seen == slice_rows) slice.to = event.seq;
    }
    if (step == Step::failed) return failed();
    return {};
}

StoreResult<void> Check::batches(Slice& slice) {
    std::int64_t seen = 0;
    select_batches_.bind(1, storable(slice.from)).bind(2, storable(slice.to));
    Step step;
    while ((step = select_batches_.step()) == Step::row) {
        if (auto done = batch(select_batches_, slice); !done) return done;
        if (++seen == slice_batches)
            slice.to = std::min(slice.to, static_cast<Seq>(select_batches_.number(1)));
    }
    if (step == Step::failed) return failed();
    return {};
}

StoreResult<void> Check::batch(const Statement& row, Slice& slice) {
    BatchHead head;
    ByteView records;
    auto sum = take(row, head, records);
    bool is_new = head.first_seq >= slice.from;  // else the slice before has told
    auto name = fmt::format("the reads {} to {}", head.first_seq, head.last_seq);
    if (!sum.sound()) {
        if (is_new) problem(name + " are not as they were stored");
        // Of the last number, too, nobody knows whether it is right.
        slice.unknown.emplace_back(head.first_seq,
                                   std::max(head.first_seq, std::min(head.last_seq, slice.to)));
        return {};
    }
    bool tag_missing = false, point_missing = false;
    for (; !records.empty(); records = records.subspan(RecordLayout::size)) {
        auto record = unpack(records, head);
        if (record.seq >= slice.from) slice.seqs.push_back(record.seq);
        auto known = is_there(find_tag_, slice.tags, record.tag);
        if (!known) return tl::unexpected(known.error());
        tag_missing = tag_missing || !*known;
        known = is_there(find_point_, slice.points, record.read_point);
        if (!known) return tl::unexpected(known.error());
        point_missing = point_missing || !*known;
    }
    if (is_new && tag_missing) problem("tags are missing of " + name);
    if (is_new && point_missing) problem("read points are missing of " + name);
    return {};
}

StoreResult<bool> Check::is_there(Statement& find, std::unordered_set<std::uint64_t>& known,
                                  std::uint64_t id) {
    if (id == 0 || known.contains(id)) return true;
    auto step = find.bind(1, storable(id)).step();
    if (step == Step::failed) {
        auto error = failed();
        find.reset();
        return error;
    }
    find.reset();
    if (step == Step::row) known.insert(id);
    return step == Step::row;
}

// Retention deletes from the front of each table, so numbers may be missing only where one of the two does
// not begin yet, or where a restore left some out.
void Check::account(Slice& slice) {
    auto& seqs = slice.seqs;
    std::erase_if(seqs, [&](Seq seq) { return seq > slice.to; });
    std::ranges::sort(seqs);
    auto doubled = std::ranges::adjacent_find(seqs);
    if (doubled != seqs.end()) problem(fmt::format("the number {} is there twice", *doubled));
    seqs.erase(std::unique(seqs.begin(), seqs.end()), seqs.end());
    out_.events += seqs.size();

    // What explains that numbers are missing, but for deletion.
    auto explained = std::move(slice.unknown);
    for (auto& ids : earlier_)
        if (ids.next_seq > ids.last_seq + 1) explained.emplace_back(ids.last_seq + 1, ids.next_seq - 1);
    auto deleted_below = std::max(slice.first_row, slice.first_batch);
    auto missing = [&](Seq first, Seq last) {
        for (Seq at = first, end = last; at <= last; at = end + 1, end = last) {
            bool is_explained = false, is_deleted = at < deleted_below;
            if (is_deleted) end = std::min(end, deleted_below - 1);
            for (auto& [low, high] : explained) {
                if (low > at) end = std::min(end, low - 1);
                if (low > at || high < at) continue;
                end = std::min(last, high);
                is_explained = true;
                break;
            }
            if (is_explained) continue;
            if (is_deleted)
                out_.deleted += end - at + 1;
            else
                problem(fmt::format("{} missing, and nothing says that it was deleted",
                                    at == end ? fmt::format("event {} is", at)
                                              : fmt::format("what had the numbers {} to {} is", at, end)));
        }
    };
    Seq expected = slice.from;
    for (auto seq : seqs) {
        if (seq > expected) missing(expected, seq - 1);
        expected = seq + 1;
    }
    if (expected <= slice.to) missing(expected, slice.to);
}
}  // namespace

StoreResult<Checked> check_store(const std::filesystem::path& path, const Progress& progress) {
    auto db = Database::open(path, Database::Access::read);
    if (!db) return tl::unexpected(db.error());
    if (auto current = expect_current_schema(*db); !current) return tl::unexpected(current.error());
    return Check(*db, progress).run();
}

}  // namespace gantry::journal
