#include <algorithm>
#include <array>

#include <fmt/format.h>

#include "base/text.hpp"
#include "protocols/caen/tables.hpp"

namespace gantry::caen {

using wire::EnumRow;

// --- enumerations ------------------------------------------------------------------------------------------

// Section 5. Revision 19 lists eleven of them; all others are from two client libraries that agree.
static constexpr std::array result_rows = {
    EnumRow{0, "success", "rev 4"},
    EnumRow{100, "channel name exists"},
    EnumRow{101, "address already in use"},
    EnumRow{102, "unknown error", "rev 19"},
    EnumRow{103, "bad channel"},
    EnumRow{104, "invalid source name"},
    EnumRow{105, "invalid channel name"},
    EnumRow{106, "too many channels"},
    EnumRow{107, "too many sources"},
    EnumRow{109, "source not in channel"},
    EnumRow{110, "bad timer value"},
    EnumRow{111, "trigger name exists"},
    EnumRow{112, "too many triggers"},
    EnumRow{113, "bad trigger"},
    EnumRow{114, "bad address"},
    EnumRow{115, "invalid protocol"},
    EnumRow{116, "bad port address"},
    EnumRow{117, "cannot connect to server"},
    EnumRow{118, "invalid trigger name"},
    EnumRow{119, "invalid time"},
    EnumRow{120, "source not found"},
    EnumRow{121, "trigger not found"},
    EnumRow{122, "channel not found"},
    EnumRow{123, "bad read point"},
    EnumRow{124, "channel busy"},
    EnumRow{125, "trigger busy"},
    EnumRow{126, "internal file system error"},
    EnumRow{127, "invalid command", "rev 19"},
    EnumRow{128, "bad parameter value"},
    EnumRow{129, "notify server not ready"},
    EnumRow{183, "power out of range", "rev 19"},
    EnumRow{200, "invalid parameter", "rev 19, which warns that firmware uses it for much else"},
    EnumRow{201, "logical source disabled"},
    EnumRow{202, "tag not present", "rev 4"},
    EnumRow{203, "tag write error", "rev 19"},
    EnumRow{204, "tag read error"},
    EnumRow{205, "bad tag address", "rev 19"},
    EnumRow{206, "invalid function", "rev 19"},
    EnumRow{207, "select or unselect error"},
    EnumRow{209, "tag locked", "rev 19: the lock failed, too"},
    EnumRow{210, "unsupported", "rev 19 says failed, a library of 2011 kill failed"},
    EnumRow{211, "insufficient power"},
    EnumRow{212, "non-specific tag error"},
    EnumRow{213, "kill tag error"},
    EnumRow{214, "channels full"},
    EnumRow{215, "read point matching error"},
};
static constexpr std::array event_type_rows = {
    EnumRow{0, "Unknown"},  EnumRow{1, "Glimpsed"}, EnumRow{2, "New"},
    EnumRow{3, "Observed"}, EnumRow{4, "Lost"},     EnumRow{5, "Purged"},
};
static constexpr std::array tag_type_rows = {
    EnumRow{0, "ISO18000-6B"}, EnumRow{1, "EPCC1G1"}, EnumRow{2, "ISO18000-6A"},
    EnumRow{3, "EPCC1G2"},     EnumRow{5, "EPC119"},
};
static constexpr std::array protocol_rows = {
    EnumRow{0, "ISO18000-6B"},
    EnumRow{1, "EPCC1G1"},
    EnumRow{2, "ISO18000-6A"},
    EnumRow{3, "EPCC1G2"},
    EnumRow{4, "Multiprotocol", "later than rev 4"},
    EnumRow{5, "EPC119", "later than rev 4"},
    EnumRow{255, "Unspecified", "a library of 2011 only"},
};
// Modulation and kbit/s to the tag, then coding and kbit/s from it. Revision 4 knows 0 to 3.
static constexpr std::array bit_rate_rows = {
    EnumRow{0, "DSB10-FM0-10", "rev 4"},
    EnumRow{1, "DSB10-FM0-40", "rev 4"},
    EnumRow{2, "DSB40-FM0-40", "rev 4"},
    EnumRow{3, "DSB40-FM0-160", "rev 4"},
    EnumRow{4, "DSB160-FM0-400", "rev 19"},
    EnumRow{5, "DSB40-M2-160", "rev 19"},
    EnumRow{6, "PR40-M4-250", "rev 19"},
    EnumRow{7, "PR40-M4-300", "rev 19"},
    EnumRow{8, "PR40-M2-250", "rev 19"},
    EnumRow{9, "PR40-FM0-40", "rev 19"},
    EnumRow{10, "DSB40-M4-256", "rev 19"},
    EnumRow{11, "PR40-M4-320", "rev 19"},
    EnumRow{12, "PR40-FM0-640", "rev 19"},
    EnumRow{13, "PR80-M4-320", "rev 19"},
    EnumRow{14, "PR40-M4-256", "rev 19"},
    EnumRow{15, "PR40-M8-256", "light library"},
    EnumRow{16, "PR133-M2-640", "light library"},
    EnumRow{17, "PR50-M2-320", "light library"},
    EnumRow{18, "PR50-M4-320", "light library"},
    EnumRow{19, "PR50-M4-250", "light library"},
    EnumRow{20, "PR133-FM0-640", "light library"},
    EnumRow{21, "PR66-M2-320", "light library"},
    EnumRow{22, "PR50-M8-160", "light library"},
    EnumRow{23, "PR133-M4-640", "light library"},
    EnumRow{24, "DSB160-FM0-640", "light library"},
    EnumRow{25, "DSB160-M2-640", "light library"},
};
// Revisions 4 and 12 print the opposite order; code written against readers has this one (section 12, I3).
static constexpr std::array read_point_rows = {
    EnumRow{0, "Good", "rev 4 to 12 print Bad"},
    EnumRow{1, "Poor"},
    EnumRow{2, "Bad", "rev 4 to 12 print Good"},
    EnumRow{0x5F33, "InvalidReadPoint", "one client"},
};
static constexpr std::array parity_rows = {EnumRow{0, "None"}, EnumRow{1, "Odd"}, EnumRow{2, "Even"}};
static constexpr std::array flow_control_rows = {EnumRow{0, "None"}, EnumRow{1, "Hardware"},
                                                 EnumRow{2, "Software", "not implemented, says the manual"}};
static constexpr std::array sel_unsel_rows = {
    EnumRow{0, "SelectEqual"},     EnumRow{1, "SelectNotEqual"}, EnumRow{2, "SelectGreater"},
    EnumRow{3, "SelectLower"},     EnumRow{4, "UnselectEqual"},  EnumRow{5, "UnselectNotEqual"},
    EnumRow{6, "UnselectGreater"}, EnumRow{7, "UnselectLower"},
};
// Section 4.2.
static constexpr std::array config_rows = {
    EnumRow{0, "ReadCycle", "inventory rounds; 0: endless in continuous mode (rev 4)"},
    EnumRow{1, "ObservedThreshold", "rev 4"},
    EnumRow{2, "LostThreshold", "rev 4"},
    EnumRow{3, "G2Q", "starting Q, 0 to 15 (rev 19)"},
    EnumRow{4, "G2Session", "0 to 3 (rev 19)"},
    EnumRow{5, "G2Target", "0 is A, 1 is B (rev 19)"},
    EnumRow{6, "G2Selected", "0 to 3: 0 all, 2 not selected, 3 selected (rev 19)"},
    EnumRow{7, "DESB", "0 or 1, ISO18000-6B (rev 19)"},
    EnumRow{8, "DwellTime", "antenna dwell time in ms (rev 19)"},
    EnumRow{9, "InventoryType", "algorithm, 0 to 3; A528 only (rev 19)"},
    EnumRow{10, "InventoryCount", "light library"},
    EnumRow{11, "G2MinQ", "a library of 2011"},
    EnumRow{12, "G2MaxQ", "a library of 2011"},
    EnumRow{13, "TIDLength", "bytes of the TID to read in inventories (light library)"},
    EnumRow{14, "RFMatching", "inside MatchRFImpedance only (light library)"},
    EnumRow{15, "QuietTime", "light library"},
};
static constexpr std::array event_mode_rows = {EnumRow{0, "ReadCycle"}, EnumRow{1, "Time"},
                                               EnumRow{2, "NoEvent"}};
static constexpr std::array upgrade_rows = {EnumRow{1, "TFTP"}};
static constexpr std::array bank_rows = {EnumRow{0, "Reserved"}, EnumRow{1, "EPC"}, EnumRow{2, "TID"},
                                         EnumRow{3, "User"}};
// Section 4.3.
static constexpr std::array regulation_rows = {
    EnumRow{0, "ETSI-EN-302-208", "rev 4"},
    EnumRow{1, "ETSI-EN-300-220", "rev 4"},
    EnumRow{2, "FCC", "rev 19"},
    EnumRow{3, "Malaysia", "rev 19"},
    EnumRow{4, "Japan", "rev 19"},
    EnumRow{5, "Korea", "rev 19"},
    EnumRow{6, "Australia", "rev 19"},
    EnumRow{7, "China", "rev 19"},
    EnumRow{8, "Taiwan", "rev 19"},
    EnumRow{9, "Singapore", "rev 19"},
    EnumRow{10, "Brazil", "rev 19"},
    EnumRow{11, "Japan-STD-T106", "rev 19"},
    EnumRow{12, "Japan-STD-T107", "rev 19"},
    EnumRow{13, "Peru", "light library"},
    EnumRow{14, "South-Africa", "light library"},
    EnumRow{15, "Chile", "light library"},
};

constinit const wire::Enumeration result_codes{"ResultCode", result_rows};
constinit const wire::Enumeration event_types{"EventType", event_type_rows};
constinit const wire::Enumeration tag_types{"TagType", tag_type_rows};
constinit const wire::Enumeration bit_rates{"BitRate", bit_rate_rows};
constinit const wire::Enumeration protocols{"Protocol", protocol_rows};
constinit const wire::Enumeration read_point_states{"ReadPointStatus", read_point_rows};
constinit const wire::Enumeration parities{"Parity", parity_rows};
constinit const wire::Enumeration flow_controls{"FlowCtrl", flow_control_rows};
constinit const wire::Enumeration sel_unsel_ops{"SelUnselOp", sel_unsel_rows};
constinit const wire::Enumeration config_parameters{"ConfigParameter", config_rows};
constinit const wire::Enumeration event_modes{"EventMode", event_mode_rows};
constinit const wire::Enumeration upgrade_types{"UpgradeType", upgrade_rows};
constinit const wire::Enumeration memory_banks{"MemoryBank", bank_rows};
constinit const wire::Enumeration rf_regulations{"RFRegulation", regulation_rows};

std::string describe(std::uint16_t result) {
    auto* row = result_codes.find(std::int64_t{result});
    return row != nullptr ? fmt::format("{} ({})", row->name, result) : fmt::format("{}", result);
}

// --- attributes --------------------------------------------------------------------------------------------

namespace {

using Row = AttributeRow;

constexpr Row number(std::uint16_t code, std::string_view name, std::uint16_t size, std::string_view note,
                     std::string_view unit = {}) {
    return {.code = code, .name = name, .kind = Kind::number, .size = size, .unit = unit, .note = note};
}
constexpr Row ranged(std::uint16_t code, std::string_view name, std::uint16_t size, std::int64_t min,
                     std::int64_t max, std::string_view note, std::string_view unit = {}) {
    auto row = number(code, name, size, note, unit);
    row.min = min;
    row.max = max;
    return row;
}
constexpr Row named(std::uint16_t code, std::string_view name, std::uint16_t size,
                    const wire::Enumeration* enumeration, std::string_view note) {
    auto row = number(code, name, size, note);
    row.enumeration = enumeration;
    return row;
}
constexpr Row text(std::uint16_t code, std::string_view name, std::uint16_t size, std::string_view note) {
    return {.code = code, .name = name, .kind = Kind::text, .size = size, .note = note};
}
constexpr Row bytes(std::uint16_t code, std::string_view name, std::uint16_t size, std::string_view note) {
    return {.code = code, .name = name, .kind = Kind::bytes, .size = size, .note = note};
}
// Known by name alone: its size is published nowhere.
constexpr Row name_only(std::uint16_t code, std::string_view name, std::string_view note) {
    return bytes(code, name, 0, note);
}

constexpr std::array rows = {
    number(0x01, "CommandName", 2, "rev 4; the first pair of a message"),
    named(0x02, "ResultCode", 2, &result_codes, "rev 4; the last pair of an answer"),
    named(0x0E, "EventType", 4, &event_types, "rev 4"),
    ranged(0x0F, "TagIDLen", 2, 0, 64, "rev 4", "bytes"),
    Row{.code = 0x10,
        .name = "TimeStamp",
        .kind = Kind::timestamp,
        .size = 8,
        .unit = "s",
        .note = "since 1970, seconds first (rev 4's sample against its text); zero: the clock is not set"},
    bytes(0x11, "TagID", 64, "rev 4: at most 12; rev 19: 64. In InventoryTag the mask"),
    named(0x12, "TagType", 2, &tag_types, "rev 12"),
    text(0x1E, "ChannelName", 30, "rev 4"),
    text(0x1F, "ChannelAddress", 30, "rev 4; its form is not published: address:port (chosen)"),
    text(0x20, "TriggerName", 30, "rev 4"),
    text(0x21, "TriggerType", 30, "rev 4; its form is not published: a period in ms (chosen)"),
    text(0x22, "ReadPointName", 5, "rev 4: Ant0 to Ant3"),
    bytes(0x4D, "TagValue", 128, "rev 4; in inventories the TID. Custom commands may send more"),
    number(0x4E, "TagAddress", 2, "rev 4; of Gen2 memory in bytes, in InventoryTag the mask's first bit"),
    name_only(0x4F, "TestMode", "rev 4: reserved; named by the light library"),
    number(0x50, "Length", 2, "rev 4; bytes, in InventoryTag the bits of the mask"),
    named(0x51, "BitRate", 2, &bit_rates, "rev 4; later called the RF link profile"),
    number(0x52, "PowerGet", 4, "rev 4", "mW"),
    Row{.code = 0x53,
        .name = "PowerVSWR",
        .kind = Kind::real,
        .size = 4,
        .note = "rev 4: reserved; the answer to MatchRFImpedance (light library)"},
    named(0x54, "Protocol", 4, &protocols, "rev 4"),
    name_only(0x55, "ReadPoint", "named by the light library"),
    named(0x56, "ReadPointStatus", 4, &read_point_states, "rev 19; rev 4 to 12 print the opposite order"),
    number(0x57, "Boolean", 2, "rev 4; 0 is false, all else true"),
    text(0x58, "IPAddress", 30, "rev 4; dotted decimal"),
    text(0x59, "IPNetMask", 30, "rev 4; dotted decimal"),
    text(0x5A, "IPGateway", 30, "rev 4; dotted decimal"),
    number(0x5B, "DESBEnable", 2, "rev 4; 0 is off, all else on"),
    text(0x5C, "FWRelease", 200, "rev 4"),
    number(0x5D, "DESBStatus", 2, "rev 4; 0 is off, all else on"),
    number(0x5E, "EPCPWD", 2, "rev 4; password of EPC Gen1 tags"),
    number(0x5F, "RFOnOff", 2, "rev 4; 0 stops the carrier, all else starts it"),
    ranged(0x60, "BaudRate", 4, 9600, 921600, "rev 4; the range is that of the readers known", "bit/s"),
    ranged(0x61, "DataBits", 4, 5, 8, "rev 4"),
    ranged(0x62, "StopBits", 4, 1, 2, "rev 4"),
    named(0x63, "Parity", 4, &parities, "rev 4"),
    named(0x64, "FlowCtrl", 4, &flow_controls, "rev 4"),
    text(0x65, "DateTime", 30, "rev 4; YYYY-MM-DD HH:MM:SS"),
    named(0x66, "SelUnselOp", 2, &sel_unsel_ops, "rev 4"),
    number(
        0x67, "Bitmask", 2,
        "rev 4: byte mask of ISO18000-6B. In InventoryTag flags: 1 RSSI, 2 framed, 4 continuous, 8 compact, "
        "0x10 TID, 0x20 event trigger, 0x40 XPC, 0x80 match, 0x100 PC (rev 19)"),
    name_only(0x68, "Reserved0x68", "rev 4: reserved"),
    number(0x69, "IORegister", 4, "rev 4; a bit a line, inputs low; as direction 0 is in, 1 is out"),
    named(0x6A, "ConfigParameter", 4, &config_parameters, "rev 4: 0 to 2"),
    number(0x6B, "ConfigValue", 4, "rev 4"),
    number(0x6C, "NoOfTriggers", 2, "rev 4"),
    number(0x6D, "NoOfChannels", 2, "rev 4"),
    named(0x6E, "EventMode", 2, &event_modes, "rev 4"),
    named(0x6F, "UpgradeType", 2, &upgrade_types, "rev 4"),
    text(0x70, "UpgradeArgument", 255, "rev 4; TFTP server:file"),
    named(0x71, "MemoryBank", 2, &memory_banks, "rev 4"),
    ranged(0x72, "Payload", 4, 0, 0xFFFFF, "rev 4; of the Gen2 lock: mask in bits 19 to 10, action below"),
    number(0x73, "G2Password", 4, "rev 4"),
    number(0x74, "G2NSI", 2, "rev 4; numbering system identifier"),
    ranged(0x75, "QParameter", 2, 0, 15, "rev 4; initial Q"),
    text(0x76, "ReaderInfo", 255, "rev 4; model, a blank, serial number. No limit is stated"),
    named(0x77, "RFRegulation", 2, &rf_regulations, "rev 4: 0 and 1"),
    ranged(0x78, "RFChannel", 2, 0, 9, "rev 4; numbered as in ETSI EN 302 208"),
    number(0x79, "SubCmd", 1, "light library; of a custom Gen2 command"),
    Row{.code = 0x7A,
        .name = "RSSI",
        .kind = Kind::integer,
        .size = 2,
        .unit = "0.1 dBm",
        .note = "rev 12; the unit on readers of that time is not published"},
    name_only(0x7B, "Option", "rev 19: named only"),
    bytes(0x7C, "XPC", 4, "rev 19"),
    bytes(0x7D, "PC", 4, "rev 19: 4 bytes; light library: 2. Both are taken"),
    number(0x7E, "Phase", 2, "light library; 0 to 4095 is the full circle on some radios"),
    name_only(0x7F, "TerminalType", "named by the light library"),
    name_only(0x80, "BatteryLevel", "named by the light library"),
    name_only(0x81, "LongLength", "named by the light library"),
    name_only(0x82, "LongAddress", "named by the light library"),
    name_only(0x83, "Uint16", "named by the light library"),
    number(0x96, "PowerSet", 4, "rev 4", "mW"),
    text(0xFB, "SourceName", 30, "rev 4: Source_0 to Source_3"),
};

constexpr auto index = [] {
    std::array<const Row*, 256> table{};
    for (auto& row : rows)
        table[row.code] = &row;
    return table;
}();

}  // namespace

std::span<const AttributeRow> attributes() {
    return rows;
}

const AttributeRow* find_attribute(std::uint16_t code) {
    return code < index.size() ? index[code] : nullptr;
}

const AttributeRow* find_attribute(std::string_view name) {
    auto it = std::ranges::find(rows, name, &Row::name);
    if (it == rows.end()) it = std::ranges::find_if(rows, [&](auto& row) { return alike(row.name, name); });
    return it == rows.end() ? nullptr : &*it;
}

}  // namespace gantry::caen
