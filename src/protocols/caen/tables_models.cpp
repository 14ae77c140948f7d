#include <algorithm>
#include <array>

#include <fmt/format.h>

#include "base/text.hpp"
#include "protocols/caen/model_sets.hpp"

namespace gantry::caen {

namespace {

// No source gives power ranges, I/O lines and firmware texts, and from revision 14 on no numbers of sources
// and read points: what stands here then is chosen, after the kind of reader.
constexpr std::string_view rev4_note = "tables 4.1 to 4.4; power, I/O lines and firmware are chosen";
constexpr std::string_view chosen = "all figures are chosen";
constexpr std::string_view later_note =
    "in no manual; commands of rev 19 and the light library, figures chosen";

// Fixed readers of revision 4 with a network.
constexpr ModelRow fixed_rev4(std::string_view name, std::uint8_t bit) {
    return {.name = name,
            .bit = bit,
            .revision = 4,
            .sources = 4,
            .read_points = 4,
            .power_min_mw = 50,
            .power_max_mw = 2000,
            .power_default_mw = 500,
            .inputs = 4,
            .outputs = 4,
            .io_directions = false,
            .listens_before_talking = bit == a948eu,
            .notifies = true,
            .network = true,
            .phase = false,
            .firmware = "2.4.0",
            .note = rev4_note};
}
// One antenna, a serial line.
constexpr ModelRow serial(std::string_view name, std::uint8_t bit, std::uint8_t revision,
                          std::uint32_t max_mw, bool lbt, std::string_view firmware, std::string_view note) {
    return {.name = name,
            .bit = bit,
            .revision = revision,
            .sources = 1,
            .read_points = 1,
            .power_min_mw = 10,
            .power_max_mw = max_mw,
            .power_default_mw = max_mw / 2,
            .inputs = 2,
            .outputs = 2,
            .io_directions = true,
            .listens_before_talking = lbt,
            .notifies = false,
            .network = false,
            .phase = false,
            .firmware = firmware,
            .note = note};
}
constexpr ModelRow ports(ModelRow row, std::uint8_t count, bool network) {
    row.sources = row.read_points = count;
    row.network = network;
    if (count > 1) row.inputs = row.outputs = 4;
    return row;
}

// The Lepton modules. A program that others use with the R3100C drives two antennas and 1 to 316 mW.
constexpr ModelRow lepton(ModelRow row) {
    row.phase = true;
    return row;
}
constexpr ModelRow lepton3() {
    auto row = lepton(serial("R3100C", r3100c, 19, 316, true, "1.4.0",
                             "sources, read points and power after a program for it, the rest chosen"));
    row.sources = row.read_points = 2;
    row.power_min_mw = 1;
    return row;
}

constexpr std::array rows = {
    fixed_rev4("A928EU", a928eu),
    fixed_rev4("A948EU", a948eu),
    serial("A828EU", a828eu, 4, 500, false, "2.4.0", rev4_note),
    serial("A828US", a828us, 4, 500, false, "2.4.0", rev4_note),
    serial("A829EU", a829eu, 4, 500, false, "2.4.0", rev4_note),
    serial("A829US", a829us, 4, 500, false, "2.4.0", rev4_note),
    serial("A946EU", a946eu, 4, 500, true, "2.4.0", rev4_note),
    serial("A949EU", a949eu, 4, 500, true, "2.4.0", rev4_note),
    serial("A528", a528, 12, 500, false, "2.9.0", chosen),
    ports(serial("A941", a941, 5, 1000, true, "2.9.0", chosen), 4, false),
    serial("A828A", a828a, 12, 500, false, "2.9.0", chosen),
    serial("A829A", a829a, 5, 500, false, "2.9.0", chosen),
    ports(serial("A941M", a941m, 19, 1000, true, "3.2.0", chosen), 4, true),
    serial("R1230CB", r1230cb, 19, 500, true, "3.2.0", chosen),
    serial("R1260I", r1260i, 19, 500, true, "3.2.0", chosen),
    serial("R1260U", r1260u, 19, 500, true, "3.2.0", chosen),
    serial("R1260E", r1260e, 19, 500, true, "3.2.0", chosen),
    ports(serial("R4300P", r4300p, 19, 1300, true, "4.1.0", chosen), 4, true),
    ports(serial("R4301P", r4301p, 19, 1300, true, "4.1.0", chosen), 4, true),
    ports(serial("A528B", a528b, 19, 500, true, "4.1.0", chosen), 4, false),
    serial("R1240I", r1240i, 19, 500, true, "4.1.0", chosen),
    serial("R1240IE", r1240ie, 19, 500, true, "4.1.0", chosen),
    serial("R1240IU", r1240iu, 19, 500, true, "4.1.0", chosen),
    serial("R1170I", r1170i, 19, 250, true, "4.1.0", chosen),
    serial("R1270", r1270, 19, 320, true, "4.1.0", chosen),
    serial("R1250I", r1250i, 19, 200, true, "4.1.0", chosen),
    serial("R1170INF", r1170inf, 19, 250, true, "4.1.0", "rev 19 or later; figures chosen"),
    lepton3(),
    lepton(serial("R7100C", r7100c, 19, 1400, true, "1.4.0", later_note)),
    lepton(serial("R7101C", r7101c, 19, 1400, true, "1.4.0", later_note)),
    lepton(ports(serial("R7104C", r7104c, 19, 1400, true, "1.4.0", later_note), 4, false)),
    ports(serial("R4320P", r4320p, 19, 2000, true, "1.4.0", later_note), 4, true),
    ModelRow{.name = "all",
             .bit = every_command,
             .revision = 19,
             .sources = 4,
             .read_points = 4,
             .power_min_mw = 10,
             .power_max_mw = 2000,
             .power_default_mw = 500,
             .inputs = 4,
             .outputs = 4,
             .io_directions = true,
             .listens_before_talking = true,
             .notifies = true,
             .network = true,
             .phase = false,
             .firmware = "4.1.0",
             .note = "no real reader: has every command; the virtual reader's default. Figures chosen"},
};

// --- parameters --------------------------------------------------------------------------------------------

constexpr ParameterBinding setting(std::string_view name, Command get, Command set, Attribute answer,
                                   Attribute argument, std::string_view help) {
    return {.name = name, .get = get, .set = set, .answer = answer, .argument = argument, .help = help};
}
constexpr ParameterBinding config(std::string_view name, std::string_view source, std::int64_t parameter,
                                  std::string_view help) {
    return {.name = name,
            .get = Command::get_source_config,
            .set = Command::set_source_config,
            .answer = Attribute::config_value,
            .argument = Attribute::config_value,
            .source = source,
            .config_parameter = parameter,
            .help = help};
}

constexpr std::array reader_parameters = {
    setting("Power", Command::get_power, Command::set_power, Attribute::power_get, Attribute::power_set,
            "RF power in mW"),
    setting("Protocol", Command::get_protocol, Command::set_protocol, Attribute::protocol,
            Attribute::protocol, "air protocol"),
    setting("BitRate", Command::get_bit_rate, Command::set_bit_rate, Attribute::bit_rate, Attribute::bit_rate,
            "RF link profile"),
    setting("Q", Command::g2_get_q, Command::g2_set_q, Attribute::q_parameter, Attribute::q_parameter,
            "initial Q of the Gen2 anticollision, 0 to 15"),
    setting("DESB", Command::get_desb, Command::set_desb, Attribute::desb_status, Attribute::desb_enable,
            "data exchange status bit of ISO18000-6B and EPC 1.19: 0 or 1"),
    setting("LBT", Command::get_lbt_mode, Command::set_lbt_mode, Attribute::boolean, Attribute::boolean,
            "listen before talk, or frequency hopping: 0 or 1"),
    setting("RFRegulation", Command::get_rf_regulation, Command::set_rf_regulation, Attribute::rf_regulation,
            Attribute::rf_regulation, "radio regulation"),
    setting("RFChannel", Command::get_rf_channel, Command::set_rf_channel, Attribute::rf_channel,
            Attribute::rf_channel, "radio channel, 0 to 9"),
    setting("EventMode", Command::get_event_mode, Command::set_event_mode, Attribute::event_mode,
            Attribute::event_mode, "when notifications are made"),
    setting("IODirection", Command::get_io_direction, Command::set_io_direction, Attribute::io_register,
            Attribute::io_register, "a bit a line: 0 is in, 1 is out"),
    setting("IO", Command::get_io, Command::set_io, Attribute::io_register, Attribute::io_register,
            "state of the lines, a bit each"),
    setting("Firmware", Command::get_firmware_release, Command::get_firmware_release, Attribute::fw_release,
            Attribute::fw_release, "firmware release; read only"),
    setting("ReaderInfo", Command::get_reader_info, Command::get_reader_info, Attribute::reader_info,
            Attribute::reader_info, "model and serial number; read only"),
};

#define GANTRY_CAEN_SOURCE(source)                                                                    \
    config(source ".ReadCycle", source, 0, "inventory rounds; 0: endless in continuous mode"),        \
        config(source ".ObservedThreshold", source, 1, "rounds or time until a tag is observed"),     \
        config(source ".LostThreshold", source, 2, "rounds or time until a tag is lost"),             \
        config(source ".Q", source, 3, "starting Q, 0 to 15"),                                        \
        config(source ".Session", source, 4, "Gen2 session, 0 to 3"),                                 \
        config(source ".Target", source, 5, "Gen2 target: 0 is A, 1 is B"),                           \
        config(source ".Selected", source, 6, "Gen2 Sel, 0 to 3: 0 all, 2 not selected, 3 selected"), \
        config(source ".DESB", source, 7, "ISO18000-6B: 0 or 1"),                                     \
        config(source ".DwellTime", source, 8, "antenna dwell time in ms"),                           \
        config(source ".InventoryType", source, 9, "algorithm, 0 to 3"),                              \
        config(source ".InventoryCount", source, 10, "inventories of a round"),                       \
        config(source ".MinQ", source, 11, "minimum Q, 0 to 15"),                                     \
        config(source ".MaxQ", source, 12, "maximum Q, 0 to 15"),                                     \
        config(source ".TIDLength", source, 13, "bytes of the TID to read in inventories"),           \
        config(source ".QuietTime", source, 15, "pause between rounds")
constexpr std::array source_parameters = {GANTRY_CAEN_SOURCE("Source_0"), GANTRY_CAEN_SOURCE("Source_1"),
                                          GANTRY_CAEN_SOURCE("Source_2"), GANTRY_CAEN_SOURCE("Source_3")};
#undef GANTRY_CAEN_SOURCE

constexpr auto bindings = [] {
    std::array<ParameterBinding, reader_parameters.size() + source_parameters.size()> all = {};
    auto next = std::ranges::copy(reader_parameters, all.begin()).out;
    std::ranges::copy(source_parameters, next);
    return all;
}();

template <class Rows>
auto find_by_name(const Rows& table, std::string_view name) -> decltype(table.data()) {
    for (auto& row : table)
        if (row.name == name) return &row;
    for (auto& row : table)
        if (alike(row.name, name)) return &row;
    return nullptr;
}

}  // namespace

std::span<const ModelRow> models() {
    return rows;
}

const ModelRow* find_model(std::string_view name) {
    if (auto* row = find_by_name(rows, name)) return row;
    // Later manuals drop the region from the names of revision 4.
    if (name.size() < 4) return nullptr;
    for (auto& row : rows)
        if (row.name.size() == name.size() + 2 && row.name.ends_with("EU") &&
            alike(row.name.substr(0, name.size()), name))
            return &row;
    return nullptr;
}

std::string source_name(std::size_t number) {
    return fmt::format("Source_{}", number);
}

std::string read_point_name(std::size_t number) {
    return fmt::format("Ant{}", number);
}

event::Technology technology_of(std::int64_t tag_type) {
    using event::Technology;
    constexpr std::array table = {Technology::iso18000_6b, Technology::epc_gen1, Technology::iso18000_6a,
                                  Technology::epc_gen2,    Technology::unknown,  Technology::epc_1_19};
    return tag_type >= 0 && tag_type < static_cast<std::int64_t>(table.size())
               ? table[static_cast<std::size_t>(tag_type)]
               : Technology::unknown;
}

std::int64_t tag_type_of(event::Technology technology) {
    for (std::int64_t type = 0; type <= 5; ++type)
        if (technology != event::Technology::unknown && technology_of(type) == technology) return type;
    return -1;
}

std::span<const ParameterBinding> parameters() {
    return bindings;
}

const ParameterBinding* find_parameter(std::string_view name) {
    return find_by_name(bindings, name);
}

}  // namespace gantry::caen
