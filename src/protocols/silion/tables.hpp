#pragma once
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "wire/layout.hpp"
#include "wire/message.hpp"

// What the bytes of Silion's active mode mean, as data. Sections are those of docs/protocols/silion.md.
namespace gantry::silion {

enum class Code : std::uint8_t {
    tags = 0x01,  // to the reader: tag acknowledgement
    inputs = 0x02,
    first_seen = 0x03,
    heartbeat = 0x04,
    fault = 0x05,
    time_request = 0x06,
    get_inputs = 0x16,
    set_outputs = 0x17,
    restart = 0x18,
};

inline constexpr std::uint8_t flag_answer = 0x01;  // the receiver must answer
inline constexpr std::uint8_t flag_crc = 0x02;     // two CRC bytes follow the data

// One message of the protocol.
struct MessageRow {
    Code code;
    wire::Direction direction;
    std::string_view name;
    wire::Layout layout;
    std::uint16_t max_data;  // a head of this code that claims more data is no head: wrong start
    std::uint8_t flags;      // what a sender sets beside the CRC bit
    std::string_view source;
};
std::span<const MessageRow> messages();
const MessageRow* find_message(std::uint8_t code, wire::Direction direction);  // nullptr: no such row
const MessageRow* find_message(std::string_view name, wire::Direction direction);

// The most data of a code that no row has: the largest frame a reader can be configured to send.
inline constexpr std::uint16_t max_unknown_data = 8192;

// Tag data with the bank length that all known readers send (one byte), and with two bytes, which section 5
// wants tried when the first does not fit.
extern const wire::Layout tags_layout;
extern const wire::Layout wide_tags_layout;
inline bool carries_tags(const MessageRow& row) {
    return row.layout.data() == tags_layout.data();
}

extern const wire::Enumeration main_boards, modules, tag_protocols, errors;

// The status field of a frame (section 6): both generations' codings.
struct ReaderStatus {
    std::int64_t code = 0;  // the error number, or the whole field where the number is unknown; 0: normal
    std::string text;
};
ReaderStatus describe_status(std::uint32_t status);
inline constexpr std::uint32_t status_base = 100'000;  // gen 1 adds it to every error number

}  // namespace gantry::silion
