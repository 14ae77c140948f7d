#pragma once
#include <string_view>

#include "protocols/caen/message.hpp"
#include "wire/message.hpp"

// One attribute-value pair as people and programs see it, for the codec.
namespace gantry::caen {

// The field of a pair that no row fits: {"type": "0x1234", "value": "hex"}.
inline constexpr std::string_view raw_name = "Attribute";

// The field that a pair is; raw where its row, or the size that its row wants, is missing.
wire::Field field_of(const Avp& avp);

// A field as encode found it: which attribute, and its bytes.
struct Pair {
    std::uint16_t type = 0;
    Bytes value;
    const AttributeRow* row = nullptr;  // null where it was given raw
};
// Takes values as a person types them. `command` (may be null) knows its parameters by other names, too.
// `offset`: of the pair in the message, for faults.
wire::Result<Pair> pair_of(const wire::Field& field, const CommandRow* command, std::size_t offset);

// Is the value legal by its row: range, enumeration, length?
wire::Result<void> check_value(const Pair& pair, std::size_t offset);

}  // namespace gantry::caen
