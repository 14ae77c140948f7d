#include <algorithm>
#include <functional>
#include <limits>
#include <utility>

#include <fmt/format.h>

#include "journal/ids.hpp"
#include "journal/reader_impl.hpp"
#include "journal/schema.hpp"

namespace gantry::journal {

namespace {
// A query reads slice by slice and hands out each after its read transaction has ended: a slow consumer never
// keeps the log from being emptied, and memory stays bounded.
constexpr std::size_t slice_rows = 2048;
constexpr std::size_t slice_batches = 256;
constexpr std::size_t slice_records = 4096;
constexpr Seq last_number = std::numeric_limits<std::int64_t>::max();

bool has_hex_prefix(ByteView bytes, std::string_view prefix) {
    if (prefix.size() > 2 * bytes.size()) return false;
    for (std::size_t i = 0; i < prefix.size(); ++i) {
        auto nibble = i % 2 == 0 ? bytes[i / 2] >> 4 : bytes[i / 2] & 0xF;
        if ("0123456789ABCDEF"[nibble] != prefix[i]) return false;
    }
    return true;
}
}  // namespace

Reader::Reader(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Reader::~Reader() = default;

StoreResult<std::unique_ptr<Reader>> Reader::open(const std::filesystem::path& path) {
    auto db = Database::open(path, Database::Access::read);
    if (!db) return tl::unexpected(db.error());
    auto impl = std::make_unique<Impl>();
    impl->db = std::move(*db);
    if (auto current = expect_current_schema(impl->db); !current) return tl::unexpected(current.error());
    struct {
        Statement& statement;
        std::string sql;
    } all[] = {
        {impl->find_tag, fmt::format("{} WHERE id = ?1", select_tags)},
        {impl->find_point, fmt::format("{} WHERE id = ?1", select_read_points)},
        {impl->find_version, "PRAGMA data_version"},
    };
    for (auto& [statement, sql] : all) {
        auto prepared = impl->db.prepare(sql);
        if (!prepared) return tl::unexpected(prepared.error());
        statement = std::move(*prepared);
    }
    return std::unique_ptr<Reader>(new Reader(std::move(impl)));
}

StoreResult<IdPrefixes> Reader::id_prefixes() const {
    return read_id_prefixes(impl_->db);
}

std::string Reader::id_prefix() const {
    auto prefixes = id_prefixes();
    return prefixes ? prefixes->newest() : std::string();
}

StoreResult<Seq> Reader::last_seq() const {
    auto next = impl_->db.number("SELECT next_seq FROM state");
    if (!next) return tl::unexpected(next.error());
    return static_cast<Seq>(*next) - 1;
}

StoreResult<std::uint64_t> Reader::version() const {
    auto& statement = impl_->find_version;
    if (statement.step() != Step::row) {
        auto error = impl_->failed();
        statement.reset();
        return error;
    }
    auto version = static_cast<std::uint64_t>(statement.number(0));
    statement.reset();
    return version;
}

StoreResult<Reader::Impl::Plan> Reader::Impl::plan(const Filter& filter) {
    std::string where;
    if (filter.since) where += fmt::format(" AND e.time_us >= {}", to_us(*filter.since));
    if (filter.until) where += fmt::format(" AND e.time_us < {}", to_us(*filter.until));
    if (!filter.types.empty()) {
        where += " AND e.type IN (";
        for (auto type : filter.types)
            where += fmt::format("{}{}", where.back() == '(' ? "" : ",", static_cast<int>(type));
        where += ")";
    }
    auto order = filter.newest_first ? "DESC" : "ASC";
    auto rows = db.prepare(
        fmt::format("{} WHERE e.seq >= ?1 AND e.seq <= ?2{} ORDER BY e.seq {}", select_events, where, order));
    if (!rows) return tl::unexpected(rows.error());
    // A batch that begins before the range may reach into it: the one before is read too.
    auto batches = db.prepare(fmt::format(
        "{} WHERE first_seq >= ifnull((SELECT first_seq FROM read_batches WHERE first_seq <= ?1 ORDER BY "
        "first_seq DESC LIMIT 1), ?1) AND first_seq <= ?2 AND last_seq >= ?1 ORDER BY first_seq {}",
        select_batches, order));
    if (!batches) return tl::unexpected(batches.error());
    bool wants_reads =
        filter.types.empty() || std::ranges::find(filter.types, event::Type::tag_read) != filter.types.end();
    return Plan{filter, std::move(*rows), std::move(*batches), {}, wants_reads};
}

StoreResult<void> Reader::query(const Filter& filter,
                                const std::function<bool(const event::Event&)>& each) const {
    auto plan = impl_->plan(filter);
    if (!plan) return tl::unexpected(plan.error());
    Seq low = std::min(filter.after, last_number - 1) + 1;
    Seq high = filter.up_to == 0 ? last_number : std::min(filter.up_to, last_number);
    Impl::Slice slice;
    event::Event read;
    read.type = event::Type::tag_read;
    while (low <= high) {
        if (auto done = impl_->read_slice(*plan, filter.newest_first ? high : low, slice); !done) return done;
        auto row = slice.rows.begin();
        auto record = slice.records.begin();
        while (row != slice.rows.end() || record != slice.records.end()) {
            bool take_row =
                record == slice.records.end() ||
                (row != slice.rows.end() && (row->seq < record->first.seq) != filter.newest_first);
            if (take_row) {
                if (!each(*row++)) return {};
            } else {
                impl_->fill(record->first, *record->second, read);
                ++record;
                if (!each(read)) return {};
            }
        }
        if (slice.last) break;
        if (filter.newest_first)
            high = slice.end - 1;
        else
            low = slice.end + 1;
    }
    return {};
}

StoreResult<void> Reader::Impl::read_slice(Plan& plan, Seq from, Slice& slice) {
    bool down = plan.filter.newest_first;
    auto low = down ? std::min(plan.filter.after, last_number - 1) + 1 : from;
    auto high = down ? from : plan.filter.up_to == 0 ? last_number : std::min(plan.filter.up_to, last_number);
    slice.rows.clear();
    slice.records.clear();
    slice.end = down ? low : high;
    slice.last = true;
    Transaction transaction(db);
    if (auto begun = transaction.begin_read(); !begun) return begun;
    if (plan.wants_reads) {
        plan.batches.bind(1, storable(low)).bind(2, storable(high));
        auto batches = read_batches(plan, low, high, slice);
        plan.batches.reset();
        if (!batches) return batches;
        (down ? low : high) = slice.end;
    }
    plan.rows.bind(1, storable(low)).bind(2, storable(high));
    auto rows = read_rows(plan, slice);
    plan.rows.reset();
    if (!rows) return rows;
    // The rows may have ended the slice earlier; reads beyond would come out of order.
    auto beyond = [&](Seq seq) { return down ? seq < slice.end : seq > slice.end; };
    while (!slice.records.empty() && beyond(slice.records.back().first.seq))
        slice.records.pop_back();
    return {};
}

StoreResult<void> Reader::Impl::read_rows(Plan& plan, Slice& slice) {
    // Rows that a pattern leaves out cost no memory, but time: a slice ends after so many.
    std::size_t seen = 0;
    Step step;
    while ((step = plan.rows.step()) == Step::row) {
        auto seq = static_cast<Seq>(plan.rows.number(0));
        auto& event = slice.rows.emplace_back();
        auto wanted = read_event(event, plan);
        if (!wanted && !passes_over(plan, wanted.error())) return tl::unexpected(wanted.error());
        if (!wanted || !*wanted) slice.rows.pop_back();
        if (slice.rows.size() < slice_rows && ++seen < 8 * slice_rows) continue;
        slice.end = seq;
        slice.last = false;
        return {};
    }
    if (step == Step::failed) return failed();
    return {};
}

StoreResult<bool> Reader::Impl::read_event(event::Event& e, Plan& plan) {
    auto wanted = wanted_point(plan, static_cast<ReadPointId>(plan.rows.number(3)));
    if (!wanted || !*wanted) return wanted;
    ReadPointId point_id = 0;
    std::uint64_t tag_id = 0;
    if (!take(plan.rows, e, point_id, tag_id).sound())
        return damage(fmt::format("event {} is not as it was stored", e.seq));
    if (point_id != 0) {
        auto names = point(point_id);
        if (!names) return tl::unexpected(names.error());
        e.reader = (*names)->reader;
        e.antenna = (*names)->antenna;
        e.zone = (*names)->zone;
    }
    if (tag_id != 0) {
        auto found = tag(tag_id);
        if (!found) return tl::unexpected(found.error());
        e.tag = (*found)->tag;
        e.technology = (*found)->technology;
        e.epc = (*found)->epc;
        e.gs1 = (*found)->gs1;
        e.link = (*found)->link;
        e.pc = (*found)->pc;
        e.xpc = (*found)->xpc;
    }
    return has_hex_prefix(e.tag.view(), plan.filter.tag);
}

StoreResult<void> Reader::Impl::read_batches(Plan& plan, Seq low, Seq high, Slice& slice) {
    auto& row = plan.batches;
    auto& filter = plan.filter;
    bool down = filter.newest_first;
    std::int64_t since = filter.since ? to_us(*filter.since) : std::numeric_limits<std::int64_t>::min();
    std::int64_t until = filter.until ? to_us(*filter.until) : std::numeric_limits<std::int64_t>::max();
    std::size_t taken = 0;
    auto& records_out = slice.records;
    Step step;
    while ((step = row.step()) == Step::row) {
        BatchHead head;
        ByteView records;
        auto sum = take(row, head, records);
        if (head.last_time_us < since || head.time_us >= until) continue;
        if (taken == slice_batches || records_out.size() >= slice_records) {
            // What is left begins here: the slice ends just before it.
            slice.end = down ? head.last_seq + 1 : head.first_seq - 1;
            slice.last = false;
            break;
        }
        if (!sum.sound()) {
            auto error = damage(
                fmt::format("the reads {} to {} are not as they were stored", head.first_seq, head.last_seq));
            if (!passes_over(plan, error.value())) return error;
            records = {};
        }
        auto begin = records_out.size();
        for (; !records.empty(); records = records.subspan(RecordLayout::size)) {
            auto record = unpack(records, head);
            if (record.seq < low || record.seq > high) continue;
            if (record.time_us < since || record.time_us >= until) continue;
            auto wanted = read_record(record, plan, slice);
            if (!wanted && !passes_over(plan, wanted.error())) return tl::unexpected(wanted.error());
        }
        if (down) std::reverse(records_out.begin() + static_cast<std::ptrdiff_t>(begin), records_out.end());
        ++taken;
    }
    if (step == Step::failed) return failed();
    return {};
}

// Into the slice, if it is wanted.
StoreResult<bool> Reader::Impl::read_record(const Record& record, Plan& plan, Slice& slice) {
    auto wanted = wanted_point(plan, record.read_point);
    if (!wanted || !*wanted) return wanted;
    if (record.read_point != 0)
        if (auto names = point(record.read_point); !names) return tl::unexpected(names.error());
    auto found = tag(record.tag);
    if (!found) return tl::unexpected(found.error());
    if (!has_hex_prefix((*found)->tag.view(), plan.filter.tag)) return false;
    slice.records.emplace_back(record, std::move(*found));
    return true;
}

// What is damaged is told and left out, if the query wants it so.
bool Reader::Impl::passes_over(Plan& plan, const StoreError& error) {
    constexpr std::size_t most_told = 1000;
    if (!plan.filter.on_damage || error.kind != StoreError::Kind::corrupt) return false;
    if (plan.damage_told.size() < most_told && plan.damage_told.insert(error.error.what).second)
        plan.filter.on_damage(error.error.what);
    return true;
}

StoreResult<std::vector<event::Event>> Reader::newest(const Filter& filter, std::size_t count) const {
    std::vector<event::Event> events;
    if (count == 0) return events;
    auto backwards = filter;
    backwards.newest_first = true;
    auto read = query(backwards, [&](const event::Event& event) {
        events.push_back(event);
        return events.size() < count;
    });
    if (!read) return tl::unexpected(read.error());
    std::ranges::reverse(events);
    return events;
}

}  // namespace gantry::journal
