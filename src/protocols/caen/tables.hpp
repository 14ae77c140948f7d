#pragma once
#include <cstdint>
#include <span>
#include <string_view>

#include "event/event.hpp"
#include "wire/layout.hpp"

// What the bytes of CAEN's UHF protocol mean, as data. Sections are those of docs/protocols/caen.md.
namespace gantry::caen {

inline constexpr std::uint16_t to_reader_head = 0x8001, to_host_head = 0x0001;
inline constexpr std::uint32_t vendor = 21336;
inline constexpr std::uint16_t port = 1000;
inline constexpr std::uint8_t abort_byte = 0xAB;  // unframed: ends a framed inventory

// --- attributes (section 4) --------------------------------------------------------------------------------

enum class Kind : std::uint8_t {
    number,     // unsigned, of the row's size
    integer,    // two's complement, of the row's size
    real,       // 4 bytes, IEEE 754 big-endian; as text "1.25"
    bytes,      // 1 to `size` bytes
    text,       // at most `size` bytes with its NUL
    timestamp,  // u32 seconds since 1970, u32 microseconds; as text "seconds.microseconds"
};

struct AttributeRow {
    std::uint16_t code;
    std::string_view name;
    Kind kind;
    std::uint16_t size;  // bytes: exactly (numbers, timestamp) or at most (bytes, text); 0: not known
    std::int64_t min = 0, max = -1;  // legal numbers, if min <= max
    std::string_view unit = {};
    const wire::Enumeration* enumeration = nullptr;
    std::string_view note = {};  // meaning and source, for the documents
};

// The attributes that code needs by name. Others are rows only.
enum class Attribute : std::uint16_t {
    command_name = 0x01,
    result_code = 0x02,
    event_type = 0x0E,
    tag_id_len = 0x0F,
    time_stamp = 0x10,
    tag_id = 0x11,
    tag_type = 0x12,
    channel_name = 0x1E,
    channel_address = 0x1F,
    trigger_name = 0x20,
    trigger_type = 0x21,
    read_point_name = 0x22,
    tag_value = 0x4D,
    tag_address = 0x4E,
    length = 0x50,
    bit_rate = 0x51,
    power_get = 0x52,
    power_vswr = 0x53,
    protocol = 0x54,
    read_point_status = 0x56,
    boolean = 0x57,
    ip_address = 0x58,
    ip_net_mask = 0x59,
    ip_gateway = 0x5A,
    desb_enable = 0x5B,
    fw_release = 0x5C,
    desb_status = 0x5D,
    epc_password = 0x5E,
    rf_on_off = 0x5F,
    baud_rate = 0x60,
    data_bits = 0x61,
    stop_bits = 0x62,
    parity = 0x63,
    flow_ctrl = 0x64,
    date_time = 0x65,
    sel_unsel_op = 0x66,
    bitmask = 0x67,
    io_register = 0x69,
    config_parameter = 0x6A,
    config_value = 0x6B,
    no_of_triggers = 0x6C,
    no_of_channels = 0x6D,
    event_mode = 0x6E,
    upgrade_type = 0x6F,
    upgrade_argument = 0x70,
    memory_bank = 0x71,
    payload = 0x72,
    g2_password = 0x73,
    g2_nsi = 0x74,
    q_parameter = 0x75,
    reader_info = 0x76,
    rf_regulation = 0x77,
    rf_channel = 0x78,
    sub_cmd = 0x79,
    rssi = 0x7A,
    xpc = 0x7C,
    pc = 0x7D,
    phase = 0x7E,
    power_set = 0x96,
    source_name = 0xFB,
};

std::span<const AttributeRow> attributes();
const AttributeRow* find_attribute(std::uint16_t code);     // nullptr: no such row; O(1)
const AttributeRow* find_attribute(std::string_view name);  // exact, then ignoring case
inline const AttributeRow& row_of(Attribute attribute) {
    return *find_attribute(static_cast<std::uint16_t>(attribute));
}

// --- enumerations ------------------------------------------------------------------------------------------

extern const wire::Enumeration result_codes, event_types, tag_types, bit_rates, protocols, read_point_states,
    parities, flow_controls, sel_unsel_ops, config_parameters, event_modes, upgrade_types, memory_banks,
    rf_regulations;

enum class ResultCode : std::uint16_t {
    success = 0,
    channel_name_exists = 100,
    address_in_use = 101,
    unknown_error = 102,
    bad_channel = 103,
    invalid_source_name = 104,
    invalid_channel_name = 105,
    too_many_channels = 106,
    too_many_sources = 107,
    source_not_in_channel = 109,
    bad_timer_value = 110,
    trigger_name_exists = 111,
    too_many_triggers = 112,
    bad_trigger = 113,
    bad_address = 114,
    invalid_protocol = 115,
    bad_port_address = 116,
    cannot_connect = 117,
    invalid_trigger_name = 118,
    invalid_time = 119,
    source_not_found = 120,
    trigger_not_found = 121,
    channel_not_found = 122,
    bad_read_point = 123,
    channel_busy = 124,
    trigger_busy = 125,
    file_system_error = 126,
    invalid_command = 127,
    bad_parameter_value = 128,
    notify_server_not_ready = 129,
    power_out_of_range = 183,
    invalid_parameter = 200,
    source_disabled = 201,
    tag_not_present = 202,
    tag_write_error = 203,
    tag_read_error = 204,
    bad_tag_address = 205,
    invalid_function = 206,
    select_error = 207,
    tag_locked = 209,
    unsupported = 210,
    insufficient_power = 211,
    tag_error = 212,
    kill_error = 213,
    channels_full = 214,
    read_point_matching_error = 215,
};
// "tag not present (202)"; a number alone when no row has it.
std::string describe(std::uint16_t result);

// --- commands (section 6) ----------------------------------------------------------------------------------

// A parameter of a command: its attribute, and how often it may come.
struct Param {
    Attribute attribute;
    bool optional = false;
    bool repeated = false;       // once or more often
    std::string_view name = {};  // in the manual, where that is not the attribute's
};

// Bits of the models that have a command; see models().
using ModelSet = std::uint64_t;

struct CommandRow {
    std::uint16_t code;
    std::string_view name;             // revision 4's
    std::string_view later_name = {};  // where later revisions say something else
    std::span<const Param> in = {};    // after the command, in order
    std::span<const Param> out = {};   // before the result code, in order
    bool out_repeats = false;          // `out` comes once per read point or tag, and not at all for none
    bool parameters_known = true;      // false: only raw attributes can be sent
    bool reserved = false;             // a code without a command
    bool obsolete = false;             // declared so by revision 19
    bool notification = false;         // sent by readers of their own accord; its code is ours
    ModelSet models = 0;
    std::string_view source = {};
};

// The commands that code needs by name.
enum class Command : std::uint16_t {
    raw_read_ids = 0x12,
    inventory_tag = 0x13,
    add_read_trigger = 0x3F,
    add_notify_trigger = 0x40,
    remove_read_trigger = 0x41,
    remove_notify_trigger = 0x42,
    allocate_trigger = 0x49,
    deallocate_trigger = 0x4A,
    allocate_channel = 0x53,
    deallocate_channel = 0x54,
    add_source_to_channel = 0x5D,
    remove_source_from_channel = 0x5E,
    add_read_point_to_source = 0x5F,
    remove_read_point_from_source = 0x60,
    set_power = 0x64,
    read_tag_data = 0x6E,
    write_tag_data = 0x6F,
    lock_tag = 0x70,
    set_bit_rate = 0x72,
    get_power = 0x73,
    set_protocol = 0x74,
    check_read_point_status = 0x76,
    check_source_in_channel = 0x77,
    check_read_point_in_source = 0x78,
    get_protocol = 0x79,
    set_network = 0x7A,
    set_desb = 0x7B,
    get_firmware_release = 0x7C,
    get_desb = 0x7D,
    program_id = 0x7E,
    kill_tag = 0x7F,
    rf_on_off = 0x80,
    get_bit_rate = 0x81,
    block_write_tag = 0x82,
    set_rs232 = 0x83,
    set_date_time = 0x84,
    group_select_unselect = 0x85,
    get_io = 0x86,
    set_io = 0x87,
    set_io_direction = 0x88,
    get_io_direction = 0x89,
    set_source_config = 0x8A,
    get_source_config = 0x8B,
    get_triggers = 0x8C,
    get_channels = 0x8D,
    check_source_in_trigger = 0x8E,
    check_trigger_in_channel = 0x8F,
    check_channel_in_trigger = 0x90,
    set_event_mode = 0x91,
    get_event_mode = 0x92,
    firmware_upgrade = 0x93,
    e119_program_id = 0x94,
    g2_program_id = 0x95,
    g2_read = 0x96,
    g2_write = 0x97,
    g2_lock = 0x98,
    g2_kill = 0x99,
    g2_query = 0x9A,
    g2_set_q = 0x9B,
    g2_get_q = 0x9C,
    g2_query_ack = 0x9D,
    get_reader_info = 0x9E,
    set_lbt_mode = 0x9F,
    get_lbt_mode = 0xA0,
    set_rf_regulation = 0xA1,
    get_rf_regulation = 0xA2,
    set_rf_channel = 0xA3,
    get_rf_channel = 0xA4,
    g2_reset_session = 0xA5,
    g2_custom = 0xA8,
    match_rf_impedance = 0xB4,
    clear_buffer = 0xB8,
    // Not published (section 9); ours until somebody records a reader's. Receivers take any value.
    report_buffer = 0xFFFE,
    kill_message = 0xFFFF,
};

std::span<const CommandRow> commands();
const CommandRow* find_command(std::uint16_t code);     // nullptr: no such row; O(1)
const CommandRow* find_command(std::string_view name);  // either name; exact, then ignoring case
inline const CommandRow& row_of(Command command) {
    return *find_command(static_cast<std::uint16_t>(command));
}

// Flags of InventoryTag (section 7).
enum InventoryFlag : std::uint16_t {
    flag_rssi = 0x0001,
    flag_framed = 0x0002,
    flag_continuous = 0x0004,
    flag_compact = 0x0008,
    flag_tid = 0x0010,
    flag_event_trigger = 0x0020,
    flag_xpc = 0x0040,
    flag_match = 0x0080,
    flag_pc = 0x0100,
};

// --- models (sections 6 and 10) ----------------------------------------------------------------------------

struct ModelRow {
    std::string_view name;     // "A948EU", "R4300P", "all"
    std::uint8_t bit;          // in a ModelSet; "all": has every command
    std::uint8_t revision;     // of the manual it follows: 4, 5, 12, 19
    std::uint8_t sources;      // Source_0 …
    std::uint8_t read_points;  // Ant0 …
    std::uint32_t power_min_mw, power_max_mw, power_default_mw;
    std::uint8_t inputs, outputs;  // I/O lines; with separate lines inputs are the low bits
    bool io_directions;            // lines whose direction can be set
    bool listens_before_talking;
    bool notifies;              // notification channels
    bool network;               // has an IP address
    bool phase;                 // gives a tag's phase in inventories
    std::string_view firmware;  // what a virtual one says
    std::string_view note = {};
};

std::span<const ModelRow> models();
const ModelRow* find_model(std::string_view name);  // exact, then ignoring case, then "A948" for "A948EU"
inline bool has(const ModelRow& model, const CommandRow& command) {
    return (command.models >> model.bit & 1) != 0;
}

// The readers' own names of their parts (section 10): "Source_0", "Ant0".
std::string source_name(std::size_t number);
std::string read_point_name(std::size_t number);

// What a tag type (0x12) or an air protocol (0x54) is in events.
event::Technology technology_of(std::int64_t tag_type);
std::int64_t tag_type_of(event::Technology technology);  // -1: none

// --- parameters of a reader that people get and set --------------------------------------------------------

// "Power", "Protocol", "Source_0.Session": how each is asked for and set, out of the commands above.
struct ParameterBinding {
    std::string_view name;               // "Power"; "Source_0.Q" for each source
    Command get, set;                    // set == get: cannot be set
    Attribute answer, argument;          // the value in the answer of `get`, and in `set`
    std::string_view source = {};        // SourceName, for {Get,Set}SourceConfig
    std::int64_t config_parameter = -1;  // ConfigParameter, likewise
    std::string_view help = {};
};
std::span<const ParameterBinding> parameters();
const ParameterBinding* find_parameter(std::string_view name);  // exact, then ignoring case

}  // namespace gantry::caen
