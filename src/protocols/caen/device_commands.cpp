// The commands that set and tell what a virtual reader is and how it works.
#include <algorithm>
#include <array>
#include <bit>

#include <fmt/format.h>

#include "protocols/caen/device_call.hpp"

namespace gantry::caen {

// --- plain registers ---------------------------------------------------------------------------------------

// A number of the RAM behind a pair of commands.
struct Register {
    Command set, get;
    Attribute in, out;
    std::uint32_t Ram::*where;
};
static constexpr std::array registers = {
    Register{Command::set_power, Command::get_power, Attribute::power_set, Attribute::power_get, &Ram::power},
    Register{Command::set_protocol, Command::get_protocol, Attribute::protocol, Attribute::protocol,
             &Ram::protocol},
    Register{Command::set_bit_rate, Command::get_bit_rate, Attribute::bit_rate, Attribute::bit_rate,
             &Ram::bit_rate},
    Register{Command::set_lbt_mode, Command::get_lbt_mode, Attribute::boolean, Attribute::boolean, &Ram::lbt},
    Register{Command::set_rf_channel, Command::get_rf_channel, Attribute::rf_channel, Attribute::rf_channel,
             &Ram::channel},
    Register{Command::set_event_mode, Command::get_event_mode, Attribute::event_mode, Attribute::event_mode,
             &Ram::event_mode},
    Register{Command::rf_on_off, Command::rf_on_off, Attribute::rf_on_off, Attribute::rf_on_off, &Ram::rf_on},
};

static ResultCode get_register(Call& call) {
    const auto* row = std::ranges::find(registers, call.command, &Register::get);
    append_number(call.answer, row->out, call.memory.ram.*row->where);
    return ResultCode::success;
}

// What the tables cannot say of a value, because it depends on the model.
static ResultCode model_allows(const ModelRow& model, Attribute attribute, std::uint32_t value) {
    switch (attribute) {
        case Attribute::power_set:
            return value < model.power_min_mw || value > model.power_max_mw ? ResultCode::power_out_of_range
                                                                            : ResultCode::success;
        case Attribute::protocol:  // revision 4 ends at 3 (section 4, 0x54)
            return model.revision < 12 && value > 3 ? ResultCode::invalid_protocol : ResultCode::success;
        case Attribute::bit_rate:  // and here too (section 4.1)
            return model.revision < 12 && value > 3 ? ResultCode::bad_parameter_value : ResultCode::success;
        case Attribute::rf_regulation:  // section 4.3
            return model.revision < 12 && value > 1 ? ResultCode::bad_parameter_value : ResultCode::success;
        default:
            return ResultCode::success;
    }
}

static ResultCode set_register(Call& call) {
    const auto* row = std::ranges::find(registers, call.command, &Register::set);
    auto value = call.arguments.number(row->in);
    auto allowed = model_allows(call.memory.model, row->in, value);
    if (allowed != ResultCode::success) return allowed;
    bool truth = row->in == Attribute::boolean || row->in == Attribute::rf_on_off;
    call.memory.ram.*row->where = truth ? std::uint32_t{value != 0} : value;
    return ResultCode::success;
}

static ResultCode set_regulation(Call& call) {
    auto value = call.arguments.number(Attribute::rf_regulation);
    auto allowed = model_allows(call.memory.model, Attribute::rf_regulation, value);
    if (allowed == ResultCode::success) call.memory.eeprom.regulation = value;
    return allowed;
}

static ResultCode get_regulation(Call& call) {
    append_number(call.answer, Attribute::rf_regulation, call.memory.eeprom.regulation);
    return ResultCode::success;
}

// --- sources -----------------------------------------------------------------------------------------------

SourceChoice choose_source(const Arguments& arguments, const ReaderMemory& memory) {
    if (!arguments.has(Attribute::source_name)) return {};
    auto name = arguments.text(Attribute::source_name);
    if (name.empty()) return {ResultCode::invalid_source_name, 0};
    auto source = memory.source(name);
    return source ? SourceChoice{ResultCode::success, *source}
                  : SourceChoice{ResultCode::source_not_found, 0};
}

struct PointChoice {
    ResultCode result = ResultCode::success;
    std::size_t source = 0;
    unsigned point = 0;
};
static PointChoice choose_point(const Call& call) {
    auto [result, source] = choose_source(call.arguments, call.memory);
    if (result != ResultCode::success) return {result, 0, 0};
    auto point = call.memory.read_point(call.arguments.text(Attribute::read_point_name));
    if (!point) return {ResultCode::bad_read_point, 0, 0};
    return {ResultCode::success, source, *point};
}

static ResultCode add_read_point(Call& call) {
    auto [result, source, point] = choose_point(call);
    if (result == ResultCode::success) call.memory.ram.sources[source].read_points |= 1u << point;
    return result;
}

static ResultCode remove_read_point(Call& call) {
    auto [result, source, point] = choose_point(call);
    if (result != ResultCode::success) return result;
    auto& points = call.memory.ram.sources[source].read_points;
    if ((points >> point & 1u) == 0) return ResultCode::bad_read_point;
    points &= ~(1u << point);
    return ResultCode::success;
}

static ResultCode check_read_point(Call& call) {
    auto [result, source, point] = choose_point(call);
    if (result == ResultCode::success)
        append_number(call.answer, Attribute::boolean,
                      call.memory.ram.sources[source].read_points >> point & 1u);
    return result;
}

static ResultCode check_read_point_status(Call& call) {
    auto [result, source, point] = choose_point(call);
    if (result != ResultCode::success) return result;
    auto status = static_cast<std::uint32_t>(call.memory.antenna(point));
    append_number(call.answer, Attribute::read_point_status, call.memory.good_is_zero ? status : 2 - status);
    return ResultCode::success;
}

// The largest value of each source parameter (section 4.2). Where no source says one, what a person could
// mean.
static constexpr std::array<std::uint32_t, config_size> config_max = {
    0xFFFFFFFF,  // ReadCycle
    0xFFFFFFFF,  // observed threshold
    0xFFFFFFFF,  // lost threshold
    15,          // Q
    3,           // session
    1,           // target
    3,           // selected
    1,           // DESB
    60'000,      // dwell time, ms
    3,           // inventory type
    0xFFFF,      // inventory count
    15,          // minimum Q
    15,          // maximum Q
    62,          // TID length
    0,           // RF matching: never
    60'000,      // quiet time, ms
};

static bool source_has(const ModelRow& model, std::uint32_t parameter) {
    if (parameter >= config_size || parameter == static_cast<std::uint32_t>(Config::matching)) return false;
    return model.revision >= 12 || parameter <= static_cast<std::uint32_t>(Config::lost_threshold);
}

static ResultCode set_source_config(Call& call) {
    auto [result, source] = choose_source(call.arguments, call.memory);
    if (result != ResultCode::success) return result;
    auto parameter = call.arguments.number(Attribute::config_parameter);
    auto value = call.arguments.number(Attribute::config_value);
    if (!source_has(call.memory.model, parameter) || value > config_max[parameter])
        return ResultCode::bad_parameter_value;
    call.memory.ram.sources[source].config[parameter] = value;
    return ResultCode::success;
}

static ResultCode get_source_config(Call& call) {
    auto [result, source] = choose_source(call.arguments, call.memory);
    if (result != ResultCode::success) return result;
    auto parameter = call.arguments.number(Attribute::config_parameter);
    if (!source_has(call.memory.model, parameter)) return ResultCode::bad_parameter_value;
    append_number(call.answer, Attribute::config_value, call.memory.ram.sources[source].config[parameter]);
    return ResultCode::success;
}

// Q and DESB are one for the whole reader in these commands, and one for each source in SetSourceConfig: here
// they go to all sources and are read from the first.
static ResultCode set_in_all(Call& call, Config which, std::uint32_t value) {
    for (auto& source : call.memory.ram.sources)
        source[which] = value;
    return ResultCode::success;
}
static ResultCode set_q(Call& call) {
    return set_in_all(call, Config::starting_q, call.arguments.number(Attribute::q_parameter));
}
static ResultCode get_q(Call& call) {
    append_number(call.answer, Attribute::q_parameter, call.memory.ram.sources[0][Config::starting_q]);
    return ResultCode::success;
}
static ResultCode set_desb(Call& call) {
    return set_in_all(call, Config::desb, std::uint32_t{call.arguments.number(Attribute::desb_enable) != 0});
}
static ResultCode get_desb(Call& call) {
    append_number(call.answer, Attribute::desb_status, call.memory.ram.sources[0][Config::desb]);
    return ResultCode::success;
}

// --- network, serial line, clock ---------------------------------------------------------------------------

static ResultCode set_network(Call& call) {
    auto address = call.arguments.text(Attribute::ip_address),
         mask = call.arguments.text(Attribute::ip_net_mask),
         gateway = call.arguments.text(Attribute::ip_gateway);
    for (auto text : {address, mask, gateway})
        if (!is_dotted_decimal(text)) return ResultCode::bad_address;
    // Stored only: they would take effect after a restart, and a virtual reader has no address of its own.
    auto& eeprom = call.memory.eeprom;
    eeprom.address = address;
    eeprom.net_mask = mask;
    eeprom.gateway = gateway;
    return ResultCode::success;
}

static ResultCode set_rs232(Call& call) {
    static constexpr std::array<std::uint32_t, 8> rates = {9600,   19200,  38400,  57600,
                                                           115200, 230400, 460800, 921600};
    static constexpr std::uint32_t software = 2;  // not implemented, say revisions 4 and 19 (0x64)
    auto rate = call.arguments.number(Attribute::baud_rate);
    auto flow = call.arguments.number(Attribute::flow_ctrl);
    if (std::ranges::find(rates, rate) == rates.end() || flow == software)
        return ResultCode::bad_parameter_value;
    auto& eeprom = call.memory.eeprom;
    eeprom.baud_rate = rate;
    eeprom.data_bits = call.arguments.number(Attribute::data_bits);
    eeprom.stop_bits = call.arguments.number(Attribute::stop_bits);
    eeprom.parity = call.arguments.number(Attribute::parity);
    eeprom.flow_ctrl = flow;
    return ResultCode::success;
}

static ResultCode set_date_time(Call& call) {
    auto text = call.arguments.text(Attribute::date_time);  // "YYYY-MM-DD HH:MM:SS"
    if (text.size() != 19 || text[10] != ' ') return ResultCode::invalid_time;
    auto time = parse_rfc3339(fmt::format("{}T{}Z", text.substr(0, 10), text.substr(11)));
    // TimeStamp has 32 bits of seconds since 1970.
    if (!time || to_us(*time) < 0 || to_us(*time) / 1'000'000 > 0xFFFFFFFFll) return ResultCode::invalid_time;
    call.memory.set_time(call.now.steady, to_us(*time));
    return ResultCode::success;
}

// --- I/O lines ---------------------------------------------------------------------------------------------

static ResultCode get_io(Call& call) {
    append_number(call.answer, Attribute::io_register, call.memory.io_register());
    return ResultCode::success;
}

// Bits of lines that the model does not have are not used (section 4, 0x69).
static ResultCode set_io(Call& call) {
    call.memory.ram.outputs =
        call.arguments.number(Attribute::io_register) & call.memory.ram.directions & call.memory.line_mask();
    return ResultCode::success;
}

static ResultCode get_io_direction(Call& call) {
    append_number(call.answer, Attribute::io_register, call.memory.ram.directions);
    return ResultCode::success;
}

static ResultCode set_io_direction(Call& call) {
    auto wanted = call.arguments.number(Attribute::io_register) & call.memory.line_mask();
    if (!call.memory.model.io_directions && wanted != call.memory.ram.directions)
        return ResultCode::bad_parameter_value;
    call.memory.ram.directions = wanted;
    return ResultCode::success;
}

// --- the reader itself -------------------------------------------------------------------------------------

static ResultCode get_firmware(Call& call) {
    append_text(call.answer, Attribute::fw_release, call.memory.firmware);
    return ResultCode::success;
}

static ResultCode get_reader_info(Call& call) {
    append_text(call.answer, Attribute::reader_info,
                fmt::format("{} {}", call.memory.model.name, call.memory.serial));
    return ResultCode::success;
}

// ClearBuffer and G2ResetSession without parameters: no reads are kept between two inventories, and no
// session flags between two rounds.
static ResultCode nothing_to_do(Call&) {
    return ResultCode::success;
}

static ResultCode firmware_upgrade(Call& call) {
    auto argument = call.arguments.text(Attribute::upgrade_argument);  // "<tftp server>:<file>"
    auto colon = argument.find(':');
    if (colon == std::string_view::npos || colon + 1 == argument.size() ||
        !is_dotted_decimal(argument.substr(0, colon)))
        return ResultCode::bad_address;
    call.restart = true;
    return ResultCode::success;
}

static ResultCode match_rf_impedance(Call& call) {
    auto [result, source, point] = choose_point(call);
    if (result != ResultCode::success) return result;
    // The parameter must be 14, its value 0 (section 6.1).
    if (call.arguments.number(Attribute::config_parameter) != static_cast<std::uint32_t>(Config::matching) ||
        call.arguments.number(Attribute::config_value) != 0)
        return ResultCode::bad_parameter_value;
    auto antenna = call.memory.antenna(point);
    if (antenna == ReaderMemory::Antenna::bad) return ResultCode::read_point_matching_error;
    auto vswr = std::bit_cast<std::uint32_t>(antenna == ReaderMemory::Antenna::good ? 1.25f : 2.5f);
    append_number(call.answer, Attribute::power_vswr, vswr);
    return ResultCode::success;
}

// --- the table ---------------------------------------------------------------------------------------------

static constexpr std::array setting_rows = {
    HandlerRow{Command::set_power, set_register},
    HandlerRow{Command::get_power, get_register},
    HandlerRow{Command::set_protocol, set_register},
    HandlerRow{Command::get_protocol, get_register},
    HandlerRow{Command::set_bit_rate, set_register},
    HandlerRow{Command::get_bit_rate, get_register},
    HandlerRow{Command::set_lbt_mode, set_register},
    HandlerRow{Command::get_lbt_mode, get_register},
    HandlerRow{Command::set_rf_channel, set_register},
    HandlerRow{Command::get_rf_channel, get_register},
    HandlerRow{Command::set_event_mode, set_register},
    HandlerRow{Command::get_event_mode, get_register},
    HandlerRow{Command::rf_on_off, set_register},
    HandlerRow{Command::set_rf_regulation, set_regulation},
    HandlerRow{Command::get_rf_regulation, get_regulation},
    HandlerRow{Command::add_read_point_to_source, add_read_point},
    HandlerRow{Command::remove_read_point_from_source, remove_read_point},
    HandlerRow{Command::check_read_point_in_source, check_read_point},
    HandlerRow{Command::check_read_point_status, check_read_point_status},
    HandlerRow{Command::set_source_config, set_source_config},
    HandlerRow{Command::get_source_config, get_source_config},
    HandlerRow{Command::g2_set_q, set_q},
    HandlerRow{Command::g2_get_q, get_q},
    HandlerRow{Command::set_desb, set_desb},
    HandlerRow{Command::get_desb, get_desb},
    HandlerRow{Command::set_network, set_network},
    HandlerRow{Command::set_rs232, set_rs232},
    HandlerRow{Command::set_date_time, set_date_time},
    HandlerRow{Command::get_io, get_io},
    HandlerRow{Command::set_io, set_io},
    HandlerRow{Command::get_io_direction, get_io_direction},
    HandlerRow{Command::set_io_direction, set_io_direction},
    HandlerRow{Command::get_firmware_release, get_firmware},
    HandlerRow{Command::get_reader_info, get_reader_info},
    HandlerRow{Command::firmware_upgrade, firmware_upgrade},
    HandlerRow{Command::match_rf_impedance, match_rf_impedance},
    HandlerRow{Command::clear_buffer, nothing_to_do},
    HandlerRow{Command::g2_reset_session, nothing_to_do},
};

std::span<const HandlerRow> setting_handlers() {
    return setting_rows;
}

Handler find_handler(Command command) {
    for (auto rows : {setting_handlers(), tag_handlers(), notify_handlers()}) {
        auto row = std::ranges::find(rows, command, &HandlerRow::command);
        if (row != rows.end()) return row->handler;
    }
    return nullptr;
}

}  // namespace gantry::caen
