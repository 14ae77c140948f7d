#include "protocols/silion/codec.hpp"

#include <array>

#include <fmt/format.h>

#include "base/text.hpp"
#include "protocols/silion/frame.hpp"
#include "wire/cursor.hpp"

namespace gantry::silion {

using wire::Direction;
using wire::Errc;
using wire::Fault;
using wire::Fields;
using wire::Message;
using wire::Value;

static constexpr std::string_view unknown_name = "Unknown";
static constexpr std::array<std::string_view, 8> extra_names = {
    "Trailing", "reader", "flags", "status", "crc", "code", "bank_length_bytes", "status_text"};
static constexpr std::array unknown_rows = {
    wire::FieldRow{.name = "Data", .type = wire::Type::bytes, .size = 0}};

namespace {

struct Body {
    Fields fields;
    bool wide = false;
    std::optional<Fault> fault;
};

Body decode_body(const Frame& frame, wire::Layout layout) {
    Body body;
    wire::Reader in(frame.data, frame.data_offset());
    wire::decode(layout, in, body.fields);
    body.fault = in.fault();
    if (!body.fault && in.left() > 0) {
        auto rest = in.rest();
        body.fields.push_back({"Trailing", Value(Bytes(rest.begin(), rest.end()))});
    }
    return body;
}

Body decode_data(const Frame& frame) {
    if (frame.row == nullptr) return decode_body(frame, unknown_rows);
    auto body = decode_body(frame, frame.row->layout);
    bool exact = !body.fault && wire::find(body.fields, "Trailing") == nullptr;
    if (exact || !carries_tags(*frame.row)) return body;
    auto wide = decode_body(frame, wide_tags_layout);
    if (wide.fault || wire::find(wide.fields, "Trailing") != nullptr) return body;
    wide.wide = true;
    return wide;
}

Fields decode_head(const Frame& frame, Direction direction, bool wide) {
    Fields head;
    if (frame.row == nullptr) head.push_back({"code", Value(frame.code)});
    if (direction == Direction::to_host) head.push_back({"reader", wire::text_value(frame.name)});
    head.push_back({"flags", Value(frame.flags)});
    if (direction == Direction::to_host) {
        head.push_back({"status", Value(frame.status)});
        if (frame.status != 0) head.push_back({"status_text", Value(describe_status(frame.status).text)});
    }
    if (wide) head.push_back({"bank_length_bytes", Value(2)});
    if (frame.has_crc()) head.push_back({"crc", Value(to_hex(frame.crc()))});
    return head;
}

// Header members may stand among the fields: that is where a command line puts them.
const Value* find_extra(const Message& message, std::string_view name) {
    if (auto* value = wire::find(message.header, name)) return value;
    return wire::find(message.fields, name);
}

wire::Result<std::int64_t> number_or(const Message& message, std::string_view name, std::int64_t fallback,
                                     std::int64_t max) {
    auto* value = find_extra(message, name);
    if (value == nullptr) return fallback;
    auto number = wire::as_number(*value);
    if (number && *number >= 0 && *number <= max) return *number;
    return tl::unexpected(
        Fault{Errc::bad_value, 0, name, fmt::format("expected a number from 0 to {}", max)});
}

struct Parts {  // of a frame, as encode gathers them
    std::uint8_t code = 0, flags = 0;
    std::uint32_t status = 0;
    Bytes name, data;
    std::optional<Bytes> crc;
};

wire::Result<void> head_parts(const Message& message, Direction direction, const MessageRow* row,
                              Parts& parts) {
    auto code = number_or(message, "code", row != nullptr ? static_cast<std::int64_t>(row->code) : -1, 255);
    if (!code) return tl::unexpected(code.error());
    if (*code < 0)
        return tl::unexpected(Fault{Errc::bad_value, 4, "code", "a message without a name needs its code"});
    parts.code = static_cast<std::uint8_t>(*code);
    if (find_message(parts.code, direction) != row)
        return tl::unexpected(Fault{Errc::bad_value, 4, "code", "that code has another name"});
    auto* crc = find_extra(message, "crc");
    int fallback = (row != nullptr ? row->flags : 0) | (crc != nullptr ? flag_crc : 0);
    auto flags = number_or(message, "flags", fallback, 255);
    if (!flags) return tl::unexpected(flags.error());
    parts.flags = static_cast<std::uint8_t>(*flags);
    if (crc != nullptr) {
        parts.crc = wire::as_raw(*crc);
        if (!parts.crc || parts.crc->size() != 2)
            return tl::unexpected(Fault{Errc::bad_value, 0, "crc", "expected two bytes as hex digits"});
        if ((parts.flags & flag_crc) == 0)
            return tl::unexpected(Fault{Errc::bad_value, 5, "crc", "a CRC needs bit 1 of the flags"});
    }
    if (direction == Direction::to_reader) return {};
    auto status = number_or(message, "status", 0, 0xFFFFFFFF);
    if (!status) return tl::unexpected(status.error());
    parts.status = static_cast<std::uint32_t>(*status);
    if (auto* reader = find_extra(message, "reader")) {
        auto name = wire::as_text_bytes(*reader);
        if (!name || name->size() > 255)
            return tl::unexpected(Fault{Errc::bad_value, 10, "reader", "expected text of at most 255 bytes"});
        parts.name = std::move(*name);
    }
    return {};
}

wire::Result<void> data_part(const Message& message, const MessageRow* row, Parts& parts) {
    wire::Layout layout = row != nullptr ? row->layout : wire::Layout{unknown_rows};
    if (row != nullptr && carries_tags(*row)) {
        auto width = number_or(message, "bank_length_bytes", 1, 2);
        if (!width) return tl::unexpected(width.error());
        if (*width == 2) layout = wide_tags_layout;
    }
    if (auto done = wire::encode(layout, message.fields, parts.data, extra_names); !done) return done;
    if (auto* trailing = wire::find(message.fields, "Trailing")) {
        auto raw = wire::as_raw(*trailing);
        if (!raw) return tl::unexpected(Fault{Errc::bad_value, 0, "Trailing", "expected hex digits"});
        parts.data.insert(parts.data.end(), raw->begin(), raw->end());
    }
    std::size_t max = row != nullptr ? row->max_data : max_unknown_data;
    if (parts.data.size() > max)
        return tl::unexpected(Fault{Errc::too_big, 2, "data length",
                                    fmt::format("{} bytes of data, at most {} fit", parts.data.size(), max)});
    return {};
}

Fault no_such_message(const Message& message, const wire::Codec& codec, Direction direction) {
    auto names = codec.names(direction);
    auto near = nearest(message.name, names);
    return Fault{Errc::unknown_code, 0, "message",
                 near.empty() ? fmt::format("there is no message {}; messages: {}", printable(message.name),
                                            fmt::join(names, ", "))
                              : fmt::format("there is no message {}; did you mean {}?",
                                            printable(message.name), near)};
}

class SilionCodec final : public wire::Codec {
public:
    wire::Decoded decode(ByteView input, Direction direction, bool end) const override {
        if (input.empty()) return {.length = 0, .more = !end};
        auto look = look_at(input, direction, CrcRule::any());
        auto refuse = [&](std::size_t length, Fault fault) {
            return wire::Decoded{.length = length, .message = tl::unexpected(std::move(fault))};
        };
        switch (look.what) {
            case Look::What::more: {
                if (!end) return {.more = true};
                auto detail = fmt::format("{} bytes of a frame of at least {}", input.size(), look.size);
                return refuse(find_start(input, 1, direction),
                              {Errc::truncated, input.size(), "frame", detail});
            }
            case Look::What::wrong:
                return refuse(look.size, {look.why, look.offset, look.field});
            case Look::What::frame:
                break;
        }
        auto body = decode_data(look.frame);
        if (body.fault) return refuse(look.size, *body.fault);
        Message message{.name = std::string(look.frame.row != nullptr ? look.frame.row->name : unknown_name),
                        .header = decode_head(look.frame, direction, body.wide),
                        .fields = std::move(body.fields)};
        return {.length = look.size, .message = std::move(message)};
    }

    wire::Result<void> encode(const Message& message, Direction direction, Bytes& out) const override {
        auto* row = find_message(message.name, direction);
        if (row == nullptr && message.name != unknown_name)
            return tl::unexpected(no_such_message(message, *this, direction));
        Parts parts;
        if (auto done = head_parts(message, direction, row, parts); !done) return done;
        if (auto done = data_part(message, row, parts); !done) return done;
        if (row == nullptr && direction == Direction::to_host &&
            (parts.name.empty() || !is_printable_ascii(as_text(parts.name))))
            return tl::unexpected(Fault{Errc::bad_value, 10, "reader",
                                        "an unknown code is only believed with a printable reader name"});
        if (direction == Direction::to_host)
            append_to_host(out, parts.code, parts.flags, parts.status, parts.name, parts.data,
                           CrcKind::modbus);
        else
            append_to_reader(out, parts.code, parts.flags, parts.data, CrcKind::modbus);
        if (parts.crc) std::copy(parts.crc->begin(), parts.crc->end(), out.end() - 2);
        return {};
    }

    wire::Result<void> check(const Message& message, Direction direction) const override {
        auto* row = find_message(message.name, direction);
        if (row == nullptr) return tl::unexpected(no_such_message(message, *this, direction));
        Parts parts;
        if (auto done = head_parts(message, direction, row, parts); !done) return done;
        if (auto done = data_part(message, row, parts); !done) return done;
        if ((parts.flags & ~(flag_answer | flag_crc)) != 0)
            return tl::unexpected(Fault{Errc::bad_value, 5, "flags", "bits 2 to 7 are not defined: leave 0"});
        if (auto fine = wire::check(row->layout, message.fields); !fine) return fine;
        if (row->code != Code::set_outputs || direction != Direction::to_reader) return {};
        if (parts.data[0] == 0)
            return tl::unexpected(Fault{Errc::bad_value, 6, "Outputs", "name at least one output"});
        std::array<bool, 256> seen{};
        for (std::size_t at = 1; at + 3 <= parts.data.size(); at += 3)
            if (std::exchange(seen[parts.data[at]], true))
                return tl::unexpected(Fault{Errc::bad_value, 6 + at, "Output",
                                            fmt::format("output {} is named twice", parts.data[at])});
        return {};
    }

    std::vector<std::string_view> names(Direction direction) const override {
        std::vector<std::string_view> names;
        for (auto& row : messages())
            if (row.direction == direction) names.push_back(row.name);
        return names;
    }

    std::vector<std::string_view> field_names(std::string_view message, Direction direction) const override {
        std::vector<std::string_view> names;
        if (auto* row = find_message(message, direction))
            for (auto& field : row->layout)
                names.push_back(field.name);
        return names;
    }
};

}  // namespace

const wire::Codec& codec() {
    static const SilionCodec codec;
    return codec;
}

}  // namespace gantry::silion
