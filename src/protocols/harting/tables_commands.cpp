#include <array>

#include "base/text.hpp"
#include "protocols/harting/shapes.hpp"

// All commands, in the order of the documents. Where a note names no source, the command is in the contents
// of the reader's own manual and its bytes are in manuals of sister readers.
namespace gantry::harting {

using namespace shapes;

namespace {

constexpr std::array read_buffer_request = {number("DATA-SETS", 2, "how many at most")};
constexpr std::array buffer_info_reply = {number("TAB-SIZE", 2, "how many data sets fit"),
                                          number("TAB-START", 2, "the first that is not read yet"),
                                          number("TAB-LENGTH", 2, "how many are there")};
constexpr std::array notify_trigger_request = {number("MODE", 1, "0x00")};
constexpr std::array system_reset_request = {number("MODE", 1, "0x00: the RF controller")};
constexpr std::array software_version_reply = {
    number("SW-REV", 2),  number("D-REV", 1),  number("HW-TYPE", 1), number("SW-TYPE", 1),
    number("TR-TYPE", 2), number("RX-BUF", 2), number("TX-BUF", 2)};
constexpr std::array info_request = {number("MODE", 1, "the record", &info_modes)};
constexpr std::array info_reply = {raw("Record", 0, "the fields of the record that was asked for")};
constexpr std::array diagnostic_request = {number("MODE", 1, "the record", &diagnostic_modes)};
constexpr std::array rf_output_request = {
    number("RF-OUTPUT", 1, "bits 3 to 0: the antenna, 0 all off; 0x10 DC; 0x80 stay in host mode")};
constexpr std::array output_record = {
    number("OUT-NR", 1, "bits 7 to 5: 000 output, 001 LED, 010 buzzer, 100 relay; bits 3 to 0: from 1"),
    number("OUT-S", 1,
           "bits 1 to 0: 00 unchanged, 01 on, 10 off, 11 flash; bits 3 to 2: 00 8 Hz, 01 4 Hz, 10 2 Hz, 11 "
           "1 Hz; bits 7 to 4: repetitions"),
    number("OUT-TIME", 2, "65535: for good", nullptr, "100 ms")};
constexpr std::array set_output_request = {number("MODE", 1, "0x01"), list("OUT-N", 1, output_record)};
constexpr std::array get_input_reply = {number("INPUTS", 1, "bit 0: input 1")};
constexpr std::array config_address = {
    number("CFG-ADR", 1, "0x80 EEPROM, else RAM; 0x40 all blocks; bits 5 to 0: the block")};
constexpr std::array config_data = {raw("CFG-DATA", 14)};
constexpr std::array write_config_request = {config_address[0], config_data[0]};
constexpr std::array timer = {range("HOUR", 0, 23), range("MINUTE", 0, 59), milliseconds()};
constexpr std::array time_and_date = {range("CENTURY", 0, 99, "20"),   range("YEAR", 0, 99, "of the century"),
                                      range("MONTH", 1, 12),           range("DAY", 1, 31),
                                      number("TIMEZONE", 1, "unused"), range("HOUR", 0, 23),
                                      range("MINUTE", 0, 59),          milliseconds()};
constexpr std::array login_request = {raw("READER-ID", 4, "the password")};
constexpr std::array aes_keys_request = {number("MODE", 1, "bit 0: 0 RAM, 1 EEPROM"), number("KEY-INDEX", 1),
                                         number("AUTH-MODE", 1), sized("KEY")};
constexpr std::array authentication_key_request = {
    number("MODE", 1), number("KEY-TYPE", 1, "0 AES-128, 1 AES-192, 2 AES-256"), sized("KEY")};

constexpr Shape none = {};
constexpr Shape unpublished = {.layout = opaque, .opaque = true};
constexpr Shape inventory_asks = {
    .layout = inventory_request, .decode = decode_inventory_request, .encode = encode_inventory_request};
constexpr Shape inventory_gives = {
    .layout = inventory_reply, .decode = decode_inventory_reply, .encode = encode_inventory_reply};
constexpr Shape blocks_read = {
    .layout = read_blocks_reply, .decode = decode_read_blocks_reply, .encode = encode_read_blocks_reply};
constexpr Shape blocks_written = {
    .layout = write_blocks_reply, .decode = decode_write_blocks_reply, .encode = encode_write_blocks_reply};
constexpr Shape buffer_gives = {
    .layout = buffer_reply, .decode = decode_buffer_reply, .encode = encode_buffer_reply};
constexpr Shape info_gives = {.layout = info_reply, .decode = decode_info_reply, .encode = encode_info_reply};
constexpr Shape diagnostic_gives = {
    .layout = info_reply, .decode = decode_diagnostic_reply, .encode = encode_diagnostic_reply};
template <Command command>
constexpr Shape tag_shape(wire::Layout layout) {
    return {.layout = layout, .decode = decode_tag<command>, .encode = encode_tag<command>};
}
constexpr Shape plain(wire::Layout layout) {
    return {.layout = layout};
}

constexpr CommandRow row(Command command, std::string_view name, Shape request, Shape reply,
                         std::string_view note, Confidence confidence = Confidence::confirmed) {
    return {.control = control_of(command),
            .sub = sub_of(command),
            .name = name,
            .request = request,
            .reply = reply,
            .confidence = confidence,
            .note = note};
}
constexpr CommandRow when(When when, CommandRow row) {
    row.when = when;
    return row;
}
constexpr CommandRow on_tags(CommandRow row) {
    row.when = When::host_mode;
    row.on_tags = true;
    return row;
}
constexpr CommandRow notified(CommandRow row) {
    row.notified = true;
    return row;
}
constexpr CommandRow of_sisters(CommandRow row) {
    row.of_manual = false;
    return row;
}

using enum Command;
constexpr std::array rows = {
    when(When::buffer_mode,
         notified(row(read_buffer, "ReadBuffer", plain(read_buffer_request), buffer_gives,
                      "reads the data sets of the buffer; they stay there until Clear Data Buffer"))),
    when(When::buffer_mode, row(read_data_buffer_info, "ReadDataBufferInfo", none, plain(buffer_info_reply),
                                "how full the buffer is")),
    when(When::buffer_mode,
         row(clear_data_buffer, "ClearDataBuffer", none, none,
             "removes what the last Read Buffer gave; acknowledges a notification", Confidence::manual)),
    when(When::buffer_mode, row(initialize_buffer, "InitializeBuffer", none, none, "empties the whole buffer",
                                Confidence::manual)),
    row(force_notify_trigger, "ForceNotifyTrigger", plain(notify_trigger_request), none,
        "makes the reader send a notification now"),
    row(baud_rate_detection, "BaudRateDetection", none, none, "an empty command that every mode answers"),
    row(rf_controller_reset, "RfControllerReset", none, none,
        "restarts the reader: what EEPROM holds takes effect; logs out"),
    row(system_reset, "SystemReset", plain(system_reset_request), none, "restarts one of its controllers"),
    of_sisters(row(get_software_version, "GetSoftwareVersion", none, plain(software_version_reply),
                   "not in the manual's contents; a sister reader has it", Confidence::single)),
    row(get_reader_info, "GetReaderInfo", plain(info_request), info_gives, "section 4"),
    row(rf_reset, "RfReset", none, none, "switches the field off for a moment: tags start anew"),
    row(rf_output, "RfOutput", plain(rf_output_request), none,
        "switches the field of one antenna on; what 0x80 does to the other modes nobody says"),
    notified(row(reader_diagnostic, "ReaderDiagnostic", plain(diagnostic_request), diagnostic_gives,
                 "section 5; readers send it by themselves as keepalive (section 8)")),
    row(set_output, "SetOutput", plain(set_output_request), none, "outputs, relay, LEDs and buzzer"),
    row(get_input, "GetInput", none, plain(get_input_reply), "the inputs now"),
    row(read_configuration, "ReadConfiguration", plain(config_address), plain(config_data),
        "one block; section 9"),
    row(write_configuration, "WriteConfiguration", plain(write_config_request), none,
        "one block; section 9. What is written to EEPROM is in RAM, too"),
    row(reset_configuration, "ResetConfiguration", plain(config_address), none,
        "one block, or all of them, to factory values"),
    row(set_system_timer, "SetSystemTimer", plain(timer), none, "sets the clock's time of day"),
    row(get_system_timer, "GetSystemTimer", none, plain(timer), "the clock's time of day"),
    row(set_system_time_and_date, "SetSystemTimeAndDate", plain(time_and_date), none,
        "sets the clock; plain numbers, no BCD"),
    row(get_system_time_and_date, "GetSystemTimeAndDate", none, plain(time_and_date), "the clock"),
    row(lock_region, "LockRegion", unpublished, unpublished,
        "only the name is public: its data are raw bytes", Confidence::manual),
    row(reader_login, "ReaderLogin", plain(login_request), none,
        "a wrong password logs out; needed again after every restart"),
    row(write_aes_reader_keys, "WriteAesReaderKeys", plain(aes_keys_request), none,
        "bytes as on HF readers; nobody has published this reader's own modes", Confidence::single),
    row(write_reader_authentication_key, "WriteReaderAuthenticationKey", plain(authentication_key_request),
        none, "bytes from one program; nobody has published this reader's own modes", Confidence::single),
    on_tags(row(inventory, "Inventory", inventory_asks, inventory_gives, "the tags in the field")),
    on_tags(row(read_multiple_blocks, "ReadMultipleBlocks",
                tag_shape<read_multiple_blocks>(read_blocks_request), blocks_read, "memory of one tag")),
    on_tags(row(write_multiple_blocks, "WriteMultipleBlocks",
                tag_shape<write_multiple_blocks>(write_blocks_request), blocks_written,
                "writes memory of one tag")),
    on_tags(row(kill, "Kill", tag_shape<kill>(kill_request), none,
                "the tag never answers again; RECOM rests on one source")),
    on_tags(row(lock, "Lock", tag_shape<lock>(lock_request), none, "locks banks and passwords of one tag")),
    on_tags(row(block_permalock, "BlockPermalock", tag_shape<block_permalock>(permalock_request), none,
                "locks sections of user memory for ever")),
    on_tags(row(read_permalock_status, "ReadPermalockStatus",
                tag_shape<read_permalock_status>(permalock_status_request), plain(permalock_status_reply),
                "which sections of user memory are locked for ever")),
    on_tags(row(untraceable, "Untraceable", unpublished, unpublished,
                "only the name is public: its data are raw bytes", Confidence::manual)),
    on_tags(row(authenticate, "Authenticate", unpublished, unpublished,
                "only the name is public: its data are raw bytes", Confidence::manual)),
};

constexpr std::uint8_t no_row = 0xFF;
constexpr auto by_control = [] {
    std::array<std::uint8_t, 256> index{};
    index.fill(no_row);
    for (std::size_t i = rows.size(); i-- > 0;)
        index[rows[i].control] = static_cast<std::uint8_t>(i);
    return index;
}();

}  // namespace

std::span<const CommandRow> commands() {
    return rows;
}

const CommandRow* find_command(std::uint8_t control, std::uint8_t sub) {
    std::size_t at = by_control[control];
    for (; at < rows.size() && rows[at].control == control; ++at)
        if (rows[at].sub == sub) return &rows[at];
    return nullptr;
}

const CommandRow* find_command(std::string_view name) {
    for (auto& row : rows)
        if (row.name == name) return &row;
    for (auto& row : rows)
        if (alike(row.name, name)) return &row;
    return nullptr;
}

const CommandRow* find_request(std::uint8_t control, ByteView data) {
    if (!has_sub(control)) return find_command(control);
    return data.empty() ? nullptr : find_command(control, data[0]);
}

}  // namespace gantry::harting
