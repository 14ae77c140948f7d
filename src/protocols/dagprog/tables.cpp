#include "protocols/dagprog/tables.hpp"

#include <algorithm>
#include <array>

namespace gantry::dagprog {

using wire::Direction;
using wire::EnumRow;

static constexpr std::array transmit_rows = {
    EnumRow{0, "Nothing"},
    EnumRow{1, "Data"},
    EnumRow{4, "SerialNumber", "ISO15693 only"},
    EnumRow{5, "SerialNumberAndData", "ISO15693 only"},
};
static constexpr std::array power_up_rows = {
    EnumRow{0, "ReadForever"},           EnumRow{1, "ReadForever1", "the same"}, EnumRow{2, "ReadOnce"},
    EnumRow{3, "ReadOnce3", "the same"}, EnumRow{4, "ReadForever4", "the same"},
};
static constexpr std::array error_rows = {
    EnumRow{1, "Crc8Invalid", "of the last byte of a block, in checked reading"},
    EnumRow{2, "InvalidTag"},
};
constinit const wire::Enumeration transmit_modes{"TransmitMode", transmit_rows};
constinit const wire::Enumeration power_up_modes{"PowerUpMode", power_up_rows};
constinit const wire::Enumeration errors{"Error", error_rows};

static constexpr PartRow first_block_part{
    .name = "FirstBlock", .kind = Kind::decimal, .size = 5, .icode1_max = 15, .iso15693_max = 14};
static constexpr PartRow block_count_part{.name = "BlockCountMinus1",
                                          .kind = Kind::decimal,
                                          .size = 5,
                                          .icode1_max = 15,
                                          .iso15693_max = 1,
                                          .note = "0: one block; ICODE1: FirstBlock and this are 15 at most"};
static constexpr PartRow transmit_part{.name = "TransmitMode",
                                       .kind = Kind::decimal,
                                       .size = 5,
                                       .icode1_max = 1,
                                       .iso15693_max = 5,
                                       .enumeration = &transmit_modes,
                                       .note = "2 and 3 are not defined"};
static constexpr PartRow power_up_part{.name = "PowerUpMode",
                                       .kind = Kind::decimal,
                                       .size = 5,
                                       .iso15693_max = 4,
                                       .enumeration = &power_up_modes};
static constexpr PartRow block_part{
    .name = "Block", .kind = Kind::hex, .size = 2, .icode1_max = 15, .iso15693_max = 14};
static constexpr PartRow count_part{
    .name = "Count", .kind = Kind::hex, .size = 2, .note = "counts detections, 255 is followed by 0"};

static constexpr std::array first_block = {first_block_part};
static constexpr std::array block_count = {block_count_part};
static constexpr std::array transmit = {transmit_part};
static constexpr std::array power_up = {power_up_part};
static constexpr std::array write = {
    block_part, PartRow{.name = "Data",
                        .kind = Kind::bytes,
                        .size = 8,
                        .shorter = true,
                        .note = "the first bytes of the block; those that are missing become 00"}};
static constexpr std::array write_crc8 = {
    block_part, PartRow{.name = "Data",
                        .kind = Kind::bytes,
                        .size = 6,
                        .shorter = true,
                        .note = "the first three bytes of the block; the unit adds their CRC8"}};
static constexpr std::array version = {
    PartRow{.name = "Version", .kind = Kind::text, .size = 6, .note = "of the firmware"}};
static constexpr std::array long_version = {PartRow{.name = "LongVersion", .kind = Kind::text, .size = 0}};
static constexpr std::array block_data = {count_part,
                                          PartRow{.name = "Data", .kind = Kind::bytes, .size = 8}};
static constexpr std::array serial_number = {
    PartRow{.name = "SerialNumber", .kind = Kind::serial, .size = 16, .note = "or a result, section 5.2"}};
static constexpr std::array saved = {PartRow{.name = "Saved", .kind = Kind::decimal, .size = 5, .note = "1"}};
static constexpr std::array error = {
    PartRow{.name = "Error", .kind = Kind::decimal, .size = 1, .enumeration = &errors}};

static constexpr auto to_reader = Direction::to_reader, to_host = Direction::to_host;
static constexpr std::string_view table_1 = "list of commands, 1", table_2 = "list of commands, 2",
                                  table_3 = "list of commands, 3", table_4 = "list of commands, 4";

// AP0 and AP1 before what else begins with AP; words of two characters are told from them by their length.
static constexpr std::array rows = {
    MessageRow{
        Code::first_block, to_reader, "bk", "GetFirstBlock", {}, true, true, Answer::echo, "", table_1},
    MessageRow{Code::first_block, to_reader, "BK", "SetFirstBlock", first_block, true, true, Answer::echo, "",
               table_1},
    MessageRow{
        Code::block_count, to_reader, "nb", "GetBlockCount", {}, true, true, Answer::echo, "", table_1},
    MessageRow{Code::block_count, to_reader, "NB", "SetBlockCount", block_count, true, true, Answer::echo, "",
               table_1},
    MessageRow{Code::version, to_reader, "v?", "GetVersion", {}, true, true, Answer::echo, "", table_1},
    MessageRow{Code::transmit, to_reader, "tx", "GetTransmitMode", {}, true, true, Answer::echo, "", table_2},
    MessageRow{Code::transmit, to_reader, "TX", "SetTransmitMode", transmit, true, true, Answer::echo, "",
               table_2},
    MessageRow{Code::power_up, to_reader, "tl", "GetPowerUpMode", {}, false, true, Answer::echo, "", table_4},
    MessageRow{Code::power_up, to_reader, "TL", "SetPowerUpMode", power_up, false, true, Answer::echo, "",
               table_4},
    MessageRow{Code::read_forever, to_reader, "UR", "ReadForever", {}, true, true, Answer::echo, "", table_2},
    MessageRow{
        Code::read_checked, to_reader, "RC", "ReadChecked", {}, false, true, Answer::echo, "", table_2},
    MessageRow{Code::read_once, to_reader, "SR", "ReadOnce", {}, false, true, Answer::echo, "", table_2},
    MessageRow{
        Code::read_serial, to_reader, "AS", "ReadSerialNumber", {}, true, false, Answer::serial, "", table_2},
    MessageRow{Code::write, to_reader, "WD", "WriteData", write, true, true, Answer::write, "", table_2},
    MessageRow{Code::write_crc8, to_reader, "WC", "WriteDataCrc8", write_crc8, false, true, Answer::write, "",
               table_2},
    MessageRow{Code::stop, to_reader, "SO", "Stop", {}, true, true, Answer::echo, "SO.", table_3},
    MessageRow{Code::save, to_reader, "SV", "SaveNext", {}, true, true, Answer::echo, "", table_3},
    MessageRow{Code::field_off, to_reader, "AP0", "FieldOff", {}, true, true, Answer::echo, "", table_4},
    MessageRow{Code::field_on, to_reader, "AP1", "FieldOn", {}, true, true, Answer::echo, "", table_4},
    MessageRow{Code::empty, to_reader, "", "EmptyLine", {}, true, true, Answer::none, "", "section 9.2"},

    MessageRow{Code::block_data, to_host, "00", "BlockData", block_data, true, true, {}, "", table_1},
    MessageRow{
        Code::serial_number, to_host, "SN", "SerialNumber", serial_number, true, true, {}, "", table_1},
    MessageRow{Code::first_block, to_host, "BK", "FirstBlock", first_block, true, true, {}, "", table_1},
    MessageRow{Code::block_count, to_host, "NB", "BlockCount", block_count, true, true, {}, "", table_1},
    MessageRow{Code::version, to_host, "V=", "Version", version, true, true, {}, "", table_1},
    MessageRow{Code::transmit, to_host, "TX", "TransmitMode", transmit, true, true, {}, "", table_2},
    MessageRow{Code::power_up, to_host, "TL", "PowerUpMode", power_up, false, true, {}, "", table_4},
    MessageRow{Code::read_forever, to_host, "UR", "ReadForever", {}, true, true, {}, "", table_2},
    MessageRow{Code::read_checked, to_host, "RC", "ReadChecked", {}, false, true, {}, "", table_2},
    MessageRow{Code::read_once, to_host, "SR", "ReadOnce", {}, false, true, {}, "", table_2},
    MessageRow{Code::read_serial, to_host, "AS", "ReadSerialNumber", {}, true, false, {}, "", table_2},
    MessageRow{Code::stop, to_host, "SO", "Stop", {}, true, true, {}, "SO.", table_3},
    MessageRow{Code::save, to_host, "SV", "SaveNext", saved, true, true, {}, "", table_3},
    MessageRow{Code::field_off, to_host, "AP0", "FieldOff", {}, true, true, {}, "", table_4},
    MessageRow{Code::field_on, to_host, "AP1", "FieldOn", {}, true, true, {}, "", table_4},
    MessageRow{Code::error, to_host, "ER", "Error", error, true, true, {}, "", table_3},
    MessageRow{Code::unknown_command, to_host, "??", "UnknownCommand", {}, true, true, {}, "", table_3},
    MessageRow{Code::banner, to_host, "#0", "PowerUp", long_version, true, true, {}, "0", table_4},
    MessageRow{Code::ready, to_host, "#6", "Ready", {}, true, true, {}, "6", table_4},
    MessageRow{Code::empty, to_host, "", "EmptyLine", {}, true, true, {}, "", "section 9.2"},
};

std::string_view to_text(Family family) {
    return family == Family::icode1 ? "icode1" : "iso15693";
}

std::span<const MessageRow> messages() {
    return rows;
}
const MessageRow* find_message(std::string_view name, Direction direction) {
    for (auto& row : rows)
        if (row.name == name && row.direction == direction) return &row;
    return nullptr;
}
const MessageRow* find_word(std::string_view word, Direction direction) {
    for (auto& row : rows)
        if (row.direction == direction && (row.word == word || (!row.alias.empty() && row.alias == word)))
            return &row;
    return nullptr;
}
static const MessageRow& command(Code code, bool sets) {
    return *std::ranges::find_if(rows, [&](auto& row) {
        return row.direction == to_reader && row.code == code && row.parts.empty() != sets;
    });
}
const MessageRow& query(Code code) {
    return command(code, false);
}
const MessageRow& setter(Code code) {
    return command(code, true);
}

std::int64_t max_of(const PartRow& part, Family family) {
    return family == Family::icode1 ? part.icode1_max : part.iso15693_max;
}

}  // namespace gantry::dagprog
