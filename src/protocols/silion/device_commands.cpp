// What a virtual reader does when a host tells it something.
#include <algorithm>

#include "protocols/silion/device.hpp"

namespace gantry::silion {

static constexpr std::uint32_t invalid_parameter = 7, already_running = 16;
static constexpr std::size_t max_command_data =
    1800;  // gen 2 refuses more (docs/protocols/silion.md section 3)

void SilionDevice::received(ByteView bytes, Now now) {
    if (!connected_ || hang_up_ || faults_.deaf()) return;
    if (booted_at_ && now.steady < *booted_at_) return;  // on a serial line: nobody is there yet
    framer_.give(bytes);
    auto skipped = framer_.tally().skipped;
    take_commands(now);
    if (!framer_.settle()) {
        if (serial_)
            framer_ = Framer(wire::Direction::to_reader, crc_rule());  // a line has no end
        else
            hang_up_ = true;
    }
    // Gen 1 takes a stray byte for a failed wait and sends again (section 8).
    if (!gen2() && waiting_ && greeted_ && framer_.tally().skipped > skipped) send_again(now);
}

void SilionDevice::take_commands(Now now) {
    while (!hang_up_ && !pending_) {  // a gen 1 is busy with its timed outputs: what comes waits
        auto frame = framer_.next();
        if (!frame) break;
        on_command(*frame, now);
    }
}

void SilionDevice::on_command(const Frame& frame, Now now) {
    if (frame.row == nullptr || (gen2() && frame.data.size() > max_command_data)) return;  // ignored silently
    switch (frame.row->code) {
        case Code::tags:
            on_acknowledged(now);
            break;
        case Code::get_inputs:
            answer(Code::get_inputs, frame.flags, 0, inputs_data(), now);
            break;
        case Code::set_outputs:
            on_set_outputs(frame, now);
            break;
        case Code::restart:
            answer(Code::restart, frame.flags, 0, {}, now);
            restart_at_ = now.steady + (gen2() ? 400ms : 1500ms);
            break;
        default:
            break;
    }
}

void SilionDevice::on_acknowledged(Now now) {
    if (stuck_ack_ || !waiting_) return;  // one that nobody waits for is ignored
    ++total_.acknowledgements;
    total_.tags_acknowledged += waiting_->tags;
    total_.reads_acknowledged += waiting_->reads;
    waiting_.reset();
    // Heartbeats stopped while it waited.
    if (heartbeat_at_ && *heartbeat_at_ <= now.steady) send_heartbeat(now);
    send_waiting(now);
}

bool SilionDevice::legal_outputs(ByteView data) const {
    std::uint8_t outputs = gen2() ? 5 : 4;
    if (data.empty() || data[0] == 0 || data[0] > outputs || data.size() != 1 + 3 * std::size_t{data[0]})
        return false;
    unsigned named = 0;
    for (std::size_t at = 1; at < data.size(); at += 3) {
        if (data[at] < 1 || data[at] > outputs || data[at + 1] > 1) return false;
        auto bit = 1u << data[at];
        if (gen2() && (named & bit) != 0) return false;
        named |= bit;
    }
    return true;
}

void SilionDevice::on_set_outputs(const Frame& frame, Now now) {
    if (!legal_outputs(frame.data)) {
        answer(Code::set_outputs, frame.flags, coded(invalid_parameter), {}, now);
        return;
    }
    if (gen2() && std::ranges::any_of(outputs_, [](auto& output) { return output.reverts.has_value(); })) {
        answer(Code::set_outputs, frame.flags, coded(already_running), {}, now);
        return;
    }
    std::chrono::seconds longest{0};
    for (std::size_t at = 1; at < frame.data.size(); at += 3) {
        auto& output = outputs_[frame.data[at] - 1u];
        output.on = frame.data[at + 1] != 0;
        output.reverts.reset();
        std::chrono::seconds time{frame.data[at + 2]};
        if (time.count() == 0 || (!gen2() && time.count() == 255)) continue;  // it stays
        output.reverts = now.steady + time;
        longest = std::max(longest, time);
    }
    if (gen2() || longest.count() == 0)
        answer(Code::set_outputs, frame.flags, 0, {}, now);
    else
        pending_ = PendingAnswer{frame.flags, now.steady + longest};
}

void SilionDevice::answer(Code code, std::uint8_t command_flags, std::uint32_t status, ByteView data,
                          Now now) {
    // Gen 2 answers with a CRC exactly when the command had one (section 4).
    std::uint8_t flags = gen2() ? command_flags & flag_crc : own_flags();
    Bytes frame;
    append_to_host(frame, static_cast<std::uint8_t>(code), flags, status, as_bytes(name_), data, crc_kind());
    say(frame, now);
}

Bytes SilionDevice::inputs_data() const {
    Bytes data{static_cast<std::uint8_t>(inputs_.size())};
    for (std::size_t i = 0; i < inputs_.size(); ++i) {
        data.push_back(static_cast<std::uint8_t>(i + 1));
        data.push_back(inputs_[i] ? 1 : 0);
    }
    return data;
}

}  // namespace gantry::silion
