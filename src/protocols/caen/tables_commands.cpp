#include <algorithm>
#include <array>

#include "base/text.hpp"
#include "protocols/caen/model_sets.hpp"

namespace gantry::caen {

namespace {

using enum Attribute;

constexpr Param maybe(Attribute attribute, std::string_view name = {}) {
    return {.attribute = attribute, .optional = true, .name = name};
}
constexpr Param many(Attribute attribute, bool optional = true) {
    return {.attribute = attribute, .optional = optional, .repeated = true};
}
constexpr Param called(Attribute attribute, std::string_view name) {
    return {.attribute = attribute, .name = name};
}

// Parameters, in the order of the wire (section 6).
constexpr std::array source = {Param{source_name}};
constexpr std::array raw_read_out = {Param{source_name}, Param{read_point_name}, Param{time_stamp},
                                     Param{tag_id_len}, many(tag_id)};
constexpr std::array inventory_in = {maybe(source_name),
                                     maybe(memory_bank),
                                     maybe(length, "mask bits"),
                                     maybe(tag_id, "mask"),
                                     maybe(tag_address, "first bit of the mask"),
                                     maybe(bitmask, "flags")};
// What a compact answer leaves out, and what only a flag brings, is optional (section 7).
constexpr std::array inventory_out = {
    maybe(source_name),         maybe(read_point_name),  maybe(time_stamp), maybe(tag_type),
    maybe(tag_id_len),          Param{tag_id},           maybe(rssi),       maybe(phase),
    maybe(length, "TID bytes"), maybe(tag_value, "TID"), maybe(xpc),        maybe(pc)};
constexpr std::array source_trigger = {Param{source_name}, Param{trigger_name}};
constexpr std::array channel_trigger = {Param{channel_name}, Param{trigger_name}};
constexpr std::array allocate_trigger_in = {Param{trigger_name}, Param{trigger_type}};
constexpr std::array trigger = {Param{trigger_name}};
constexpr std::array allocate_channel_in = {Param{channel_name}, Param{channel_address}};
constexpr std::array channel = {Param{channel_name}};
constexpr std::array source_channel = {Param{source_name}, Param{channel_name}};
constexpr std::array source_read_point = {Param{source_name}, Param{read_point_name}};
constexpr std::array read_point_source = {Param{read_point_name}, Param{source_name}};
constexpr std::array power_in = {Param{power_set}};
constexpr std::array power_out = {Param{power_get}};
constexpr std::array tag_read_in = {Param{source_name}, Param{tag_id_len}, Param{tag_id}, Param{tag_address},
                                    Param{length}};
constexpr std::array value_out = {Param{tag_value}};
constexpr std::array tag_write_in = {Param{source_name}, Param{tag_id_len}, Param{tag_id},
                                     Param{tag_address}, Param{length},     Param{tag_value}};
constexpr std::array tag_lock_in = {Param{source_name}, Param{tag_id_len}, Param{tag_id}, Param{tag_address}};
constexpr std::array bit_rate_row = {Param{bit_rate}};
constexpr std::array protocol_row = {Param{protocol}};
constexpr std::array read_point = {Param{read_point_name}};
constexpr std::array status_out = {Param{read_point_status}};
constexpr std::array boolean_row = {Param{boolean}};
constexpr std::array network_in = {Param{ip_address}, Param{ip_net_mask}, Param{ip_gateway}};
constexpr std::array desb_in = {Param{desb_enable}};
constexpr std::array firmware_out = {Param{fw_release}};
constexpr std::array desb_out = {Param{desb_status}};
constexpr std::array program_in = {Param{source_name}, Param{tag_id_len}, Param{tag_id}, Param{epc_password},
                                   called(boolean, "Lock")};
constexpr std::array kill_in = {Param{source_name}, Param{tag_id_len}, Param{tag_id}, Param{epc_password}};
constexpr std::array rf_in = {Param{rf_on_off}};
constexpr std::array rs232_in = {Param{baud_rate}, Param{data_bits}, Param{stop_bits}, Param{parity},
                                 Param{flow_ctrl}};
constexpr std::array date_in = {Param{date_time}};
constexpr std::array select_in = {maybe(source_name), called(sel_unsel_op, "Operation"),
                                  called(bitmask, "Bytemask"), Param{tag_address}, Param{tag_value}};
constexpr std::array ids_out = {many(tag_id)};
constexpr std::array io_row = {Param{io_register}};
constexpr std::array set_config_in = {Param{source_name}, Param{config_parameter}, Param{config_value}};
constexpr std::array get_config_in = {Param{source_name}, Param{config_parameter}};
constexpr std::array config_out = {Param{config_value}};
constexpr std::array triggers_out = {Param{no_of_triggers}, many(trigger_name)};
constexpr std::array channels_out = {Param{no_of_channels}, many(channel_name)};
constexpr std::array event_mode_row = {Param{event_mode}};
constexpr std::array upgrade_in = {Param{upgrade_type}, Param{upgrade_argument}};
constexpr std::array e119_in = {Param{source_name}, called(tag_id, "old EPC"), called(tag_value, "new EPC")};
constexpr std::array g2_program_in = {Param{source_name}, Param{tag_id_len}, called(tag_id, "new EPC"),
                                      Param{g2_nsi}, maybe(g2_password)};
// The bank and address before the tag's id make the id a mask (section 6.2).
constexpr std::array g2_read_in = {maybe(source_name),
                                   maybe(memory_bank, "BankMask"),
                                   maybe(tag_address, "PositionMask"),
                                   Param{tag_id_len},
                                   Param{tag_id},
                                   Param{memory_bank},
                                   Param{tag_address},
                                   Param{length},
                                   maybe(g2_password)};
constexpr std::array g2_write_in = {maybe(source_name),
                                    maybe(memory_bank, "BankMask"),
                                    maybe(tag_address, "PositionMask"),
                                    Param{tag_id_len},
                                    Param{tag_id},
                                    Param{memory_bank},
                                    Param{tag_address},
                                    Param{length},
                                    Param{tag_value},
                                    maybe(g2_password)};
constexpr std::array g2_lock_in = {maybe(source_name),
                                   maybe(memory_bank, "BankMask"),
                                   maybe(tag_address, "PositionMask"),
                                   Param{tag_id_len},
                                   Param{tag_id},
                                   Param{payload},
                                   maybe(g2_password)};
constexpr std::array g2_kill_in = {maybe(source_name),
                                   maybe(memory_bank, "BankMask"),
                                   maybe(tag_address, "PositionMask"),
                                   Param{tag_id_len},
                                   Param{tag_id},
                                   called(g2_password, "kill password")};
constexpr std::array q_row = {Param{q_parameter}};
constexpr std::array id_out = {Param{tag_id}};
constexpr std::array info_out = {Param{reader_info}};
constexpr std::array regulation_row = {Param{rf_regulation}};
constexpr std::array rf_channel_row = {Param{rf_channel}};
constexpr std::array custom_in = {maybe(source_name),
                                  maybe(tag_id_len),
                                  maybe(tag_id),
                                  Param{sub_cmd},
                                  maybe(length, "bytes to send"),
                                  maybe(tag_value, "to send"),
                                  called(length, "bytes to receive"),
                                  maybe(g2_password)};
constexpr std::array match_in = {Param{read_point_name}, Param{config_parameter}, Param{config_value}};
constexpr std::array match_out = {Param{power_vswr}};
constexpr std::array report_out = {Param{time_stamp}, Param{tag_id_len}, Param{tag_id}, Param{source_name},
                                   Param{event_type}};

using Params = std::span<const Param>;

constexpr CommandRow row(Command code, std::string_view name, std::string_view later, Params in, Params out,
                         ModelSet models, std::string_view from = "rev 4") {
    return {.code = static_cast<std::uint16_t>(code),
            .name = name,
            .later_name = later,
            .in = in,
            .out = out,
            .models = models | set_of(every_command),
            .source = from};
}
constexpr CommandRow row(Command code, std::string_view name, Params in, Params out, ModelSet models,
                         std::string_view from = "rev 4") {
    return row(code, name, {}, in, out, models, from);
}
constexpr CommandRow repeats(CommandRow row) {
    row.out_repeats = true;
    return row;
}
constexpr CommandRow obsolete(CommandRow row) {
    row.obsolete = true;
    return row;
}
constexpr CommandRow reserved(std::uint16_t code, std::string_view name) {
    return {.code = code, .name = name, .parameters_known = false, .reserved = true, .source = "rev 4"};
}
// Known by its code and name alone.
constexpr CommandRow name_only(std::uint16_t code, std::string_view name, ModelSet models,
                               std::string_view from) {
    return {.code = code,
            .name = name,
            .parameters_known = false,
            .models = models | set_of(every_command),
            .source = from};
}
constexpr CommandRow notification(CommandRow row) {
    row.notification = true;
    row.models = sets::net | set_of(every_command);
    return row;
}

constexpr Params none{};
constexpr std::string_view library = "light library";
using namespace sets;
constexpr ModelSet all_r = all | rev5 | r;
constexpr ModelSet net_r = net | rev5 | r;
constexpr ModelSet lbt_r = lbt | set_of(a941) | r;

constexpr std::array rows = {
    obsolete(
        repeats(row(Command::raw_read_ids, "RawReadIDs", source, raw_read_out, all | rev5 | set_of(a941m)))),
    repeats(row(Command::inventory_tag, "InventoryTag", "NewRawReadIDs", inventory_in, inventory_out,
                set_of(a928eu, a948eu, a828eu, a828a, a829eu, a949eu, a528) | r, "rev 12")),
    obsolete(row(Command::add_read_trigger, "AddReadTrigger", source_trigger, none, net)),
    obsolete(row(Command::add_notify_trigger, "AddNotifyTrigger", channel_trigger, none, net)),
    obsolete(row(Command::remove_read_trigger, "RemoveReadTrigger", source_trigger, none, net)),
    obsolete(row(Command::remove_notify_trigger, "RemoveNotifyTrigger", channel_trigger, none, net)),
    obsolete(row(Command::allocate_trigger, "AllocateTrigger", allocate_trigger_in, none, net)),
    obsolete(row(Command::deallocate_trigger, "DeallocateTrigger", trigger, none, net)),
    obsolete(row(Command::allocate_channel, "AllocateChannel", allocate_channel_in, none, net)),
    obsolete(row(Command::deallocate_channel, "DeallocateChannel", channel, none, net)),
    obsolete(row(Command::add_source_to_channel, "AddSourceToChannel", source_channel, none, net)),
    obsolete(row(Command::remove_source_from_channel, "RemoveSourceFromChannel", source_channel, none, net)),
    row(Command::add_read_point_to_source, "AddReadPointToSource", source_read_point, none,
        net | r_oem | later),
    row(Command::remove_read_point_from_source, "RemoveReadPointFromSource", source_read_point, none,
        net | r_oem | later),
    row(Command::set_power, "SetPower", power_in, none, pwr | rev5 | r),
    obsolete(row(Command::read_tag_data, "ReadTagData", tag_read_in, value_out, all | rev5)),
    obsolete(row(Command::write_tag_data, "WriteTagData", tag_write_in, none, all | rev5)),
    obsolete(row(Command::lock_tag, "LockTag", tag_lock_in, none, all | rev5)),
    reserved(0x71, "Reserved0x71"),
    obsolete(row(Command::set_bit_rate, "SetBitRate", "SetRFLinkProfile", bit_rate_row, none,
                 all | rev5 | r_oem | later | set_of(a941m, r1250i))),
    row(Command::get_power, "GetPower", none, power_out, pwr | rev5 | r),
    row(Command::set_protocol, "SetProtocol", protocol_row, none, all_r),
    reserved(0x75, "Reserved0x75"),
    row(Command::check_read_point_status, "CheckReadPointStatus", read_point, status_out,
        pwr | rev5 | r_oem | later | set_of(a941m, r1250i)),
    obsolete(row(Command::check_source_in_channel, "CheckSourceInChannel", source_channel, boolean_row, net)),
    row(Command::check_read_point_in_source, "CheckReadPointInSource", read_point_source, boolean_row,
        pwr | rev5 | r),
    row(Command::get_protocol, "GetProtocol", none, protocol_row, all_r),
    obsolete(row(Command::set_network, "SetNetwork", network_in, none, net)),
    obsolete(row(Command::set_desb, "SetDESB", desb_in, none, all | rev5)),
    row(Command::get_firmware_release, "GetFirmwareRelease", none, firmware_out, all_r),
    obsolete(row(Command::get_desb, "GetDESB", none, desb_out, all | rev5)),
    obsolete(row(Command::program_id, "ProgramID", program_in, none, net)),
    obsolete(row(Command::kill_tag, "KillTag", kill_in, none, net)),
    row(Command::rf_on_off, "RFOnOff", rf_in, none, all_r & ~set_of(a941m, r1260e)),
    row(Command::get_bit_rate, "GetBitRate", none, bit_rate_row, all | rev5 | r_oem | later | set_of(a941m)),
    obsolete(row(Command::block_write_tag, "BlockWriteTag", tag_write_in, none, all | rev5)),
    row(Command::set_rs232, "SetRS232", rs232_in, none, all_r & ~r_oem),
    row(Command::set_date_time, "SetDateTime", date_in, none, all | rev5 | set_of(a941m)),
    obsolete(row(Command::group_select_unselect, "GroupSelectUnselect", select_in, ids_out, all | rev5)),
    row(Command::get_io, "GetIO", none, io_row, all_r),
    row(Command::set_io, "SetIO", io_row, none, all_r),
    row(Command::set_io_direction, "SetIODirection", io_row, none, dir | rev5 | r),
    row(Command::get_io_direction, "GetIODirection", none, io_row, dir | rev5 | r),
    row(Command::set_source_config, "SetSourceConfig", set_config_in, none, net_r),
    row(Command::get_source_config, "GetSourceConfig", get_config_in, config_out, net_r),
    obsolete(row(Command::get_triggers, "GetTriggers", none, triggers_out, net)),
    obsolete(row(Command::get_channels, "GetChannels", none, channels_out, net)),
    obsolete(row(Command::check_source_in_trigger, "CheckSourceInTrigger", source_trigger, boolean_row, net)),
    obsolete(
        row(Command::check_trigger_in_channel, "CheckTriggerInChannel", channel_trigger, boolean_row, net)),
    obsolete(
        row(Command::check_channel_in_trigger, "CheckChannelInTrigger", channel_trigger, boolean_row, net)),
    obsolete(row(Command::set_event_mode, "SetEventMode", event_mode_row, none, net)),
    obsolete(row(Command::get_event_mode, "GetEventMode", none, event_mode_row, net)),
    obsolete(row(Command::firmware_upgrade, "FirmwareUpgrade", upgrade_in, none, net)),
    obsolete(row(Command::e119_program_id, "E119ProgramID", e119_in, none, all | rev5)),
    row(Command::g2_program_id, "G2ProgramID", "ProgramID_EPC_C1G2", g2_program_in, none,
        all | rev5 | later | set_of(a941m, r1230cb, r1170i, r1270, r1250i)),
    row(Command::g2_read, "G2Read", "ReadTagData_EPC_C1G2", g2_read_in, value_out, all_r),
    row(Command::g2_write, "G2Write", "WriteTagData_EPC_C1G2", g2_write_in, none, all_r),
    row(Command::g2_lock, "G2Lock", "LockTag_EPC_C1G2", g2_lock_in, none, all_r),
    row(Command::g2_kill, "G2Kill", "KillTag_EPC_C1G2", g2_kill_in, none, all_r),
    row(Command::g2_query, "G2Query", "Query_EPC_C1G2", source, none, all_r),
    row(Command::g2_set_q, "G2SetQ", "SetQ_EPC_C1G2", q_row, none, all_r),
    row(Command::g2_get_q, "G2GetQ", "GetQ_EPC_C1G2", none, q_row, all_r),
    obsolete(row(Command::g2_query_ack, "G2QueryAck", "QueryAck_EPC_C1G2", source, id_out, all | rev5)),
    // Revision 4 leaves the models of the next two blank: revision 5's are taken.
    row(Command::get_reader_info, "GetReaderInfo", none, info_out, (all | rev5 | r) & ~set_of(r1260e),
        "rev 4; models of rev 5"),
    row(Command::set_lbt_mode, "SetLBTMode", "SetFHMode", boolean_row, none, lbt_r, "rev 4; models of rev 5"),
    row(Command::get_lbt_mode, "GetLBTMode", "GetFHMode", none, boolean_row, lbt_r),
    row(Command::set_rf_regulation, "SetRFRegulation", regulation_row, none, lbt | set_of(a941) | later,
        "rev 4; gone in rev 19, alive in the light library"),
    row(Command::get_rf_regulation, "GetRFRegulation", none, regulation_row, lbt_r),
    row(Command::set_rf_channel, "SetRFChannel", rf_channel_row, none, lbt_r & ~r_oem),
    row(Command::get_rf_channel, "GetRFChannel", none, rf_channel_row, lbt_r & ~r_oem),
    // Section 6.1.
    name_only(0xA5, "G2ResetSession", later, library),
    name_only(0xA6, "G1ScrollAllID", later, library),
    obsolete(name_only(0xA7, "GetChannelData", 0, library)),
    row(Command::g2_custom, "G2CustomCommand", custom_in, value_out, later, library),
    name_only(0xA9, "GetChannelStatus", later, library),
    name_only(0xAA, "GetRFChannelStatus", later, library),
    name_only(0xAB, "SetExtendedLBT", later, library),
    name_only(0xAC, "SetAdminPassword", later, library),
    name_only(0xAD, "Login", later, library),
    name_only(0xAE, "Logout", later, library),
    obsolete(name_only(0xB0, "GetBufferedData", 0, library)),
    name_only(0xB1, "G2BlockPermalock", r_oem | later, "rev 19, light library"),
    name_only(0xB2, "G2ReadBlockPermalock", r_oem | later, "rev 19, light library"),
    name_only(0xB3, "SaveSettings", later, library),
    row(Command::match_rf_impedance, "MatchRFImpedance", match_in, match_out, later, library),
    name_only(0xB6, "GetBatteryLevel", later, library),
    name_only(0xB7, "GetBufferSize", later, library),
    name_only(0xB8, "ClearBuffer", later, library),
    name_only(0xB9, "G2Untraceable", later, library),
    name_only(0xBA, "G2Authenticate", later, library),
    name_only(0xBB, "SetDAC", later, library),
    name_only(0xBC, "GetADC", later, library),
    name_only(0xBD, "SetReadPointPower", later, library),
    name_only(0xBE, "GetReadPointPower", later, library),
    name_only(0xBF, "G2BlockWrite", later, library),
    name_only(0xC0, "G2BlockProgramID", later, library),
    name_only(0xF0, "DumpRegisters", 0, "a library of 2011"),
    // Section 9: the codes are not published. 0xFFFF is reserved by the manual.
    notification(repeats(
        row(Command::report_buffer, "ReportBuffer", none, report_out, net, "rev 4, section 3; code chosen"))),
    notification(row(Command::kill_message, "KillMessage", none, none, net,
                     "rev 4, section 3; code chosen: reserved by the manual")),
};

constexpr auto index = [] {
    std::array<const CommandRow*, 256> table{};
    for (auto& row : rows)
        if (row.code < table.size()) table[row.code] = &row;
    return table;
}();
constexpr const CommandRow* high_row(std::uint16_t code) {
    for (auto& row : rows)
        if (row.code == code) return &row;
    return nullptr;
}
constexpr const CommandRow* report_row = high_row(0xFFFE);
constexpr const CommandRow* kill_row = high_row(0xFFFF);

}  // namespace

std::span<const CommandRow> commands() {
    return rows;
}

const CommandRow* find_command(std::uint16_t code) {
    if (code < index.size()) [[likely]]
        return index[code];
    if (code == report_row->code) return report_row;
    return code == kill_row->code ? kill_row : nullptr;
}

const CommandRow* find_command(std::string_view name) {
    if (name.empty()) return nullptr;  // most rows have no later name
    for (auto& row : rows)
        if (row.name == name || row.later_name == name) return &row;
    for (auto& row : rows)
        if (alike(row.name, name) || alike(row.later_name, name)) return &row;
    return nullptr;
}

}  // namespace gantry::caen
