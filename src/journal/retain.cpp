#include <algorithm>
#include <limits>

#include "journal/journal_impl.hpp"

// Retention: what may go goes, in slices small enough that commits between them do not wait long.
namespace gantry::journal {

namespace {
constexpr int slice_rows = 4096;
constexpr int slice_batches = 8;
constexpr int slice_tags = 4096;

constexpr Seq all = std::numeric_limits<std::int64_t>::max();

// In percent of max_size: where room is made, and until where.
constexpr std::uint64_t crowded = 90, comfortable = 85;
}  // namespace

// Everything up to here has been delivered to every sink. A sink that has no cursor yet has been given
// nothing.
Seq Journal::Impl::delivered() const {
    Seq least = all;
    for (auto& sink : options.sinks) {
        auto it = cursors.find(sink);
        least = std::min(least, it == cursors.end() ? 0 : it->second);
    }
    return least;
}

bool Journal::Impl::may_delete_delivered() const {
    return !options.sinks.empty();
}

StoreResult<Retained> Journal::retain(Wall now) {
    auto& impl = *impl_;
    if (impl.broken) return Retained{};
    auto done = impl.retain_slice(now);
    if (!done && done.error().kind == StoreError::Kind::io) impl.broken = true;
    if (done) impl.after_write();
    return done;
}

StoreResult<Retained> Journal::Impl::retain_slice(Wall now) {
    Retained out;
    Transaction transaction(db);
    if (auto begun = transaction.begin_write(); !begun) return tl::unexpected(begun.error());

    // By age, each table for itself: all of the oldest that are too old and delivered.
    auto now_us = storable_us(now);
    auto cutoff_us = storable_us(now - options.keep);
    auto safe = delivered();
    auto new_rows_scanned = rows_scanned, new_batches_scanned = batches_scanned;
    bool more = false;
    auto rows =
        old_until("SELECT seq, time_us FROM event_rows WHERE seq > ?1 AND seq <= ?2 ORDER BY seq LIMIT ?3",
                  cutoff_us, now_us, safe, new_rows_scanned, more);
    if (!rows) return tl::unexpected(rows.error());
    auto batches = old_until(
        "SELECT last_seq, last_time_us FROM read_batches WHERE first_seq > ?1 AND last_seq <= ?2 ORDER BY "
        "first_seq "
        "LIMIT ?3 / 512",
        cutoff_us, now_us, safe, new_batches_scanned, more);
    if (!batches) return tl::unexpected(batches.error());

    // For space.
    Dropped dropped;
    bool nothing_found = false;
    auto used = used_bytes();
    if (used * 100 > options.max_size * crowded) shrinking = true;
    if (used * 100 <= options.max_size * comfortable) shrinking = false;
    if ((shrinking || was_full) && *rows == 0 && *batches == 0) {
        auto slice = oldest_slice();
        if (!slice) return tl::unexpected(slice.error());
        auto allowed = may_delete_delivered() ? safe : 0;
        auto up_to = std::min(*slice, allowed);
        if (options.on_full == OnFull::drop_oldest) {
            auto counted = count_dropped(allowed, *slice);
            if (!counted) return tl::unexpected(counted.error());
            // An event that tells of drops would come back as a new one, and so for ever.
            if (counted->events > 1 || counted->telling == 0) {
                dropped = *counted;
                up_to = *slice;
            }
            nothing_found = up_to == 0;
        }
        *rows = *batches = up_to;
    }

    std::uint64_t erased = 0;
    if (*rows != 0) {
        auto done = erase_rows(*rows);
        if (!done) return tl::unexpected(done.error());
        erased += *done;
    }
    if (*batches != 0) {
        auto done = erase_batches(*batches);
        if (!done) return tl::unexpected(done.error());
        erased += *done;
    }
    out.deleted = erased - std::min(erased, dropped.events);
    auto tags_left = erase_tags();
    if (!tags_left) return tl::unexpected(tags_left.error());
    auto letters = erase_dead_letters(cutoff_us);
    if (!letters) return tl::unexpected(letters.error());
    out.dead_letters = *letters;
    if (auto done = erase_jobs(cutoff_us); !done) return tl::unexpected(done.error());
    // What is dropped and that it is not told yet are on the disk together, or a crash would lose the count.
    auto next = state;
    if (dropped.events != 0) {
        out.dropped = dropped.events;
        out.dropped_since = from_us(dropped.since_us);
        auto since_us = std::min(dropped.since_us, dropped.told_since_us);
        next.untold_since_us = next.untold == 0 ? since_us : std::min(next.untold_since_us, since_us);
        next.untold += dropped.events + dropped.told;
        if (auto written = write_state(next, state.next_seq); !written)
            return tl::unexpected(written.error());
    }
    if (auto done = transaction.commit(); !done) return tl::unexpected(done.error());
    state = std::move(next);
    rows_scanned = new_rows_scanned;
    batches_scanned = new_batches_scanned;
    was_full = false;
    nothing_to_drop = nothing_found;
    out.more = more || (shrinking && erased != 0) || *tags_left;
    return out;
}

// The number up to which all are older than the cutoff; 0: none. Events that are stamped in the future come
// from a clock that has since been set back: they go with the next old one behind them, and never hold it up.
StoreResult<Seq> Journal::Impl::old_until(const char* sql, std::int64_t cutoff_us, std::int64_t now_us,
                                          Seq up_to, Seq& scanned, bool& more) {
    auto statement = db.prepare(sql);
    if (!statement) return tl::unexpected(statement.error());
    statement->bind(1, storable(scanned)).bind(2, storable(up_to)).bind(3, std::int64_t{slice_rows});
    Seq found = 0, last = scanned;
    Step step;
    while ((step = statement->step()) == Step::row) {
        auto time_us = statement->number(1);
        if (time_us >= cutoff_us && time_us <= now_us) return found;
        last = static_cast<Seq>(statement->number(0));
        if (time_us < cutoff_us) found = last;
    }
    if (step == Step::failed) return failed("read");
    if (last != scanned) more = true;
    scanned = last;
    return found;
}

// A number so that few enough rows and batches lie up to it; 0: there is nothing.
StoreResult<Seq> Journal::Impl::oldest_slice() {
    auto row = db.number("SELECT max(seq) FROM (SELECT seq FROM event_rows ORDER BY seq LIMIT " +
                         std::to_string(slice_rows) + ")");
    if (!row) return tl::unexpected(row.error());
    auto batch =
        db.number("SELECT max(last_seq) FROM (SELECT last_seq FROM read_batches ORDER BY first_seq LIMIT " +
                  std::to_string(slice_batches) + ")");
    if (!batch) return tl::unexpected(batch.error());
    if (*row == 0) return static_cast<Seq>(*batch);
    if (*batch == 0) return static_cast<Seq>(*row);
    return static_cast<Seq>(std::min(*row, *batch));
}

// Counts what is about to be deleted though not every sink has it: numbers above `beyond`.
StoreResult<Journal::Impl::Dropped> Journal::Impl::count_dropped(Seq beyond, Seq up_to) {
    Dropped out;
    std::int64_t oldest = std::numeric_limits<std::int64_t>::max();
    auto rows = db.prepare("SELECT count(*), min(time_us) FROM event_rows WHERE seq > ?1 AND seq <= ?2");
    if (!rows) return tl::unexpected(rows.error());
    if (rows->bind(1, storable(beyond)).bind(2, storable(up_to)).step() != Step::row) return failed("read");
    out.events += static_cast<std::uint64_t>(rows->number(0));
    if (!rows->is_null(1)) oldest = rows->number(1);

    auto telling = db.prepare(
        "SELECT d.count, ifnull(d.since_us, e.time_us) FROM event_rows e JOIN event_details d ON d.seq = "
        "e.seq "
        "WHERE e.seq > ?1 AND e.seq <= ?2 AND e.type = ?3 AND d.scope = ?4");
    if (!telling) return tl::unexpected(telling.error());
    telling->bind(1, storable(beyond)).bind(2, storable(up_to));
    telling->bind(3, static_cast<std::int64_t>(event::Type::overflow)).bind(4, store_scope);
    out.told_since_us = oldest;
    Step step;
    while ((step = telling->step()) == Step::row) {
        ++out.telling;
        out.told += static_cast<std::uint64_t>(std::max<std::int64_t>(telling->number(0), 0));
        out.told_since_us = std::min(out.told_since_us, telling->number(1));
    }
    if (step == Step::failed) return failed("read");

    auto batches = db.prepare(
        "SELECT first_seq, last_seq, time_us, last_time_us, first_tag, count, records FROM read_batches "
        "WHERE last_seq > ?1 AND last_seq <= ?2 AND first_seq <= ?2");
    if (!batches) return tl::unexpected(batches.error());
    batches->bind(1, storable(beyond)).bind(2, storable(up_to));
    while ((step = batches->step()) == Step::row) {
        BatchHead head{static_cast<Seq>(batches->number(0)),
                       static_cast<Seq>(batches->number(1)),
                       batches->number(2),
                       batches->number(3),
                       0,
                       0};
        // A batch goes whole; of one that lies across the line only what is beyond it is lost.
        auto records_left = batches->blob(6);
        for (; records_left.size() >= RecordLayout::size;
             records_left = records_left.subspan(RecordLayout::size)) {
            auto record = unpack(records_left, head);
            if (record.seq <= beyond) continue;
            ++out.events;
            oldest = std::min(oldest, record.time_us);
        }
    }
    if (step == Step::failed) return failed("read");
    out.since_us = oldest;
    return out;
}

StoreResult<std::uint64_t> Journal::Impl::erase_rows(Seq up_to) {
    auto limit = std::to_string(up_to);
    if (auto done = db.run("DELETE FROM event_details WHERE seq <= " + limit); !done)
        return tl::unexpected(done.error());
    if (auto done = db.run("DELETE FROM event_rows WHERE seq <= " + limit); !done)
        return tl::unexpected(done.error());
    return static_cast<std::uint64_t>(db.changed_rows());
}

StoreResult<std::uint64_t> Journal::Impl::erase_batches(Seq up_to) {
    auto which = " FROM read_batches WHERE first_seq <= " + std::to_string(up_to) +
                 " AND last_seq <= " + std::to_string(up_to);
    auto reads = db.number("SELECT ifnull(sum(count), 0)" + which);
    if (!reads) return tl::unexpected(reads.error());
    if (auto done = db.run("DELETE" + which); !done) return tl::unexpected(done.error());
    return static_cast<std::uint64_t>(*reads);
}

StoreResult<Seq> Journal::Impl::oldest_seq() {
    auto row = db.number("SELECT ifnull(min(seq), 0) FROM event_rows");
    if (!row) return tl::unexpected(row.error());
    auto batch = db.number("SELECT ifnull(min(first_seq), 0) FROM read_batches");
    if (!batch) return tl::unexpected(batch.error());
    Seq oldest = state.next_seq;
    if (*row != 0) oldest = std::min(oldest, static_cast<Seq>(*row));
    if (*batch != 0) oldest = std::min(oldest, static_cast<Seq>(*batch));
    return oldest;
}

// Tags that only deleted events referred to. True when there are more of them.
StoreResult<bool> Journal::Impl::erase_tags() {
    auto oldest = oldest_seq();
    if (!oldest) return tl::unexpected(oldest.error());
    auto keep_from = db.number("SELECT ifnull(max(first_tag), 0) FROM generations WHERE first_seq <= " +
                               std::to_string(*oldest));
    if (!keep_from) return tl::unexpected(keep_from.error());
    auto first = db.number("SELECT ifnull(min(id), 0) FROM tags");
    if (!first) return tl::unexpected(first.error());
    if (*first == 0 || *first >= *keep_from) return false;
    auto until = std::min(*keep_from, *first + slice_tags);
    auto done = db.run("DELETE FROM tags WHERE id < " + std::to_string(until) +
                       "; DELETE FROM generations WHERE first_tag < " + std::to_string(until));
    if (!done) return tl::unexpected(done.error());
    return until < *keep_from;
}

}  // namespace gantry::journal
