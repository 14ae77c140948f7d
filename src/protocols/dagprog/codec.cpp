#include "protocols/dagprog/codec.hpp"

#include <algorithm>
#include <array>
#include <vector>

#include <fmt/format.h>

#include "base/text.hpp"
#include "protocols/dagprog/line.hpp"

namespace gantry::dagprog {

using wire::Direction;
using wire::Errc;
using wire::Fault;
using wire::Fields;
using wire::Message;
using wire::Value;

static constexpr std::string_view unknown_name = "Unknown", line_feed_name = "LineFeed";
// What may stand in the header, or among the fields where a command line puts it.
static constexpr std::array<std::string_view, 6> extra_names = {"stx",     "separator", "line",
                                                                "meaning", "lf",        "Trailing"};

namespace {

bool usual_stx(Direction direction) {
    return direction == Direction::to_host;
}
Value text(std::string_view of) {
    return Value(std::string(of));
}

const Value* find_extra(const Message& message, std::string_view name) {
    if (auto* value = wire::find(message.header, name)) return value;
    return wire::find(message.fields, name);
}

wire::Result<bool> boolean_or(const Message& message, std::string_view name, bool fallback) {
    auto* value = find_extra(message, name);
    if (value == nullptr) return fallback;
    if (auto* yes = value->get<bool>()) return *yes;
    if (auto* said = value->get<std::string>(); said != nullptr && (*said == "true" || *said == "false"))
        return *said == "true";
    return tl::unexpected(Fault{Errc::bad_value, 0, name, "expected true or false"});
}

wire::Result<Separator> separator_of(const Message& message) {
    auto* value = find_extra(message, "separator");
    if (value == nullptr) return Separator::tab;
    auto* said = value->get<std::string>();
    auto separator = said != nullptr ? parse_separator(*said) : std::nullopt;
    if (separator) return *separator;
    return tl::unexpected(Fault{Errc::bad_value, 0, "separator", "expected tab, none or space"});
}

Value value_of(const PartRow& part, std::string_view written_as) {
    switch (part.kind) {
        case Kind::decimal:
        case Kind::hex: {
            auto number = parse_number(part, written_as).value_or(0);
            auto* named = part.enumeration != nullptr ? part.enumeration->find(number) : nullptr;
            return named != nullptr ? text(named->name) : Value(number);
        }
        case Kind::bytes:
            return Value(from_hex(written_as).value_or(Bytes{}));
        case Kind::serial: {
            auto serial = parse_serial(written_as).value_or(Serial{});
            Bytes bytes(serial.bytes.begin(), serial.bytes.end());
            if (serial.what == Serial::What::no_tag) bytes.back() = 1;
            if (serial.what == Serial::What::write_error) bytes.back() = 2;
            return Value(bytes);
        }
        case Kind::text:
            break;
    }
    return text(written_as);
}

Fields fields_of(const Line& line) {
    Fields fields;
    if (line.row == nullptr) {
        fields.push_back({"Line", text(line.body)});
        return fields;
    }
    for (std::size_t i = 0; i < line.row->parts.size(); ++i)
        fields.push_back({std::string(line.row->parts[i].name), value_of(line.row->parts[i], line.parts[i])});
    if (line.trailing) fields.push_back({"Trailing", text(*line.trailing)});
    return fields;
}

// --- values to characters ----------------------------------------------------------------------------------

wire::Result<std::string> write_number(const PartRow& part, const Value& value) {
    auto most = part.kind == Kind::hex ? std::int64_t{255} : std::int64_t{999'999'999};
    auto number = wire::as_number(value, part.enumeration);
    if (number && *number >= 0 && *number <= most) return written(part, *number);
    std::vector<std::string_view> names;
    if (part.enumeration != nullptr)
        for (auto& row : part.enumeration->rows)
            names.push_back(row.name);
    return tl::unexpected(Fault{Errc::bad_value, 0, part.name,
                                names.empty()
                                    ? fmt::format("expected a number from 0 to {}", most)
                                    : fmt::format("expected a number or one of {}", fmt::join(names, ", "))});
}

wire::Result<std::string> write_bytes(const PartRow& part, const Value& value) {
    auto bytes = wire::as_raw(value);
    std::size_t most = part.size / 2;
    if (bytes && !bytes->empty() && bytes->size() <= most && (part.shorter || bytes->size() == most))
        return to_hex(*bytes);
    return tl::unexpected(Fault{Errc::bad_value, 0, part.name,
                                part.shorter ? fmt::format("expected 1 to {} bytes as hex digits", most)
                                             : fmt::format("expected {} bytes as hex digits", most)});
}

wire::Result<std::string> write_text(std::string_view name, const Value& value, bool tabs) {
    auto* said = value.get<std::string>();
    if (said != nullptr && said->size() <= max_line &&
        std::ranges::all_of(*said, [&](char c) { return (c >= 0x20 && c <= 0x7E) || (tabs && c == '\t'); }))
        return *said;
    return tl::unexpected(Fault{Errc::bad_value, 0, name, "expected plain ASCII text"});
}

wire::Result<std::string> write_part(const PartRow& part, const Value& value) {
    switch (part.kind) {
        case Kind::decimal:
        case Kind::hex:
            return write_number(part, value);
        case Kind::bytes:
        case Kind::serial:
            return write_bytes(part, value);
        case Kind::text:
            break;
    }
    return write_text(part.name, value, true);
}

wire::Result<std::vector<std::string>> write_parts(const Message& message, const MessageRow& row) {
    std::vector<std::string> values;
    for (auto& field : message.fields) {
        bool known = std::ranges::find(extra_names, field.name) != extra_names.end() ||
                     std::ranges::find(row.parts, field.name, &PartRow::name) != row.parts.end();
        if (known) continue;
        std::vector<std::string_view> names;
        for (auto& part : row.parts)
            names.push_back(part.name);
        return tl::unexpected(
            Fault{Errc::unknown_code, 0, row.name,
                  names.empty() ? fmt::format("there is no field {}; it has none", printable(field.name))
                                : fmt::format("there is no field {}; fields: {}", printable(field.name),
                                              fmt::join(names, ", "))});
    }
    for (auto& part : row.parts) {
        auto* value = wire::find(message.fields, part.name);
        if (value == nullptr) return tl::unexpected(Fault{Errc::truncated, 0, part.name, "it is missing"});
        auto one = write_part(part, *value);
        if (!one) return tl::unexpected(one.error());
        values.push_back(std::move(*one));
    }
    if (auto* trailing = find_extra(message, "Trailing")) {
        auto rest = write_text("Trailing", *trailing, true);
        if (!rest) return tl::unexpected(rest.error());
        values.push_back(std::move(*rest));
    }
    return values;
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

wire::Result<std::string> line_text(const Message& message, std::string_view name) {
    auto* value = find_extra(message, name);
    if (value == nullptr) return tl::unexpected(Fault{Errc::truncated, 0, "Line", "it is missing"});
    return write_text("Line", *value, true);
}

// A message's line without its own STX and CR, as the values give it.
wire::Result<std::string> body_of(const Message& message, const MessageRow* row, Separator separator) {
    if (row == nullptr) return line_text(message, "Line");
    auto values = write_parts(message, *row);
    if (!values) return tl::unexpected(values.error());
    Bytes bytes;
    append_line(bytes, false, row->word, *values, separator);
    bytes.pop_back();
    return std::string(as_text(bytes));
}

class DagprogCodec final : public wire::Codec {
public:
    wire::Decoded decode(ByteView input, Direction direction, bool end) const override {
        if (input.empty()) return {.length = 0, .more = !end};
        auto refuse = [](std::size_t length, Fault fault) {
            return wire::Decoded{.length = length, .message = tl::unexpected(std::move(fault))};
        };
        auto look = look_at(input, direction);
        switch (look.what) {
            case Look::What::more:
                if (!end) return {.more = true};
                return refuse(input.size(), {Errc::truncated, input.size(), "line", "no CR ends it"});
            case Look::What::wrong:
                return wrong(input, look);
            case Look::What::line_feed:
                return {.length = 1,
                        .message = Message{.name = std::string(line_feed_name), .header = {}, .fields = {}}};
            case Look::What::line:
                break;
        }
        auto line = parse_line(look.body, direction);
        line.has_stx = look.has_stx;
        if (line.fault) {
            auto fault = *line.fault;
            fault.offset += look.has_stx ? 1 : 0;
            return refuse(look.size, std::move(fault));
        }
        auto message = message_of(line, direction);
        auto size = look.size;
        if (size < input.size() && input[size] == byte_lf) {  // ignored by the protocol, kept for encode
            message.header.push_back({"lf", Value(true)});
            ++size;
        }
        return {.length = size, .message = std::move(message)};
    }

    wire::Result<void> encode(const Message& message, Direction direction, Bytes& out) const override {
        if (message.name == line_feed_name) {
            out.push_back(byte_lf);
            return {};
        }
        auto* row = find_message(message.name, direction);
        if (row == nullptr && message.name != unknown_name)
            return tl::unexpected(no_such_message(message, *this, direction));
        auto with_stx = boolean_or(message, "stx", usual_stx(direction));
        auto with_lf = boolean_or(message, "lf", false);
        auto separator = separator_of(message);
        if (!with_stx) return tl::unexpected(with_stx.error());
        if (!with_lf) return tl::unexpected(with_lf.error());
        if (!separator) return tl::unexpected(separator.error());
        auto body = body_of(message, row, *separator);
        if (!body) return tl::unexpected(body.error());
        if (find_extra(message, "line") != nullptr) {
            auto whole = line_text(message, "line");
            if (!whole) return tl::unexpected(whole.error());
            auto line = parse_line(*whole, direction);
            auto as_it_says = line.row == nullptr || line.fault ? whole : rewritten(line, row);
            if (line.row != row || line.fault || !as_it_says || *as_it_says != *body)
                return tl::unexpected(Fault{Errc::bad_value, 0, "line",
                                            "it says something else than the values; leave it out"});
            body = std::move(whole);
        }
        auto line = parse_line(*body, direction);
        if (line.row != row)
            return tl::unexpected(
                Fault{Errc::bad_value, 0, "Line",
                      row == nullptr ? "that code has a name" : "written so it would be something else"});
        if (line.fault) return tl::unexpected(*line.fault);
        if (row == nullptr && direction == Direction::to_host && !*with_stx)
            return tl::unexpected(
                Fault{Errc::bad_value, 0, "stx", "an unknown code is only believed behind STX"});
        if (body->size() + (*with_stx ? 1 : 0) > max_line)
            return tl::unexpected(
                Fault{Errc::too_big, 0, "line",
                      fmt::format("{} characters, at most {} are a line", body->size(), max_line)});
        append_line(out, *with_stx, *body, {}, Separator::none);
        if (*with_lf) out.push_back(byte_lf);
        return {};
    }

    wire::Result<void> check(const Message& message, Direction direction) const override {
        auto* row = find_message(message.name, direction);
        if (row == nullptr) return tl::unexpected(no_such_message(message, *this, direction));
        Bytes bytes;
        if (auto fine = encode(message, direction, bytes); !fine) return fine;
        for (auto& part : row->parts) {
            // What either kind of unit may know; which kind it is the driver knows.
            auto most = std::max(part.icode1_max, part.iso15693_max);
            auto number = wire::as_number(*wire::find(message.fields, part.name), part.enumeration);
            bool legal = most < 0 || (*number <= most && (part.enumeration == nullptr ||
                                                          part.enumeration->find(*number) != nullptr));
            if (!legal)
                return tl::unexpected(
                    Fault{Errc::bad_value, 0, part.name,
                          fmt::format("{} is not one of its values, {} at most", *number, most)});
        }
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
            for (auto& part : row->parts)
                names.push_back(part.name);
        return names;
    }
    std::vector<std::string_view> value_names(std::string_view message, std::string_view field,
                                              Direction direction) const override {
        std::vector<std::string_view> names;
        auto* row = find_message(message, direction);
        if (row == nullptr) return names;
        for (auto& part : row->parts)
            if (part.name == field && part.enumeration != nullptr)
                for (auto& each : part.enumeration->rows)
                    names.push_back(each.name);
        return names;
    }

private:
    static wire::Decoded wrong(ByteView input, const Look& look) {
        auto size = look.size;
        if (look.ends_in_line) {  // the rest of a line that is too long goes with it
            while (size < input.size() && input[size] != byte_stx && input[size] != byte_cr)
                ++size;
            if (size < input.size() && input[size] == byte_cr) ++size;
        }
        return {.length = size, .message = tl::unexpected(Fault{look.why, look.offset, "line"})};
    }

    // What the values of a line give when they are written anew.
    static wire::Result<std::string> rewritten(const Line& line, const MessageRow* row) {
        Message message{.name = {}, .header = {}, .fields = fields_of(line)};
        return body_of(message, row, line.separator);
    }

    static Message message_of(const Line& line, Direction direction) {
        Message message{.name = std::string(line.row != nullptr ? line.row->name : unknown_name),
                        .header = {},
                        .fields = fields_of(line)};
        if (line.has_stx != usual_stx(direction)) message.header.push_back({"stx", Value(line.has_stx)});
        if (line.row == nullptr) return message;
        if (line.separator != Separator::tab)
            message.header.push_back({"separator", text(to_text(line.separator))});
        auto again = rewritten(line, line.row);
        if (!again || *again != line.body) message.header.push_back({"line", text(line.body)});
        if (line.row->code == Code::serial_number)
            if (auto serial = parse_serial(line.parts[0]); serial && serial->what != Serial::What::number)
                message.header.push_back({"meaning", text(to_text(serial->what))});
        return message;
    }
};

}  // namespace

const wire::Codec& codec() {
    static const DagprogCodec codec;
    return codec;
}

}  // namespace gantry::dagprog
