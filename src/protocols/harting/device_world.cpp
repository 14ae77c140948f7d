// What a hand does to a virtual reader from outside, and what a person sees on it.
#include <array>
#include <charconv>

#include <fmt/format.h>

#include "base/text.hpp"
#include "protocols/harting/device.hpp"

namespace gantry::harting {

static std::optional<std::uint32_t> number(std::string_view text) {
    std::uint32_t value = 0;
    auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc{} || end != text.data() + text.size()) return {};
    return value;
}

static tl::unexpected<Error> refused(const FaultWord& fault, std::string_view value, std::string_view hint) {
    return fail(fmt::format("\"{} {}\" is not understood", fault.word, printable(value)), std::string(hint));
}

// "3=bad": a number from 1 to `count`, as an index, and what stands after the sign.
struct Assignment {
    std::optional<std::size_t> index;
    std::string_view value;
};
static Assignment assignment(std::string_view text, std::size_t count) {
    auto sign = text.find('=');
    auto which = number(text.substr(0, sign));
    if (sign == std::string_view::npos || !which || *which < 1 || *which > count) return {};
    return {*which - 1, text.substr(sign + 1)};
}

// --- the words ---------------------------------------------------------------------------------------------

struct HartingDevice::Rows {
    static constexpr FaultWord input{"input", "N=0|1", "an input changes"};
    static constexpr FaultWord antenna{"antenna", "N=good|bad|auto", "how good an antenna is"};
    static constexpr FaultWord eeprom{"eeprom", "CFGn", "a block of the configuration breaks"};
    static constexpr FaultWord config{"config", "CFGn.NAME=VALUE", "set with the maker's tool; it restarts"};
    static constexpr FaultWord power{"power", "on|off", "somebody switches it off, or on again"};
    static constexpr FaultWord status{"status", "0xNN", "the next request gets that status"};
    static constexpr FaultWord busy{"busy", "on|off", "every request is refused as busy"};
    static constexpr FaultWord silent{"silent", "on|off", "no request is answered, on whatever link"};
    using Row = FaultRow<HartingDevice>;
    static constexpr std::array all = {
        Row{input, &HartingDevice::inject_input},
        Row{antenna, &HartingDevice::inject_antenna},
        Row{eeprom, &HartingDevice::inject_eeprom},
        Row{config, &HartingDevice::inject_config},
        Row{power, &HartingDevice::inject_power},
        Row{status, &HartingDevice::inject_status},
        Row{busy, &HartingDevice::inject_busy},
        Row{silent, &HartingDevice::inject_silent},
        Row{faults::drop, &HartingDevice::inject_link},
        Row{faults::half_open, &HartingDevice::inject_link},
        Row{faults::garbage, &HartingDevice::inject_link},
        Row{faults::bad_crc, &HartingDevice::inject_link},
        Row{faults::truncated, &HartingDevice::inject_link},
        Row{faults::duplicate, &HartingDevice::inject_link},
        Row{faults::slow, &HartingDevice::inject_link},
        Row{faults::stuck_ack, &HartingDevice::inject_stuck_ack},
        Row{faults::reboot, &HartingDevice::inject_reboot},
        Row{faults::clock_jump, &HartingDevice::inject_clock},
        Row{faults::antenna_broken, &HartingDevice::inject_broken},
        Row{faults::buffer_full, &HartingDevice::inject_full},
    };
    static constexpr auto words = words_of(all);
};

// --- the world ---------------------------------------------------------------------------------------------

Result<void> HartingDevice::inject_input(const FaultCall& call) {
    auto value = call.value;
    auto now = call.now;
    auto [input, level] = assignment(value, input_count);
    if (!input || (level != "0" && level != "1"))
        return refused(Rows::input, value, fmt::format("inputs are 1 to {}: \"input 1=1\"", input_count));
    bool high = level == "1";
    if (std::exchange(reader_.levels[*input], high) == high) return {};
    read(now);  // up to this moment
    auto& setup = reader_.setup;
    Trigger::Change change;
    if (*input == 0) change = reader_.trigger.input_changed(setup, reader_.input(0), now.steady);
    store_event(setup.input_events[*input] || (change.begun && setup.trigger_event) ||
                    (change.timed_out && setup.timeout_event),
                now);
    return {};
}

Result<void> HartingDevice::inject_antenna(const FaultCall& call) {
    auto value = call.value;
    auto [antenna, state] = assignment(value, antenna_count);
    if (!antenna || (state != "good" && state != "bad" && state != "auto"))
        return refused(Rows::antenna, value,
                       fmt::format("antennas are 1 to {}: \"antenna 2=bad\", good or auto", antenna_count));
    std::optional<bool> broken;
    if (state != "auto") broken = state == "bad";
    reader_.force_broken(static_cast<std::uint16_t>(*antenna + 1), broken);
    return {};
}

Result<void> HartingDevice::inject_eeprom(const FaultCall& call) {
    auto value = call.value;
    auto block = value.starts_with("CFG") ? number(value.substr(3)) : std::optional<std::uint32_t>{};
    if (!block || *block >= block_count)
        return refused(Rows::eeprom, value, "names the block that breaks: \"eeprom CFG12\"");
    reader_.config.spoil(*block);
    return {};
}

// As the maker's own tool does it, past all protection.
Result<void> HartingDevice::inject_config(const FaultCall& call) {
    auto value = call.value;
    auto now = call.now;
    if (auto done = reader_.config.preset(value); !done) return done;
    reader_.changed();
    reset(now, boot_);
    return {};
}

Result<void> HartingDevice::inject_power(const FaultCall& call) {
    auto value = call.value;
    auto now = call.now;
    if (value != "on" && value != "off") return refused(Rows::power, value, "\"power on\" or \"power off\"");
    bool on = value == "on";
    if (on == powered_) return {};
    powered_ = on;
    reset(now, boot_);
    if (on)
        reader_.power_on(now);
    else
        start_at_.reset();
    hang_up_ = connected_ && !serial_;
    return {};
}

Result<void> HartingDevice::inject_reboot(const FaultCall& call) {
    reboot_waits_ = total_.connects == 0 && notifier_->tally().connects == 0;
    if (powered_ && !reboot_waits_) reset(call.now, boot_);
    return {};
}

Result<void> HartingDevice::inject_clock(const FaultCall& call) {
    auto by = fault_jump(call.value);
    if (!by) return tl::unexpected(by.error());
    reader_.clock.jump(*by);
    return {};
}

Result<void> HartingDevice::inject_broken(const FaultCall& call) {
    auto antenna = fault_antenna(call.value, antenna_count);
    if (!antenna) return tl::unexpected(antenna.error());
    if (*antenna) {
        reader_.force_broken(**antenna, true);
        return {};
    }
    for (std::uint16_t each = 1; each <= antenna_count; ++each)
        reader_.force_broken(each, std::nullopt);
    return {};
}

Result<void> HartingDevice::inject_full(const FaultCall&) {
    reader_.buffer.overflow_and_tell();
    return {};
}

// --- the links ---------------------------------------------------------------------------------------------

// While it speaks by itself its faults are those of that link; drop, half-open and slow are the reader's.
Result<void> HartingDevice::inject_link(const FaultCall& call) {
    bool drops = call.word == faults::drop.word, slow = call.word == faults::slow.word;
    bool both = drops || slow || call.word == faults::half_open.word;
    bool ours = both ? !drops || connected_ || !notifies() : !notifies();
    bool theirs = slow || notifies() || (both && !drops && notifier_->is_wanted());
    Result<void> done;
    if (ours) done = faults_.inject(call, out());
    if (done && theirs) done = notifier_->inject(call);
    pump();
    return done;
}

Result<void> HartingDevice::inject_status(const FaultCall& call) {
    auto value = call.value;
    auto raw = from_hex(value.starts_with("0x") ? value.substr(2) : std::string_view{});
    auto code = raw && raw->size() == 1 ? std::optional<std::uint32_t>{raw->front()} : number(value);
    if (!code || *code > 0xFF) return refused(Rows::status, value, "write it like \"status 0x83\"");
    next_status_ = static_cast<std::uint8_t>(*code);
    return {};
}

Result<void> HartingDevice::inject_stuck_ack(const FaultCall& call) {
    auto done = fault_switch(stuck_ack_, faults::stuck_ack, call.value);
    notifier_->stuck_ack = stuck_ack_;
    return done;
}
Result<void> HartingDevice::inject_busy(const FaultCall& call) {
    return fault_switch(busy_, Rows::busy, call.value);
}
Result<void> HartingDevice::inject_silent(const FaultCall& call) {
    return fault_switch(silent_, Rows::silent, call.value);
}

std::span<const FaultWord> HartingDevice::faults() {
    return Rows::words;
}

Result<void> HartingDevice::inject(std::string_view command, Now now) {
    return inject_by(*this, std::span<const FaultRow<HartingDevice>>(Rows::all), faults(), {}, command, now);
}

wire::Fields HartingDevice::state() const {
    wire::Fields fields;
    auto add = [&](std::string_view name, auto value) {
        fields.push_back({std::string(name), wire::Value(std::move(value))});
    };
    auto& setup = reader_.setup;
    const auto* mode = modes.find(static_cast<std::int64_t>(reader_.mode()));
    add("mode", std::string(!powered_                        ? "off"
                            : reader_.config.eeprom_failed() ? "EE-Init"
                            : mode != nullptr                ? mode->name
                                                             : "?"));
    add("connected", connected_);
    add("logged_in", reader_.logged_in);
    std::string antennas, outputs;
    for (auto antenna : reader_.antennas())
        antennas += fmt::format("{}{}{}", antennas.empty() ? "" : " ", antenna,
                                reader_.is_broken(antenna) ? " broken" : "");
    static constexpr std::array<std::string_view, 4> output_words = {"off", "on", "off", "flash"};
    for (std::size_t i = 0; i < output_count; ++i)
        outputs += fmt::format(
            "{}{}", outputs.empty() ? "" : " ",
            output_words[static_cast<std::size_t>(reader_.outputs.mode(i, setup, last_seen_.steady))]);
    add("antennas", antennas);
    add("inputs", reader_.inputs());
    add("outputs", outputs);  // OUT1, OUT2, REL1
    add("reading", reader_.reads_by_itself());
    auto& buffer = reader_.buffer;
    auto& sets = buffer.tally();
    add("buffered", buffer.size());
    add("overflow", buffer.overflowed());
    add("sets_stored", sets.stored);
    add("sets_sent", sets.sent);
    add("sets_cleared", sets.cleared);  // read or notified, and no longer here
    // What every virtual reader says: a set is a tag, and a read.
    add("tags_sent", sets.sent + total_.scans + reader_.tags_sent);
    add("reads_acked", sets.cleared - sets.unasked);
    add("sets_overflowed", sets.overflowed);
    add("sets_initialized", sets.initialized);
    add("sets_lost_at_reset", sets.lost_at_reset);
    auto& notified = notifier_->tally();
    add("notify_to", notifier_->address());
    add("notify_connected", notifier_->connected());
    add("waiting_for_ack", notifier_->waits());
    add("notifications", notified.messages);
    add("resent", notified.repeated);
    add("acks", notified.acknowledged);
    add("acks_lost", total_.acks_lost + notified.acks_lost);
    add("sets_acked", notified.sets_acknowledged);
    add("keepalives", notified.keepalives);
    add("notify_connects", notified.connects);
    add("scanned", total_.scans);
    add("scans_lost", total_.scans_lost);
    add("inventory_tags", reader_.tags_sent);
    add("keys", reader_.keys);
    add("requests", total_.requests);
    add("refused", total_.refused);
    add("foreign", total_.foreign);
    add("skipped_bytes", framer_.tally().skipped_bytes);
    add("restarts", total_.resets);
    add("connects", total_.connects);
    return fields;
}

}  // namespace gantry::harting
