// What a hand does to a virtual reader from outside.
#include <array>
#include <charconv>

#include <fmt/format.h>

#include "base/text.hpp"
#include "protocols/silion/device.hpp"

namespace gantry::silion {

static constexpr std::uint32_t return_loss = 9;  // section 6

Result<void> SilionDevice::inject_error(const FaultCall& call) {
    std::uint32_t error = 0;
    auto [end, wrong] = std::from_chars(call.value.data(), call.value.data() + call.value.size(), error);
    if (wrong != std::errc{} || end != call.value.data() + call.value.size() || error == 0 || error > 65535)
        return fail(fmt::format("\"error {}\" names no error number", printable(call.value)),
                    "write it like \"error 11\"");
    status_ = status_base + error;
    fault_due_ = true;
    return {};
}

Result<void> SilionDevice::inject_clear(const FaultCall&) {
    status_ = 0;
    return {};
}

Result<void> SilionDevice::inject_input(const FaultCall& call) {
    auto value = call.value;
    bool fine = value.size() == 3 && value[0] >= '1' && value[0] <= '4' && value[1] == '=' &&
                (value[2] == '0' || value[2] == '1');
    if (!fine)
        return fail(fmt::format("\"input {}\" names no input and state", printable(value)),
                    "inputs are 1 to 4: \"input 2=1\"");
    auto& input = inputs_[static_cast<std::size_t>(value[0] - '1')];
    bool state = value[2] == '1';
    inputs_due_ = inputs_due_ || input != state;
    input = state;
    return {};
}

Result<void> SilionDevice::inject_link(const FaultCall& call) {
    return faults_.inject(call, out());
}

// The frame that a reader sends twice is one with tags.
Result<void> SilionDevice::inject_duplicate(const FaultCall& call) {
    repeat_tags_ = last_tags_.empty() || !connected_;
    if (!repeat_tags_) say(last_tags_, call.now);
    return {};
}

Result<void> SilionDevice::inject_stuck_ack(const FaultCall& call) {
    return fault_switch(stuck_ack_, faults::stuck_ack, call.value);
}

Result<void> SilionDevice::inject_reboot(const FaultCall& call) {
    reboot_waits_ = total_.connects == 0;
    if (!reboot_waits_) reboot(call.now);
    return {};
}

// Said as a fault, as real ones do. Gen 2 sends no batches as long as it is faulty (section 6).
Result<void> SilionDevice::inject_antenna(const FaultCall& call) {
    auto antenna = fault_antenna(call.value, antennas_);
    if (!antenna) return tl::unexpected(antenna.error());
    if (call.now.steady > scanned_to_) inventory(call.now);  // what it has heard until now
    broken_ = *antenna ? broken_ | 1u << **antenna : 0;
    status_ = broken_ != 0 ? status_base + return_loss : 0;
    fault_due_ = broken_ != 0;
    return {};
}

Result<void> SilionDevice::inject_full(const FaultCall&) {
    buffer_.overflow();
    return {};
}

struct SilionDevice::Rows {
    static constexpr FaultWord error{"error", "N", "an error of the RF module, by its number"};
    static constexpr FaultWord clear{"clear", "", "that error is over"};
    static constexpr FaultWord input{"input", "N=0|1", "an input changes"};
    static constexpr std::array all = {
        FaultRow<SilionDevice>{error, &SilionDevice::inject_error},
        FaultRow<SilionDevice>{clear, &SilionDevice::inject_clear},
        FaultRow<SilionDevice>{input, &SilionDevice::inject_input},
        FaultRow<SilionDevice>{faults::drop, &SilionDevice::inject_link},
        FaultRow<SilionDevice>{faults::half_open, &SilionDevice::inject_link},
        FaultRow<SilionDevice>{faults::garbage, &SilionDevice::inject_link},
        FaultRow<SilionDevice>{faults::bad_crc, &SilionDevice::inject_link},
        FaultRow<SilionDevice>{faults::truncated, &SilionDevice::inject_link},
        FaultRow<SilionDevice>{faults::duplicate, &SilionDevice::inject_duplicate},
        FaultRow<SilionDevice>{faults::slow, &SilionDevice::inject_link},
        FaultRow<SilionDevice>{faults::stuck_ack, &SilionDevice::inject_stuck_ack},
        FaultRow<SilionDevice>{faults::reboot, &SilionDevice::inject_reboot},
        FaultRow<SilionDevice>{faults::antenna_broken, &SilionDevice::inject_antenna},
        FaultRow<SilionDevice>{faults::buffer_full, &SilionDevice::inject_full},
    };
    static constexpr auto words = words_of(all);
    static constexpr std::array impossible = {NoFault{faults::clock_jump, "its frames carry no time"}};
};

std::span<const FaultWord> SilionDevice::faults() {
    return Rows::words;
}

Result<void> SilionDevice::inject(std::string_view command, Now now) {
    auto done = inject_by(*this, std::span<const FaultRow<SilionDevice>>(Rows::all), faults(),
                          Rows::impossible, command, now);
    if (done) send_waiting(now);
    return done;
}

}  // namespace gantry::silion
