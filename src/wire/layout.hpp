#pragma once
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include "wire/cursor.hpp"
#include "wire/message.hpp"

namespace gantry::wire {

// Tables that say what the bytes of a message mean. A protocol writes them as constexpr data; the functions
// below decode, encode and check from them. What no table can say is code beside the table.

struct EnumRow {
    std::int64_t value;
    std::string_view name;
    std::string_view note = {};  // source, or what the name does not say
};

struct Enumeration {
    std::string_view name;
    std::span<const EnumRow> rows;

    const EnumRow* find(std::int64_t value) const;
    const EnumRow* find(std::string_view wanted) const;  // exact, then ignoring case
};

enum class Type : std::uint8_t {
    number,   // `size` bytes, most significant first, unsigned
    integer,  // the same, two's complement
    bytes,    // `size` bytes; 0: all that is left
    text,     // the same, shown as text when it is printable ASCII, else as {"hex": "..."}
    version,  // four bytes a.b.c.d, shown as "a.b.c.d"
    list,     // a count of `size` bytes, then as many records of `record`
    sized,    // a length of `size` bytes, then as many bytes
};

struct FieldRow;

// The rows of a message or record, in wire order.
using Layout = std::span<const FieldRow>;

struct FieldRow {
    std::string_view name;
    Type type;
    std::uint8_t size;                         // see Type
    std::int64_t min = 0, max = -1;            // legal values for check(); min > max: all that fit
    std::string_view unit = {};                // "dBm", "s", "0.1 dBm", ...
    const Enumeration* enumeration = nullptr;  // numbers shown by name where a row has one
    Layout record = {};                        // of a list
    std::string_view note = {};                // meaning and source, for the documents
};

// Reads the rows of `layout` from `in` and appends them to `out`. A fault is left in the reader.
void decode(Layout layout, Reader& in, Fields& out);

// Appends the bytes of `fields` by the rows of `layout`. Every row must be there; a name that no row has is
// refused with `unknown_code`, a value that does not fit with `bad_value`. `allow` names fields that the
// caller handles itself.
Result<void> encode(Layout layout, const Fields& fields, Bytes& out,
                    std::span<const std::string_view> allow = {});

// Are all numbers inside the legal values of their rows? Asked before a person's message is sent; `encode`
// itself puts back whatever `decode` found.
Result<void> check(Layout layout, const Fields& fields);

// A number, or its text ("12", "0x0C", an enumeration's name); nothing when it is neither.
std::optional<std::int64_t> as_number(const Value& value, const Enumeration* enumeration = nullptr);
// Bytes, or their hex text.
std::optional<Bytes> as_raw(const Value& value);
// Text, or {"hex": "..."} as `decode` makes it for what is not printable.
std::optional<Bytes> as_text_bytes(const Value& value);
Value text_value(ByteView raw);

}  // namespace gantry::wire
