#include <array>

#include "protocols/harting/config.hpp"

// Section 9. The manual's public part names the blocks; what is in them comes from manuals and programs for
// sister readers, whose blocks have the same numbers. Where only one of them says so the row says `single`.
// Bits without a row are not public: nothing here ever changes them.
namespace gantry::harting {

using enum Confidence;
using Kind = ConfigRow::Kind;

// --- enumerations ------------------------------------------------------------------------------------------

static constexpr wire::EnumRow mode_rows[] = {
    {0x00, "Host", "answers commands"},
    {0x01, "Scan", "sends what it reads over the serial line"},
    {0x80, "BufferedRead", "reads into its buffer"},
    {0xC0, "Notification", "reads into its buffer and dials the host with it"},
};
const wire::Enumeration modes{"MODE", mode_rows};

static constexpr wire::EnumRow switch_rows[] = {{0, "off"}, {1, "on"}};
static constexpr wire::Enumeration switches{"switch", switch_rows};

static constexpr wire::EnumRow baud_rows[] = {{0x05, "4800"},  {0x06, "9600"},  {0x07, "19200"},
                                              {0x08, "38400"}, {0x09, "57600"}, {0x0A, "115200"}};
static constexpr wire::Enumeration bauds{"BAUD", baud_rows};

static constexpr wire::EnumRow parity_rows[] = {{0, "none"}, {1, "even"}, {2, "odd"}};
static constexpr wire::Enumeration parities{"PARITY", parity_rows};

static constexpr wire::EnumRow output_rows[] = {{0, "unchanged"}, {1, "on"}, {2, "off"}, {3, "flash"}};
static constexpr wire::Enumeration output_modes{"output mode", output_rows};

static constexpr wire::EnumRow session_rows[] = {{0, "S0"}, {1, "S1"}, {2, "S2"}, {3, "S3"}};
static constexpr wire::Enumeration sessions{"session", session_rows};

static constexpr wire::EnumRow tr_id_rows[] = {{0, "DataBlock"}, {1, "SerialNumber"}};
static constexpr wire::Enumeration tr_id_sources{"TR-ID source", tr_id_rows};

static constexpr wire::EnumRow format_rows[] = {{0, "raw"}, {2, "ASCII-hex"}};
static constexpr wire::Enumeration data_formats{"DB-FORMAT", format_rows};

static constexpr wire::EnumRow power_rows[] = {
    {0x10, "100mW"},  {0x11, "200mW"},  {0x12, "300mW"},  {0x13, "400mW"},  {0x14, "500mW"},
    {0x15, "600mW"},  {0x16, "700mW"},  {0x17, "800mW"},  {0x18, "900mW"},  {0x19, "1000mW"},
    {0x1A, "1100mW"}, {0x1B, "1200mW"}, {0x1C, "1300mW"}, {0x1D, "1400mW"}, {0x1E, "1500mW"},
    {0x1F, "1600mW"}, {0x20, "1700mW"}, {0x21, "1800mW"}, {0x22, "1900mW"}, {0x23, "2000mW"}};
static constexpr wire::Enumeration powers{"RF-POWER", power_rows};

// --- blocks ------------------------------------------------------------------------------------------------

static constexpr BlockRow reserved(std::uint8_t number) {
    return {.number = number, .name = "Reserved", .reserved = true};
}

static constexpr std::string_view chosen = "factory values not public: those that make a working reader";

static constexpr std::array<BlockRow, block_count> block_rows = {{
    {0, "Passwords"},
    {1,
     "Interface and Mode",
     false,
     true,
     {0x00, 0x00, 0x08, 0x01, 0, 0, 0x00, 0x1E, 0, 0, 0, 0, 0, 0x00},
     "host mode, 38400 baud, even parity, address 0; MODE alone takes effect at once"},
    {2,
     "Inputs / Outputs",
     false,
     false,
     {0xA8, 0, 0x54, 0, 0, 0, 0x00, 0x03, 0x00, 0x03, 0, 0, 0, 0x03},
     chosen},
    {3,
     "RF-Interface",
     false,
     false,
     {0x00, 0x10, 0x14, 0x00, 0, 0, 0, 0, 0, 0, 0, 0x04, 0x47, 0xAD},
     chosen},
    {4, "Transponder Parameters"},
    {5, "Anticollision", false, false, {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0x00, 0x04, 0, 0}, chosen},
    reserved(6),
    reserved(7),
    reserved(8),
    {9, "Input / Output II (Assignment - output to antenna read event)"},
    {10, "Trigger"},
    {11,
     "Read Mode - Read Data",
     false,
     false,
     {0x31, 0x00, 0x00, 0x03, 0x00, 0x00, 0, 0, 0x00, 0x04, 0, 0x00, 0x00, 0x08},
     chosen},
    {12, "Read Mode - Filter", false, false, {0x00, 0x37, 0x01, 0x00, 0x00, 0x04, 0x00, 0x00}, "5.5 s"},
    {13, "Scan Mode", false, false, {0x02, 0x20, 0x2C, 0x01, 0x0D}, "of a sister reader"},
    reserved(14),
    {15, "Antenna Multiplexing I", false, false, {0x00, 0x09}, chosen},
    {16, "Persistence Reset"},
    reserved(17),
    reserved(18),
    reserved(19),
    {20, "RF-Parameter", false, false, {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0x14, 0x14, 0x14, 0}, chosen},
    reserved(21),
    {22, "Selection masks for EPC Gen 2: mask 1"},
    {23, "Selection masks for EPC Gen 2: mask 1, continued"},
    {24, "Selection masks for EPC Gen 2: mask 2"},
    {25, "Selection masks for EPC Gen 2: mask 2, continued"},
    {26, "Selection masks for EPC Gen 2: mask 3"},
    {27, "Selection masks for EPC Gen 2: mask 3, continued"},
    reserved(28),
    reserved(29),
    reserved(30),
    reserved(31),
    reserved(32),
    {33, "LAN-Hostname", false, true},
    {34, "LAN-Hostname, continued", false, true},
    reserved(35),
    reserved(36),
    reserved(37),
    reserved(38),
    reserved(39),
    {40, "LAN Settings, Part 1", false, true, {192, 168, 10, 10, 0, 0, 0, 0, 0x27, 0x11}, chosen},
    {41,
     "LAN Settings, Part 2",
     false,
     true,
     {255, 255, 0, 0, 0x01, 0x02, 0, 0, 0, 0, 0x00, 0x05, 0x00, 0x05},
     "the keepalive values are the manual's"},
    reserved(42),
    reserved(43),
    reserved(44),
    reserved(45),
    reserved(46),
    reserved(47),
    reserved(48),
    {49,
     "Notification Channel",
     false,
     false,
     {0, 0, 0, 0x02, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0x05},
     "of a sister reader"},
    reserved(50),
    reserved(51),
    reserved(52),
    reserved(53),
    reserved(54),
    reserved(55),
    reserved(56),
    reserved(57),
    reserved(58),
    reserved(59),
    reserved(60),
    reserved(61),
    reserved(62),
    {63, "Customer Parameter", false, false, {}, "layout not public"},
}};

std::span<const BlockRow> blocks() {
    return block_rows;
}

// --- parameters --------------------------------------------------------------------------------------------

// A number in whole bytes, a bit field, and a single bit.
static constexpr ConfigRow number(std::string_view name, unsigned block, unsigned byte, unsigned bytes,
                                  std::string_view help, Confidence confidence = single,
                                  std::string_view unit = {}, std::int64_t min = 0, std::int64_t max = -1) {
    return {.name = name,
            .block = static_cast<std::uint8_t>(block),
            .byte = static_cast<std::uint8_t>(byte),
            .bits = static_cast<std::uint16_t>(8 * bytes),
            .unit = unit,
            .min = min,
            .max = max,
            .confidence = confidence,
            .help = help};
}
static constexpr ConfigRow field(std::string_view name, unsigned block, unsigned byte, unsigned bit,
                                 unsigned bits, const wire::Enumeration* enumeration, std::string_view help,
                                 Confidence confidence = single) {
    return {.name = name,
            .block = static_cast<std::uint8_t>(block),
            .byte = static_cast<std::uint8_t>(byte),
            .bit = static_cast<std::uint8_t>(bit),
            .bits = static_cast<std::uint16_t>(bits),
            .enumeration = enumeration,
            .confidence = confidence,
            .help = help};
}
static constexpr ConfigRow flag(std::string_view name, unsigned block, unsigned byte, unsigned bit,
                                std::string_view help, Confidence confidence = single) {
    return field(name, block, byte, bit, 1, &switches, help, confidence);
}
static constexpr ConfigRow bytes(std::string_view name, unsigned block, unsigned byte, unsigned size,
                                 Kind kind, std::string_view help, Confidence confidence = single) {
    auto row = number(name, block, byte, size, help, confidence);
    row.kind = kind;
    return row;
}
static constexpr ConfigRow lock(std::string_view name, unsigned byte, unsigned bit) {
    return flag(name, 0, byte, bit, "the block is read and written only after a login");
}

static constexpr ConfigRow config[] = {
    {.name = "CFG0.PASSWORD",
     .block = 0,
     .byte = 0,
     .bits = 32,
     .kind = Kind::bytes,
     .confidence = confirmed,
     .secret = true,
     .help = "READER-ID of [0xA0] Reader-Login, 4 bytes"},
    lock("CFG0.LOCK-CFG0", 8, 0),
    lock("CFG0.LOCK-CFG1", 8, 1),
    lock("CFG0.LOCK-CFG2", 8, 2),
    lock("CFG0.LOCK-CFG3", 8, 3),
    lock("CFG0.LOCK-CFG4", 8, 4),
    lock("CFG0.LOCK-CFG5", 8, 5),
    lock("CFG0.LOCK-CFG6", 8, 6),
    lock("CFG0.LOCK-CFG7", 8, 7),
    lock("CFG0.LOCK-CFG8", 9, 0),
    lock("CFG0.LOCK-CFG9", 9, 1),
    lock("CFG0.LOCK-CFG10", 9, 2),
    lock("CFG0.LOCK-CFG11", 9, 3),
    lock("CFG0.LOCK-CFG12", 9, 4),
    lock("CFG0.LOCK-CFG13", 9, 5),
    lock("CFG0.LOCK-CFG14", 9, 6),
    lock("CFG0.LOCK-CFG15", 9, 7),
    lock("CFG0.LOCK-CFG16", 10, 0),
    lock("CFG0.LOCK-CFG17", 10, 1),
    lock("CFG0.LOCK-CFG18", 10, 2),
    lock("CFG0.LOCK-CFG19", 10, 3),
    lock("CFG0.LOCK-CFG20", 10, 4),
    lock("CFG0.LOCK-CFG21", 10, 5),
    lock("CFG0.LOCK-CFG22-29", 10, 6),

    number("CFG1.COM-ADR", 1, 0, 1, "bus address; 255 reaches every reader", confirmed, {}, 0, 254),
    field("CFG1.BAUD", 1, 2, 0, 8, &bauds, "of the serial line; another value means 38400", confirmed),
    field("CFG1.PARITY", 1, 3, 0, 2, &parities, "TRANS-FORM, of the serial line", confirmed),
    field("CFG1.DATA-BITS", 1, 3, 2, 1, nullptr, "TRANS-FORM: 0 is 8 data bits", confirmed),
    field("CFG1.STOP-BITS", 1, 3, 3, 1, nullptr, "TRANS-FORM: 0 is 1 stop bit", confirmed),
    number("CFG1.TR-RESPONSE-TIME", 1, 6, 2, "time limit for a command on tags", inferred, "100 ms"),
    field("CFG1.SCAN-INTERFACE", 1, 11, 0, 3, nullptr, "where scan mode sends; values not public"),
    field("CFG1.DATA-CLOCK-FORMAT", 1, 11, 3, 3, nullptr, "values not public"),
    field("CFG1.INTERFACES", 1, 12, 0, 8, nullptr, "host interfaces that are on; bits not public"),
    field("CFG1.MODE", 1, 13, 0, 8, &modes, "how the reader works", confirmed),

    field("CFG2.OUT1-IDLE", 2, 0, 2, 2, &output_modes, "output 1 while nothing drives it", inferred),
    field("CFG2.OUT2-IDLE", 2, 0, 4, 2, &output_modes, "output 2 while nothing drives it", inferred),
    field("CFG2.REL1-IDLE", 2, 0, 6, 2, &output_modes, "relay 1 while nothing drives it", inferred),
    field("CFG2.OUT1-ACTIVE", 2, 2, 2, 2, &output_modes, "output 1 when an event drives it", inferred),
    field("CFG2.OUT2-ACTIVE", 2, 2, 4, 2, &output_modes, "output 2 when an event drives it", inferred),
    field("CFG2.REL1-ACTIVE", 2, 2, 6, 2, &output_modes, "relay 1 when an event drives it", inferred),
    flag("CFG2.IN1-INVERTED", 2, 4, 0, "input 1 counts as set when it is open"),
    number("CFG2.REL1-SETTING-TIME", 2, 6, 2, "how long an event drives relay 1", inferred, "100 ms"),
    number("CFG2.OUT1-SETTING-TIME", 2, 8, 2, "how long an event drives output 1", inferred, "100 ms"),
    number("CFG2.OUT2-SETTING-TIME", 2, 13, 1, "how long an event drives output 2", inferred, "100 ms"),

    number("CFG3.TAG-DRV", 3, 0, 2, "kinds of tags that it reads, a bit each; 0x0010 is EPC Class1 Gen2"),
    field("CFG3.RF-POWER-1", 3, 2, 0, 6, &powers, "power of antenna 1"),
    number("CFG3.REGION", 3, 3, 1, "radio regulation; values not public"),
    field("CFG3.FCC-UPPER-CHANNEL", 3, 8, 0, 7, nullptr, "highest FCC channel"),
    field("CFG3.FCC-LOWER-CHANNEL", 3, 9, 0, 7, nullptr, "lowest FCC channel"),
    number("CFG3.EU-CHANNELS", 3, 11, 1, "number of EU channels in use"),
    field("CFG3.EU-CHANNEL-1", 3, 12, 4, 4, nullptr, "first EU channel in use"),
    field("CFG3.EU-CHANNEL-2", 3, 12, 0, 4, nullptr, "second EU channel in use"),
    field("CFG3.EU-CHANNEL-3", 3, 13, 4, 4, nullptr, "third EU channel in use"),
    field("CFG3.EU-CHANNEL-4", 3, 13, 0, 4, nullptr, "fourth EU channel in use"),

    number("CFG4.WRITE-OPTION", 4, 11, 1, "how Gen2 tags are written; values not public"),
    number("CFG4.IDENTIFIER", 4, 12, 1, "the EPC, or EPC and TID as IDDT says; values not public"),
    number("CFG4.TID-LENGTH", 4, 13, 1, "length of the TID that is read with the EPC; unit not public"),

    field("CFG5.SESSION", 5, 10, 0, 2, &sessions, "Gen2 session"),
    flag("CFG5.ANTICOLLISION", 5, 11, 2, "reads many tags at a time"),

    number("CFG9.OUT1-ANTENNA", 9, 0, 1, "antennas whose reads drive output 1"),
    number("CFG9.OUT2-ANTENNA", 9, 1, 1, "antennas whose reads drive output 2"),
    number("CFG9.REL1-ANTENNA", 9, 7, 1, "antennas whose reads drive relay 1"),

    flag("CFG10.UNLIMITED", 10, 0, 0, "once triggered it reads without end"),
    flag("CFG10.CONDITION", 10, 0, 5, "how several triggers combine"),
    flag("CFG10.ENABLE", 10, 0, 7, "reads only while the trigger is on"),
    field("CFG10.IN1-USE", 10, 1, 0, 2, nullptr, "what input 1 does; values not public"),
    number("CFG10.IN1-HOLD-TIME", 10, 2, 2, "how long input 1 keeps the trigger on", inferred, "100 ms"),

    number("CFG11.TR-DATA1", 11, 0, 1,
           "parts of a record: 0x01 id, 0x02 data blocks, 0x10 antenna, 0x20 time", confirmed),
    number("CFG11.TR-DATA2", 11, 1, 1, "more parts: 0x01 input, 0x02 MAC, 0x10 antennas with RSSI",
           confirmed),
    flag("CFG11.BUS-ADDRESS-PREFIX", 11, 2, 0, "TR-DATA3: the bus address goes before each scan", confirmed),
    flag("CFG11.ANTENNA-POOL", 11, 2, 1, "TR-DATA3: a tag is one record for all antennas", confirmed),
    flag("CFG11.COMPLETE-BANK", 11, 2, 3, "TR-DATA3: reads the whole bank", confirmed),
    flag("CFG11.ACTION-ON-EPC", 11, 2, 6, "TR-DATA3", confirmed),
    field("CFG11.BANK", 11, 3, 0, 2, &banks, "where data blocks are read from", confirmed),
    number("CFG11.DB-ADR", 11, 4, 2, "first data block", confirmed),
    number("CFG11.DB-N", 11, 8, 2, "number of data blocks", confirmed),
    number("CFG11.D-START", 11, 11, 1, "scan mode: first byte of the data that is sent"),
    number("CFG11.D-LGT", 11, 12, 2, "scan mode: number of bytes that are sent", single, "bytes"),

    number("CFG12.TRANSPONDER-VALID-TIME", 12, 0, 2, "a tag is reported once in this time", confirmed,
           "100 ms"),
    field("CFG12.TR-ID", 12, 2, 0, 8, &tr_id_sources,
          "what tells tags apart; sources differ, some write 2 for the serial number"),
    number("CFG12.TR-ID-DB-ADR", 12, 3, 2, "first data block of that identity", confirmed),
    number("CFG12.TR-ID-DB-N", 12, 5, 1, "number of data blocks of that identity", confirmed),
    flag("CFG12.IN1-EVENT", 12, 6, 0, "a change of input 1 is a record"),
    flag("CFG12.IN2-EVENT", 12, 6, 1, "a change of input 2 is a record"),
    flag("CFG12.TRIGGER-EVENT", 12, 7, 0, "the begin of a trigger is a record"),
    flag("CFG12.TIMEOUT-EVENT", 12, 7, 1, "the end of a trigger's hold time is a record"),

    field("CFG13.DB-FORMAT", 13, 0, 0, 4, &data_formats, "how ids and data are sent", confirmed),
    number("CFG13.SEP-CHAR", 13, 1, 1, "between id and data; a bit each, not public", confirmed),
    number("CFG13.SEP-USER", 13, 2, 1, "own separator", confirmed),
    number("CFG13.END-CHAR", 13, 3, 1, "after each tag; a bit each, not public", confirmed),
    bytes("CFG13.END-USER", 13, 4, 3, Kind::mask, "own end characters, up to 3", confirmed),
    bytes("CFG13.HEADER-USER", 13, 8, 4, Kind::mask, "own prefix, up to 4 characters", confirmed),
    field("CFG13.END-USER-N", 13, 13, 0, 4, nullptr, "number of own end characters", confirmed),
    field("CFG13.HEADER-USER-N", 13, 13, 4, 4, nullptr, "number of own prefix characters", confirmed),

    flag("CFG15.ENABLE", 15, 0, 0, "reads on several antennas in turn"),
    field("CFG15.ANTENNAS", 15, 1, 0, 3, nullptr, "number of antennas in turn"),
    field("CFG15.ANTENNA-SELECTION", 15, 1, 3, 4, nullptr, "antennas in turn, a bit each; 1 is antenna 1"),
    flag("CFG15.SELECTION-MODE", 15, 1, 7, "whether ANTENNAS or ANTENNA-SELECTION counts; not public which"),

    flag("CFG16.ENABLE", 16, 0, 0, "a tag that stands still is read again after the time of its antenna"),
    number("CFG16.TIME-1", 16, 2, 2, "of antenna 1; unit not public"),
    number("CFG16.TIME-2", 16, 4, 2, "of antenna 2; unit not public"),
    number("CFG16.TIME-3", 16, 6, 2, "of antenna 3; unit not public"),
    number("CFG16.TIME-4", 16, 8, 2, "of antenna 4; unit not public"),

    number("CFG20.RSSI-FILTER-1", 20, 0, 1, "antenna 1 ignores weaker tags; 0 is off", single, "-dBm"),
    number("CFG20.RSSI-FILTER-2", 20, 1, 1, "antenna 2 ignores weaker tags; 0 is off", single, "-dBm"),
    number("CFG20.RSSI-FILTER-3", 20, 2, 1, "antenna 3 ignores weaker tags; 0 is off", single, "-dBm"),
    number("CFG20.RSSI-FILTER-4", 20, 3, 1, "antenna 4 ignores weaker tags; 0 is off", single, "-dBm"),
    field("CFG20.RF-POWER-2", 20, 10, 0, 6, &powers, "power of antenna 2", confirmed),
    field("CFG20.RF-POWER-3", 20, 11, 0, 6, &powers, "power of antenna 3", confirmed),
    field("CFG20.RF-POWER-4", 20, 12, 0, 6, &powers, "power of antenna 4", confirmed),

    number("CFG22.MASK-LENGTH", 22, 0, 1, "mask 1; 0 is off", single, "bits"),
    field("CFG22.BANK", 22, 1, 0, 2, &banks, "mask 1: where it is compared"),
    flag("CFG22.NEGATION", 22, 1, 2, "mask 1: selects the others"),
    number("CFG22.FIRST-BIT", 22, 2, 2, "mask 1: where in the bank it begins", single, "bits"),
    bytes("CFG22.MASK", 22, 4, 24, Kind::mask, "mask 1"),
    number("CFG24.MASK-LENGTH", 24, 0, 1, "mask 2; 0 is off", inferred, "bits"),
    field("CFG24.BANK", 24, 1, 0, 2, &banks, "mask 2: where it is compared", inferred),
    flag("CFG24.NEGATION", 24, 1, 2, "mask 2: selects the others", inferred),
    number("CFG24.FIRST-BIT", 24, 2, 2, "mask 2: where in the bank it begins", inferred, "bits"),
    bytes("CFG24.MASK", 24, 4, 24, Kind::mask, "mask 2", inferred),
    number("CFG26.MASK-LENGTH", 26, 0, 1, "mask 3; 0 is off", inferred, "bits"),
    field("CFG26.BANK", 26, 1, 0, 2, &banks, "mask 3: where it is compared", inferred),
    flag("CFG26.NEGATION", 26, 1, 2, "mask 3: selects the others", inferred),
    number("CFG26.FIRST-BIT", 26, 2, 2, "mask 3: where in the bank it begins", inferred, "bits"),
    bytes("CFG26.MASK", 26, 4, 24, Kind::mask, "mask 3", inferred),

    bytes("CFG33.HOSTNAME", 33, 1, 27, Kind::text, "the reader's name in the network"),

    bytes("CFG40.IP-ADDRESS", 40, 0, 4, Kind::address, "the reader's own address", confirmed),
    number("CFG40.PORT", 40, 8, 2, "where hosts dial in", single, {}, 1, 65535),

    bytes("CFG41.SUBNET-MASK", 41, 0, 4, Kind::address, "of the network"),
    flag("CFG41.KEEPALIVE", 41, 4, 0, "of the connections that hosts open"),
    flag("CFG41.AUTO-NEGOTIATION-OFF", 41, 4, 3, "of the network port"),
    flag("CFG41.HOSTNAME-ENABLE", 41, 4, 4, "tells the network its hostname"),
    flag("CFG41.DUPLEX", 41, 4, 5, "full duplex, without auto negotiation"),
    flag("CFG41.SPEED", 41, 4, 6, "100 Mbit/s, without auto negotiation"),
    flag("CFG41.DHCP", 41, 4, 7, "takes its address from the network"),
    number("CFG41.KEEPALIVE-RETRANSMIT", 41, 5, 1, "probes before a connection is given up"),
    bytes("CFG41.GATEWAY-ADDRESS", 41, 6, 4, Kind::address, "to other networks"),
    number("CFG41.KEEPALIVE-IDLE", 41, 10, 2, "quiet time before the first probe", inferred, "s"),
    number("CFG41.KEEPALIVE-INTERVAL", 41, 12, 2, "between probes", inferred, "s"),

    flag("CFG49.ACK", 49, 0, 7, "notifications are repeated until the host acknowledges them", confirmed),
    flag("CFG49.KEEPALIVE", 49, 4, 0, "sends keepalive messages", confirmed),
    number("CFG49.KEEPALIVE-INTERVAL", 49, 5, 2, "between keepalive messages", confirmed, "s"),
    bytes("CFG49.DESTINATION", 49, 7, 4, Kind::address, "the host that gets the notifications", confirmed),
    number("CFG49.PORT", 49, 11, 2, "of that host", confirmed),
    number("CFG49.HOLD-TIME", 49, 13, 1, "how long the connection stays open without messages", confirmed,
           "s"),
};

std::span<const ConfigRow> config_rows() {
    return config;
}

}  // namespace gantry::harting
