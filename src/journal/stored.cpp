#include "journal/stored.hpp"

#include <array>

namespace gantry::journal {

const std::string_view select_state =
    "SELECT id, gateway_id, epoch, next_seq, last_commit_us, next_tag, max_presence, untold, "
    "untold_since_us, sum "
    "FROM state";
const std::string_view select_read_points = "SELECT id, reader, antenna, zone, sum FROM read_points";
const std::string_view select_tags = "SELECT id, technology, tag, epc, gs1, link, sum, pc, xpc FROM tags";
const std::string_view select_events =
    R"(SELECT e.seq, e.type, e.time_us, e.read_point, e.tag, e.rssi, e.reads, e.first_seen_us, e.last_seen_us,
 e.reader_time_us, e.sum, d.seq, d."from", d."to", d.reason, d.text, d.code, d.bytes, d.input, d.state, d.scope,
 d.count, d.since_us, d."by", d.possible_repeat, d.user, d.tid
FROM event_rows e LEFT JOIN event_details d ON d.seq = e.seq)";
const std::string_view select_batches =
    "SELECT first_seq, last_seq, time_us, last_time_us, first_tag, count, sum, records FROM read_batches";
const std::string_view select_presence =
    R"(SELECT r.id, r.state, r.tag, r.technology, r.zone_key, r.read_point, r.antenna_number, r.rssi, r.reads,
 r.first_seen_us, r.last_seen_us, r.first_is_new, r.readers, r.sum, p.id, p.reader, p.antenna, p.zone, r.pc, r.xpc
FROM presence r LEFT JOIN read_points p ON p.id = r.read_point)";
const std::string_view select_marks = "SELECT id, reader, mark, sum FROM marks";
const std::string_view select_jobs =
    "SELECT id, reader, op, detail, state, text, created_us, deadline_us, ended_us, sum FROM jobs";
const std::string_view select_dead_letters =
    "SELECT id, sink, seq, time_us, tries, reason, event, sum FROM dead_letters";
const std::string_view select_earlier_ids =
    "SELECT last_seq, next_seq, gateway_id, epoch, sum FROM earlier_ids";

namespace {
template <class Number>
Number number(const Statement& row, int column) {
    return static_cast<Number>(row.number(column));
}
std::optional<Wall> time(const Statement& row, int column) {
    if (row.is_null(column)) return {};
    return from_us(row.number(column));
}
Bytes bytes(const Statement& row, int column) {
    auto blob = row.blob(column);
    return {blob.begin(), blob.end()};
}
}  // namespace

RowSum take(const Statement& row, State& s) {
    s.gateway_id = row.text(1);
    s.epoch = number<std::uint64_t>(row, 2);
    s.next_seq = number<Seq>(row, 3);
    s.last_commit_us = row.number(4);
    s.next_tag = number<std::uint64_t>(row, 5);
    s.max_presence = number<std::uint64_t>(row, 6);
    s.untold = number<std::uint64_t>(row, 7);
    s.untold_since_us = row.number(8);
    auto right = checksum(s);
    // The row that a new store is made with has none yet.
    if (row.is_null(9) && s.next_seq == 1 && s.epoch == 0 && s.untold == 0) return {right, right};
    return {row.number(9), right};
}

RowSum take(const Statement& row, ReadPointId& id, ReadPoint& into) {
    id = number<ReadPointId>(row, 0);
    into = {std::string(row.text(1)), std::string(row.text(2)), std::string(row.text(3))};
    return {row.number(4), checksum(id, into)};
}

RowSum take(const Statement& row, TagRow& into) {
    auto tag = row.blob(2);
    if (tag.size() > event::TagId::max_size) return {};
    into.id = number<std::uint64_t>(row, 0);
    into.technology = number<event::Technology>(row, 1);
    into.tag = event::TagId(tag);
    into.epc = row.text(3);
    into.gs1 = row.text(4);
    into.link = row.text(5);
    into.pc = number<std::uint16_t>(row, 7);
    into.xpc = number<std::uint32_t>(row, 8);
    return {row.number(6), checksum(into)};
}

RowSum take(const Statement& row, event::Event& e, ReadPointId& read_point, std::uint64_t& tag) {
    e.seq = number<Seq>(row, 0);
    e.type = number<event::Type>(row, 1);
    e.time = from_us(row.number(2));
    read_point = number<ReadPointId>(row, 3);
    tag = number<std::uint64_t>(row, 4);
    if (!row.is_null(5)) e.rssi = number<std::int16_t>(row, 5);
    e.reads = number<std::uint64_t>(row, 6);
    e.first_seen = time(row, 7);
    e.last_seen = time(row, 8);
    e.reader_time = time(row, 9);
    if (!row.is_null(11)) {
        e.from = row.text(12);
        e.to = row.text(13);
        e.reason = row.text(14);
        e.text = row.text(15);
        if (!row.is_null(16)) e.code = row.number(16);
        e.bytes = bytes(row, 17);
        if (!row.is_null(18)) e.input = row.number(18);
        if (!row.is_null(19)) e.state = row.number(19) != 0;
        e.scope = row.text(20);
        if (!row.is_null(21)) e.count = number<std::uint64_t>(row, 21);
        e.since = time(row, 22);
        e.by = row.text(23);
        e.possible_repeat = row.number(24) != 0;
        e.user = bytes(row, 25);
        e.tid = bytes(row, 26);
    }
    return {row.number(10), checksum(e, read_point, tag)};
}

RowSum take(const Statement& row, BatchHead& head, ByteView& records) {
    head.first_seq = number<Seq>(row, 0);
    head.last_seq = number<Seq>(row, 1);
    head.time_us = row.number(2);
    head.last_time_us = row.number(3);
    head.first_tag = number<std::uint64_t>(row, 4);
    head.count = number<std::uint32_t>(row, 5);
    records = row.blob(7);
    if (records.size() != head.count * RecordLayout::size) return {};
    return {row.number(6), checksum(head, records)};
}

RowSum take(const Statement& row, PresenceRow& into) {
    auto tag = row.blob(2);
    auto point = row.number(5);
    auto names = unpack_names(row.blob(12));
    into.id = number<std::uint64_t>(row, 0);
    if (tag.size() > event::TagId::max_size || !names || (point != 0 && row.is_null(14))) return {};
    into.state = number<std::uint8_t>(row, 1);
    into.tag = event::TagId(tag);
    into.technology = number<event::Technology>(row, 3);
    into.zone_key = row.text(4);
    into.antenna_number = number<std::uint16_t>(row, 6);
    into.rssi = row.is_null(7) ? event::Rssi{} : number<std::int16_t>(row, 7);
    into.reads = number<std::uint64_t>(row, 8);
    into.first_seen = from_us(row.number(9));
    into.last_seen = from_us(row.number(10));
    into.first_is_new = row.number(11) != 0;
    into.reader = row.text(15);
    into.antenna = row.text(16);
    into.zone = row.text(17);
    into.pc = number<std::uint16_t>(row, 18);
    into.xpc = number<std::uint32_t>(row, 19);
    into.readers = row.is_null(12) ? std::vector{into.reader} : std::move(*names);
    return {row.number(13), checksum(into, static_cast<ReadPointId>(point))};
}

RowSum take(const Statement& row, MarkRow& into) {
    into.id = row.number(0);
    into.reader = row.text(1);
    into.mark = bytes(row, 2);
    return {row.number(3), checksum_mark(into.reader, into.mark)};
}

RowSum take(const Statement& row, JobRow& into) {
    into.id = number<std::uint64_t>(row, 0);
    into.reader = row.text(1);
    into.op = row.text(2);
    into.detail = row.text(3);
    into.state = row.text(4);
    into.text = row.text(5);
    into.created = from_us(row.number(6));
    into.deadline = from_us(row.number(7));
    into.ended = time(row, 8);
    return {row.number(9), checksum(into)};
}

RowSum take(const Statement& row, DeadLetter& into) {
    into.sink = row.text(1);
    into.seq = number<Seq>(row, 2);
    into.time = from_us(row.number(3));
    into.tries = number<std::uint64_t>(row, 4);
    into.reason = row.text(5);
    into.event = row.text(6);
    return {row.number(7), checksum(into)};
}

std::uint32_t checksum(const EarlierIds& row) {
    return Checksum{}.add(row.last_seq).add(row.next_seq).add(row.gateway_id).add(row.epoch).value();
}

RowSum take(const Statement& row, EarlierIds& into) {
    into.last_seq = number<Seq>(row, 0);
    into.next_seq = number<Seq>(row, 1);
    into.gateway_id = row.text(2);
    into.epoch = number<std::uint64_t>(row, 3);
    return {row.number(4), checksum(into)};
}

namespace {
template <class Row>
RowSum sum_of(const Statement& statement) {
    Row row;
    return take(statement, row);
}
RowSum sum_of_point(const Statement& statement) {
    ReadPointId id = 0;
    ReadPoint point;
    return take(statement, id, point);
}
RowSum sum_of_event(const Statement& statement) {
    event::Event event;
    ReadPointId point = 0;
    std::uint64_t tag = 0;
    return take(statement, event, point, tag);
}
RowSum sum_of_batch(const Statement& statement) {
    BatchHead head;
    ByteView records;
    return take(statement, head, records);
}
}  // namespace

std::span<const SummedTable> summed_tables() {
    static const std::array all = {
        SummedTable{"state", "id", "state", select_state, "id", sum_of<State>},
        SummedTable{"read_points", "id", "read point", select_read_points, "id", sum_of_point},
        SummedTable{"tags", "id", "tag row", select_tags, "id", sum_of<TagRow>},
        SummedTable{"event_rows", "seq", "event", select_events, "e.seq", sum_of_event},
        SummedTable{"read_batches", "first_seq", "the reads from", select_batches, "first_seq", sum_of_batch},
        SummedTable{"presence", "id", "presence row", select_presence, "r.id", sum_of<PresenceRow>},
        SummedTable{"marks", "id", "mark", select_marks, "id", sum_of<MarkRow>},
        SummedTable{"jobs", "id", "job", select_jobs, "id", sum_of<JobRow>},
        SummedTable{"dead_letters", "id", "dead letter", select_dead_letters, "id", sum_of<DeadLetter>},
        SummedTable{"earlier_ids", "last_seq", "earlier ids up to", select_earlier_ids, "last_seq",
                    sum_of<EarlierIds>},
    };
    return all;
}

}  // namespace gantry::journal
