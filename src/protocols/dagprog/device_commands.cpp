// What a virtual unit does when a host tells it something.
#include <algorithm>

#include <fmt/format.h>

#include "protocols/dagprog/device.hpp"

namespace gantry::dagprog {

static constexpr std::uint8_t no_tag = 1, write_error = 2;

// A unit that insists on one way of writing does not know the others. TL is printed with a TAB, so that one
// is taken in any case.
bool DagprogDevice::understands(const Line& line) const {
    if (line.row == nullptr || line.fault || line.trailing || !line.row->known_to(family_)) return false;
    if (wants_stx_ && line.has_stx != *wants_stx_) return false;
    if (!line.row->sets() || !wants_separator_ || line.separator == *wants_separator_) return true;
    return line.row->code == Code::power_up && line.separator == Separator::tab;
}

bool DagprogDevice::legal(const Line& line) const {
    for (std::size_t i = 0; i < line.row->parts.size(); ++i) {
        auto& part = line.row->parts[i];
        if (part.kind != Kind::decimal && part.kind != Kind::hex) continue;
        auto value = line.number(i);
        auto most = max_of(part, family_);
        if (most >= 0 && value > most) return false;
        if (part.enumeration != nullptr && part.enumeration->find(value) == nullptr) return false;
    }
    if (family_ != Family::icode1 || !line.row->sets()) return true;
    if (line.row->code == Code::first_block) return line.number(0) + now_.block_count <= 15;
    if (line.row->code == Code::block_count) return now_.first_block + line.number(0) <= 15;
    return true;
}

void DagprogDevice::set(Code code, std::uint32_t value) {
    auto keep = [&](std::uint32_t Memory::*member) {
        now_.*member = value;
        if (std::exchange(save_next_, false)) saved_.*member = value;
    };
    if (code == Code::first_block) keep(&Memory::first_block);
    if (code == Code::block_count) keep(&Memory::block_count);
    if (code == Code::power_up) keep(&Memory::power_up);
    if (code == Code::transmit) transmit_ = value;
}

// Another mode is entered from rest only.
void DagprogDevice::enter(Mode mode, Code code) {
    if (mode_ != Mode::stopped && mode_ != mode) {
        ++total_.refused;
        return say(Code::unknown_command);
    }
    if (mode_ != mode) asleep_.clear();
    mode_ = mode;
    scanned_to_ = clock_;
    next_scan_ = clock_;
    if (!stuck_ack_) say(code);
}

void DagprogDevice::command(const Line& line, Now now) {
    if (line.row != nullptr && line.row->code == Code::empty) return;
    ++total_.commands;
    auto refuse = [&] {
        ++total_.refused;
        say(Code::unknown_command);
    };
    if (!understands(line) || !legal(line)) return refuse();
    auto code = line.row->code;
    if (line.row->sets() && line.row->answer == Answer::echo)
        set(code, static_cast<std::uint32_t>(line.number(0)));
    switch (code) {
        case Code::first_block:
            return stuck_ack_ && line.row->sets() ? void() : say_number(code, now_.first_block);
        case Code::block_count:
            return stuck_ack_ && line.row->sets() ? void() : say_number(code, now_.block_count);
        case Code::transmit:
            return stuck_ack_ && line.row->sets() ? void() : say_number(code, transmit_);
        case Code::power_up:
            return stuck_ack_ && line.row->sets() ? void() : say_number(code, now_.power_up);
        case Code::version:
            return say(code, {version_});
        case Code::read_forever:
            return enter(Mode::forever, code);
        case Code::read_checked:
            return enter(Mode::checked, code);
        case Code::read_once:
            return enter(Mode::once, code);
        case Code::read_serial:
            return mode_ != Mode::stopped ? refuse() : read_serial(now);
        case Code::write:
        case Code::write_crc8:
            return mode_ != Mode::stopped ? refuse() : write(line, now);
        case Code::stop:
            mode_ = Mode::stopped;
            break;
        case Code::save:
            save_next_ = true;
            return stuck_ack_ ? void() : say_number(code, 1);
        case Code::field_off:
            field_on_ = false;
            asleep_.clear();
            break;
        case Code::field_on:
            field_on_ = true;
            scanned_to_ = now.steady;
            next_scan_ = now.steady + 10ms;
            break;
        default:
            return refuse();
    }
    if (!stuck_ack_) say(code);
}

void DagprogDevice::read_serial(Now now) {
    say(Code::read_serial);
    auto tags = in_the_field(now.steady);
    if (tags.size() > 1) ++total_.collisions;
    if (tags.size() != 1) return say_result(no_tag);
    ++total_.detections;
    Serial serial{};
    std::ranges::copy(tags[0].view(), serial.begin());
    say_serial(serial);
}

void DagprogDevice::write(const Line& line, Now now) {
    static constexpr std::uint32_t words = block_size / 2;
    auto tags = in_the_field(now.steady);
    if (tags.size() > 1) ++total_.collisions;
    if (tags.size() != 1) return say_result(no_tag);
    Bytes data = from_hex(line.parts[1]).value_or(Bytes{});
    data.resize(line.row->code == Code::write ? block_size : block_size - 1);
    if (line.row->code == Code::write_crc8) data.push_back(crc8(crc8_, data));
    auto block = static_cast<std::uint32_t>(line.number(0));
    bool failed = std::exchange(write_error_, false) ||
                  !air_.write(access(tags[0], now.steady), Bank::user, block * words, data);
    auto written = failed ? std::nullopt : read_block(tags[0], block, now.steady);
    if (!written) return say_result(write_error);
    ++total_.writes;
    Serial serial{};
    std::ranges::copy(tags[0].view(), serial.begin());
    say_serial(serial);
    say(Code::block_data, {fmt::format("{:02X}", count_++), to_hex(*written)});
}

}  // namespace gantry::dagprog
