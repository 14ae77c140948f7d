#pragma once
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "event/event.hpp"
#include "wire/layout.hpp"

// What the bytes of the Ha-VIS RF-R400 mean, as data. Sections are those of docs/protocols/harting.md. Names
// are those of the manual, so that whoever reads it finds them here.
namespace gantry::harting {

inline constexpr std::uint16_t port = 10001;

// How sure a row is (section 13).
enum class Confidence : std::uint8_t {
    manual,     // the reader's own manual says so
    confirmed,  // a manual of a sister reader, or two independent sources
    single,     // one source
    inferred,
};
std::string_view to_text(Confidence confidence);

// --- status bytes (section 2) ------------------------------------------------------------------------------

enum class Status : std::uint8_t {
    ok = 0x00,
    no_transponder = 0x01,
    data_false = 0x02,
    write_error = 0x03,
    address_error = 0x04,
    wrong_transponder_type = 0x05,
    authentication_error = 0x08,
    busy = 0x0F,
    eeprom_failure = 0x10,  // EE-Init mode
    parameter_range = 0x11,
    login_request = 0x13,
    login_error = 0x14,
    read_protect = 0x15,
    write_protect = 0x16,
    firmware_activation = 0x17,
    wrong_firmware = 0x18,
    unknown_command = 0x80,
    length_error = 0x81,
    command_not_available = 0x82,
    rf_communication_error = 0x83,
    rf_warning = 0x84,
    synchronisation_error = 0x85,
    table_overrun = 0x90,
    no_valid_data = 0x92,
    buffer_overflow = 0x93,
    more_data = 0x94,
    tag_error = 0x95,  // the first byte of the data is the tag's own error code
    hardware_warning = 0xF1,
};
extern const wire::Enumeration statuses;
extern const wire::Enumeration tag_errors;  // Gen2's own, after Status::tag_error
// "no transponder in the field (0x01)"; a number alone when no row has it.
std::string describe(std::uint8_t status);
std::string describe_tag_error(std::uint8_t error);

extern const wire::Enumeration banks;  // of Gen2, in BANK

extern const wire::Enumeration transponder_types;
inline constexpr std::uint8_t type_epc_gen2 = 0x84;
event::Technology technology_of(std::uint8_t transponder_type);
int transponder_type_of(event::Technology technology);  // -1: this reader knows no such tag

// --- commands (sections 3 to 8) ----------------------------------------------------------------------------

// What a reply answers: its meaning can depend on both.
struct Asked {
    ByteView request = {};  // the data of the request; empty: not known
    std::uint8_t status = 0;
};

// Data whose fields depend on each other: what no layout can say. They see the data of one frame, after the
// sub command.
using DecodeFields = void (*)(wire::Reader& in, const Asked& asked, wire::Fields& out);
using EncodeFields = wire::Result<void> (*)(const wire::Fields& fields, Bytes& out);

// The data of a request or a reply. `layout` names all fields in wire order, for people; where fields are
// there only in some cases, the two functions say which.
struct Shape {
    wire::Layout layout = {};
    DecodeFields decode = nullptr;
    EncodeFields encode = nullptr;
    bool opaque = false;  // nobody has published it: the field "Data" takes raw bytes
};

// When a reader takes a command.
enum class When : std::uint8_t {
    always,
    host_mode,    // answers 0x82 while it reads by itself
    buffer_mode,  // only while it reads into its buffer, by itself
};

struct CommandRow {
    std::uint8_t control;
    std::uint8_t sub;  // the first byte of the data of [0xB0] and [0xB3]; 0: no such byte
    std::string_view name;
    Shape request, reply;
    When when = When::always;
    bool on_tags = false;   // needs the radio
    bool of_manual = true;  // false: of sister readers; the virtual reader answers 0x80
    bool notified = false;  // readers send its reply by themselves, too
    Confidence confidence = Confidence::confirmed;
    std::string_view note = {};  // meaning and source, for the documents
};

// The commands that code needs by name: control << 8 | sub.
enum class Command : std::uint16_t {
    read_buffer = 0x2200,
    read_data_buffer_info = 0x3100,
    clear_data_buffer = 0x3200,
    initialize_buffer = 0x3300,
    force_notify_trigger = 0x3400,
    baud_rate_detection = 0x5200,
    rf_controller_reset = 0x6300,
    system_reset = 0x6400,
    get_software_version = 0x6500,  // of sister readers
    get_reader_info = 0x6600,
    rf_reset = 0x6900,
    rf_output = 0x6A00,
    reader_diagnostic = 0x6E00,
    set_output = 0x7200,
    get_input = 0x7400,
    read_configuration = 0x8000,
    write_configuration = 0x8100,
    reset_configuration = 0x8300,
    set_system_timer = 0x8500,
    get_system_timer = 0x8600,
    set_system_time_and_date = 0x8700,
    get_system_time_and_date = 0x8800,
    lock_region = 0x8D00,
    reader_login = 0xA000,
    write_aes_reader_keys = 0xA300,
    write_reader_authentication_key = 0xAD00,
    inventory = 0xB001,
    read_multiple_blocks = 0xB023,
    write_multiple_blocks = 0xB024,
    kill = 0xB318,
    lock = 0xB322,
    block_permalock = 0xB325,
    read_permalock_status = 0xB326,
    untraceable = 0xB330,
    authenticate = 0xB331,
};
inline constexpr std::uint8_t control_of(Command command) {
    return static_cast<std::uint8_t>(static_cast<std::uint16_t>(command) >> 8);
}
inline constexpr std::uint8_t sub_of(Command command) {
    return static_cast<std::uint8_t>(static_cast<std::uint16_t>(command) & 0xFF);
}
inline constexpr std::uint8_t host_command = 0xB0, epc_command = 0xB3;  // have a sub command
inline constexpr bool has_sub(std::uint8_t control) {
    return control == host_command || control == epc_command;
}

std::span<const CommandRow> commands();
// nullptr: no such row. O(1) but for the two with a sub command.
const CommandRow* find_command(std::uint8_t control, std::uint8_t sub = 0);
const CommandRow* find_command(std::string_view name);  // exact, then ignoring case
// Of a request with this data: knows where the sub command stands.
const CommandRow* find_request(std::uint8_t control, ByteView data);
inline const CommandRow& row_of(Command command) {
    return *find_command(control_of(command), sub_of(command));
}

// The records of [0x66] Get Reader Info and [0x6E] Reader Diagnostic: a MODE each; MODE 0xFF gives all of
// them as (MODE, 30 bytes filled up with zeros).
struct RecordRow {
    std::uint8_t mode;
    std::string_view name;
    wire::Layout layout;
    Confidence confidence = Confidence::confirmed;
    std::string_view note = {};
};
extern const wire::Enumeration reader_types;      // SW-TYPE, for people
std::span<const RecordRow> info_records();        // section 4
std::span<const RecordRow> diagnostic_records();  // section 5
const RecordRow* find_record(std::span<const RecordRow> rows, std::uint8_t mode);
inline constexpr std::uint8_t all_records = 0xFF;
inline constexpr std::size_t padded_record = 30;
// Why this MODE has no data in this firmware is the reader's business; what it sends is read as far as it
// goes: records grow with firmware, so fields that are not there are left out, and what is more is "Rest".
void decode_record(wire::Layout layout, wire::Reader& in, wire::Fields& out);
wire::Result<void> encode_record(wire::Layout layout, const wire::Fields& fields, Bytes& out);
inline constexpr std::string_view rest_field = "Rest";
extern const wire::Enumeration info_modes, diagnostic_modes;  // the names of the rows, and All

// --- the bits of addresses and modes (sections 3, 6 and 7) -------------------------------------------------

// CFG-ADR of [0x80], [0x81] and [0x83].
inline constexpr std::uint8_t cfg_eeprom = 0x80, cfg_all = 0x40, cfg_number = 0x3F;

// MODE of Inventory, and the FLAGS of its records.
inline constexpr std::uint8_t inventory_more = 0x80, inventory_antennas = 0x10;
inline constexpr std::uint8_t record_has_tag = 0x01, record_has_antennas = 0x10;

// MODE of the commands that address a tag.
inline constexpr std::uint8_t address_bits = 0x07, addressed = 0x01, selected = 0x02;
inline constexpr std::uint8_t recommission = 0x08;                     // Kill: a RECOM byte follows
inline constexpr std::uint8_t uid_length = 0x10;                       // the UID has a length byte
inline constexpr std::uint8_t extended_address = 0x20;                 // bank and two-byte address
inline constexpr std::uint8_t read_complete_bank = 0x40;               // ReadMultipleBlocks
inline constexpr std::uint8_t bank_bits = 0x03, bank_password = 0x80;  // of BANK

// The data of a frame as its command's shape says; false: they do not fit it, and `out` has them raw as
// "Data". Of a reply: `request` is what was asked (CONTROL's data), which decides what some replies mean;
// empty: not known, then `row` alone says. `status` decides what follows an error.
bool decode_request(const CommandRow& row, ByteView data, wire::Fields& out);
bool decode_reply(const CommandRow& row, ByteView request, std::uint8_t status, ByteView data,
                  wire::Fields& out);
// The data from the fields, sub command first; "Data" alone is taken as it is. What a person would leave out
// has the value that fits: MODE of Inventory and of the commands for a tag, DB-SIZE, DB-N of what is written.
wire::Result<void> encode_request(const CommandRow& row, const wire::Fields& fields, Bytes& out);
wire::Result<void> encode_reply(const CommandRow& row, std::uint8_t status, const wire::Fields& fields,
                                Bytes& out);
inline constexpr std::string_view raw_data = "Data";
inline constexpr std::string_view tag_error_field = "TAG-ERROR";

// Does a reply with this status have the data of its command (section 1)?
bool has_data(std::uint8_t status);

}  // namespace gantry::harting
