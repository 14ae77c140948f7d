// What a hand does to a virtual unit from outside.
#include <array>

#include <fmt/format.h>

#include "base/text.hpp"
#include "protocols/dagprog/device.hpp"

namespace gantry::dagprog {

Result<void> DagprogDevice::inject_link(const FaultCall& call) {
    return faults_.inject(call, out());
}

// Lines have no checksum; the data of a block have, in their last byte.
Result<void> DagprogDevice::inject_bad_crc(const FaultCall&) {
    spoil_crc_ = true;
    return {};
}

Result<void> DagprogDevice::inject_stuck_ack(const FaultCall& call) {
    return fault_switch(stuck_ack_, faults::stuck_ack, call.value);
}

Result<void> DagprogDevice::inject_reboot(const FaultCall& call) {
    reboot_waits_ = total_.connects == 0;
    if (!reboot_waits_) reboot(call.now);
    return {};
}

Result<void> DagprogDevice::inject_broken(const FaultCall& call) {
    auto antenna = fault_antenna(call.value, 1);
    if (!antenna) return tl::unexpected(antenna.error());
    antenna_broken_ = antenna->has_value();
    return {};
}

Result<void> DagprogDevice::inject_antenna(const FaultCall& call) {
    if (call.value != "good" && call.value != "broken")
        return fail(fmt::format("\"antenna {}\" is not understood", printable(call.value)),
                    "\"antenna broken\" or \"antenna good\"");
    antenna_broken_ = call.value == "broken";
    return {};
}

Result<void> DagprogDevice::inject_write_error(const FaultCall&) {
    write_error_ = true;
    return {};
}

Result<void> DagprogDevice::inject_error(const FaultCall& call) {
    if (call.value != "1" && call.value != "2")
        return fail(fmt::format("\"error {}\" names no error number", printable(call.value)),
                    "the unit has two: \"error 1\" and \"error 2\"");
    say_number(Code::error, call.value == "1" ? 1 : 2);
    return {};
}

struct DagprogDevice::Rows {
    static constexpr FaultWord error{"error", "1|2", "says that a CRC8 was wrong, or a tag was disturbed"};
    static constexpr FaultWord write_error{"write-error", "", "the next write fails"};
    static constexpr FaultWord antenna{"antenna", "good|broken", "another word for antenna-broken"};
    static constexpr FaultWord silent{"silent", "on|off", "no command is answered, on whatever link"};
    using Row = FaultRow<DagprogDevice>;
    static constexpr std::array all = {
        Row{error, &DagprogDevice::inject_error},
        Row{write_error, &DagprogDevice::inject_write_error},
        Row{antenna, &DagprogDevice::inject_antenna},
        Row{silent, &DagprogDevice::inject_silent},
        Row{faults::drop, &DagprogDevice::inject_link},
        Row{faults::half_open, &DagprogDevice::inject_link},
        Row{faults::garbage, &DagprogDevice::inject_link},
        Row{faults::bad_crc, &DagprogDevice::inject_bad_crc},
        Row{faults::truncated, &DagprogDevice::inject_link},
        Row{faults::duplicate, &DagprogDevice::inject_link},
        Row{faults::slow, &DagprogDevice::inject_link},
        Row{faults::stuck_ack, &DagprogDevice::inject_stuck_ack},
        Row{faults::reboot, &DagprogDevice::inject_reboot},
        Row{faults::antenna_broken, &DagprogDevice::inject_broken},
    };
    static constexpr auto words = words_of(all);
    static constexpr std::array impossible = {
        NoFault{faults::clock_jump, "a unit has no clock"},
        NoFault{faults::buffer_full, "a unit keeps no tags, it sends each as it reads it"}};
};

Result<void> DagprogDevice::inject_silent(const FaultCall& call) {
    return fault_switch(silent_, Rows::silent, call.value);
}

std::span<const FaultWord> DagprogDevice::faults() {
    return Rows::words;
}

Result<void> DagprogDevice::inject(std::string_view command, Now now) {
    clock_ = now.steady;
    return inject_by(*this, std::span<const FaultRow<DagprogDevice>>(Rows::all), faults(), Rows::impossible,
                     command, now);
}

}  // namespace gantry::dagprog
