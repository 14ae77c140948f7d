#pragma once
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace gantry {

using Bytes = std::vector<std::uint8_t>;         // owned
using ByteView = std::span<const std::uint8_t>;  // borrowed

// "80 01" or "8001" to bytes; blanks are allowed between digits. Nothing when a character is no hex digit
// or a digit is missing its partner.
std::optional<Bytes> from_hex(std::string_view text);

// Upper-case hex without blanks.
std::string to_hex(ByteView bytes);
// The same into a caller's buffer of 2 * bytes.size() characters; returns one past the last written.
char* write_hex(ByteView bytes, char* out);

inline std::string_view as_text(ByteView bytes) {
    return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}
inline ByteView as_bytes(std::string_view text) {
    return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

}  // namespace gantry
