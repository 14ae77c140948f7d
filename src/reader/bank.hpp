#pragma once
#include <cstdint>
#include <optional>
#include <string_view>

namespace gantry {

// The memory banks of a Gen2 tag. Tags of other kinds have one memory, which counts as `user`.
enum class Bank : std::uint8_t { reserved = 0, epc = 1, tid = 2, user = 3 };
std::string_view to_text(Bank bank);
std::optional<Bank> parse_bank(std::string_view text);  // "user" or "3"

}  // namespace gantry
