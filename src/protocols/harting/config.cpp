#include "protocols/harting/config.hpp"

#include <algorithm>
#include <charconv>
#include <deque>
#include <vector>

#include <fmt/format.h>

#include "base/text.hpp"

namespace gantry::harting {

using wire::Errc;
using wire::Fault;
using wire::Value;
using Kind = ConfigRow::Kind;

// --- where a row lies --------------------------------------------------------------------------------------

static std::size_t bytes_of(const ConfigRow& row) {
    return (row.bit + row.bits + 7U) / 8U;
}

std::size_t blocks_of(const ConfigRow& row) {
    return (row.byte + bytes_of(row) - 1) / block_size + 1;
}

bool needs_reset(const ConfigRow& row) {
    return blocks()[row.block].needs_reset && row.name != "CFG1.MODE";
}

static ByteView view(const ConfigRow& row, std::span<const std::uint8_t> bytes) {
    auto begin = std::min<std::size_t>(row.byte, bytes.size());
    return bytes.subspan(begin, std::min(bytes_of(row), bytes.size() - begin));
}

// --- reading -----------------------------------------------------------------------------------------------

std::int64_t get_number(const ConfigRow& row, std::span<const std::uint8_t> bytes) {
    if (row.bits > 32) return 0;
    std::uint64_t all = 0;
    for (auto byte : view(row, bytes))
        all = all << 8 | byte;
    return static_cast<std::int64_t>((all >> row.bit) & ((std::uint64_t{1} << row.bits) - 1));
}

// The length byte is the reader's word: what it says too much is cut off.
static std::string_view text_in(const ConfigRow& row, std::span<const std::uint8_t> bytes) {
    auto text = as_text(view(row, bytes));
    if (row.byte == 0 || text.empty()) return text;
    auto cut = text.substr(0, bytes[row.byte - 1U]);
    return cut.substr(0, cut.find('\0'));
}

Value get(const ConfigRow& row, std::span<const std::uint8_t> bytes) {
    auto raw = view(row, bytes);
    switch (row.kind) {
        case Kind::address:
            if (raw.size() == 4) return Value(fmt::format("{}.{}.{}.{}", raw[0], raw[1], raw[2], raw[3]));
            return Value(Bytes(raw.begin(), raw.end()));
        case Kind::bytes:
        case Kind::mask:
            return Value(Bytes(raw.begin(), raw.end()));
        case Kind::text:
            return Value(printable(text_in(row, bytes)));
        case Kind::number:
            break;
    }
    auto number = get_number(row, bytes);
    const auto* named = row.enumeration != nullptr ? row.enumeration->find(number) : nullptr;
    return named != nullptr ? Value(std::string(named->name)) : Value(number);
}

// --- writing -----------------------------------------------------------------------------------------------

static std::string as_typed(const Value& value) {
    if (const auto* text = value.get<std::string>()) return "\"" + printable(*text) + "\"";
    if (const auto* number = value.get<std::int64_t>()) return fmt::format("{}", *number);
    if (const auto* raw = value.get<Bytes>()) return to_hex(*raw);
    return "this";
}

static tl::unexpected<Fault> refuse(const ConfigRow& row, const Value& value, std::string_view expected) {
    auto given = row.secret ? std::string("what was given") : as_typed(value);
    return tl::unexpected(Fault{Errc::bad_value, row.byte, row.name,
                                fmt::format("{} does not fit; expected {}", given, expected)});
}

static std::optional<Bytes> address_of(const Value& value) {
    if (const auto* raw = value.get<Bytes>(); raw != nullptr && raw->size() == 4) return *raw;
    const auto* text = value.get<std::string>();
    if (text == nullptr) return {};
    Bytes address;
    const char* at = text->data();
    const char* end = at + text->size();
    for (int part = 0; part < 4; ++part) {
        if (part > 0 && (at == end || *at++ != '.')) return {};
        unsigned number = 0;
        auto [next, error] = std::from_chars(at, end, number);
        if (error != std::errc{} || number > 255) return {};
        address.push_back(static_cast<std::uint8_t>(number));
        at = next;
    }
    if (at != end) return {};
    return address;
}

static wire::Result<void> set_number(const ConfigRow& row, const Value& value,
                                     std::span<std::uint8_t> place) {
    auto number = wire::as_number(value, row.enumeration);
    auto most = static_cast<std::int64_t>((std::uint64_t{1} << row.bits) - 1);
    auto min = row.min <= row.max ? row.min : 0, max = row.min <= row.max ? row.max : most;
    if (!number || *number < min || *number > max) {
        if (row.enumeration == nullptr) return refuse(row, value, fmt::format("{} to {}", min, max));
        std::string names;
        for (auto& each : row.enumeration->rows)
            names += fmt::format("{}{}", names.empty() ? "" : ", ", each.name);
        return refuse(row, value, fmt::format("one of {}, or a number {} to {}", names, min, max));
    }
    auto mask = static_cast<std::uint64_t>(most) << row.bit;
    auto bits = static_cast<std::uint64_t>(*number) << row.bit;
    for (auto i = place.size(); i-- > 0; mask >>= 8, bits >>= 8) {
        auto keep = static_cast<std::uint8_t>(~mask);
        place[i] = static_cast<std::uint8_t>((place[i] & keep) | (bits & mask & 0xFF));
    }
    return {};
}

static wire::Result<void> set_text(const ConfigRow& row, const Value& value, std::span<std::uint8_t> place,
                                   std::uint8_t& length) {
    auto text = wire::as_text_bytes(value);
    if (!text || text->size() > place.size() || !is_printable_ascii(as_text(*text)))
        return refuse(row, value, fmt::format("a text of at most {} characters", place.size()));
    std::ranges::fill(place, std::uint8_t{0});
    std::ranges::copy(*text, place.begin());
    length = static_cast<std::uint8_t>(text->size());
    return {};
}

wire::Result<void> set(const ConfigRow& row, const Value& value, std::span<std::uint8_t> bytes) {
    if (bytes.size() < row.byte + bytes_of(row))
        return tl::unexpected(Fault{Errc::truncated, bytes.size(), row.name});
    auto place = bytes.subspan(row.byte, bytes_of(row));
    switch (row.kind) {
        case Kind::number:
            return set_number(row, value, place);
        case Kind::text:
            return set_text(row, value, place, bytes[row.byte - 1U]);
        case Kind::address: {
            auto address = address_of(value);
            if (!address) return refuse(row, value, "an address like 192.168.0.10");
            std::ranges::copy(*address, place.begin());
            return {};
        }
        case Kind::bytes:
        case Kind::mask: {
            auto raw = wire::as_raw(value);
            bool fits = raw && (raw->size() == place.size() ||
                                (row.kind == Kind::mask && raw->size() < place.size()));
            if (!fits)
                return refuse(row, value,
                              fmt::format("hex digits of {}{} bytes",
                                          row.kind == Kind::mask ? "at most " : "", place.size()));
            std::ranges::fill(place, std::uint8_t{0});
            std::ranges::copy(*raw, place.begin());
            return {};
        }
    }
    return {};
}

// --- by name -----------------------------------------------------------------------------------------------

// "CFG12.RAW": the block as it is; not that of the passwords.
static std::vector<ConfigRow> make_raw_rows() {
    static std::deque<std::string> names;
    std::vector<ConfigRow> rows;
    for (auto& block : blocks()) {
        if (block.reserved || block.number == 0) continue;
        rows.push_back({.name = names.emplace_back(fmt::format("CFG{}.RAW", block.number)),
                        .block = block.number,
                        .byte = 0,
                        .bits = 8 * block_size,
                        .kind = Kind::bytes,
                        .confidence = Confidence::manual,
                        .help = block.name});
    }
    return rows;
}

static std::span<const ConfigRow> raw_rows() {
    static const std::vector<ConfigRow> rows = make_raw_rows();
    return rows;
}

const ConfigRow* find_config(std::string_view name) {
    for (auto rows : {config_rows(), raw_rows()})
        for (auto& row : rows)
            if (row.name == name) return &row;
    for (auto rows : {config_rows(), raw_rows()})
        for (auto& row : rows)
            if (alike(row.name, name)) return &row;
    return nullptr;
}

const ConfigRow& config_row(std::string_view name) {
    return *find_config(name);
}

std::string_view nearest_config(std::string_view name) {
    std::vector<std::string_view> names;
    for (auto rows : {config_rows(), raw_rows()})
        for (auto& row : rows)
            names.push_back(row.name);
    return nearest(name, names);
}

// --- for everybody -----------------------------------------------------------------------------------------

static std::string_view help_of(const ConfigRow& row) {
    static std::deque<std::string> texts;
    if (row.confidence == Confidence::manual || row.confidence == Confidence::confirmed) return row.help;
    return texts.emplace_back(
        fmt::format("{} ({})", row.help, row.confidence == Confidence::single ? "one source" : "inferred"));
}

static ParameterRow shown(const ConfigRow& row) {
    ParameterRow out{.name = row.name, .unit = row.unit, .help = help_of(row)};
    if (row.kind == Kind::number) {
        out.min = row.min <= row.max ? row.min : 0;
        out.max = row.min <= row.max ? row.max : (std::int64_t{1} << row.bits) - 1;
        out.enumeration = row.enumeration;
    }
    out.permanent = true;
    out.needs_restart = needs_reset(row);
    out.secret = row.secret;
    // Modes come after what they need, and passwords and their locks last.
    out.order = static_cast<std::int8_t>(row.block == 0 ? 2 : row.name == "CFG1.MODE" ? 1 : 0);
    return out;
}

static std::vector<ParameterRow> make_parameter_rows() {
    std::vector<bool> named(block_count);
    for (auto& row : config_rows())
        for (std::size_t i = 0; i < blocks_of(row); ++i)
            named[row.block + i] = true;
    std::vector<ParameterRow> rows;
    for (auto& block : blocks()) {
        for (auto& raw : raw_rows()) {
            if (raw.block != block.number) continue;
            auto& row = rows.emplace_back(shown(raw));
            row.raw = named[raw.block];
            if (row.raw) row.order = -1;
        }
        for (auto& each : config_rows())
            if (each.block == block.number) rows.push_back(shown(each));
    }
    return rows;
}

std::span<const ParameterRow> parameter_rows() {
    static const std::vector<ParameterRow> rows = make_parameter_rows();
    return rows;
}

Result<Value> parse_parameter(const ParameterRow& parameter, const std::string& typed) {
    const auto* row = find_config(parameter.name);
    if (row == nullptr) return fail(fmt::format("there is no parameter {}", parameter.name));
    Bytes bytes(block_size * blocks_of(*row));
    if (auto done = set(*row, Value(typed), bytes); !done)
        return fail(fmt::format("{}: {}", row->name, done.error().detail));
    return get(*row, bytes);
}

}  // namespace gantry::harting
