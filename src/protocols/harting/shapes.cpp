#include "protocols/harting/shapes.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "base/text.hpp"
#include "protocols/harting/tag_command.hpp"

namespace gantry::harting {

using shapes::put;
using wire::Errc;
using wire::Fault;
using wire::Fields;
using wire::Value;

namespace shapes {

wire::Result<void> put(const FieldRow& row, const Fields& fields, Bytes& out) {
    Fields one;
    if (const auto* value = wire::find(fields, row.name)) one.push_back({std::string(row.name), *value});
    return wire::encode(Layout(&row, 1), one, out);
}

wire::Result<void> known_names(Layout layout, const Fields& fields) {
    for (auto& field : fields) {
        if (std::ranges::find(layout, field.name, &FieldRow::name) != layout.end()) continue;
        std::vector<std::string_view> names;
        for (auto& row : layout)
            names.push_back(row.name);
        auto near = nearest(field.name, names);
        return tl::unexpected(Fault{Errc::unknown_code, 0, "field",
                                    near.empty() ? fmt::format("there is no field {}", printable(field.name))
                                                 : fmt::format("there is no field {}; did you mean {}?",
                                                               printable(field.name), near)});
    }
    return {};
}

Layout part(Layout layout, std::string_view first, std::size_t rows) {
    auto at = std::ranges::find(layout, first, &FieldRow::name) - layout.begin();
    return layout.subspan(static_cast<std::size_t>(at), rows);
}

wire::Result<void> put_part(Layout rows, const Fields& fields, Bytes& out) {
    for (auto& row : rows)
        if (auto done = put(row, fields, out); !done) return done;
    return {};
}

// --- Inventory ---------------------------------------------------------------------------------------------

void decode_inventory_request(wire::Reader& in, const Asked& /*asked*/, Fields& out) {
    auto mode = in.u8("MODE");
    out.push_back({"MODE", Value(mode)});
    if ((mode & inventory_antennas) != 0) out.push_back({"ANT-SEL", Value(in.u8("ANT-SEL"))});
}

wire::Result<void> encode_inventory_request(const Fields& fields, Bytes& out) {
    if (auto fine = known_names(inventory_request, fields); !fine) return fine;
    bool antennas = wire::find(fields, "ANT-SEL") != nullptr;
    auto at = out.size();
    if (wire::find(fields, "MODE") == nullptr)
        out.push_back(antennas ? inventory_antennas : 0);
    else if (auto done = put(inventory_request[0], fields, out); !done)
        return done;
    if (((out[at] & inventory_antennas) != 0) != antennas)
        return tl::unexpected(
            Fault{Errc::bad_value, at, "ANT-SEL",
                  antennas ? "needs MODE with ANT (0x10)" : "missing: MODE has ANT (0x10)"});
    if (!antennas) return {};
    return put(inventory_request[1], fields, out);
}

static void decode_inventory_tags(bool antennas, wire::Reader& in, Fields& out) {
    static constexpr Layout rows = inventory_record;
    Value::List list;
    std::size_t count = in.u8("DATA-SETS");
    if (count > in.left()) in.fail(Errc::truncated, "DATA-SETS");
    for (; count > 0 && !in.fault(); --count) {
        Fields record;
        std::uint8_t flags = record_has_tag;
        if (antennas) {
            flags = in.u8("FLAGS");
            record.push_back({"FLAGS", Value(flags)});
        }
        bool has_tag = (flags & record_has_tag) != 0;
        if (has_tag) wire::decode(rows.subspan(1, 3), in, record);
        if ((flags & record_has_antennas) != 0)
            wire::decode(has_tag ? rows.subspan(4, 1) : rows.subspan(5), in, record);
        list.emplace_back(std::move(record));
    }
    if (in.left() > 0) in.fail(Errc::trailing_bytes, "DATA-SETS");
    out.push_back({"DATA-SETS", Value(std::move(list))});
}

// Whether antennas are in it says the request; without it, what fits.
void decode_inventory_reply(wire::Reader& in, const Asked& asked, Fields& out) {
    auto all = in.rest();
    bool known = asked.request.size() >= 2;
    for (bool antennas : {false, true}) {
        if (known && antennas != ((asked.request[1] & inventory_antennas) != 0)) continue;
        wire::Reader tags(all);
        Fields fields;
        decode_inventory_tags(antennas, tags, fields);
        if (tags.fault()) continue;
        out.push_back(std::move(fields[0]));
        return;
    }
    in.fail(Errc::bad_length, "DATA-SETS");
}

wire::Result<void> encode_inventory_reply(const Fields& fields, Bytes& out) {
    static constexpr Layout rows = inventory_record;
    if (auto fine = known_names(inventory_reply, fields); !fine) return fine;
    const auto* value = wire::find(fields, "DATA-SETS");
    const auto* list = value != nullptr ? value->get<Value::List>() : nullptr;
    if (list == nullptr || list->size() > 0xFF)
        return tl::unexpected(Fault{Errc::bad_value, out.size(), "DATA-SETS", "expected a list of tags"});
    out.push_back(static_cast<std::uint8_t>(list->size()));
    for (auto& item : *list) {
        const auto* record = item.get<Fields>();
        if (record == nullptr)
            return tl::unexpected(Fault{Errc::bad_value, out.size(), "DATA-SETS", "expected a record"});
        if (auto fine = known_names(rows, *record); !fine) return fine;
        std::uint8_t flags = record_has_tag;
        if (wire::find(*record, "FLAGS") != nullptr) {
            if (auto done = put(rows[0], *record, out); !done) return done;
            flags = out.back();
        }
        bool has_tag = (flags & record_has_tag) != 0;
        if (has_tag)
            if (auto done = put_part(rows.subspan(1, 3), *record, out); !done) return done;
        if ((flags & record_has_antennas) != 0)
            if (auto done = put_part(has_tag ? rows.subspan(4, 1) : rows.subspan(5), *record, out); !done)
                return done;
    }
    return {};
}

// --- Read and Write Multiple Blocks ------------------------------------------------------------------------

void decode_read_blocks_reply(wire::Reader& in, const Asked& /*asked*/, Fields& out) {
    Value::List list;
    std::size_t count = in.u8("DB-N");
    std::size_t size = in.u8("DB-SIZE");
    if (in.left() != count * (size + 1)) in.fail(Errc::bad_length, "DB-N");
    for (; count > 0 && !in.fault(); --count) {
        auto status = in.u8("SEC-STATUS");
        auto block = in.bytes(size, "DB");
        list.emplace_back(
            Fields{{"SEC-STATUS", Value(status)}, {"DB", Value(Bytes(block.begin(), block.end()))}});
    }
    out.push_back({"DB-SIZE", Value(size)});
    out.push_back({"DB-N", Value(std::move(list))});
}

wire::Result<void> encode_read_blocks_reply(const Fields& fields, Bytes& out) {
    if (auto fine = known_names(read_blocks_reply, fields); !fine) return fine;
    Bytes blocks, size;
    if (auto done = put(read_blocks_reply[0], fields, size); !done) return done;
    if (auto done = put(read_blocks_reply[1], fields, blocks); !done) return done;
    if (blocks.size() != 1 + std::size_t{blocks[0]} * (std::size_t{size[0]} + 1))
        return tl::unexpected(
            Fault{Errc::bad_length, out.size(), "DB", "each block must have DB-SIZE bytes"});
    out.push_back(blocks[0]);
    out.push_back(size[0]);
    out.insert(out.end(), blocks.begin() + 1, blocks.end());
    return {};
}

// Only after a failure; one byte, or two with the extended address.
void decode_write_blocks_reply(wire::Reader& in, const Asked& asked, Fields& out) {
    bool failed = asked.status == static_cast<std::uint8_t>(Status::write_error) ||
                  asked.status == static_cast<std::uint8_t>(Status::tag_error);
    if (!failed || in.left() == 0 || in.left() > 2) return;
    wire::decode(write_blocks_reply, in, out);
}

wire::Result<void> encode_write_blocks_reply(const Fields& fields, Bytes& out) {
    if (auto fine = known_names(write_blocks_reply, fields); !fine || fields.empty()) return fine;
    auto start = out.size();
    if (auto done = put(write_blocks_reply[0], fields, out); !done) return done;
    if (auto size = out.size() - start; size == 1 || size == 2) return {};
    return tl::unexpected(Fault{Errc::bad_length, start, "DB-ADR-E", "expected one or two bytes"});
}

}  // namespace shapes

wire::Result<BlockData> parse_block_data(ByteView data) {
    wire::Reader in(data);
    BlockData blocks;
    std::size_t count = in.u8("DB-N");
    blocks.size = in.u8("DB-SIZE");
    if (!in.fault() && in.left() != count * (std::size_t{blocks.size} + 1)) in.fail(Errc::bad_length, "DB-N");
    for (std::size_t i = 0; i < count && !in.fault(); ++i) {
        auto status = in.u8("SEC-STATUS");
        auto block = in.bytes(blocks.size, "DB");
        if (status != 0 && blocks.bad_status == 0) {
            blocks.bad_status = status;
            blocks.first_bad = i;
        }
        blocks.data.insert(blocks.data.end(), block.begin(), block.end());
    }
    if (in.fault()) return tl::unexpected(*in.fault());
    return blocks;
}

void append_block_data(ByteView blocks, std::uint8_t size, Bytes& out) {
    auto count = size == 0 ? 0 : blocks.size() / size;
    out.push_back(static_cast<std::uint8_t>(count));
    out.push_back(size);
    for (std::size_t i = 0; i < count; ++i) {
        out.push_back(0);
        auto block = blocks.subspan(i * size, size);
        out.insert(out.end(), block.begin(), block.end());
    }
}

// --- the data of a frame -----------------------------------------------------------------------------------

static constexpr wire::FieldRow opaque_row = shapes::opaque[0];
static constexpr wire::FieldRow tag_error_row = shapes::number(tag_error_field, 1, {}, &tag_errors);

static bool take_raw(ByteView data, std::size_t kept, Fields& out) {
    out.resize(kept);
    out.push_back({std::string(raw_data), Value(Bytes(data.begin(), data.end()))});
    return false;
}

static bool decode_shape(const Shape& shape, const Asked& asked, ByteView data, Fields& out) {
    wire::Reader in(data);
    if (shape.decode != nullptr)
        shape.decode(in, asked, out);
    else
        wire::decode(shape.layout, in, out);
    return !in.fault() && in.left() == 0;
}

bool decode_request(const CommandRow& row, ByteView data, Fields& out) {
    auto kept = out.size();
    bool has_its_sub = !has_sub(row.control) || (!data.empty() && data[0] == row.sub);
    if (!has_its_sub) return take_raw(data, kept, out);
    auto rest = data.subspan(has_sub(row.control) ? 1 : 0);
    return decode_shape(row.request, {}, rest, out) || take_raw(rest, kept, out);
}

bool decode_reply(const CommandRow& row, ByteView request, std::uint8_t status, ByteView data, Fields& out) {
    auto kept = out.size();
    if (status == static_cast<std::uint8_t>(Status::ok))
        return decode_shape(row.reply, {request, status}, data, out) || take_raw(data, kept, out);
    if (data.empty()) return true;
    bool write_error = status == static_cast<std::uint8_t>(Status::write_error) &&
                       row.control == control_of(Command::write_multiple_blocks) &&
                       row.sub == sub_of(Command::write_multiple_blocks);
    if (!has_data(status) && !write_error) return take_raw(data, kept, out);
    auto rest = data;
    if (status == static_cast<std::uint8_t>(Status::tag_error)) {
        const auto* known = tag_errors.find(data[0]);
        out.push_back({std::string(tag_error_field),
                       known != nullptr ? Value(std::string(known->name)) : Value(data[0])});
        rest = data.subspan(1);
        if (rest.empty()) return true;
    }
    return decode_shape(row.reply, {request, status}, rest, out) || take_raw(data, kept, out);
}

static wire::Result<void> encode_shape(const Shape& shape, const Fields& fields, Bytes& out) {
    if (fields.size() == 1 && fields[0].name == raw_data) return put(opaque_row, fields, out);
    if (shape.opaque && fields.empty()) return {};
    return shape.encode != nullptr ? shape.encode(fields, out) : wire::encode(shape.layout, fields, out);
}

wire::Result<void> encode_request(const CommandRow& row, const Fields& fields, Bytes& out) {
    if (has_sub(row.control)) out.push_back(row.sub);
    return encode_shape(row.request, fields, out);
}

wire::Result<void> encode_reply(const CommandRow& row, std::uint8_t status, const Fields& fields,
                                Bytes& out) {
    const auto* error = wire::find(fields, tag_error_field);
    bool ok = status == static_cast<std::uint8_t>(Status::ok);
    if (fields.empty() && !ok) return {};
    if (error == nullptr || status != static_cast<std::uint8_t>(Status::tag_error))
        return encode_shape(row.reply, fields, out);
    if (auto done = put(tag_error_row, fields, out); !done) return done;
    Fields others;
    for (auto& field : fields)
        if (field.name != tag_error_field) others.push_back(field);
    if (others.empty()) return {};
    return encode_shape(row.reply, others, out);
}

}  // namespace gantry::harting
