#include "protocols/caen/values.hpp"

#include <array>
#include <bit>
#include <charconv>
#include <cmath>

#include <fmt/format.h>

#include "base/text.hpp"
#include "base/time.hpp"
#include "wire/cursor.hpp"

namespace gantry::caen {

using wire::Errc;
using wire::Fault;
using wire::Field;
using wire::Fields;
using wire::Value;

// --- bytes to values ---------------------------------------------------------------------------------------

static Field raw_field(const Avp& avp) {
    Fields record;
    record.push_back({"type", Value(fmt::format("0x{:04X}", avp.type))});
    record.push_back({"value", Value(Bytes(avp.value.begin(), avp.value.end()))});
    return {std::string(raw_name), Value(std::move(record))};
}

static Value number_value(const AttributeRow& row, ByteView bytes) {
    std::uint64_t raw = 0;
    for (auto byte : bytes)
        raw = raw << 8 | byte;
    auto number = static_cast<std::int64_t>(raw);
    if (row.kind == Kind::integer) {
        auto sign = std::uint64_t{1} << (8 * row.size - 1);
        number = static_cast<std::int64_t>((raw ^ sign) - sign);
    }
    if (row.enumeration != nullptr)
        if (auto* known = row.enumeration->find(number)) return Value(std::string(known->name));
    return Value(number);
}

static Value text_value(ByteView bytes) {
    auto text = as_text(bytes);
    auto nul = text.find('\0');
    if (nul != std::string_view::npos && nul + 1 == text.size() && is_printable_ascii(text.substr(0, nul)))
        return Value(std::string(text.substr(0, nul)));
    if (nul == std::string_view::npos && is_printable_ascii(text)) {
        Fields record;
        record.push_back({"unterminated", Value(std::string(text))});
        return Value(std::move(record));
    }
    return wire::text_value(bytes);
}

static std::string real_text(float real) {
    std::array<char, 64> text{};
    auto [end, error] = std::to_chars(text.data(), text.data() + text.size(), real);
    return {text.data(), error == std::errc{} ? end : text.data()};
}

Field field_of(const Avp& avp) {
    const auto* row = find_attribute(avp.type);
    if (row == nullptr) return raw_field(avp);
    std::string name(row->name);
    switch (row->kind) {
        case Kind::number:
        case Kind::integer:
            if (avp.value.size() != row->size) break;
            return {std::move(name), number_value(*row, avp.value)};
        case Kind::real: {
            if (avp.value.size() != row->size) break;
            auto real = std::bit_cast<float>(*avp.number());
            if (!std::isfinite(real)) break;
            return {std::move(name), Value(real_text(real))};
        }
        case Kind::timestamp: {
            if (avp.value.size() != row->size) break;
            wire::Reader in(avp.value);
            auto seconds = in.u32("seconds");
            return {std::move(name), Value(fmt::format("{}.{:06}", seconds, in.u32("microseconds")))};
        }
        case Kind::text:
            return {std::move(name), text_value(avp.value)};
        case Kind::bytes:
            return {std::move(name), Value(Bytes(avp.value.begin(), avp.value.end()))};
    }
    return raw_field(avp);
}

// --- values to bytes ---------------------------------------------------------------------------------------

static tl::unexpected<Fault> wrong(std::size_t offset, std::string_view field, std::string detail) {
    return tl::unexpected(Fault{Errc::bad_value, offset, field, std::move(detail)});
}

static std::string names_of(const wire::Enumeration& enumeration) {
    std::string names;
    for (auto& row : enumeration.rows)
        names += fmt::format("{}{}", names.empty() ? "" : ", ", row.name);
    return names;
}

static wire::Result<Bytes> number_bytes(const AttributeRow& row, const Value& value, std::size_t offset) {
    auto number = wire::as_number(value, row.enumeration);
    if (!number && row.enumeration != nullptr)
        return wrong(offset, row.name,
                     fmt::format("expected a number or one of: {}", names_of(*row.enumeration)));
    if (!number) return wrong(offset, row.name, "expected a number");
    bool is_signed = row.kind == Kind::integer;
    std::int64_t max = (std::int64_t{1} << (8 * row.size - (is_signed ? 1 : 0))) - 1;
    std::int64_t min = is_signed ? -max - 1 : 0;
    if (*number < min || *number > max)
        return wrong(offset, row.name, fmt::format("{} is outside {} to {}", *number, min, max));
    Bytes bytes;
    wire::Writer(bytes).big_endian(static_cast<std::uint64_t>(*number), row.size);
    return bytes;
}

static wire::Result<Bytes> real_bytes(const AttributeRow& row, const Value& value, std::size_t offset) {
    auto text = wire::as_text_bytes(value);
    float real = 0;
    const char* begin = text ? as_text(*text).data() : nullptr;
    const char* end = text ? begin + text->size() : nullptr;
    auto [stop, error] = std::from_chars(begin, end, real);
    if (begin == end || error != std::errc{} || stop != end || !std::isfinite(real))
        return wrong(offset, row.name, "expected a decimal number like 1.25");
    Bytes bytes;
    wire::Writer(bytes).u32(std::bit_cast<std::uint32_t>(real));
    return bytes;
}

// "1400", "1400.5", "1400.000001", or a date: 2026-11-21T23:04:00Z.
static std::optional<std::pair<std::uint32_t, std::uint32_t>> parse_time(std::string_view text) {
    if (auto date = parse_rfc3339(text)) {
        auto micros = to_us(*date);
        if (micros < 0 || micros / 1'000'000 > UINT32_MAX) return {};
        return std::pair{static_cast<std::uint32_t>(micros / 1'000'000),
                         static_cast<std::uint32_t>(micros % 1'000'000)};
    }
    auto dot = text.find('.');
    auto whole = text.substr(0, dot);
    std::string fraction(dot == std::string_view::npos ? "0" : text.substr(dot + 1));
    if (fraction.size() < 6) fraction.resize(6, '0');  // more digits: more microseconds than a second has
    std::uint32_t seconds = 0, micros = 0;
    auto parse = [](std::string_view digits, std::uint32_t& number) {
        auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), number);
        return !digits.empty() && error == std::errc{} && end == digits.data() + digits.size();
    };
    if (!parse(whole, seconds) || !parse(fraction, micros)) return {};
    return std::pair{seconds, micros};
}

static wire::Result<Bytes> time_bytes(const AttributeRow& row, const Value& value, std::size_t offset) {
    auto text = wire::as_text_bytes(value);
    auto time = text ? parse_time(as_text(*text)) : std::nullopt;
    if (!time)
        return wrong(offset, row.name,
                     "expected seconds since 1970 like 1400.000000, or 2026-11-21T23:04:00Z");
    Bytes bytes;
    wire::Writer writer(bytes);
    writer.u32(time->first);
    writer.u32(time->second);
    return bytes;
}

static wire::Result<Bytes> text_bytes(const AttributeRow& row, const Value& value, std::size_t offset) {
    if (auto* record = value.get<Fields>(); record != nullptr && record->size() == 1)
        if (auto* text = wire::find(*record, "unterminated"))
            if (auto raw = wire::as_text_bytes(*text)) return *raw;
    auto raw = wire::as_text_bytes(value);
    if (!raw) return wrong(offset, row.name, "expected text");
    bool as_it_is = value.get<std::string>() == nullptr && value.get<std::int64_t>() == nullptr;
    if (!as_it_is) raw->push_back(0);
    return std::move(*raw);
}

static wire::Result<Bytes> value_bytes(const AttributeRow& row, const Value& value, std::size_t offset) {
    switch (row.kind) {
        case Kind::number:
        case Kind::integer:
            return number_bytes(row, value, offset);
        case Kind::real:
            return real_bytes(row, value, offset);
        case Kind::timestamp:
            return time_bytes(row, value, offset);
        case Kind::text:
            return text_bytes(row, value, offset);
        case Kind::bytes:
            break;
    }
    auto raw = wire::as_raw(value);
    if (!raw) return wrong(offset, row.name, "expected hex digits, two a byte");
    return std::move(*raw);
}

static const AttributeRow* row_named(std::string_view name, const CommandRow* command) {
    if (const auto* row = find_attribute(name)) return row;
    if (command == nullptr) return nullptr;
    for (auto params : {command->in, command->out})
        for (auto& param : params)
            if (!param.name.empty() && param.name == name) return &row_of(param.attribute);
    return nullptr;
}

static std::optional<std::uint16_t> typed_code(const Value& value) {
    auto number = wire::as_number(value);
    if (!number || *number < 0 || *number > 0xFFFF) return {};
    return static_cast<std::uint16_t>(*number);
}

static wire::Result<Pair> raw_pair(std::optional<std::uint16_t> type, const Value* value,
                                   std::size_t offset) {
    auto bytes = value != nullptr ? wire::as_raw(*value) : std::nullopt;
    if (!type || !bytes)
        return wrong(offset, raw_name,
                     R"(expected {"type": "0x1234", "value": "hex digits"}, or 0x1234=hex digits)");
    return Pair{.type = *type, .value = std::move(*bytes)};
}

static Fault no_such_field(std::string_view name, const CommandRow* command, std::size_t offset) {
    std::vector<std::string_view> known;
    if (command != nullptr && !command->in.empty()) {
        for (auto& param : command->in)
            known.push_back(row_of(param.attribute).name);
    } else {
        for (auto& row : attributes())
            known.push_back(row.name);
    }
    auto near = nearest(name, known);
    return Fault{Errc::unknown_code, offset, "field",
                 near.empty()
                     ? fmt::format("there is no attribute {}; one without a name is typed as 0x1234=hex",
                                   printable(name))
                     : fmt::format("there is no attribute {}; did you mean {}?", printable(name), near)};
}

wire::Result<Pair> pair_of(const Field& field, const CommandRow* command, std::size_t offset) {
    if (field.name == raw_name) {
        auto* record = field.value.get<Fields>();
        auto* type = record != nullptr ? wire::find(*record, "type") : nullptr;
        auto code = type != nullptr ? typed_code(*type) : std::nullopt;
        return raw_pair(code, record != nullptr ? wire::find(*record, "value") : nullptr, offset);
    }
    if (field.name.starts_with("0x") || field.name.starts_with("0X"))
        return raw_pair(typed_code(Value(field.name)), &field.value, offset);
    const auto* row = row_named(field.name, command);
    if (row == nullptr) return tl::unexpected(no_such_field(field.name, command, offset));
    auto bytes = value_bytes(*row, field.value, offset);
    if (!bytes) return tl::unexpected(bytes.error());
    return Pair{.type = row->code, .value = std::move(*bytes), .row = row};
}

// --- is it legal? ------------------------------------------------------------------------------------------

wire::Result<void> check_value(const Pair& pair, std::size_t offset) {
    if (pair.row == nullptr) return {};
    auto& row = *pair.row;
    switch (row.kind) {
        case Kind::text:
        case Kind::bytes:
            if (row.size == 0 || pair.value.size() <= row.size) return {};
            return tl::unexpected(
                Fault{Errc::too_big, offset, row.name,
                      row.kind == Kind::text
                          ? fmt::format("{} bytes with the closing NUL, at most {} fit", pair.value.size(),
                                        row.size)
                          : fmt::format("{} bytes, at most {} fit", pair.value.size(), row.size)});
        case Kind::number:
        case Kind::integer:
            break;
        case Kind::real:
        case Kind::timestamp:
            return {};
    }
    auto value =
        number_value({.code = row.code, .name = row.name, .kind = row.kind, .size = row.size}, pair.value);
    auto number = *value.get<std::int64_t>();
    if (row.enumeration != nullptr && row.enumeration->find(number) == nullptr)
        return wrong(offset, row.name, fmt::format("{} is none of: {}", number, names_of(*row.enumeration)));
    if (row.min <= row.max && (number < row.min || number > row.max))
        return wrong(offset, row.name, fmt::format("{} is outside {} to {}", number, row.min, row.max));
    return {};
}

}  // namespace gantry::caen
