#include "wire/layout.hpp"

#include <algorithm>
#include <array>
#include <charconv>

#include <fmt/format.h>

#include "base/text.hpp"

namespace gantry::wire {

const EnumRow* Enumeration::find(std::int64_t value) const {
    auto it = std::ranges::find(rows, value, &EnumRow::value);
    return it == rows.end() ? nullptr : &*it;
}

const EnumRow* Enumeration::find(std::string_view wanted) const {
    auto it = std::ranges::find(rows, wanted, &EnumRow::name);
    if (it == rows.end()) it = std::ranges::find_if(rows, [&](auto& row) { return alike(row.name, wanted); });
    return it == rows.end() ? nullptr : &*it;
}

Value text_value(ByteView raw) {
    if (is_printable_ascii(as_text(raw))) return Value(std::string(as_text(raw)));
    Fields hex;
    hex.push_back({"hex", Value(to_hex(raw))});
    return Value(std::move(hex));
}

static Value decode_one(const FieldRow& row, Reader& in) {
    switch (row.type) {
        case Type::number:
        case Type::integer: {
            auto raw = in.big_endian(row.size, row.name);
            auto number = static_cast<std::int64_t>(raw);
            if (row.type == Type::integer && row.size < 8) {
                auto sign = std::uint64_t{1} << (8 * row.size - 1);
                number = static_cast<std::int64_t>((raw ^ sign) - sign);
            }
            if (row.enumeration != nullptr)
                if (auto* known = row.enumeration->find(number)) return Value(std::string(known->name));
            return Value(number);
        }
        case Type::bytes:
        case Type::text: {
            auto raw = in.bytes(row.size == 0 ? in.left() : row.size, row.name);
            if (row.type == Type::text) return text_value(raw);
            return Value(Bytes(raw.begin(), raw.end()));
        }
        case Type::sized: {
            auto size = in.big_endian(row.size, row.name);
            auto raw = in.bytes(static_cast<std::size_t>(size), row.name);
            return Value(Bytes(raw.begin(), raw.end()));
        }
        case Type::version: {
            auto raw = in.bytes(4, row.name);
            if (raw.size() != 4) return {};
            return Value(fmt::format("{}.{}.{}.{}", raw[0], raw[1], raw[2], raw[3]));
        }
        case Type::list: {
            Value::List list;
            // A record has at least one byte, so the bytes that are left bound the count before memory does.
            auto count = in.big_endian(row.size, row.name);
            if (count > in.left() && !in.fault()) in.fail(Errc::truncated, row.name);
            for (; count > 0 && !in.fault(); --count) {
                Fields record;
                decode(row.record, in, record);
                list.emplace_back(std::move(record));
            }
            return Value(std::move(list));
        }
    }
    return {};
}

void decode(Layout layout, Reader& in, Fields& out) {
    for (auto& row : layout) {
        auto value = decode_one(row, in);
        if (in.fault()) return;
        out.push_back({std::string(row.name), std::move(value)});
    }
}

std::optional<std::int64_t> as_number(const Value& value, const Enumeration* enumeration) {
    if (auto* number = value.get<std::int64_t>()) return *number;
    if (auto* yes = value.get<bool>()) return *yes ? 1 : 0;
    auto* text = value.get<std::string>();
    if (text == nullptr || text->empty()) return {};
    if (enumeration != nullptr)
        if (auto* row = enumeration->find(std::string_view(*text))) return row->value;
    std::string_view digits = *text;
    bool negative = digits.starts_with('-');
    if (negative) digits.remove_prefix(1);
    int base = 10;
    if (digits.starts_with("0x") || digits.starts_with("0X")) {
        digits.remove_prefix(2);
        base = 16;
    }
    std::uint64_t number = 0;
    auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), number, base);
    if (error != std::errc{} || end != digits.data() + digits.size()) return {};
    return negative ? -static_cast<std::int64_t>(number) : static_cast<std::int64_t>(number);
}

std::optional<Bytes> as_raw(const Value& value) {
    if (auto* bytes = value.get<Bytes>()) return *bytes;
    if (auto* text = value.get<std::string>()) return from_hex(*text);
    return {};
}

std::optional<Bytes> as_text_bytes(const Value& value) {
    if (auto* text = value.get<std::string>()) return Bytes(text->begin(), text->end());
    if (auto* number = value.get<std::int64_t>()) {
        auto text = fmt::format("{}", *number);
        return Bytes(text.begin(), text.end());
    }
    if (auto* bytes = value.get<Bytes>()) return *bytes;
    if (auto* record = value.get<Fields>(); record != nullptr && record->size() == 1)
        if (auto* hex = find(*record, "hex")) return as_raw(*hex);
    return {};
}

static Fault refused(Errc code, const Bytes& out, const FieldRow& row, std::string detail) {
    return {code, out.size(), row.name, std::move(detail)};
}

static Result<void> encode_number(const FieldRow& row, const Value& value, Bytes& out) {
    auto number = as_number(value, row.enumeration);
    if (!number) {
        std::string expected =
            row.enumeration != nullptr ? "expected a number or one of:" : "expected a number";
        if (row.enumeration != nullptr)
            for (auto& each : row.enumeration->rows)
                expected += fmt::format(" {}", each.name);
        return tl::unexpected(refused(Errc::bad_value, out, row, expected));
    }
    std::int64_t min = 0, max = INT64_MAX;
    if (row.size < 8) {
        bool is_signed = row.type == Type::integer;
        max = (std::int64_t{1} << (8 * row.size - (is_signed ? 1 : 0))) - 1;
        min = is_signed ? -max - 1 : 0;
    } else if (row.type == Type::integer) {
        min = INT64_MIN;
    }
    if (*number < min || *number > max)
        return tl::unexpected(
            refused(Errc::bad_value, out, row, fmt::format("{} is outside {} to {}", *number, min, max)));
    Writer(out).big_endian(static_cast<std::uint64_t>(*number), row.size);
    return {};
}

static Result<void> encode_list(const FieldRow& row, const Value& value, Bytes& out) {
    auto* list = value.get<Value::List>();
    if (list == nullptr) return tl::unexpected(refused(Errc::bad_value, out, row, "expected a list"));
    if (row.size < 8 && list->size() >> (8 * row.size) != 0)
        return tl::unexpected(refused(Errc::too_big, out, row, "more records than the count can hold"));
    Writer(out).big_endian(list->size(), row.size);
    for (auto& item : *list) {
        auto* record = item.get<Fields>();
        if (record == nullptr) return tl::unexpected(refused(Errc::bad_value, out, row, "expected a record"));
        if (auto done = encode(row.record, *record, out); !done) return done;
    }
    return {};
}

static Result<void> encode_version(const FieldRow& row, const Value& value, Bytes& out) {
    auto* text = value.get<std::string>();
    std::array<unsigned, 4> part{};
    const char* at = text != nullptr ? text->data() : nullptr;
    const char* end = text != nullptr ? at + text->size() : nullptr;
    for (std::size_t i = 0; i < 4; ++i) {
        if (i > 0 && (at == end || *at++ != '.')) at = end = nullptr;
        auto [next, error] = std::from_chars(at, end, part[i]);
        if (at == nullptr || error != std::errc{} || part[i] > 255)
            return tl::unexpected(refused(Errc::bad_value, out, row, "expected a.b.c.d, each 0 to 255"));
        at = next;
    }
    if (at != end)
        return tl::unexpected(refused(Errc::bad_value, out, row, "expected a.b.c.d, each 0 to 255"));
    for (auto each : part)
        out.push_back(static_cast<std::uint8_t>(each));
    return {};
}

static Result<void> encode_one(const FieldRow& row, const Value& value, Bytes& out) {
    switch (row.type) {
        case Type::number:
        case Type::integer:
            return encode_number(row, value, out);
        case Type::list:
            return encode_list(row, value, out);
        case Type::version:
            return encode_version(row, value, out);
        case Type::bytes:
        case Type::text:
        case Type::sized:
            break;
    }
    auto raw = row.type == Type::text ? as_text_bytes(value) : as_raw(value);
    if (!raw)
        return tl::unexpected(
            refused(Errc::bad_value, out, row,
                    row.type == Type::text ? "expected text" : "expected hex digits, two a byte"));
    if (row.type == Type::sized) {
        if (row.size < 8 && raw->size() >> (8 * row.size) != 0)
            return tl::unexpected(refused(Errc::too_big, out, row, "longer than its length field can say"));
        Writer(out).big_endian(raw->size(), row.size);
    } else if (row.size != 0 && raw->size() != row.size) {
        return tl::unexpected(
            refused(Errc::bad_length, out, row, fmt::format("{} bytes, expected {}", raw->size(), row.size)));
    }
    Writer(out).bytes(*raw);
    return {};
}

Result<void> encode(Layout layout, const Fields& fields, Bytes& out,
                    std::span<const std::string_view> allow) {
    for (auto& field : fields) {
        bool known = std::ranges::find(layout, field.name, &FieldRow::name) != layout.end() ||
                     std::ranges::find(allow, field.name) != allow.end();
        if (known) continue;
        std::vector<std::string_view> names;
        for (auto& row : layout)
            names.push_back(row.name);
        auto near = nearest(field.name, names);
        return tl::unexpected(Fault{Errc::unknown_code, out.size(), "field",
                                    near.empty() ? fmt::format("there is no field {}", printable(field.name))
                                                 : fmt::format("there is no field {}; did you mean {}?",
                                                               printable(field.name), near)});
    }
    for (auto& row : layout) {
        auto* value = find(fields, row.name);
        if (value == nullptr)
            return tl::unexpected(
                refused(Errc::bad_value, out, row, fmt::format("field {} is missing", row.name)));
        if (auto done = encode_one(row, *value, out); !done) return done;
    }
    return {};
}

Result<void> check(Layout layout, const Fields& fields) {
    for (auto& row : layout) {
        auto* value = find(fields, row.name);
        if (value == nullptr) continue;
        if (auto* list = value->get<Value::List>()) {
            for (auto& item : *list)
                if (auto* record = item.get<Fields>())
                    if (auto fine = check(row.record, *record); !fine) return fine;
        } else if (row.min <= row.max) {
            auto number = as_number(*value, row.enumeration);
            if (number && (*number < row.min || *number > row.max))
                return tl::unexpected(
                    Fault{Errc::bad_value, 0, row.name,
                          fmt::format("{} is outside {} to {}", *number, row.min, row.max)});
        }
    }
    return {};
}

}  // namespace gantry::wire
