#include "protocols/caen/codec.hpp"

#include <algorithm>
#include <array>

#include <fmt/format.h>

#include "base/text.hpp"
#include "protocols/caen/params.hpp"
#include "protocols/caen/values.hpp"
#include "wire/cursor.hpp"

namespace gantry::caen {

using wire::Direction;
using wire::Errc;
using wire::Fault;
using wire::Fields;
using wire::Message;
using wire::Value;

static constexpr std::string_view unknown_name = "Unknown";
static constexpr std::string_view abort_name = "Abort";
static constexpr std::array<std::string_view, 4> extra_names = {"id", "framed", "code", "reserved"};

namespace {

constexpr std::size_t enough_of_a_header = 8;  // with the vendor

struct RawText {
    std::string_view name, bytes;
};
constexpr std::array raw_texts = {RawText{"UpgradeRequest", upgrade_text},
                                  RawText{"OutOfBandCommand", out_of_band_text}};

constexpr std::uint16_t head_of(Direction direction) {
    return direction == Direction::to_reader ? to_reader_head : to_host_head;
}

// --- decode ------------------------------------------------------------------------------------------------

Fault bad_header(ByteView input, std::uint16_t fixed) {
    // The head is shorter than ten bytes only where what is there cannot become one.
    wire::Reader in(input);
    auto first = in.u16("header");
    if (in.fault() || first != fixed)
        return {Errc::bad_value, 0, "header",
                fmt::format("starts with 0x{}, expected 0x{:04X}",
                            to_hex(input.first(std::min<std::size_t>(input.size(), 2))), fixed)};
    in.u16("id");
    auto maker = in.u32("vendor");
    if (in.fault() || maker != vendor)
        return {Errc::bad_value, 4, "vendor",
                fmt::format("0x{}, expected 0x{:08X}",
                            to_hex(input.subspan(4, std::min<std::size_t>(input.size() - 4, 4))), vendor)};
    return {Errc::bad_length, 8, "length",
            fmt::format("length {} is below the header ({})", in.u16("length"), header_size)};
}

// Where decoding goes on. At the end of all bytes a few that might have become a header are none.
std::size_t next_start(ByteView input, std::uint16_t fixed, bool end) {
    auto next = find_header(input, 1, fixed);
    return end && input.size() - next < enough_of_a_header ? input.size() : next;
}

Message message_of(const Header& header, std::span<const Avp> avps) {
    Message message;
    message.header.push_back({"id", Value(header.id)});
    bool named = !avps.empty() && avps.front().is(Attribute::command_name) && avps.front().value.size() == 2;
    const CommandRow* row = nullptr;
    if (named) {
        auto code = static_cast<std::uint16_t>(*avps.front().number());
        row = find_command(code);
        if (row == nullptr) message.header.push_back({"code", Value(code)});
    }
    message.name = row != nullptr ? row->name : unknown_name;
    if (header.undefined_length()) message.header.push_back({"framed", Value(true)});
    if (std::ranges::any_of(avps, [](auto& avp) { return avp.reserved != 0; })) {
        Value::List reserved;
        for (auto& avp : avps)
            reserved.emplace_back(avp.reserved);
        message.header.push_back({"reserved", Value(std::move(reserved))});
    }
    for (auto& avp : avps.subspan(named ? 1 : 0))
        message.fields.push_back(field_of(avp));
    return message;
}

// The pairs of a stream without a length: up to the next header, or to what is no pair.
struct Stream {
    std::size_t length = header_size;
    bool more = false;
};
Stream stream_extent(ByteView input, std::uint16_t fixed, bool end) {
    Stream stream;
    while (stream.length < input.size()) {
        auto rest = input.subspan(stream.length);
        bool header = plausible_header(rest, fixed);
        if (header && rest.size() >= header_size) return {.length = stream.length};
        stream.more = !end;
        if (rest.size() < avp_header_size || (header && !end)) return stream;
        std::size_t size = static_cast<std::size_t>(rest[2] << 8 | rest[3]);
        if (size > rest.size()) return stream;
        if (size < avp_header_size) break;
        stream.length += size;
    }
    stream.more = !end && stream.length == input.size();
    return stream;
}

wire::Decoded decode_signal(ByteView input, bool end) {
    if (input[0] == abort_byte) return {.length = 1, .message = Message{std::string(abort_name), {}, {}}};
    if (input.size() < header_size) {
        if (!end) return {.more = true};
        return {.length = next_start(input, to_reader_head, end),
                .message = tl::unexpected(
                    Fault{Errc::truncated, input.size(), "text", "ends inside one of the ten-byte texts"})};
    }
    auto& text = as_text(input).starts_with(raw_texts[0].bytes) ? raw_texts[0] : raw_texts[1];
    return {.length = text.bytes.size(), .message = Message{std::string(text.name), {}, {}}};
}

wire::Decoded decode_message(ByteView input, Direction direction, bool end) {
    auto fixed = head_of(direction);
    auto refuse = [](std::size_t length, Fault fault) {
        return wire::Decoded{.length = length, .message = tl::unexpected(std::move(fault))};
    };
    if (!plausible_header(input, fixed))
        return refuse(next_start(input, fixed, end), bad_header(input, fixed));
    auto header = read_header(input);
    bool whole = header && input.size() >= header->length;
    if (!whole) {
        if (!end) return {.more = true};
        auto size = header ? header->length : header_size;
        return refuse(next_start(input, fixed, end),
                      {Errc::truncated, input.size(), "message",
                       fmt::format("{} bytes of {}{}", input.size(), header ? "" : "at least ", size)});
    }
    std::size_t length = header->length;
    if (header->undefined_length()) {
        auto stream = stream_extent(input, fixed, end);
        if (stream.more) return {.more = true};
        length = stream.length;
    }
    std::vector<Avp> avps;
    AvpReader reader(input.subspan(header_size, length - header_size));
    while (auto avp = reader.next())
        avps.push_back(*avp);
    if (reader.fault()) return refuse(length, *reader.fault());
    return {.length = length, .message = message_of(*header, avps)};
}

// --- encode ------------------------------------------------------------------------------------------------

bool is_extra(std::string_view name) {
    return std::ranges::find(extra_names, name) != extra_names.end();
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

// A message as encode understood it.
struct Parts {
    const CommandRow* row = nullptr;
    std::uint16_t id = 0;
    bool framed = false;
    std::vector<std::uint16_t> reserved;  // of the first pairs
    std::vector<Pair> pairs;              // the CommandName among them
    std::size_t size = header_size;

    bool has_command() const {
        return !pairs.empty() && pairs.front().type == static_cast<std::uint16_t>(Attribute::command_name);
    }
};

wire::Result<void> reserved_part(const Message& message, Parts& parts) {
    auto* value = find_extra(message, "reserved");
    if (value == nullptr) return {};
    Fault fault{Errc::bad_value, 0, "reserved", "expected a list of numbers from 0 to 65535, one a pair"};
    auto* list = value->get<Value::List>();
    if (list == nullptr) return tl::unexpected(fault);
    for (auto& item : *list) {
        auto number = wire::as_number(item);
        if (!number || *number < 0 || *number > 0xFFFF) return tl::unexpected(fault);
        parts.reserved.push_back(static_cast<std::uint16_t>(*number));
    }
    return {};
}

wire::Result<void> add_pair(Parts& parts, Pair pair) {
    parts.size += avp_header_size + pair.value.size();
    if (pair.value.size() > 0xFFFF - avp_header_size || (!parts.framed && parts.size > 0xFFFF))
        return tl::unexpected(Fault{Errc::too_big, parts.size - pair.value.size() - avp_header_size,
                                    pair.row != nullptr ? pair.row->name : raw_name,
                                    "with it the message is longer than 65535 bytes"});
    parts.pairs.push_back(std::move(pair));
    return {};
}

wire::Result<Parts> parts_of(const Message& message) {
    Parts parts;
    parts.row = message.name == unknown_name ? nullptr : find_command(message.name);
    auto id = number_or(message, "id", 0, 0xFFFF);
    if (!id) return tl::unexpected(id.error());
    parts.id = static_cast<std::uint16_t>(*id);
    auto framed = number_or(message, "framed", 0, 1);
    if (!framed) return tl::unexpected(framed.error());
    parts.framed = *framed != 0;
    if (auto done = reserved_part(message, parts); !done) return tl::unexpected(done.error());
    auto code = number_or(message, "code", parts.row != nullptr ? parts.row->code : -1, 0xFFFF);
    if (!code) return tl::unexpected(code.error());
    if (*code >= 0) {
        if (const auto* row = find_command(static_cast<std::uint16_t>(*code)); row != parts.row)
            return tl::unexpected(Fault{Errc::bad_value, 16, "code",
                                        fmt::format("0x{:02X} is {}", *code,
                                                    row != nullptr ? row->name : "no code of this command")});
        Pair command{
            .type = static_cast<std::uint16_t>(Attribute::command_name),
            .value = {static_cast<std::uint8_t>(*code >> 8), static_cast<std::uint8_t>(*code & 0xFF)},
            .row = &row_of(Attribute::command_name)};
        if (auto done = add_pair(parts, std::move(command)); !done) return tl::unexpected(done.error());
    }
    for (auto& field : message.fields) {
        if (is_extra(field.name)) continue;
        auto pair = pair_of(field, parts.row, parts.size);
        if (!pair) return tl::unexpected(pair.error());
        if (auto done = add_pair(parts, std::move(*pair)); !done) return tl::unexpected(done.error());
    }
    return parts;
}

// The messages that are no messages: the abort byte and the texts.
std::optional<ByteView> signal_named(std::string_view name, Direction direction) {
    static constexpr std::array<std::uint8_t, 1> abort = {abort_byte};
    if (direction != Direction::to_reader) return {};
    if (name == abort_name) return ByteView(abort);
    for (auto& text : raw_texts)
        if (text.name == name) return as_bytes(text.bytes);
    return {};
}

Fault no_such_message(const Message& message, const wire::Codec& codec, Direction direction) {
    auto near = nearest(message.name, codec.names(direction));
    return Fault{Errc::unknown_code, 0, "message",
                 near.empty() ? fmt::format("there is no message {}; one without a name is {} with code=",
                                            printable(message.name), unknown_name)
                              : fmt::format("there is no message {}; did you mean {}?",
                                            printable(message.name), near)};
}

// --- check -------------------------------------------------------------------------------------------------

// The id's length and the id must agree; which of the two a reader believes nobody says.
wire::Result<void> check_lengths(const Parts& parts) {
    auto offset = header_size;
    for (std::size_t i = 0; i + 1 < parts.pairs.size(); ++i) {
        auto& length = parts.pairs[i];
        auto& id = parts.pairs[i + 1];
        auto said = Avp{.value = length.value}.number();
        if (length.row == &row_of(Attribute::tag_id_len) && id.row == &row_of(Attribute::tag_id) &&
            said != id.value.size())
            return tl::unexpected(
                Fault{Errc::bad_value, offset, length.row->name,
                      fmt::format("{}, but the TagID has {} bytes", *said, id.value.size())});
        offset += avp_header_size + length.value.size();
    }
    return {};
}

wire::Result<void> check_parts(const Parts& parts, Direction direction) {
    bool to_reader = direction == Direction::to_reader;
    if (parts.framed && to_reader)
        return tl::unexpected(Fault{Errc::bad_value, 8, "framed", "only a reader sends a framed stream"});
    if (std::ranges::any_of(parts.reserved, [](auto bits) { return bits != 0; }))
        return tl::unexpected(Fault{Errc::bad_value, header_size, "reserved", "must be 0 in what is sent"});
    if (!parts.has_command())
        return tl::unexpected(
            Fault{Errc::bad_value, header_size, "code", "a message without a name needs its code"});
    auto offset = header_size;
    std::vector<Given> given;
    for (auto& pair : parts.pairs) {
        if (auto fine = check_value(pair, offset); !fine) return fine;
        given.push_back({pair.type, offset});
        offset += avp_header_size + pair.value.size();
    }
    given.erase(given.begin());  // the CommandName
    if (parts.row == nullptr) return {};
    auto& row = *parts.row;
    if (row.reserved)
        return tl::unexpected(
            Fault{Errc::bad_value, 16, "code", "the manual reserves it: there is no such command"});
    if (row.notification && to_reader)
        return tl::unexpected(Fault{Errc::bad_value, 16, "code", "only a reader sends it"});
    if (!row.parameters_known || parts.framed) return {};
    if (to_reader) return check_params(row.name, row.in, false, given);
    if (row.code == static_cast<std::uint16_t>(Command::kill_message))
        return check_params(row.name, {}, false, given);
    bool ends = !given.empty() && given.back().type == static_cast<std::uint16_t>(Attribute::result_code);
    if (!ends)
        return tl::unexpected(
            Fault{Errc::bad_value, offset, "ResultCode", "missing: every answer ends with it"});
    bool failed = std::ranges::any_of(parts.pairs.back().value, [](auto byte) { return byte != 0; });
    given.pop_back();
    if (failed && given.empty()) return {};
    return check_params(row.name, row.out, row.out_repeats, given);
}

void add_once(std::vector<std::string_view>& names, std::string_view name) {
    if (std::ranges::find(names, name) == names.end()) names.push_back(name);
}

class CaenCodec final : public wire::Codec {
public:
    wire::Decoded decode(ByteView input, Direction direction, bool end) const override {
        if (input.empty()) return {.length = 0, .more = !end};
        if (direction == Direction::to_reader && (input[0] == abort_byte || out_of_band(input)))
            return decode_signal(input, end);
        return decode_message(input, direction, end);
    }

    wire::Result<void> encode(const Message& message, Direction direction, Bytes& out) const override {
        if (auto signal = signal_named(message.name, direction)) {
            if (auto fine = bare(message); !fine) return fine;
            out.insert(out.end(), signal->begin(), signal->end());
            return {};
        }
        if (message.name != unknown_name && find_command(message.name) == nullptr)
            return tl::unexpected(no_such_message(message, *this, direction));
        auto parts = parts_of(message);
        if (!parts) return tl::unexpected(parts.error());
        wire::Writer writer(out);
        writer.u16(head_of(direction));
        writer.u16(parts->id);
        writer.u32(vendor);
        writer.u16(parts->framed ? 0 : parts->size);
        for (std::size_t i = 0; i < parts->pairs.size(); ++i) {
            auto& pair = parts->pairs[i];
            writer.u16(i < parts->reserved.size() ? parts->reserved[i] : 0);
            writer.u16(avp_header_size + pair.value.size());
            writer.u16(pair.type);
            writer.bytes(pair.value);
        }
        return {};
    }

    wire::Result<void> check(const Message& message, Direction direction) const override {
        if (signal_named(message.name, direction)) return bare(message);
        if (message.name != unknown_name && find_command(message.name) == nullptr)
            return tl::unexpected(no_such_message(message, *this, direction));
        auto parts = parts_of(message);
        if (!parts) return tl::unexpected(parts.error());
        if (auto fine = check_parts(*parts, direction); !fine) return fine;
        return check_lengths(*parts);
    }

    std::vector<std::string_view> names(Direction direction) const override {
        std::vector<std::string_view> names;
        for (auto& row : commands()) {
            if (row.reserved || (row.notification && direction == Direction::to_reader)) continue;
            names.push_back(row.name);
            if (!row.later_name.empty()) names.push_back(row.later_name);
        }
        if (direction != Direction::to_reader) return names;
        names.push_back(abort_name);
        for (auto& text : raw_texts)
            names.push_back(text.name);
        return names;
    }

    std::vector<std::string_view> field_names(std::string_view message, Direction direction) const override {
        std::vector<std::string_view> names;
        const auto* row = find_command(message);
        if (row == nullptr) return names;
        for (auto& param : direction == Direction::to_reader ? row->in : row->out)
            add_once(names, row_of(param.attribute).name);
        if (direction == Direction::to_host) add_once(names, row_of(Attribute::result_code).name);
        return names;
    }

    std::vector<std::string_view> value_names(std::string_view /*message*/, std::string_view field,
                                              Direction /*direction*/) const override {
        std::vector<std::string_view> names;
        const auto* row = find_attribute(field);
        if (row != nullptr && row->enumeration != nullptr)
            for (auto& each : row->enumeration->rows)
                names.push_back(each.name);
        return names;
    }

    std::string_view unit(std::string_view /*message*/, std::string_view field,
                          Direction /*direction*/) const override {
        const auto* row = find_attribute(field);
        return row != nullptr ? row->unit : std::string_view{};
    }

private:
    static wire::Result<void> bare(const Message& message) {
        if (!message.fields.empty())
            return tl::unexpected(
                Fault{Errc::unknown_code, 0, "field", fmt::format("{} has no fields", message.name)});
        return {};
    }
};

}  // namespace

const wire::Codec& codec() {
    static const CaenCodec codec;
    return codec;
}

}  // namespace gantry::caen
