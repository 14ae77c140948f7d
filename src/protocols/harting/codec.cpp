#include "protocols/harting/codec.hpp"

#include <algorithm>
#include <array>

#include <fmt/format.h>

#include "base/text.hpp"
#include "protocols/harting/frame.hpp"
#include "protocols/harting/tables.hpp"

namespace gantry::harting {

using wire::Direction;
using wire::Errc;
using wire::Fault;
using wire::FieldRow;
using wire::Fields;
using wire::Message;
using wire::Value;

static constexpr std::array<std::string_view, 4> extra_names = {"address", "status", "frame", "code"};
static constexpr std::string_view short_frame = "short";

namespace {

std::string_view general_name(std::uint8_t control) {
    return control == host_command ? host_command_name : epc_command_name;
}
std::size_t least_of(Direction direction) {
    return direction == Direction::to_host ? min_reply : min_request;
}
wire::Field raw_field(ByteView data) {
    return {std::string(raw_data), Value(Bytes(data.begin(), data.end()))};
}

// --- decode ------------------------------------------------------------------------------------------------

// Of data that only might be tags or blocks: is what they say known?
bool believable_tags(const Fields& fields) {
    constexpr std::int64_t known_flags = record_has_tag | record_has_antennas, last_iddt = 2;
    const auto* list = wire::find(fields, "DATA-SETS");
    if (list == nullptr) return false;
    return std::ranges::all_of(*list->get<Value::List>(), [](const Value& item) {
        const auto& record = *item.get<Fields>();
        const auto* flags = wire::find(record, "FLAGS");
        if (flags != nullptr && (*flags->get<std::int64_t>() & ~known_flags) != 0) return false;
        const auto* type = wire::find(record, "TR-TYPE");
        if (type == nullptr) return flags != nullptr;
        return type->get<std::string>() != nullptr &&
               *wire::find(record, "IDDT")->get<std::int64_t>() <= last_iddt;
    });
}
bool believable_blocks(const Fields& fields) {
    const auto* size = wire::find(fields, "DB-SIZE");
    return size != nullptr && *size->get<std::int64_t>() > 0;
}

// A reply that does not say what it answers.
void decode_general_reply(const Frame& frame, Message& message) {
    message.name = general_name(frame.control);
    if (frame.data.empty()) return;
    if (frame.status == static_cast<std::uint8_t>(Status::tag_error)) {
        wire::Reader in(frame.data);
        static constexpr FieldRow row = {
            .name = tag_error_field, .type = wire::Type::number, .size = 1, .enumeration = &tag_errors};
        wire::decode(wire::Layout(&row, 1), in, message.fields);
        if (in.left() > 0) message.fields.push_back(raw_field(in.rest()));
        return;
    }
    if (frame.control == host_command && has_data(frame.status))
        for (auto command : {Command::inventory, Command::read_multiple_blocks}) {
            Fields fields;
            bool fits = decode_reply(row_of(command), {}, frame.status, frame.data, fields);
            bool tags = command == Command::inventory;
            if (!fits || !(tags ? believable_tags(fields) : believable_blocks(fields))) continue;
            message.name = row_of(command).name;
            message.fields = std::move(fields);
            return;
        }
    message.fields.push_back(raw_field(frame.data));
}

Message message_of(const Frame& frame, Direction direction) {
    Message message;
    bool reply = direction == Direction::to_host;
    message.header.push_back({"address", Value(frame.address)});
    if (reply) {
        const auto* known = statuses.find(frame.status);
        message.header.push_back(
            {"status", known != nullptr ? Value(std::string(known->name)) : Value(frame.status)});
    }
    if (frame.is_short) message.header.push_back({"frame", Value(std::string(short_frame))});
    if (has_sub(frame.control) && reply) {
        decode_general_reply(frame, message);
        return message;
    }
    const auto* row = reply ? find_command(frame.control) : find_request(frame.control, frame.data);
    if (row == nullptr) {
        auto data = frame.data;
        message.name = has_sub(frame.control) ? general_name(frame.control) : unknown_name;
        if (!has_sub(frame.control)) {
            message.header.push_back({"code", Value(frame.control)});
        } else if (!data.empty()) {
            message.fields.push_back({std::string(sub_command_field), Value(data[0])});
            data = data.subspan(1);
        }
        if (!data.empty()) message.fields.push_back(raw_field(data));
        return message;
    }
    message.name = row->name;
    if (reply)
        decode_reply(*row, {}, frame.status, frame.data, message.fields);
    else
        decode_request(*row, frame.data, message.fields);
    return message;
}

bool may_start(ByteView in, Direction direction) {
    if (in[0] != stx) return false;
    return in.size() < 3 || static_cast<std::size_t>(in[1] << 8 | in[2]) >= least_of(direction);
}

Look look(ByteView input, Direction direction) {
    return input[0] == stx ? look_at(input, direction) : look_at_short(input, direction);
}

// Where decoding goes on. Almost any byte could start a short frame, so only a whole good one counts. At the
// end of all bytes a few that might have become a frame are none.
std::size_t next_start(ByteView input, Direction direction, bool end) {
    for (std::size_t at = 1; at < input.size(); ++at) {
        auto rest = input.subspan(at);
        if (rest[0] != stx) {
            if (look_at_short(rest, direction).what == Look::What::frame) return at;
        } else if (may_start(rest, direction) && (!end || rest.size() >= least_of(direction))) {
            return at;
        }
    }
    return input.size();
}

Fault fault_of(const Look& look, ByteView input) {
    switch (look.why) {
        case Errc::bad_checksum: {
            auto crc = crc_of(input.first(look.size - 2));
            return {Errc::bad_checksum, look.size - 2, "CRC16",
                    fmt::format("0x{}, expected 0x{:02X}{:02X}", to_hex(input.subspan(look.size - 2, 2)),
                                crc & 0xFF, crc >> 8)};
        }
        case Errc::bad_length:
            if (input[0] == stx)
                return {Errc::bad_length, 1, "ALENGTH",
                        fmt::format("{} bytes: no frame is that short", input[1] << 8 | input[2])};
            [[fallthrough]];
        default:
            return {Errc::bad_value, 0, "STX",
                    fmt::format("starts with 0x{:02X}, expected 0x{:02X}", input[0], stx)};
    }
}

// --- encode ------------------------------------------------------------------------------------------------

// A message as encode understood it.
struct Parts {
    const CommandRow* row = nullptr;
    std::uint8_t address = any_address, control = 0, status = 0;
    bool is_short = false;
    Fields fields;  // without those of the header
    Bytes data;
};

// Header members may stand among the fields: that is where a command line puts them.
const Value* find_extra(const Message& message, std::string_view name) {
    if (const auto* value = wire::find(message.header, name)) return value;
    return wire::find(message.fields, name);
}

wire::Result<std::uint8_t> byte_or(const Message& message, std::string_view name, std::int64_t fallback,
                                   const wire::Enumeration* enumeration = nullptr) {
    const auto* value = find_extra(message, name);
    auto number = value != nullptr ? wire::as_number(*value, enumeration) : fallback;
    if (number && *number >= 0 && *number <= 0xFF) return static_cast<std::uint8_t>(*number);
    return tl::unexpected(Fault{Errc::bad_value, 0, name,
                                enumeration != nullptr ? "expected a number from 0 to 255, or its name"
                                                       : "expected a number from 0 to 255"});
}

// The data of what has no row: raw, after the sub command or the tag's error.
wire::Result<void> general_data(const Message& message, Direction direction, Parts& parts) {
    bool general = message.name != unknown_name;
    bool reply = direction == Direction::to_host;
    std::size_t used = 0;
    auto front = reply ? tag_error_field : sub_command_field;
    bool takes_front = general && (!reply || parts.status == static_cast<std::uint8_t>(Status::tag_error));
    if (takes_front && wire::find(parts.fields, front) != nullptr) {
        auto byte = byte_or(message, front, 0, reply ? &tag_errors : nullptr);
        if (!byte) return tl::unexpected(byte.error());
        parts.data.push_back(*byte);
        ++used;
    }
    if (const auto* value = wire::find(parts.fields, raw_data)) {
        auto bytes = wire::as_raw(*value);
        if (!bytes)
            return tl::unexpected(Fault{Errc::bad_value, 0, raw_data, "expected hex digits, two a byte"});
        if (!bytes->empty() && takes_front && used == 0)
            return tl::unexpected(Fault{Errc::bad_value, 0, front, "missing: it stands before the data"});
        parts.data.insert(parts.data.end(), bytes->begin(), bytes->end());
        ++used;
    }
    if (used == parts.fields.size()) return {};
    return tl::unexpected(Fault{Errc::unknown_code, 0, "field",
                                takes_front ? fmt::format("{} has {} and {}", message.name, front, raw_data)
                                            : fmt::format("{} has {} alone", message.name, raw_data)});
}

wire::Result<void> head_parts(const Message& message, Direction direction, Parts& parts) {
    bool reply = direction == Direction::to_host;
    auto address = byte_or(message, "address", reply ? 0 : any_address);
    if (!address) return tl::unexpected(address.error());
    parts.address = *address;
    auto status = byte_or(message, "status", 0, &statuses);
    if (!status) return tl::unexpected(status.error());
    parts.status = *status;
    if (!reply && find_extra(message, "status") != nullptr)
        return tl::unexpected(Fault{Errc::bad_value, 0, "status", "only replies have one"});
    if (const auto* frame = find_extra(message, "frame")) {
        const auto* kind = frame->get<std::string>();
        parts.is_short = kind != nullptr && *kind == short_frame;
        if (!parts.is_short)
            return tl::unexpected(
                Fault{Errc::bad_value, 0, "frame", "expected \"short\"; leave it out for the usual frame"});
    }
    return {};
}

wire::Result<void> code_part(const Message& message, Parts& parts) {
    bool unknown = message.name == unknown_name;
    int own = parts.row != nullptr                ? parts.row->control
              : message.name == host_command_name ? host_command
              : message.name == epc_command_name  ? epc_command
                                                  : -1;
    if (unknown && find_extra(message, "code") == nullptr)
        return tl::unexpected(Fault{Errc::bad_value, 4, "code", "a message without a name needs its code"});
    auto code = byte_or(message, "code", own);
    if (!code) return tl::unexpected(code.error());
    parts.control = *code;
    if (!unknown && parts.control != own)
        return tl::unexpected(
            Fault{Errc::bad_value, 4, "code", fmt::format("{} has 0x{:02X}", message.name, own)});
    if (unknown && (has_sub(parts.control) || find_command(parts.control) != nullptr)) {
        auto name = has_sub(parts.control) ? general_name(parts.control) : find_command(parts.control)->name;
        return tl::unexpected(
            Fault{Errc::bad_value, 4, "code", fmt::format("0x{:02X} is {}", parts.control, name)});
    }
    return {};
}

std::size_t frame_size(const Parts& parts, Direction direction) {
    bool reply = direction == Direction::to_host;
    return parts.data.size() +
           (parts.is_short ? (reply ? min_short_reply : min_short_request) : least_of(direction));
}

wire::Result<Parts> parts_of(const Message& message, Direction direction) {
    Parts parts;
    parts.row = find_command(message.name);
    if (auto done = head_parts(message, direction, parts); !done) return tl::unexpected(done.error());
    if (auto done = code_part(message, parts); !done) return tl::unexpected(done.error());
    for (auto& field : message.fields)
        if (std::ranges::find(extra_names, field.name) == extra_names.end()) parts.fields.push_back(field);
    auto done = parts.row == nullptr ? general_data(message, direction, parts)
                : direction == Direction::to_host
                    ? encode_reply(*parts.row, parts.status, parts.fields, parts.data)
                    : encode_request(*parts.row, parts.fields, parts.data);
    if (!done) return tl::unexpected(done.error());
    std::size_t most = parts.is_short ? 0xFF : max_frame;
    if (auto size = frame_size(parts, direction); size > most)
        return tl::unexpected(Fault{Errc::too_big, most, "data",
                                    fmt::format("{} bytes with the frame; at most {} fit", size, most)});
    return parts;
}

void append_short(const Parts& parts, Direction direction, Bytes& out) {
    auto start = out.size();
    wire::Writer writer(out);
    writer.u8(frame_size(parts, direction));
    writer.u8(parts.address);
    writer.u8(parts.control);
    if (direction == Direction::to_host) writer.u8(parts.status);
    writer.bytes(parts.data);
    writer.little_endian(crc_of(ByteView(out).subspan(start)), 2);
}

bool has_name(std::string_view name) {
    return name == unknown_name || name == host_command_name || name == epc_command_name ||
           find_command(name) != nullptr;
}

Fault no_such_message(const Message& message, const wire::Codec& codec, Direction direction) {
    auto near = nearest(message.name, codec.names(direction));
    return Fault{Errc::unknown_code, 0, "message",
                 near.empty() ? fmt::format("there is no message {}; one without a name is {} with code=",
                                            printable(message.name), unknown_name)
                              : fmt::format("there is no message {}; did you mean {}?",
                                            printable(message.name), near)};
}

// --- names -------------------------------------------------------------------------------------------------

// All rows of a message, those of its records too.
template <class Visit>
void each_row(wire::Layout layout, const Visit& visit) {
    for (auto& row : layout) {
        visit(row);
        each_row(row.record, visit);
    }
}
template <class Visit>
void each_row(std::string_view message, Direction direction, const Visit& visit) {
    const auto* row = find_command(message);
    if (row == nullptr) return;
    each_row(direction == Direction::to_reader ? row->request.layout : row->reply.layout, visit);
    if (direction == Direction::to_reader) return;
    if (row == &row_of(Command::get_reader_info))
        for (auto& record : info_records())
            each_row(record.layout, visit);
    if (row == &row_of(Command::reader_diagnostic))
        for (auto& record : diagnostic_records())
            each_row(record.layout, visit);
}

class HartingCodec final : public wire::Codec {
public:
    wire::Decoded decode(ByteView input, Direction direction, bool end) const override {
        if (input.empty()) return {.length = 0, .more = !end};
        auto found = look(input, direction);
        if (found.what == Look::What::frame)
            return {.length = found.size, .message = message_of(found.frame, direction)};
        if (found.what == Look::What::more) {
            if (!end) return {.more = true};
            return {.length = next_start(input, direction, end),
                    .message = tl::unexpected(Fault{
                        Errc::truncated, input.size(), "frame",
                        fmt::format("{} bytes of {}{}", input.size(),
                                    input.size() < least_of(direction) ? "at least " : "", found.size)})};
        }
        auto fault = fault_of(found, input);
        // All but the CRC is right, and what follows looks as if the length were right too.
        bool trusted = found.framed && input[0] == stx &&
                       (input.size() == found.size || may_start(input.subspan(found.size), direction));
        return {.length = trusted ? found.size : next_start(input, direction, end),
                .message = tl::unexpected(std::move(fault))};
    }

    wire::Result<void> encode(const Message& message, Direction direction, Bytes& out) const override {
        if (!has_name(message.name)) return tl::unexpected(no_such_message(message, *this, direction));
        auto parts = parts_of(message, direction);
        if (!parts) return tl::unexpected(parts.error());
        if (parts->is_short)
            append_short(*parts, direction, out);
        else if (direction == Direction::to_host)
            append_reply(out, parts->address, parts->control, parts->status, parts->data);
        else
            append_request(out, parts->address, parts->control, parts->data);
        return {};
    }

    wire::Result<void> check(const Message& message, Direction direction) const override {
        if (!has_name(message.name)) return tl::unexpected(no_such_message(message, *this, direction));
        auto parts = parts_of(message, direction);
        if (!parts) return tl::unexpected(parts.error());
        if (parts->row == nullptr) return {};
        if (direction == Direction::to_host) return wire::check(parts->row->reply.layout, parts->fields);
        if (parts->is_short)
            return tl::unexpected(
                Fault{Errc::bad_value, 0, "frame", "the reader does not take short frames"});
        // As the reader sees them: with what a person may leave out.
        Fields fields;
        if (!decode_request(*parts->row, parts->data, fields) && !parts->row->request.opaque)
            return tl::unexpected(Fault{Errc::bad_length, 5, raw_data,
                                        fmt::format("these bytes are not the data of {}", parts->row->name)});
        return check_request(*parts->row, fields);
    }

    std::vector<std::string_view> names(Direction /*direction*/) const override {
        std::vector<std::string_view> names;
        for (auto& row : commands())
            names.push_back(row.name);
        names.push_back(host_command_name);
        names.push_back(epc_command_name);
        return names;
    }

    std::vector<std::string_view> field_names(std::string_view message, Direction direction) const override {
        std::vector<std::string_view> names;
        bool reply = direction == Direction::to_host;
        if (message == host_command_name || message == epc_command_name)
            return {reply ? tag_error_field : sub_command_field, raw_data};
        if (message == unknown_name) return {raw_data};
        const auto* row = find_command(message);
        if (row == nullptr) return names;
        for (auto& field : reply ? row->reply.layout : row->request.layout)
            names.push_back(field.name);
        if (reply && row->on_tags) names.push_back(tag_error_field);
        return names;
    }

    std::vector<std::string_view> value_names(std::string_view message, std::string_view field,
                                              Direction direction) const override {
        const wire::Enumeration* found = nullptr;
        if (field == "status" && direction == Direction::to_host) found = &statuses;
        if (field == tag_error_field && direction == Direction::to_host) found = &tag_errors;
        each_row(message, direction, [&](const FieldRow& row) {
            if (row.name == field && row.enumeration != nullptr) found = row.enumeration;
        });
        std::vector<std::string_view> names;
        if (found != nullptr)
            for (auto& row : found->rows)
                names.push_back(row.name);
        return names;
    }

    std::string_view unit(std::string_view message, std::string_view field,
                          Direction direction) const override {
        std::string_view unit;
        each_row(message, direction, [&](const FieldRow& row) {
            if (row.name == field) unit = row.unit;
        });
        return unit;
    }
};

}  // namespace

const wire::Codec& codec() {
    static const HartingCodec codec;
    return codec;
}

}  // namespace gantry::harting
