#include <algorithm>

#include "protocols/harting/records.hpp"
#include "protocols/harting/shapes.hpp"

// The reply to Read Buffer, field by field (section 8). records.hpp has the fast way.
namespace gantry::harting::shapes {

using wire::Errc;
using wire::Fault;
using wire::Value;

namespace {

constexpr Layout rows = buffer_record;

// A part of a record: there when the bit is set. In the order of the wire.
struct Part {
    std::uint8_t tr1, tr2;
    std::string_view first;
    std::size_t size;
};
constexpr std::array parts = {
    Part{tr1_idd, 0, "TR-TYPE", 3},      Part{tr1_blocks, 0, "DB-N", 2},
    Part{tr1_timer, 0, "HOUR", 3},       Part{tr1_date, 0, "CENTURY", 5},
    Part{tr1_antenna, 0, "ANT", 1},      Part{tr1_antenna, tr2_statistics, "COUNT", 4},
    Part{0, tr2_input, "IN", 2},         Part{0, tr2_mac, "MAC", 1},
    Part{0, tr2_antennas, "ANT-CNT", 1}, Part{0, tr2_direction, "DIRECTION", 1}};
constexpr bool is_there(const Part& part, std::uint8_t tr1, std::uint8_t tr2) {
    return (tr1 & part.tr1) == part.tr1 && (tr2 & part.tr2) == part.tr2;
}

void decode_record_parts(std::uint8_t tr1, std::uint8_t tr2, wire::Reader& in, Fields& out) {
    for (auto& each : parts) {
        if (!is_there(each, tr1, tr2)) continue;
        wire::decode(part(rows, each.first, each.size), in, out);
        if (each.tr1 != tr1_blocks || in.fault()) continue;
        auto count = *out[out.size() - 2].value.get<std::int64_t>();
        auto size = *out[out.size() - 1].value.get<std::int64_t>();
        auto bytes = in.bytes(static_cast<std::size_t>(count * size), "DB");
        out.push_back({"DB", Value(Bytes(bytes.begin(), bytes.end()))});
    }
    if (in.fault() || in.left() == 0) return;
    auto rest = in.rest();
    out.push_back({std::string(rest_field), Value(Bytes(rest.begin(), rest.end()))});
}

wire::Result<void> encode_blocks(const Fields& record, std::size_t at, Bytes& out) {
    auto start = out.size();
    if (auto done = put(part(rows, "DB")[0], record, out); !done) return done;
    std::size_t count = static_cast<std::size_t>(out[at] << 8 | out[at + 1]) * out[at + 2];
    if (out.size() - start == count) return {};
    return tl::unexpected(Fault{Errc::bad_length, start, "DB", "expected DB-N times DB-SIZE bytes"});
}

wire::Result<void> encode_record_parts(std::uint8_t tr1, std::uint8_t tr2, const Fields& record, Bytes& out) {
    std::size_t used = 0;
    for (auto& each : parts) {
        if (!is_there(each, tr1, tr2)) continue;
        auto at = out.size();
        for (auto& row : part(rows, each.first, each.size))
            if (auto done = put(row, record, out); !done) return done;
        used += each.size;
        if (each.tr1 != tr1_blocks) continue;
        if (auto done = encode_blocks(record, at, out); !done) return done;
        ++used;
    }
    if (wire::find(record, rest_field) != nullptr) {
        if (auto done = put(part(rows, rest_field)[0], record, out); !done) return done;
        ++used;
    }
    if (used == record.size()) return {};
    return tl::unexpected(Fault{Errc::unknown_code, out.size(), "DATA-SETS",
                                "a record has a field that TR-DATA1 and TR-DATA2 do not name"});
}

}  // namespace

void decode_buffer_reply(wire::Reader& in, const Asked& /*asked*/, Fields& out) {
    auto tr1 = in.u8("TR-DATA1");
    std::uint8_t tr2 = 0;
    out.push_back({"TR-DATA1", Value(tr1)});
    if ((tr1 & tr1_extension) != 0) {
        tr2 = in.u8("TR-DATA2");
        out.push_back({"TR-DATA2", Value(tr2)});
    }
    if ((tr2 & tr2_extension) != 0) out.push_back({"TR-DATA3", Value(in.u8("TR-DATA3"))});
    Value::List list;
    std::size_t count = in.u16("DATA-SETS");
    if (count * 2 > in.left()) in.fail(Errc::truncated, "DATA-SETS");
    for (; count > 0 && !in.fault(); --count) {
        std::size_t size = in.u16("RecLen");
        if (size < 2) in.fail(Errc::bad_length, "RecLen");
        if (in.fault()) break;
        wire::Reader record(in.bytes(size - 2, "RecLen"), in.offset());
        Fields fields;
        decode_record_parts(tr1, tr2, record, fields);
        if (record.fault()) in.fail(record.fault()->code, record.fault()->field);
        list.emplace_back(std::move(fields));
    }
    out.push_back({"DATA-SETS", Value(std::move(list))});
}

wire::Result<void> encode_buffer_reply(const Fields& fields, Bytes& out) {
    if (auto fine = known_names(buffer_reply, fields); !fine) return fine;
    std::array<std::uint8_t, 3> tr{};
    std::size_t used = 1;
    for (std::size_t i = 0; i < tr.size(); ++i) {
        if (i > 0 && (tr[i - 1] & tr1_extension) == 0) break;
        if (auto done = put(buffer_reply[i], fields, out); !done) return done;
        tr[i] = out.back();
        ++used;
    }
    const auto* value = wire::find(fields, "DATA-SETS");
    const auto* list = value != nullptr ? value->get<Value::List>() : nullptr;
    if (list == nullptr || list->size() > 0xFFFF)
        return tl::unexpected(Fault{Errc::bad_value, out.size(), "DATA-SETS", "expected a list of records"});
    if (used != fields.size())
        return tl::unexpected(
            Fault{Errc::bad_value, out.size(), "TR-DATA1", "bit 7 says whether there is one more"});
    wire::Writer(out).u16(list->size());
    for (auto& item : *list) {
        const auto* record = item.get<Fields>();
        if (record == nullptr)
            return tl::unexpected(Fault{Errc::bad_value, out.size(), "DATA-SETS", "expected a record"});
        wire::Writer writer(out);
        auto at = writer.hole(2);
        if (auto done = encode_record_parts(tr[0], tr[1], *record, out); !done) return done;
        if (out.size() - at > 0xFFFF)
            return tl::unexpected(Fault{Errc::too_big, at, "DATA-SETS", "a record has at most 65535 bytes"});
        writer.patch_big_endian(at, out.size() - at, 2);
    }
    return {};
}

}  // namespace gantry::harting::shapes
