// What a hand does to a virtual reader from outside, and what a person sees on it.
#include <array>
#include <charconv>

#include <fmt/format.h>

#include "base/text.hpp"
#include "protocols/caen/device.hpp"

namespace gantry::caen {

static std::optional<std::uint32_t> number(std::string_view text) {
    std::uint32_t value = 0;
    auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc{} || end != text.data() + text.size()) return {};
    return value;
}

Result<void> CaenDevice::inject_input(const FaultCall& call) {
    auto value = call.value;
    auto sign = value.find('=');
    auto line = number(value.substr(0, sign));
    auto level = sign == std::string_view::npos ? std::string_view{} : value.substr(sign + 1);
    if (!line || *line < 1 || *line > memory_.lines() || (level != "0" && level != "1"))
        return fail(fmt::format("\"input {}\" names no line and state", printable(value)),
                    fmt::format("lines are 1 to {}: \"input 1=1\"", memory_.lines()));
    auto bit = 1u << (*line - 1);
    if ((memory_.ram.directions & bit) != 0)
        return fail(fmt::format("line {} is an output now", *line), "its level is the reader's own");
    memory_.inputs = level == "1" ? memory_.inputs | bit : memory_.inputs & ~bit;
    return {};
}

Result<void> CaenDevice::inject_antenna(const FaultCall& call) {
    auto value = call.value;
    using Antenna = ReaderMemory::Antenna;
    static constexpr std::array<std::string_view, 3> words = {"good", "poor", "bad"};
    auto sign = value.find('=');
    auto name = value.substr(0, sign);
    auto word = sign == std::string_view::npos ? std::string_view{} : value.substr(sign + 1);
    auto point = memory_.read_point(name);  // "Ant0", or as the air counts: 1
    if (auto antenna = number(name); antenna && *antenna >= 1 && *antenna <= memory_.model.read_points)
        point = *antenna - 1;
    std::optional<Antenna> state;
    for (std::size_t i = 0; i < words.size(); ++i)
        if (word == words[i]) state = static_cast<Antenna>(i);
    if (!point || (!state && word != "auto"))
        return fail(fmt::format("\"antenna {}\" names no antenna and state", printable(value)),
                    fmt::format("antennas are Ant0 to Ant{}: \"antenna Ant0=good\", poor, bad or auto",
                                memory_.model.read_points - 1));
    memory_.force_antenna(*point, state);
    return {};
}

Result<void> CaenDevice::inject_trigger(const FaultCall& call) {
    if (inventory_) inventory_->trigger(call.now);
    return {};
}

Result<void> CaenDevice::inject_result(const FaultCall& call) {
    auto code = number(call.value);
    if (!code || *code > 0xFFFF)
        return fail(fmt::format("\"result {}\" names no result code", printable(call.value)),
                    "write it like \"result 202\"");
    next_result_ = static_cast<std::uint16_t>(*code);
    return {};
}

// While it speaks by itself its faults are those of its channels; drop, half-open and slow are the reader's.
Result<void> CaenDevice::inject_link(const FaultCall& call) {
    bool drops = call.word == faults::drop.word;
    bool all = drops || call.word == faults::half_open.word || call.word == faults::slow.word;
    bool notifies = notifier_.speaks();
    Result<void> done;
    if (all ? !drops || connected_ || !notifies : !notifies) done = faults_.inject(call, out());
    if (done && (all || notifies)) done = notifier_.inject(call);
    return done;
}

Result<void> CaenDevice::inject_reboot(const FaultCall& call) {
    reboot_waits_ = total_.connects == 0;
    if (!reboot_waits_) reboot(call.now);
    return {};
}

Result<void> CaenDevice::inject_clock(const FaultCall& call) {
    auto by = fault_jump(call.value);
    if (!by) return tl::unexpected(by.error());
    memory_.jump(*by);
    return {};
}

Result<void> CaenDevice::inject_broken(const FaultCall& call) {
    auto antenna = fault_antenna(call.value, memory_.model.read_points);
    if (!antenna) return tl::unexpected(antenna.error());
    if (*antenna) {
        memory_.force_antenna(**antenna - 1u, ReaderMemory::Antenna::bad);
        return {};
    }
    for (unsigned point = 0; point < memory_.model.read_points; ++point)
        memory_.force_antenna(point, std::nullopt);
    return {};
}

Result<void> CaenDevice::inject_full(const FaultCall&) {
    notifier_.overflow();
    return {};
}

struct CaenDevice::Rows {
    static constexpr FaultWord input{"input", "N=0|1", "an input changes"};
    static constexpr FaultWord antenna{"antenna", "Ant0=good|poor|bad|auto", "how good an antenna is"};
    static constexpr FaultWord trigger{"trigger", "", "somebody presses the key that starts a reading"};
    static constexpr FaultWord result{"result", "CODE", "the next request is refused with that code"};
    static constexpr FaultWord busy{"busy", "on|off", "every request is refused as busy"};
    static constexpr FaultWord silent{"silent", "on|off", "no request is answered, on whatever link"};
    using Row = FaultRow<CaenDevice>;
    static constexpr std::array all = {
        Row{input, &CaenDevice::inject_input},
        Row{antenna, &CaenDevice::inject_antenna},
        Row{trigger, &CaenDevice::inject_trigger},
        Row{result, &CaenDevice::inject_result},
        Row{busy, &CaenDevice::inject_busy},
        Row{silent, &CaenDevice::inject_silent},
        Row{faults::drop, &CaenDevice::inject_link},
        Row{faults::half_open, &CaenDevice::inject_link},
        Row{faults::garbage, &CaenDevice::inject_link},
        Row{faults::truncated, &CaenDevice::inject_link},
        Row{faults::duplicate, &CaenDevice::inject_link},
        Row{faults::slow, &CaenDevice::inject_link},
        Row{faults::reboot, &CaenDevice::inject_reboot},
        Row{faults::clock_jump, &CaenDevice::inject_clock},
        Row{faults::antenna_broken, &CaenDevice::inject_broken},
        Row{faults::buffer_full, &CaenDevice::inject_full},
    };
    static constexpr auto words = words_of(all);
    static constexpr std::array impossible = {
        NoFault{faults::bad_crc, "its messages have no checksum"},
        NoFault{faults::stuck_ack, "nothing that it sends is acknowledged"}};
};

Result<void> CaenDevice::inject_busy(const FaultCall& call) {
    return fault_switch(busy_, Rows::busy, call.value);
}
Result<void> CaenDevice::inject_silent(const FaultCall& call) {
    return fault_switch(silent_, Rows::silent, call.value);
}

std::span<const FaultWord> CaenDevice::faults() {
    return Rows::words;
}

Result<void> CaenDevice::inject(std::string_view command, Now now) {
    return inject_by(*this, std::span<const FaultRow<CaenDevice>>(Rows::all), faults(), Rows::impossible,
                     command, now);
}

wire::Fields CaenDevice::state() const {
    wire::Fields fields;
    auto add = [&](std::string_view name, wire::Value value) {
        fields.push_back({std::string(name), std::move(value)});
    };
    auto text = [](std::string_view value) { return wire::Value(std::string(value)); };
    auto name_in = [&](const wire::Enumeration& names, std::uint32_t value) {
        const auto* row = names.find(std::int64_t{value});
        return text(row != nullptr ? row->name : std::string_view("?"));
    };
    auto& ram = memory_.ram;
    auto& eeprom = memory_.eeprom;
    add("model", text(memory_.model.name));
    add("serial", text(memory_.serial));
    add("firmware", text(memory_.firmware));
    add("connected", wire::Value(connected_));
    add("inventory", text(!inventory_ ? "off" : streaming() ? "streaming" : "reading"));
    add("power_mw", wire::Value(ram.power));
    add("protocol", name_in(protocols, ram.protocol));
    add("rf_on", wire::Value(ram.rf_on != 0));
    add("inputs", wire::Value(memory_.io_register() & ~ram.directions));
    add("outputs", wire::Value(memory_.io_register() & ram.directions));
    std::string sources;
    for (std::size_t i = 0; i < ram.sources.size(); ++i) {
        sources += fmt::format("{}{}:", i == 0 ? "" : " ", source_name(i));
        for (auto point : memory_.points_of(i))
            sources += fmt::format("{},", read_point_name(point));
        sources.pop_back();
    }
    add("sources", wire::Value(sources));
    add("network", wire::Value(fmt::format("{} {} {}", eeprom.address, eeprom.net_mask, eeprom.gateway)));
    add("serial_line",
        wire::Value(fmt::format("{} {} {} parity {} flow {}", eeprom.baud_rate, eeprom.data_bits,
                                eeprom.stop_bits, eeprom.parity, eeprom.flow_ctrl)));
    add("regulation", name_in(rf_regulations, eeprom.regulation));
    std::string channels;
    std::size_t waiting = 0;
    for (auto& channel : notifier_.channels()) {
        channels += fmt::format("{}{} {} {}", channels.empty() ? "" : ", ", printable(channel->name()),
                                channel->address(), channel->connected() ? "connected" : "not connected");
        waiting += channel->buffered();
    }
    add("channels", wire::Value(channels));
    add("triggers", wire::Value(notifier_.trigger_names().size()));
    add("events_waiting", wire::Value(waiting));
    add("events_dropped", wire::Value(notifier_.dropped()));
    add("requests", wire::Value(total_.requests));
    add("refused", wire::Value(total_.refused));
    add("tags_sent", wire::Value(total_.tags + (inventory_ ? inventory_->tags() : 0)));
    add("tags_lost", wire::Value(total_.lost + (inventory_ ? inventory_->lost() : 0)));
    add("skipped_bytes", wire::Value(framer_.tally().skipped_bytes + total_.ignored_bytes));
    add("restarts", wire::Value(total_.restarts));
    add("connects", wire::Value(total_.connects));
    return fields;
}

}  // namespace gantry::caen
