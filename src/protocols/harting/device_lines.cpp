#include "protocols/harting/device_lines.hpp"

namespace gantry::harting {

static constexpr auto time_unit = 100ms;
static constexpr std::uint16_t for_ever = 0xFFFF;

void Outputs::set(std::size_t line, OutputMode mode, std::uint8_t frequency, std::uint16_t time, Steady now) {
    if (mode == OutputMode::unchanged) return;
    auto& it = lines_[line];
    it = {mode, frequency, {}};
    if (time != 0 && time != for_ever) it.until = now + time * time_unit;
}

void Outputs::on_read(std::uint16_t antenna, const Setup& setup, Steady now) {
    for (std::size_t i = 0; i < output_count; ++i) {
        auto& output = setup.outputs[i];
        if ((output.antennas >> (antenna - 1) & 1u) == 0 || output.time == 0ms) continue;
        lines_[i] = {static_cast<OutputMode>(output.active), 1, now + output.time};
    }
}

void Outputs::time_passed(Steady now) {
    for (auto& line : lines_)
        if (line.until && now >= *line.until) line = {};
}

std::optional<Steady> Outputs::deadline() const {
    std::optional<Steady> due;
    for (auto& line : lines_)
        if (line.until && (!due || *line.until < *due)) due = line.until;
    return due;
}

OutputMode Outputs::mode(std::size_t line, const Setup& setup, Steady now) const {
    auto& it = lines_[line];
    bool driven = it.mode != OutputMode::unchanged && (!it.until || now < *it.until);
    return driven ? it.mode : static_cast<OutputMode>(setup.outputs[line].idle);
}

bool Outputs::level(std::size_t line, const Setup& setup, Steady now) const {
    auto mode = this->mode(line, setup, now);
    if (mode != OutputMode::flash) return mode == OutputMode::on;
    auto half_period = 1'000'000us / (2 * (8 >> (lines_[line].frequency & 3)));
    return now.time_since_epoch() / half_period % 2 == 0;
}

// --- the trigger -------------------------------------------------------------------------------------------

void Trigger::restart(const Setup& setup, bool input_1, Steady now) {
    *this = {};
    input_changed(setup, input_1, now);
}

Trigger::Change Trigger::input_changed(const Setup& setup, bool input_1, Steady now) {
    if (input_1) {
        bool begun = !std::exchange(on_, true);
        ends_at_.reset();
        timed_out_ = false;
        return {.begun = begun && setup.triggered};
    }
    if (on_ && !ends_at_ && !setup.unlimited) ends_at_ = now + setup.hold;
    return time_passed(setup, now);
}

Trigger::Change Trigger::time_passed(const Setup& setup, Steady now) {
    if (!on_ || !ends_at_ || now < *ends_at_) return {};
    on_ = false;
    ends_at_.reset();
    timed_out_ = true;
    return {.timed_out = setup.triggered};
}

}  // namespace gantry::harting
