#include <algorithm>

#include <fmt/format.h>

#include "base/failpoint.hpp"
#include "journal/journal_impl.hpp"

namespace gantry::journal {

namespace {
// The log is copied into the file when it holds this much. Larger: fewer but longer pauses.
constexpr std::uint64_t log_bytes = 16 << 20;
// A reader that keeps an old state open keeps the log from starting again. Beyond half of max_size, and at
// least this, nothing more is written.
constexpr std::uint64_t least_log_limit = 4 << 20;

// Tags are given new rows after so much, so that rows only old events refer to can go with those.
constexpr Seq most_generation_seqs = 1 << 24;

std::optional<std::uint64_t> number_or_none(std::uint64_t number) {
    return number == 0 ? std::nullopt : std::optional(number);
}

void bind_optional(Statement& statement, int at, std::optional<std::int64_t> value) {
    if (value)
        statement.bind(at, *value);
    else
        statement.bind_null(at);
}
void bind_time(Statement& statement, int at, const std::optional<Wall>& time) {
    bind_optional(statement, at, time ? std::optional(storable_us(*time)) : std::nullopt);
}

std::string key_of(const ReadPoint& point) {
    std::string key;
    key.reserve(point.reader.size() + point.antenna.size() + point.zone.size() + 2);
    key.append(point.reader).append(1, '\0').append(point.antenna).append(1, '\0').append(point.zone);
    return key;
}

// A read that has no room in a record.
event::Event as_event(const Read& read) {
    event::Event event;
    event.seq = read.seq;
    event.type = event::Type::tag_read;
    event.technology = read.observation.technology;
    event.possible_repeat = read.possible_repeat;
    event.time = read.time;
    auto key = tag_key(read.observation);
    event.tag = key.tag;
    event.pc = key.pc;
    event.xpc = key.xpc;
    if (read.observation.rssi != Observation::no_rssi) event.rssi = read.observation.rssi;
    event.reads = read.observation.reads;
    if (read.observation.reader_time_us != 0) event.reader_time = from_us(read.observation.reader_time_us);
    return event;
}
}  // namespace

StoreResult<void> Journal::commit(Batch& batch) {
    auto& impl = *impl_;
    if (batch.empty()) return {};
    if (impl.broken)
        return tl::unexpected(StoreError{
            StoreError::Kind::io,
            {fmt::format("the store {} has failed and was not opened again", impl.options.path.string()),
             {}}});
    if (auto written = impl.write(batch); !written) {
        impl.forget_tags();
        if (written.error().kind == StoreError::Kind::io) impl.broken = true;
        if (written.error().kind != StoreError::Kind::full) return written;
        impl.was_full = true;
        return tl::unexpected(impl.why_full(std::move(written.error())));
    }
    batch.clear();
    impl.after_write();
    return {};
}

// Deleting events makes no room when it is not events that fill the store.
StoreError Journal::Impl::why_full(StoreError error) {
    if (!nothing_to_drop || used_bytes() < options.max_size / 2) return error;
    auto present = db.number("SELECT count(*) FROM presence");
    if (!present || *present == 0) return error;
    error.error = {
        fmt::format("the store {} is full, and it has no event left to drop: the {} tags present now "
                    "fill it, store.max_size is too small for them",
                    options.path.string(), *present),
        "raise store.max_size"};
    return error;
}

StoreResult<void> Journal::Impl::check_order(const Batch& batch) const {
    auto wrong = [&](std::string what) {
        return tl::unexpected(
            StoreError{StoreError::Kind::other, {fmt::format("cannot store a batch: {}", what), {}}});
    };
    auto event = batch.events.begin();
    auto read = batch.reads.begin();
    auto stored = [&](auto& item) { return item.seq < stored_below; };
    event = std::find_if_not(event, batch.events.end(), stored);
    read = std::find_if_not(read, batch.reads.end(), stored);
    for (auto seq = state.next_seq; seq < batch.next_seq; ++seq) {
        if (event != batch.events.end() && event->seq == seq)
            ++event;
        else if (read != batch.reads.end() && read->seq == seq)
            ++read;
        else
            return wrong(fmt::format("number {} is missing or out of order", seq));
    }
    if (event != batch.events.end() || read != batch.reads.end() || batch.next_seq < state.next_seq)
        return wrong(fmt::format("its numbers do not go on from {}", state.next_seq));
    return {};
}

StoreResult<void> Journal::Impl::write(const Batch& batch) {
    if (auto order = check_order(batch); !order) return order;
    if (db.wal_pages() * page_size > std::max(least_log_limit, options.max_size / 2)) {
        after_write();
        if (db.wal_pages() != 0)
            return tl::unexpected(StoreError{
                StoreError::Kind::other,
                {fmt::format(
                     "the log of the store {} has grown too long: another program keeps an old state open",
                     options.path.string()),
                 "close programs that read the store"}});
    }
    Transaction transaction(db);
    if (auto begun = transaction.begin_write(); !begun) return begun;
    auto time_us = storable_us(batch.time);
    auto next = state;
    if (generation_due(time_us))
        if (auto begun = begin_generation(state.next_seq, time_us); !begun) return begun;

    auto is_new = [&](auto& item) { return item.seq >= stored_below; };
    for (auto it = std::ranges::find_if(batch.events, is_new); it != batch.events.end(); ++it) {
        if (auto written = write_event(*it); !written) return written;
        if (it->type == event::Type::overflow && it->scope == store_scope)
            next.untold -= std::min(next.untold, it->count.value_or(0));
    }
    if (next.untold == 0) next.untold_since_us = 0;
    auto new_reads = std::span(std::ranges::find_if(batch.reads, is_new), batch.reads.end());
    if (auto written = write_reads(new_reads); !written) return written;
    for (auto& row : batch.presence) {
        if (auto written = write_presence(row); !written) return written;
        next.max_presence = std::max(next.max_presence, row.id);
    }
    for (auto id : batch.presence_deleted)
        if (!statements.presence_delete.bind(1, storable(id)).run()) return failed("write to");
    for (auto& [reader, mark] : batch.marks) {
        auto [known, added] = mark_ids.try_emplace(reader, next_mark);
        if (added) ++next_mark;
        auto id = known->second;
        auto& statement =
            statements.mark.bind(1, id).bind(2, std::string_view(reader)).bind(3, ByteView(mark));
        if (!statement.bind(4, std::int64_t{checksum_mark(reader, mark)}).run()) return failed("write to");
    }
    for (auto& [sink, seq] : batch.cursors)
        if (!statements.cursor.bind(1, std::string_view(sink)).bind(2, storable(seq)).run())
            return failed("write to");
    if (auto written = write_dead_letters(batch); !written) return written;
    if (auto written = write_jobs(batch); !written) return written;
    if (auto written = write_read_points(); !written) return written;

    next.next_seq = batch.next_seq;
    next.last_commit_us = time_us;
    next.next_tag = first_tag + tags.size();
    if (auto written = write_state(next, state.next_seq); !written) return written;
    die_at("inserted");  // and not committed
    if (auto done = transaction.commit(); !done) return done;

    state = std::move(next);
    // What may be stored already is still to come when this was a commit of cursors alone.
    if (!batch.events.empty() || !batch.reads.empty()) stored_below = 0;
    stored_read_points = read_points.size();
    for (auto& [sink, seq] : batch.cursors)
        cursors[sink] = seq;
    return {};
}

// The log goes into the file now and then, between commits. What fails here has lost nothing (the log is
// synced), but the disk can no longer be trusted.
void Journal::Impl::after_write() {
    auto due = std::min(log_bytes, std::max<std::uint64_t>(options.max_size / 8, 256 * 1024));
    if (failpoint("checkpoint_often")) due = 64 * 1024;
    if (db.wal_pages() * page_size < due) return;
    die_soon_at("in_checkpoint");
    if (auto copied = db.checkpoint(false); !copied && copied.error().kind == StoreError::Kind::io)
        broken = true;
}

StoreResult<void> Journal::Impl::write_state(const State& next, Seq expected) {
    auto& statement = statements.state;
    statement.bind(1, std::string_view(next.gateway_id))
        .bind(2, storable(next.epoch))
        .bind(3, storable(next.next_seq));
    statement.bind(4, next.last_commit_us)
        .bind(5, storable(next.next_tag))
        .bind(6, storable(next.max_presence));
    statement.bind(7, storable(next.untold)).bind(8, next.untold_since_us);
    statement.bind(9, std::int64_t{checksum(next)}).bind(10, storable(expected));
    if (!statement.run()) return failed("write to");
    if (db.changed_rows() != 1)
        return tl::unexpected(
            StoreError{StoreError::Kind::other,
                       {fmt::format("another gateway has written into {}", options.path.string()),
                        "stop one of the two"}});
    return {};
}

ReadPointId Journal::Impl::read_point(const ReadPoint& point) {
    auto id = static_cast<ReadPointId>(read_points.size() + 1);
    auto [it, added] = read_point_ids.try_emplace(key_of(point), id);
    if (added) read_points.push_back(point);
    return it->second;
}

StoreResult<void> Journal::Impl::write_read_points() {
    for (auto at = stored_read_points; at < read_points.size(); ++at) {
        auto& point = read_points[at];
        auto id = static_cast<ReadPointId>(at + 1);
        auto& statement =
            statements.read_point.bind(1, std::int64_t{id}).bind(2, std::string_view(point.reader));
        statement.bind(3, std::string_view(point.antenna)).bind(4, std::string_view(point.zone));
        if (!statement.bind(5, std::int64_t{checksum(id, point)}).run()) return failed("write to");
    }
    return {};
}

void Journal::Impl::forget_tags() {
    tags.clear();
    first_tag = 0;
}

bool Journal::Impl::generation_due(std::int64_t time_us) const {
    auto seqs = std::clamp<Seq>(options.max_size / 512, 1 << 16, most_generation_seqs);
    auto span_us = options.keep.count() / 8;
    return first_tag == 0 || tags.size() >= TagDictionary::max_tags ||
           state.next_seq - generation_seq >= seqs || time_us < generation_us ||
           time_us - generation_us > span_us;
}

StoreResult<void> Journal::Impl::begin_generation(Seq first_seq, std::int64_t time_us) {
    tags.clear();
    first_tag = state.next_tag;
    generation_seq = first_seq;
    generation_us = time_us;
    auto& statement = statements.generation.bind(1, storable(first_tag)).bind(2, storable(first_seq));
    if (!statement.bind(3, time_us).run()) return failed("write to");
    return {};
}

StoreResult<std::uint32_t> Journal::Impl::tag_offset(const TagKey& tag) {
    auto [offset, added] = tags.find_or_add(tag);
    if (!added) return offset;
    if (offset >> (8 * RecordLayout::tag.size) != 0)
        return tl::unexpected(
            StoreError{StoreError::Kind::other, {"a batch has too many different tags", {}}});
    auto row = describe(first_tag + offset, tag);
    auto& statement = statements.tag.bind(1, storable(row.id));
    statement.bind(2, static_cast<std::int64_t>(row.technology)).bind(3, row.tag.view());
    statement.bind(4, std::string_view(row.epc)).bind(5, std::string_view(row.gs1));
    statement.bind(6, std::string_view(row.link)).bind(7, std::int64_t{checksum(row)});
    bind_optional(statement, 8, number_or_none(row.pc));
    bind_optional(statement, 9, number_or_none(row.xpc));
    if (!statement.run()) return failed("write to");
    return offset;
}

StoreResult<void> Journal::Impl::write_event(const event::Event& event) {
    ReadPointId point = 0;
    if (!event.reader.empty() || !event.antenna.empty() || !event.zone.empty())
        point = read_point({event.reader, event.antenna, event.zone});
    std::uint64_t tag = 0;
    if (has_tag(event)) {
        auto offset = tag_offset(tag_key(event));
        if (!offset) return tl::unexpected(offset.error());
        tag = first_tag + *offset;
    }
    auto& statement =
        statements.event.bind(1, storable(event.seq)).bind(2, static_cast<std::int64_t>(event.type));
    statement.bind(3, storable_us(event.time));
    bind_optional(statement, 4, number_or_none(point));
    bind_optional(statement, 5, number_or_none(tag));
    bind_optional(statement, 6, event.rssi);
    bind_optional(statement, 7, event.reads == 0 ? std::nullopt : std::optional(storable(event.reads)));
    bind_time(statement, 8, event.first_seen);
    bind_time(statement, 9, event.last_seen);
    bind_time(statement, 10, event.reader_time);
    if (!statement.bind(11, std::int64_t{checksum(event, point, tag)}).run()) return failed("write to");
    if (has_details(event)) return write_details(event);
    return {};
}

StoreResult<void> Journal::Impl::write_details(const event::Event& e) {
    auto& statement = statements.details.bind(1, storable(e.seq)).bind(2, std::string_view(e.from));
    statement.bind(3, std::string_view(e.to))
        .bind(4, std::string_view(e.reason))
        .bind(5, std::string_view(e.text));
    bind_optional(statement, 6, e.code);
    statement.bind(7, ByteView(e.bytes));
    bind_optional(statement, 8, e.input);
    bind_optional(statement, 9, e.state ? std::optional<std::int64_t>(*e.state) : std::nullopt);
    statement.bind(10, std::string_view(e.scope));
    bind_optional(statement, 11, e.count ? std::optional(storable(*e.count)) : std::nullopt);
    bind_time(statement, 12, e.since);
    statement.bind(13, std::string_view(e.by));
    bind_optional(statement, 14, e.possible_repeat ? std::optional<std::int64_t>(1) : std::nullopt);
    if (!statement.bind(15, ByteView(e.user)).bind(16, ByteView(e.tid)).run()) return failed("write to");
    return {};
}

StoreResult<void> Journal::Impl::write_reads(std::span<const Read> reads) {
    while (!reads.empty()) {
        if (!fits_record(reads.front()) || reads.front().read_point > read_points.size()) {
            auto event = as_event(reads.front());
            if (auto at = reads.front().read_point; at != 0 && at <= read_points.size()) {
                auto& point = read_points[at - 1];
                event.reader = point.reader;
                event.antenna = point.antenna;
                event.zone = point.zone;
            }
            if (auto written = write_event(event); !written) return written;
            reads = reads.subspan(1);
            continue;
        }
        BatchHead head;
        auto count = plan_batch(reads, head);
        head.first_tag = first_tag;
        records.clear();
        for (auto& read : reads.first(count)) {
            auto offset = tag_offset(tag_key(read.observation));
            if (!offset) return tl::unexpected(offset.error());
            pack(read, *offset, head, records);
        }
        auto& statement = statements.batch.bind(1, storable(head.first_seq)).bind(2, storable(head.last_seq));
        statement.bind(3, head.time_us).bind(4, head.last_time_us).bind(5, storable(head.first_tag));
        statement.bind(6, std::int64_t{head.count}).bind(7, std::int64_t{checksum(head, records)});
        if (!statement.bind(8, ByteView(records)).run()) return failed("write to");
        reads = reads.subspan(count);
    }
    return {};
}

StoreResult<void> Journal::Impl::write_presence(const PresenceRow& row) {
    ReadPointId point = 0;
    if (!row.reader.empty() || !row.antenna.empty() || !row.zone.empty())
        point = read_point({row.reader, row.antenna, row.zone});
    auto epc = epc_of(row.tag, row.technology);
    Bytes readers;
    auto& statement = statements.presence.bind(1, storable(row.id)).bind(2, std::int64_t{row.state});
    statement.bind(3, row.tag.view()).bind(4, static_cast<std::int64_t>(row.technology));
    statement.bind(5, std::string_view(epc))
        .bind(6, std::string_view(row.zone_key))
        .bind(7, std::int64_t{point});
    statement.bind(8, std::int64_t{row.antenna_number});
    bind_optional(statement, 9, row.rssi);
    statement.bind(10, storable(row.reads))
        .bind(11, storable_us(row.first_seen))
        .bind(12, storable_us(row.last_seen));
    statement.bind(13, std::int64_t{row.first_is_new});
    if (row.readers.size() == 1 && row.readers.front() == row.reader) {
        statement.bind_null(14);
    } else {
        readers = pack_names(row.readers);
        statement.bind(14, ByteView(readers));
    }
    bind_optional(statement, 16, number_or_none(row.pc));
    bind_optional(statement, 17, number_or_none(row.xpc));
    if (!statement.bind(15, std::int64_t{checksum(row, point)}).run()) return failed("write to");
    return {};
}

}  // namespace gantry::journal
