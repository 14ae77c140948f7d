#include "journal/rows.hpp"

#include <algorithm>
#include <limits>

#include <fmt/format.h>

#include "epc/epc.hpp"
#include "journal/records.hpp"

namespace gantry::journal {

using event::Technology;

// UIDs of HF and 18000-6B tags are no EPCs, though their bytes may look like one.
static bool may_hold_epc(Technology technology) {
    return technology == Technology::epc_gen2 || technology == Technology::epc_gen1 ||
           technology == Technology::epc_1_19 || technology == Technology::unknown;
}

TagKey tag_key(const event::Event& event) {
    return {event.tag, event.technology, event.pc, event.xpc};
}

TagKey tag_key(const Observation& seen) {
    return {seen.tag, seen.technology, seen.pc, seen.xpc == Observation::no_xpc ? 0 : seen.xpc};
}

TagRow describe(std::uint64_t id, const TagKey& key) {
    TagRow row{id, key.tag, key.technology, key.pc, key.xpc, {}, {}, {}};
    if (key.tag.size == 0 || !may_hold_epc(key.technology)) return row;
    if (auto epc = epc::decode(key.tag.view())) {
        row.epc = std::move(epc->uri);
        row.gs1 = std::move(epc->gs1);
        row.link = std::move(epc->link);
    }
    return row;
}

std::string epc_of(const event::TagId& tag, Technology technology) {
    return describe(0, {tag, technology}).epc;
}

std::string State::id_prefix() const {
    return epoch == 0 ? gateway_id + ":" : fmt::format("{}:{}:", gateway_id, epoch);
}

std::int64_t storable(std::uint64_t number) {
    return static_cast<std::int64_t>(
        std::min<std::uint64_t>(number, std::numeric_limits<std::int64_t>::max()));
}

bool has_tag(const event::Event& event) {
    return event::is_tag(event.type) || event.tag.size != 0 || event.technology != Technology::unknown;
}

bool has_details(const event::Event& e) {
    return !e.from.empty() || !e.to.empty() || !e.reason.empty() || !e.text.empty() || e.code ||
           !e.bytes.empty() || e.input || e.state || !e.scope.empty() || e.count || e.since ||
           !e.by.empty() || e.possible_repeat || !e.user.empty() || !e.tid.empty();
}

std::uint32_t checksum(const event::Event& e, ReadPointId read_point, std::uint64_t tag) {
    Checksum sum;
    // Absent and zero differ in the bits that go in first.
    std::uint64_t present = 0;
    int bit = 0;
    auto note = [&](bool is_there) { present |= std::uint64_t{is_there} << bit++; };
    note(e.rssi.has_value());
    note(e.first_seen.has_value());
    note(e.last_seen.has_value());
    note(e.reader_time.has_value());
    note(e.code.has_value());
    note(e.input.has_value());
    note(e.state.has_value());
    note(e.state.value_or(false));
    note(e.count.has_value());
    note(e.since.has_value());
    note(e.possible_repeat);
    auto time = [](const std::optional<Wall>& t) { return t ? storable_us(*t) : 0; };
    sum.add(e.seq).add(std::uint64_t(e.type) | present << 8).add(storable_us(e.time));
    sum.add(std::uint64_t{read_point}).add(tag).add(std::int64_t{e.rssi.value_or(0)}).add(storable(e.reads));
    sum.add(time(e.first_seen)).add(time(e.last_seen)).add(time(e.reader_time));
    if (!has_details(e)) return sum.value();
    sum.add(e.from).add(e.to).add(e.reason).add(e.text).add(e.code.value_or(0)).add(ByteView(e.bytes));
    sum.add(e.input.value_or(0)).add(e.scope).add(storable(e.count.value_or(0))).add(time(e.since));
    sum.add(e.by).add(ByteView(e.user));
    // Versions 1 and 2 did not have it; what they stored is still good.
    if (!e.tid.empty()) sum.add(ByteView(e.tid));
    return sum.value();
}

// Versions before 5 did not have them; what they stored is still good.
static void add_words(Checksum& sum, std::uint16_t pc, std::uint32_t xpc) {
    if (pc != 0 || xpc != 0) sum.add(std::uint64_t{pc} << 32 | xpc);
}

std::uint32_t checksum(const TagRow& row) {
    Checksum sum;
    sum.add(row.id).add(std::uint64_t(row.technology)).add(row.tag.view());
    sum.add(row.epc).add(row.gs1).add(row.link);
    add_words(sum, row.pc, row.xpc);
    return sum.value();
}

std::uint32_t checksum(const State& s) {
    Checksum sum;
    sum.add(s.gateway_id).add(s.epoch).add(s.next_seq).add(s.last_commit_us);
    sum.add(s.next_tag).add(s.max_presence);
    // Version 1 did not have these; what it stored is still good.
    if (s.untold != 0 || s.untold_since_us != 0) sum.add(s.untold).add(s.untold_since_us);
    return sum.value();
}

std::uint32_t checksum(ReadPointId id, const ReadPoint& point) {
    return Checksum{}.add(std::uint64_t{id}).add(point.reader).add(point.antenna).add(point.zone).value();
}

std::uint32_t checksum(const PresenceRow& row, ReadPointId read_point) {
    Checksum sum;
    sum.add(row.id).add(row.tag.view()).add(std::uint64_t(row.technology)).add(std::uint64_t{row.state});
    sum.add(row.zone_key).add(std::uint64_t{read_point}).add(std::uint64_t{row.antenna_number});
    sum.add(std::uint64_t{row.rssi.has_value()})
        .add(std::int64_t{row.rssi.value_or(0)})
        .add(storable(row.reads));
    sum.add(storable_us(row.first_seen)).add(storable_us(row.last_seen)).add(std::uint64_t{row.first_is_new});
    for (auto& reader : row.readers)
        sum.add(reader);
    add_words(sum, row.pc, row.xpc);
    return sum.value();
}

std::uint32_t checksum(const JobRow& row) {
    Checksum sum;
    sum.add(row.id).add(row.reader).add(row.op).add(row.detail).add(row.state).add(row.text);
    sum.add(storable_us(row.created)).add(storable_us(row.deadline));
    return sum.add(row.ended ? storable_us(*row.ended) : 0).value();
}

std::uint32_t checksum(const DeadLetter& row) {
    Checksum sum;
    sum.add(row.sink).add(row.seq).add(storable_us(row.time)).add(row.tries);
    return sum.add(row.reason).add(row.event).value();
}

std::uint32_t checksum_mark(std::string_view reader, ByteView mark) {
    return Checksum{}.add(reader).add(mark).value();
}

Bytes pack_names(const std::vector<std::string>& names) {
    Bytes out;
    for (auto& name : names) {
        auto bytes = as_bytes(name).first(std::min<std::size_t>(name.size(), 0xFFFF));
        out.push_back(static_cast<std::uint8_t>(bytes.size() >> 8));
        out.push_back(static_cast<std::uint8_t>(bytes.size()));
        out.insert(out.end(), bytes.begin(), bytes.end());
    }
    return out;
}

std::optional<std::vector<std::string>> unpack_names(ByteView packed) {
    std::vector<std::string> names;
    while (!packed.empty()) {
        if (packed.size() < 2) return {};
        std::size_t size = static_cast<std::size_t>(packed[0]) << 8 | packed[1];
        packed = packed.subspan(2);
        if (packed.size() < size) return {};
        names.emplace_back(as_text(packed.first(size)));
        packed = packed.subspan(size);
    }
    return names;
}

}  // namespace gantry::journal
