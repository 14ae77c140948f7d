#include "protocols/silion/tables.hpp"

#include <array>

#include <fmt/format.h>

namespace gantry::silion {

using wire::Direction;
using wire::EnumRow;
using wire::FieldRow;
using wire::Type;

static constexpr std::array board_rows = {
    EnumRow{0, "None"},       EnumRow{1, "Arm7"},         EnumRow{2, "Serial"},
    EnumRow{3, "WiFi"},       EnumRow{4, "Arm9"},         EnumRow{5, "Arm9WiFi"},
    EnumRow{6, "Integrated"}, EnumRow{7, "Arm9Version2"}, EnumRow{8, "Arm9WiFiVersion2"},
};
// From 28 on the vendor's own lists disagree, so these are shown as numbers.
static constexpr std::array module_rows = {
    EnumRow{0, "None"},     EnumRow{1, "R902-M1S"},  EnumRow{2, "R902-M2S"}, EnumRow{3, "M5e"},
    EnumRow{4, "M5e-C"},    EnumRow{5, "M6e"},       EnumRow{6, "PR9000"},   EnumRow{7, "M5e-PRC"},
    EnumRow{8, "M6e-PRC"},  EnumRow{9, "M6e-Micro"}, EnumRow{10, "SLR1100"}, EnumRow{11, "SLR1200"},
    EnumRow{12, "SLR1300"}, EnumRow{13, "SLR3000"},  EnumRow{14, "SLR5100"}, EnumRow{15, "SLR5200"},
    EnumRow{16, "SLR3100"}, EnumRow{17, "SLR3200"},  EnumRow{18, "SLR5300"}, EnumRow{19, "SLR5900"},
    EnumRow{20, "SLR5800"}, EnumRow{21, "SLR6000"},  EnumRow{22, "SLR6100"}, EnumRow{23, "SIM7100"},
    EnumRow{24, "SIM7200"}, EnumRow{25, "SIM7300"},  EnumRow{26, "SIM7400"}, EnumRow{27, "SIM7500"},
};
static constexpr std::array protocol_rows = {
    EnumRow{0, "None"},
    EnumRow{3, "Iso18000-6B"},
    EnumRow{5, "Gen2"},
    EnumRow{6, "Iso18000-6B-Ucode"},
    EnumRow{7, "Ipx64"},
    EnumRow{8, "Ipx256"},
    EnumRow{0x10, "Gb", "Chinese national standard"},
    EnumRow{0x1D, "Ata"},
};
static constexpr std::array error_rows = {
    EnumRow{1, "I/O error to the RF module"},
    EnumRow{2, "internal device error"},
    EnumRow{3, "command failed"},
    EnumRow{4, "no tag"},
    EnumRow{5, "fatal module error"},
    EnumRow{6, "not supported"},
    EnumRow{7, "invalid parameter"},
    EnumRow{8, "invalid handle"},
    EnumRow{9, "alarm: high return loss"},
    EnumRow{10, "alarm: too many module resets"},
    EnumRow{11, "alarm: no antennas connected"},
    EnumRow{12, "alarm: temperature too high"},
    EnumRow{13, "alarm: reader down"},
    EnumRow{14, "hardware alarm: unknown"},
    EnumRow{15, "M6e start-up failed"},
    EnumRow{16, "operation already running"},
    EnumRow{17, "unknown reader type"},
    EnumRow{18, "operation not valid, or nothing configured"},
    EnumRow{19, "module reset failed"},
    EnumRow{51, "factory test fault 51"},
    EnumRow{52, "factory test fault 52"},
    EnumRow{53, "factory test fault 53"},
    EnumRow{54, "factory test fault 54"},
    EnumRow{55, "factory test fault 55, or unknown module"},
    EnumRow{60, "too many errors in a short time"},
    EnumRow{80, "firmware file cannot be opened"},
    EnumRow{81, "firmware file has a bad format"},
    EnumRow{101, "invalid parameter in the Java layer"},
};

constinit const wire::Enumeration main_boards{"MainBoard", board_rows};
constinit const wire::Enumeration modules{"Module", module_rows};
constinit const wire::Enumeration tag_protocols{"Protocol", protocol_rows};
constinit const wire::Enumeration errors{"Error", error_rows};

static constexpr std::array tag_row = {
    FieldRow{.name = "Antenna", .type = Type::number, .size = 1, .min = 1, .max = 16, .note = "from 1"},
    FieldRow{.name = "ReadCount", .type = Type::number, .size = 1, .note = "reads in this batch"},
    FieldRow{.name = "Rssi", .type = Type::integer, .size = 1, .unit = "dBm"},
    FieldRow{.name = "Protocol",
             .type = Type::number,
             .size = 1,
             .enumeration = &tag_protocols,
             .note = "gen 2 may put a trigger number here: any value is accepted"},
    FieldRow{.name = "Epc", .type = Type::sized, .size = 1, .note = "without PC and CRC"},
    FieldRow{.name = "BankData", .type = Type::sized, .size = 1, .note = "extra bank bytes if configured"},
};
static constexpr std::array wide_tag_row = {
    tag_row[0],
    tag_row[1],
    tag_row[2],
    tag_row[3],
    tag_row[4],
    FieldRow{.name = "BankData", .type = Type::sized, .size = 2, .note = "no reader known to send it"},
};
static constexpr std::array tags = {FieldRow{
    .name = "Tags", .type = Type::list, .size = 2, .record = tag_row, .note = "0 tags: nothing read"}};
static constexpr std::array wide_tags = {
    FieldRow{.name = "Tags", .type = Type::list, .size = 2, .record = wide_tag_row}};
static constexpr std::array input_row = {
    FieldRow{.name = "Input", .type = Type::number, .size = 1, .min = 1, .max = 255, .note = "from 1"},
    FieldRow{.name = "State", .type = Type::number, .size = 1, .min = 0, .max = 1},
};
static constexpr std::array inputs = {FieldRow{.name = "Inputs",
                                               .type = Type::list,
                                               .size = 1,
                                               .record = input_row,
                                               .note = "all, not only the changed"}};
static constexpr std::array antenna_row = {
    FieldRow{.name = "Antenna", .type = Type::number, .size = 1, .min = 1, .max = 16}};
static constexpr std::array heartbeat = {
    FieldRow{.name = "MainBoard", .type = Type::number, .size = 1, .enumeration = &main_boards},
    FieldRow{.name = "Module", .type = Type::number, .size = 1, .enumeration = &modules},
    FieldRow{.name = "Software", .type = Type::version, .size = 4},
    FieldRow{.name = "Antennas",
             .type = Type::list,
             .size = 1,
             .record = antenna_row,
             .note = "connected; none for one-antenna modules, or when they were chosen by configuration"},
    FieldRow{
        .name = "Count", .type = Type::number, .size = 4, .note = "0 at power-up, one more each heartbeat"},
};
static constexpr std::array fault = {
    FieldRow{.name = "Text", .type = Type::text, .size = 0, .note = "24 zero bytes, or gen 2's own text"}};
static constexpr std::array output_row = {
    FieldRow{.name = "Output", .type = Type::number, .size = 1, .min = 1, .max = 5, .note = "gen 1: 1 to 4"},
    FieldRow{.name = "State", .type = Type::number, .size = 1, .min = 0, .max = 1},
    FieldRow{.name = "Seconds",
             .type = Type::number,
             .size = 1,
             .min = 0,
             .max = 255,
             .unit = "s",
             .note = "then the opposite state; 0 keeps it; 255 keeps it in gen 1 and is 255 s in gen 2"},
};
static constexpr std::array outputs = {FieldRow{
    .name = "Outputs", .type = Type::list, .size = 1, .record = output_row, .note = "each output once"}};
static constexpr std::array raw = {FieldRow{.name = "Data", .type = Type::bytes, .size = 0}};
static constexpr wire::Layout nothing{};

constinit const wire::Layout tags_layout{tags};
constinit const wire::Layout wide_tags_layout{wide_tags};

static constexpr auto to_host = Direction::to_host;
static constexpr auto to_reader = Direction::to_reader;
static constexpr std::array message_rows = {
    MessageRow{Code::tags, to_host, "TagUpload", tags, 65535, 0, "guide, example 2"},
    MessageRow{Code::inputs, to_host, "GpiUpload", inputs, 1024, 0, "guide, example 4"},
    MessageRow{Code::first_seen, to_host, "TagFirstSeen", tags, 65535, 0, "guide: reserved; gen 2 sends it"},
    MessageRow{Code::heartbeat, to_host, "Heartbeat", heartbeat, 1024, 0, "guide, example 1"},
    MessageRow{Code::fault, to_host, "Fault", fault, max_unknown_data, 0, "guide, example 3"},
    MessageRow{Code::time_request, to_host, "TimeRequest", raw, max_unknown_data, 0,
               "gen 2, other transports"},
    MessageRow{Code::get_inputs, to_host, "GetGpi", inputs, 1024, 0, "guide, table of answers"},
    MessageRow{Code::set_outputs, to_host, "SetGpo", nothing, 256, 0, "guide, example 5"},
    MessageRow{Code::restart, to_host, "Restart", nothing, 256, 0, "guide, table of answers"},
    MessageRow{Code::tags, to_reader, "TagAck", nothing, 256, 0, "guide, table of commands"},
    MessageRow{Code::inputs, to_reader, "GpiAck", nothing, 256, 0, "guide: reserved, never sent"},
    MessageRow{Code::get_inputs, to_reader, "GetGpi", nothing, 256, flag_answer, "guide, table of commands"},
    MessageRow{Code::set_outputs, to_reader, "SetGpo", outputs, 1024, flag_answer, "guide, example 5"},
    MessageRow{Code::restart, to_reader, "Restart", nothing, 256, flag_answer, "guide, table of commands"},
};

using Index = std::array<const MessageRow*, 256>;
static constexpr Index index_of(Direction direction) {
    Index index{};
    for (auto& row : message_rows)
        if (row.direction == direction) index[static_cast<std::size_t>(row.code)] = &row;
    return index;
}
static constexpr Index to_host_index = index_of(to_host);
static constexpr Index to_reader_index = index_of(to_reader);

std::span<const MessageRow> messages() {
    return message_rows;
}

const MessageRow* find_message(std::uint8_t code, Direction direction) {
    return direction == to_host ? to_host_index[code] : to_reader_index[code];
}

const MessageRow* find_message(std::string_view name, Direction direction) {
    for (auto& row : message_rows)
        if (row.direction == direction && row.name == name) return &row;
    return nullptr;
}

ReaderStatus describe_status(std::uint32_t status) {
    if (status == 0) return {0, "normal"};
    std::int64_t error = status >= status_base ? status - status_base : status;
    if (auto* row = errors.find(error)) return {error, std::string(row->name)};
    return {status, fmt::format("unknown status 0x{:08X}", status)};
}

}  // namespace gantry::silion
