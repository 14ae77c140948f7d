#pragma once
#include <array>

#include "protocols/harting/tables.hpp"

// The fields of commands whose parts depend on each other: their layouts, for people, and the functions that
// know which parts are there. Private to the tables.
namespace gantry::harting::shapes {

using wire::Enumeration;
using wire::FieldRow;
using wire::Fields;
using wire::Layout;
using wire::Type;

constexpr FieldRow number(std::string_view name, std::uint8_t size, std::string_view note = {},
                          const Enumeration* enumeration = nullptr, std::string_view unit = {}) {
    return {.name = name,
            .type = Type::number,
            .size = size,
            .unit = unit,
            .enumeration = enumeration,
            .note = note};
}
constexpr FieldRow range(std::string_view name, std::int64_t min, std::int64_t max,
                         std::string_view note = {}) {
    return {.name = name, .type = Type::number, .size = 1, .min = min, .max = max, .note = note};
}
constexpr FieldRow raw(std::string_view name, std::uint8_t size, std::string_view note = {}) {
    return {.name = name, .type = Type::bytes, .size = size, .note = note};
}
constexpr FieldRow sized(std::string_view name, std::string_view note = {}) {
    return {.name = name, .type = Type::sized, .size = 1, .note = note};
}
constexpr FieldRow list(std::string_view name, std::uint8_t size, Layout record, std::string_view note = {}) {
    return {.name = name, .type = Type::list, .size = size, .record = record, .note = note};
}
constexpr FieldRow milliseconds() {
    return {.name = "MILLISECONDS",
            .type = Type::number,
            .size = 2,
            .min = 0,
            .max = 59'999,
            .unit = "ms",
            .note = "with the seconds"};
}

inline constexpr std::array opaque = {raw(raw_data, 0, "nobody has published its bytes")};
inline constexpr std::array mode_only = {number("MODE", 1)};

// --- Inventory (section 6) ---------------------------------------------------------------------------------

inline constexpr std::array inventory_request = {
    number("MODE", 1, "0x80 MORE: the rest after 0x94; 0x10 ANT: of these antennas, and say which read it"),
    range("ANT-SEL", 0, 0xFF, "only with ANT: bit 0 antenna 1 ... bit 3 antenna 4")};
inline constexpr std::array inventory_antenna = {number("ANT-NR", 1), number("ANT-STATUS", 1),
                                                 number("RSSI", 1, "-dBm", nullptr, "-dBm"),
                                                 number("PHASE", 2, "1/4096 of a turn"), raw("RESERVED", 2)};
inline constexpr std::array inventory_tag = {number("TR-TYPE", 1, "section 10", &transponder_types),
                                             number("IDDT", 1, "0x00 EPC, 0x02 EPC and TID"), sized("IDD")};
// Without a tag (FLAGS bit 0) one antenna follows and no count.
inline constexpr std::array inventory_record = {
    number("FLAGS", 1, "only with ANT: 0x01 a tag, 0x10 antennas"),
    number("TR-TYPE", 1, "section 10", &transponder_types),
    number("IDDT", 1, "0x00 EPC, 0x02 EPC and TID"),
    sized("IDD"),
    list("ANT-CNT", 1, inventory_antenna, "only with ANT"),
    number("ANT-NR", 1, "these five: only with ANT and no tag"),
    number("ANT-STATUS", 1),
    number("RSSI", 1),
    number("PHASE", 2),
    raw("RESERVED", 2)};
inline constexpr std::array inventory_reply = {list("DATA-SETS", 1, inventory_record)};

void decode_inventory_request(wire::Reader& in, const Asked& asked, Fields& out);
wire::Result<void> encode_inventory_request(const Fields& fields, Bytes& out);
void decode_inventory_reply(wire::Reader& in, const Asked& asked, Fields& out);
wire::Result<void> encode_inventory_reply(const Fields& fields, Bytes& out);

// --- the data buffer (section 8) ---------------------------------------------------------------------------

inline constexpr std::array buffer_antenna = {number("ANT-NR", 1), number("RSSI", 1, "-dBm", nullptr, "-dBm"),
                                              number("PHASE", 2, "1/4096 of a turn"), raw("RESERVED", 2)};
// One record: the parts that TR-DATA1 and TR-DATA2 name, in this order.
inline constexpr std::array buffer_record = {
    number("TR-TYPE", 1, "TR-DATA1 0x01, with the next two", &transponder_types),
    number("IDDT", 1, "0x00 EPC, 0x02 EPC and TID"),
    sized("IDD"),
    number("DB-N", 2, "TR-DATA1 0x02, with the next two"),
    number("DB-SIZE", 1),
    raw("DB", 0, "DB-N times DB-SIZE bytes; TR-DATA1 0x08: each block last byte first"),
    number("HOUR", 1, "TR-DATA1 0x20, with the next two"),
    number("MINUTE", 1),
    milliseconds(),
    number("CENTURY", 1, "TR-DATA1 0x40, with the next four"),
    number("YEAR", 1),
    number("MONTH", 1),
    number("DAY", 1),
    number("TIMEZONE", 1, "unused"),
    number("ANT", 1, "TR-DATA1 0x10: bit 0 antenna 1"),
    number("COUNT", 2, "TR-DATA2 0x08, with the next three"),
    number("RSSI-MAX", 1, {}, nullptr, "-dBm"),
    number("RSSI-AVG", 1, {}, nullptr, "-dBm"),
    raw("ANT-RESERVED", 3),
    number("IN", 1, "TR-DATA2 0x01, with the next: bit 0 input 1"),
    number("IN-STATUS", 1, "bit 0: the trigger is on; bit 1: its hold time is over"),
    raw("MAC", 6, "TR-DATA2 0x02"),
    list("ANT-CNT", 1, buffer_antenna, "TR-DATA2 0x10"),
    number("DIRECTION", 1, "TR-DATA2 0x20"),
    raw(rest_field, 0, "what RecLen has more: newer parts")};
inline constexpr std::array buffer_reply = {
    number("TR-DATA1", 1, "the parts of the records"), number("TR-DATA2", 1, "only with TR-DATA1 0x80"),
    number("TR-DATA3", 1, "only with TR-DATA2 0x80"), list("DATA-SETS", 2, buffer_record)};

void decode_buffer_reply(wire::Reader& in, const Asked& asked, Fields& out);
wire::Result<void> encode_buffer_reply(const Fields& fields, Bytes& out);

// --- Get Reader Info and Reader Diagnostic (sections 4 and 5) ----------------------------------------------

void decode_info_reply(wire::Reader& in, const Asked& asked, Fields& out);
wire::Result<void> encode_info_reply(const Fields& fields, Bytes& out);
void decode_diagnostic_reply(wire::Reader& in, const Asked& asked, Fields& out);
wire::Result<void> encode_diagnostic_reply(const Fields& fields, Bytes& out);

// --- commands for one tag (sections 6 and 7) ---------------------------------------------------------------

inline constexpr FieldRow tag_mode =
    number("MODE", 1, "0x01 addressed, 0x10 UID with its length, 0x20 bank and two-byte address");
inline constexpr FieldRow tag_uid =
    raw("UID", 0, "only addressed: the EPC, or the TID where inventories have it");
inline constexpr FieldRow tag_bank = number("BANK", 1, "not without MODE 0x20", &banks);
inline constexpr FieldRow tag_password = raw("A-PW", 0, "access password; on the wire it is a flag of BANK");

inline constexpr std::array read_blocks_request = {
    tag_mode, tag_uid, tag_bank, tag_password, number("DB-ADR", 2, "of Gen2 in words"), number("DB-N", 1)};
inline constexpr std::array write_blocks_request = {tag_mode,
                                                    tag_uid,
                                                    tag_bank,
                                                    tag_password,
                                                    number("DB-ADR", 2, "of Gen2 in words"),
                                                    number("DB-N", 1),
                                                    number("DB-SIZE", 1, "2 for Gen2"),
                                                    raw("DB", 0, "DB-N times DB-SIZE bytes")};
inline constexpr std::array kill_request = {tag_mode, tag_uid, raw("KILL-PW", 0),
                                            number("RECOM", 1, "only with MODE 0x08")};
inline constexpr std::array lock_request = {
    tag_mode, tag_uid, number("TR-TYPE", 1, {}, &transponder_types),
    raw("LOCK-DATA", 0, "three bytes: ten mask and ten action bits, then zeros"), raw("A-PW", 0)};
inline constexpr std::array permalock_request = {
    tag_mode,
    tag_uid,
    tag_bank,
    tag_password,
    number("BLOCK-PTR", 2, "in groups of 16 sections"),
    number("BLOCK-RANGE", 1),
    raw("MASK", 0, "two bytes a group; a bit that is set locks its section for ever")};
inline constexpr std::array permalock_status_request = {tag_mode,
                                                        tag_uid,
                                                        tag_bank,
                                                        tag_password,
                                                        number("BLOCK-PTR", 2, "in groups of 16 sections"),
                                                        number("BLOCK-RANGE", 1)};
inline constexpr std::array permalock_status_reply = {raw("MASK", 0, "two bytes a group")};
inline constexpr std::array block_record = {number("SEC-STATUS", 1, "0: fine"), raw("DB", 0)};
inline constexpr std::array read_blocks_reply = {number("DB-SIZE", 1, "on the wire after the count"),
                                                 list("DB-N", 1, block_record)};
inline constexpr std::array write_blocks_reply = {
    raw("DB-ADR-E", 0, "after a failure: the first block that was not written; some readers leave it out")};

void decode_read_blocks_reply(wire::Reader& in, const Asked& asked, Fields& out);
wire::Result<void> encode_read_blocks_reply(const Fields& fields, Bytes& out);
void decode_write_blocks_reply(wire::Reader& in, const Asked& asked, Fields& out);
wire::Result<void> encode_write_blocks_reply(const Fields& fields, Bytes& out);

void decode_tag_command(Command command, wire::Reader& in, Fields& out);
wire::Result<void> encode_tag_command(Command command, const Fields& fields, Bytes& out);
template <Command command>
void decode_tag(wire::Reader& in, const Asked& /*asked*/, Fields& out) {
    decode_tag_command(command, in, out);
}
template <Command command>
wire::Result<void> encode_tag(const Fields& fields, Bytes& out) {
    return encode_tag_command(command, fields, out);
}

// --- helpers -----------------------------------------------------------------------------------------------

// Appends the field of this row; it must be there.
wire::Result<void> put(const FieldRow& row, const Fields& fields, Bytes& out);
// Are all of them rows of the layout?
wire::Result<void> known_names(Layout layout, const Fields& fields);
Layout part(Layout layout, std::string_view first, std::size_t rows = 1);

}  // namespace gantry::harting::shapes
