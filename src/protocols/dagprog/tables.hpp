#pragma once
#include <cstdint>
#include <span>
#include <string_view>

#include "event/event.hpp"
#include "wire/layout.hpp"
#include "wire/message.hpp"

// What the lines of DAGProg say, as data. Sections are those of docs/protocols/dagprog.md.
namespace gantry::dagprog {

inline constexpr std::uint8_t byte_stx = 0x02, byte_tab = 0x09, byte_lf = 0x0A, byte_cr = 0x0D;
// A line from STX or its first character to CR. The longest known one is the banner, whose length is open.
inline constexpr std::size_t max_line = 128;

enum class Code : std::uint8_t {
    empty,
    first_block,  // `bk` and `BK`, and their one answer
    block_count,
    version,
    transmit,
    power_up,
    read_forever,
    read_checked,
    read_once,
    read_serial,
    write,
    write_crc8,
    stop,
    save,
    field_off,
    field_on,
    block_data,
    serial_number,
    error,
    unknown_command,
    banner,
    ready,
};

// The two kinds of units, by the tags that they read.
enum class Family : std::uint8_t { icode1, iso15693 };
std::string_view to_text(Family family);
inline event::Technology technology(Family family) {
    return family == Family::icode1 ? event::Technology::icode1 : event::Technology::iso15693;
}

// How a field is written in a line.
enum class Kind : std::uint8_t {
    decimal,  // `size` digits, filled up with zeros
    hex,      // a number in `size` hex digits
    bytes,    // hex digits, `size` of them, of at most as many when `shorter`
    serial,   // the same, and a result may stand there instead (section 5.2)
    text,     // all that is left
};

struct PartRow {
    std::string_view name;
    Kind kind;
    std::uint8_t size;  // characters
    bool shorter = false;
    std::int64_t icode1_max = -1, iso15693_max = -1;  // legal values from 0; -1: all that fit
    const wire::Enumeration* enumeration = nullptr;
    std::string_view note = {};
};

// What becomes of a command.
enum class Answer : std::uint8_t {
    none,
    echo,    // a line of the same code
    serial,  // the echo and then a serial number
    write,   // a serial number and then the block
};

struct MessageRow {
    Code code;
    wire::Direction direction;
    std::string_view word;  // as it stands in the line
    std::string_view name;
    std::span<const PartRow> parts;
    bool icode1, iso15693;   // which units know it
    Answer answer;           // of a command
    std::string_view alias;  // another way to write the word; empty: none (section 9.1)
    std::string_view source;

    bool known_to(Family family) const { return family == Family::icode1 ? icode1 : iso15693; }
    bool sets() const { return !parts.empty() && direction == wire::Direction::to_reader; }
};
std::span<const MessageRow> messages();
const MessageRow* find_message(std::string_view name, wire::Direction direction);
// By word or alias; nullptr: no row has it.
const MessageRow* find_word(std::string_view word, wire::Direction direction);
// The command that asks for a value, or the one that has no value.
const MessageRow& query(Code code);
// The command that sets one.
const MessageRow& setter(Code code);

std::int64_t max_of(const PartRow& part, Family family);  // -1: all that fit

extern const wire::Enumeration transmit_modes, power_up_modes, errors;

// Transmission mode as bits (section 5.1).
inline constexpr std::uint32_t transmit_data = 1, transmit_serial = 4;

inline constexpr std::uint32_t last_block(Family family) {
    return family == Family::icode1 ? 15 : 14;
}
inline constexpr std::size_t block_size = 4;
// Blocks of an ICODE1 tag that hold its number, its write-access bits and its special functions: what is
// written there cannot be undone (section 7).
inline constexpr std::uint32_t icode1_system_blocks = 4;

}  // namespace gantry::dagprog
