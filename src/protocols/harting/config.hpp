#pragma once
#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "protocols/harting/tables.hpp"
#include "reader/plugin.hpp"
#include "wire/layout.hpp"

// The reader's configuration: 64 blocks CFG0 to CFG63 of 14 bytes each, once in RAM, where it takes effect,
// and once in EEPROM, where it outlives a power-down (section 9).
namespace gantry::harting {

inline constexpr std::size_t block_size = 14, block_count = 64;
using Block = std::array<std::uint8_t, block_size>;

struct BlockRow {
    std::uint8_t number;
    std::string_view name;     // "Interface and Mode"
    bool reserved = false;     // reads as 0x15, writes as 0x16
    bool needs_reset = false;  // what is written to it takes effect after a write to EEPROM and a reset
    Block factory = {};
    std::string_view note = {};
};
std::span<const BlockRow> blocks();  // all 64, in order

// One parameter: some bits of a block, or bytes in a row.
struct ConfigRow {
    enum class Kind : std::uint8_t {
        number,   // `bits` bits, most significant byte first where they span bytes
        address,  // 4 bytes, "192.168.0.10"
        bytes,    // hex
        mask,     // hex; what is not given is zero
        text,     // its length is in the byte before it; zero-filled
    };
    std::string_view name;  // "CFG1.MODE"
    std::uint8_t block;
    std::uint8_t byte;     // the first one
    std::uint8_t bit = 0;  // the lowest bit of a number within one byte
    std::uint16_t bits =
        8;  // numbers: 1 to 32; else 8 * bytes. May run over into the next blocks (masks, names)
    Kind kind = Kind::number;
    std::string_view unit = {};
    std::int64_t min = 0, max = -1;  // legal numbers, if min <= max
    const wire::Enumeration* enumeration = nullptr;
    Confidence confidence = Confidence::single;
    bool secret = false;  // a password: can be set, is never read back to anybody
    std::string_view help = {};
};
std::span<const ConfigRow> config_rows();
const ConfigRow* find_config(std::string_view name);     // exact, then ignoring case; "CFG12" + ".RAW" too
std::string_view nearest_config(std::string_view name);  // for "did you mean"; empty when none is near
const ConfigRow& config_row(std::string_view name);      // the name must be a row

// The parameter in the bytes of its block and of those that follow it (a row can run over into them).
wire::Value get(const ConfigRow& row, std::span<const std::uint8_t> bytes);
std::int64_t get_number(const ConfigRow& row, std::span<const std::uint8_t> bytes);
// Changes nothing else: bits that nobody has published stay as they are.
wire::Result<void> set(const ConfigRow& row, const wire::Value& value, std::span<std::uint8_t> bytes);
// Does what is written to it take effect only after a write to EEPROM and a reset?
bool needs_reset(const ConfigRow& row);
// How many blocks from row.block on it touches.
std::size_t blocks_of(const ConfigRow& row);

// All rows as everybody sees them: Plugin::parameters. "CFG1.MODE", and "CFGn.RAW" for each block but the
// passwords' as hex, first of its block.
std::span<const ParameterRow> parameter_rows();
Result<wire::Value> parse_parameter(const ParameterRow& row, const std::string& typed);  // Plugin's

extern const wire::Enumeration modes;  // of CFG1.MODE
enum class Mode : std::uint8_t { host = 0x00, scan = 0x01, buffered_read = 0x80, notification = 0xC0 };

}  // namespace gantry::harting
