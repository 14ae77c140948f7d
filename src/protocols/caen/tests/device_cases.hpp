#pragma once
#include "device_support.hpp"

// Every command of the table with what it takes well, and with what it must refuse: for the virtual reader
// alone, and for the driver that speaks with it.
namespace gantry::caen::device_test {

using enum Attribute;
using event::Technology;

inline constexpr std::string_view gen2 = "300833B2DDD9014035050000", gen1 = "0102030405060708",
                                  iso_b = "E0040F0E06010000", epc119 = "A1A2A3A4A5A6A7A8",
                                  nobody = "DEADBEEF";

struct Ask {
    Pairs pairs;
    ResultCode result = ResultCode::success;
    std::vector<Attribute> answers = {};  // attributes that must come
};
struct Case {
    Command command;
    Ask well, ill;
    std::vector<std::pair<Command, Pairs>> before = {};
};

inline Bytes trigger(std::string_view name = "every") {
    return text(trigger_name, name);
}
inline Bytes channel(std::string_view name = "events") {
    return text(channel_name, name);
}
inline const std::pair<Command, Pairs> a_trigger{Command::allocate_trigger,
                                                 {trigger(), text(trigger_type, "1000")}};
inline const std::pair<Command, Pairs> a_channel{Command::allocate_channel,
                                                 {channel(), text(channel_address, "10.0.0.1:3000")}};

inline Pairs memory_of(std::string_view id, Bank bank, std::uint32_t address, std::uint32_t size) {
    return Pairs{source()} + tag_pairs(id) +
           Pairs{number(memory_bank, static_cast<std::uint64_t>(bank)), number(tag_address, address),
                 number(length, size)};
}
inline Pairs bytes_of(std::string_view id, std::uint32_t address, std::uint32_t size) {
    return Pairs{source()} + tag_pairs(id) + Pairs{number(tag_address, address), number(length, size)};
}

inline std::vector<Case> settings_cases() {
    using R = ResultCode;
    return {
        {Command::set_power,
         {{number(power_set, 1000)}},
         {{number(power_set, 3'000'000)}, R::power_out_of_range}},
        {Command::get_power, {{}, R::success, {power_get}}, {{source()}, R::invalid_parameter}},
        {Command::set_protocol, {{number(protocol, 3)}}, {{number(protocol, 9)}, R::invalid_protocol}},
        {Command::get_protocol, {{}, R::success, {protocol}}, {{source()}, R::invalid_parameter}},
        {Command::set_bit_rate, {{number(bit_rate, 25)}}, {{number(bit_rate, 26)}, R::bad_parameter_value}},
        {Command::get_bit_rate, {{}, R::success, {bit_rate}}, {{source()}, R::invalid_parameter}},
        {Command::set_lbt_mode, {{number(boolean, 1)}}, {{}, R::invalid_parameter}},
        {Command::get_lbt_mode, {{}, R::success, {boolean}}, {{number(boolean, 1)}, R::invalid_parameter}},
        {Command::set_rf_channel,
         {{number(rf_channel, 9)}},
         {{number(rf_channel, 10)}, R::bad_parameter_value}},
        {Command::get_rf_channel, {{}, R::success, {rf_channel}}, {{source()}, R::invalid_parameter}},
        {Command::set_rf_regulation,
         {{number(rf_regulation, 15)}},
         {{number(rf_regulation, 16)}, R::bad_parameter_value}},
        {Command::get_rf_regulation, {{}, R::success, {rf_regulation}}, {{source()}, R::invalid_parameter}},
        {Command::set_event_mode,
         {{number(event_mode, 2)}},
         {{number(event_mode, 3)}, R::bad_parameter_value}},
        {Command::get_event_mode, {{}, R::success, {event_mode}}, {{source()}, R::invalid_parameter}},
        {Command::rf_on_off, {{number(rf_on_off, 1)}}, {{}, R::invalid_parameter}},
        {Command::g2_set_q, {{number(q_parameter, 15)}}, {{number(q_parameter, 16)}, R::bad_parameter_value}},
        {Command::g2_get_q, {{}, R::success, {q_parameter}}, {{source()}, R::invalid_parameter}},
        {Command::set_desb, {{number(desb_enable, 1)}}, {{}, R::invalid_parameter}},
        {Command::get_desb, {{}, R::success, {desb_status}}, {{source()}, R::invalid_parameter}},
        {Command::add_read_point_to_source,
         {{source(), point(1)}},
         {{source(), text(read_point_name, "Ant9")}, R::bad_read_point}},
        {Command::remove_read_point_from_source,
         {{source(), point(0)}},
         {{source(), point(1)}, R::bad_read_point}},
        {Command::check_read_point_in_source,
         {{point(0), source()}, R::success, {boolean}},
         {{point(0), text(source_name, "Source_9")}, R::source_not_found}},
        {Command::check_read_point_status,
         {{point(0)}, R::success, {read_point_status}},
         {{text(read_point_name, "Ant4")}, R::bad_read_point}},
        {Command::set_source_config,
         {{source(), number(config_parameter, 4), number(config_value, 3)}},
         {{source(), number(config_parameter, 4), number(config_value, 4)}, R::bad_parameter_value}},
        {Command::get_source_config,
         {{source(), number(config_parameter, 0)}, R::success, {config_value}},
         {{source(), number(config_parameter, 16)}, R::bad_parameter_value}},
        {Command::set_network,
         {{text(ip_address, "10.0.0.2"), text(ip_net_mask, "255.0.0.0"), text(ip_gateway, "10.0.0.1")}},
         {{text(ip_address, "10.0.0.256"), text(ip_net_mask, "255.0.0.0"), text(ip_gateway, "10.0.0.1")},
          R::bad_address}},
        {Command::set_rs232,
         {{number(baud_rate, 19200), number(data_bits, 8), number(stop_bits, 1), number(parity, 2),
           number(flow_ctrl, 1)}},
         {{number(baud_rate, 19201), number(data_bits, 8), number(stop_bits, 1), number(parity, 2),
           number(flow_ctrl, 1)},
          R::bad_parameter_value}},
        {Command::set_date_time,
         {{text(date_time, "2026-11-22 21:00:00")}},
         {{text(date_time, "2026-13-22 21:00:00")}, R::invalid_time}},
        {Command::get_io, {{}, R::success, {io_register}}, {{source()}, R::invalid_parameter}},
        {Command::set_io, {{number(io_register, 0x10)}}, {{}, R::invalid_parameter}},
        {Command::get_io_direction, {{}, R::success, {io_register}}, {{source()}, R::invalid_parameter}},
        {Command::set_io_direction, {{number(io_register, 0xF0)}}, {{}, R::invalid_parameter}},
        {Command::get_firmware_release, {{}, R::success, {fw_release}}, {{source()}, R::invalid_parameter}},
        {Command::get_reader_info, {{}, R::success, {reader_info}}, {{source()}, R::invalid_parameter}},
        {Command::firmware_upgrade,
         {{number(upgrade_type, 1), text(upgrade_argument, "10.0.0.9:image.bin")}},
         {{number(upgrade_type, 2), text(upgrade_argument, "10.0.0.9:image.bin")}, R::bad_parameter_value}},
        {Command::match_rf_impedance,
         {{point(0), number(config_parameter, 14), number(config_value, 0)}, R::success, {power_vswr}},
         {{point(0), number(config_parameter, 13), number(config_value, 0)}, R::bad_parameter_value}},
    };
}

inline std::vector<Case> tag_cases() {
    using R = ResultCode;
    return {
        {Command::raw_read_ids,
         {{source()}, R::success, {source_name, read_point_name, time_stamp, tag_id_len, tag_id}},
         {{text(source_name, "Source_9")}, R::source_not_found}},
        {Command::inventory_tag,
         {{source()}, R::success, {source_name, read_point_name, time_stamp, tag_type, tag_id_len, tag_id}},
         {{source(), number(bitmask, flag_framed)}, R::invalid_parameter}},
        {Command::g2_read,
         {memory_of(gen2, Bank::user, 2, 4), R::success, {tag_value}},
         {memory_of(nobody, Bank::user, 2, 4), R::tag_not_present}},
        {Command::g2_write,
         {memory_of(gen2, Bank::user, 2, 2) + Pairs{bytes(tag_value, "CAFE")}},
         {memory_of(gen2, Bank::user, 2, 4) + Pairs{bytes(tag_value, "CAFE")}, R::invalid_parameter}},
        {Command::g2_lock,
         {Pairs{source()} + tag_pairs(gen2) + Pairs{number(payload, 0x0C02)}},
         {Pairs{source()} + tag_pairs(gen2) + Pairs{number(payload, 0x100000)}, R::bad_parameter_value}},
        {Command::g2_kill,
         {Pairs{source()} + tag_pairs(gen2) + Pairs{number(g2_password, 0)}},
         {Pairs{source()} + tag_pairs(gen2) + Pairs{number(g2_password, 5)}, R::kill_error}},
        {Command::g2_program_id,
         {Pairs{source()} + tag_pairs("E00000000000000000000001") + Pairs{number(g2_nsi, 0)}},
         {Pairs{source()} + tag_pairs("E0000000000001") + Pairs{number(g2_nsi, 0)}, R::invalid_parameter}},
        {Command::g2_query, {{source()}}, {{source(3)}, R::tag_not_present}},
        {Command::g2_query_ack, {{source()}, R::success, {tag_id}}, {{source(3)}, R::tag_not_present}},
        // No tag of ours knows a maker's own command.
        {Command::g2_custom,
         {{number(sub_cmd, 1), number(length, 2)}, R::unsupported},
         {Pairs{source()} + tag_pairs(nobody) + Pairs{number(sub_cmd, 1), number(length, 2)},
          R::tag_not_present}},
        {Command::read_tag_data,
         {bytes_of(iso_b, 8, 5), R::success, {tag_value}},
         {bytes_of(iso_b, 60, 5), R::bad_tag_address}},
        {Command::write_tag_data,
         {bytes_of(iso_b, 20, 3) + Pairs{bytes(tag_value, "010203")}},
         {bytes_of(iso_b, 20, 2) + Pairs{bytes(tag_value, "010203")}, R::invalid_parameter}},
        {Command::block_write_tag,
         {bytes_of(iso_b, 20, 4) + Pairs{bytes(tag_value, "01020304")}},
         {bytes_of(nobody, 20, 4) + Pairs{bytes(tag_value, "01020304")}, R::tag_not_present}},
        {Command::lock_tag,
         {Pairs{source()} + tag_pairs(iso_b) + Pairs{number(tag_address, 20)}},
         {Pairs{source()} + tag_pairs(nobody) + Pairs{number(tag_address, 20)}, R::tag_not_present}},
        {Command::group_select_unselect,
         {{source(), number(sel_unsel_op, 0), number(bitmask, 0x80), number(tag_address, 0),
           bytes(tag_value, "E0")},
          R::success,
          {tag_id}},
         {{source(), number(sel_unsel_op, 8), number(bitmask, 0x80), number(tag_address, 0),
           bytes(tag_value, "E0")},
          R::bad_parameter_value}},
        {Command::program_id,
         {Pairs{source()} + tag_pairs("1112131415161718") +
          Pairs{number(epc_password, 7), number(boolean, 0)}},
         {Pairs{source(3)} + tag_pairs("1112131415161718") +
              Pairs{number(epc_password, 7), number(boolean, 0)},
          R::tag_not_present}},
        {Command::kill_tag,
         {Pairs{source()} + tag_pairs(gen1) + Pairs{number(epc_password, 0)}},
         {Pairs{source()} + tag_pairs(gen1) + Pairs{number(epc_password, 9)}, R::kill_error}},
        {Command::e119_program_id,
         {{source(), bytes(tag_id, epc119), bytes(tag_value, "B1B2B3B4B5B6B7B8")}},
         {{source(), bytes(tag_id, nobody), bytes(tag_value, "B1B2B3B4B5B6B7B8")}, R::tag_not_present}},
    };
}

inline std::vector<Case> notify_cases() {
    using R = ResultCode;
    const Pairs source_trigger{source(), trigger()}, channel_trigger{channel(), trigger()},
        source_channel{source(), channel()};
    return {
        {Command::allocate_trigger,
         {{trigger(), text(trigger_type, "1000")}},
         {{trigger(), text(trigger_type, "soon")}, R::bad_trigger}},
        {Command::deallocate_trigger, {{trigger()}}, {{trigger("other")}, R::trigger_not_found}, {a_trigger}},
        {Command::allocate_channel,
         {{channel(), text(channel_address, "10.0.0.1:3000")}},
         {{channel(), text(channel_address, "here:3000")}, R::bad_address}},
        {Command::deallocate_channel, {{channel()}}, {{channel("other")}, R::channel_not_found}, {a_channel}},
        {Command::add_read_trigger,
         {source_trigger},
         {{source(), trigger("other")}, R::trigger_not_found},
         {a_trigger}},
        {Command::remove_read_trigger,
         {source_trigger},
         {{source(1), trigger()}, R::trigger_not_found},
         {a_trigger, {Command::add_read_trigger, source_trigger}}},
        {Command::add_notify_trigger,
         {channel_trigger},
         {{channel("other"), trigger()}, R::channel_not_found},
         {a_trigger, a_channel}},
        {Command::remove_notify_trigger,
         {channel_trigger},
         {{channel(), trigger("other")}, R::trigger_not_found},
         {a_trigger, a_channel, {Command::add_notify_trigger, channel_trigger}}},
        {Command::add_source_to_channel,
         {source_channel},
         {{text(source_name, ""), channel()}, R::invalid_source_name},
         {a_channel}},
        {Command::remove_source_from_channel,
         {source_channel},
         {{source(1), channel()}, R::source_not_in_channel},
         {a_channel, {Command::add_source_to_channel, source_channel}}},
        {Command::check_source_in_channel,
         {source_channel, R::success, {boolean}},
         {{source(), channel("other")}, R::channel_not_found},
         {a_channel}},
        {Command::check_source_in_trigger,
         {source_trigger, R::success, {boolean}},
         {{source(), trigger("other")}, R::trigger_not_found},
         {a_trigger}},
        {Command::check_trigger_in_channel,
         {channel_trigger, R::success, {boolean}},
         {{channel(""), trigger()}, R::invalid_channel_name},
         {a_trigger, a_channel}},
        {Command::check_channel_in_trigger,
         {channel_trigger, R::success, {boolean}},
         {{channel(), trigger("")}, R::invalid_trigger_name},
         {a_trigger, a_channel}},
        {Command::get_triggers,
         {{}, R::success, {no_of_triggers, trigger_name}},
         {{trigger()}, R::invalid_parameter},
         {a_trigger}},
        {Command::get_channels,
         {{}, R::success, {no_of_channels, channel_name}},
         {{channel()}, R::invalid_parameter},
         {a_channel}},
    };
}

inline const Case* find_case(std::uint16_t code) {
    static const std::vector<Case> cases = [] {
        auto all = settings_cases();
        for (auto& more : {tag_cases(), notify_cases()})
            all.insert(all.end(), more.begin(), more.end());
        return all;
    }();
    auto found = std::ranges::find(cases, static_cast<Command>(code), &Case::command);
    return found == cases.end() ? nullptr : &*found;
}

inline void fill(Shelf& shelf) {
    shelf.add(gen1, Technology::epc_gen1);
    shelf.add(iso_b, Technology::iso18000_6b);
    shelf.add(epc119, Technology::epc_1_19);
}

}  // namespace gantry::caen::device_test
