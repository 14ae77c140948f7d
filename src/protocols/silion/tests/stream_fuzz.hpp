#pragma once
#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <map>

#include "protocols/silion/codec.hpp"
#include "protocols/silion/device.hpp"
#include "protocols/silion/driver.hpp"
#include "protocols/silion/plugin.hpp"
#include "protocols/silion/walker.hpp"
#include "testkit/fuzz_input.hpp"

// What every stream must hold to, whatever the bytes: the result does not depend on the pieces, every byte is
// accounted for, memory stays bounded, and what decodes encodes to the same bytes.
namespace gantry::silion::fuzz {

using testkit::demand;
using testkit::Input;

inline void check_tags(const Frame& frame, const wire::Decoded& decoded) {
    std::vector<Observation> seen;
    Bytes bank;
    auto walked = walk_tags(frame.data, frame.data_offset(), seen, bank);
    demand(walked.records * std::size_t{6} <= frame.data.size());
    demand(seen.size() + walked.unusable == walked.records);
    demand(bank.size() <= frame.data.size());
    for (auto& each : seen)
        demand(std::size_t{each.data_offset} + each.data_size <= bank.size());
    bool exact = decoded.message && wire::find(decoded.message->fields, "Trailing") == nullptr;
    demand(exact == !walked.fault.has_value());
    if (decoded.message)
        demand(wire::find(decoded.message->fields, "Tags")->get<wire::Value::List>()->size() ==
               walked.records);
}

inline void check_frame(const Frame& frame, wire::Direction direction) {
    auto decoded = codec().decode(frame.bytes, direction, true);
    demand(decoded.length == frame.bytes.size());
    if (frame.row != nullptr && carries_tags(*frame.row)) check_tags(frame, decoded);
    if (!decoded.message) return;
    Bytes again;
    demand(codec().encode(*decoded.message, direction, again).has_value());
    demand(std::ranges::equal(again, frame.bytes));
}

inline std::vector<Bytes> frames_of(Framer& framer, const std::vector<ByteView>& pieces, std::size_t given) {
    std::vector<Bytes> frames;
    for (auto piece : pieces) {
        framer.give(piece);
        while (auto frame = framer.next())
            frames.emplace_back(frame->bytes.begin(), frame->bytes.end());
        demand(framer.settle());
        demand(framer.kept().size() <= max_frame_size);
    }
    auto& tally = framer.tally();
    demand(tally.frame_bytes + tally.skipped + framer.kept().size() == given);
    return frames;
}

inline void check_stream(const std::uint8_t* data, std::size_t size, wire::Direction direction) {
    Input input(data, size);
    auto pieces = input.pieces();
    Framer whole(direction, CrcRule::any()), cut(direction, CrcRule::any());
    auto frames = frames_of(whole, {input.bytes}, input.bytes.size());
    demand(frames == frames_of(cut, pieces, input.bytes.size()));
    demand(whole.tally().resyncs == cut.tally().resyncs);
    for (auto& bytes : frames) {
        auto look = look_at(bytes, direction, CrcRule::any());
        demand(look.what == Look::What::frame);
        check_frame(look.frame, direction);
    }
    std::size_t covered = 0;
    for (auto rest = input.bytes; !rest.empty();) {
        auto decoded = codec().decode(rest, direction, true);
        demand(decoded.length > 0 && decoded.length <= rest.size());
        covered += decoded.length;
        rest = rest.subspan(decoded.length);
    }
    demand(covered == input.bytes.size());
}

inline Settings settings_of(std::span<const SettingRow> rows) {
    return *Settings::make(rows, {});
}

// The driver under frames, time-outs, commits and jobs in any order.
inline void check_driver(const std::uint8_t* data, std::size_t size) {
    static const auto settings = settings_of(plugin.driver_settings);
    Input input(data, size);
    SilionDriver driver(settings);
    Now now{Steady{} + std::chrono::hours{1}, Wall{}};
    driver.start(now);
    Ticket last = 0, committed = 0;
    JobId job = 0;
    std::size_t ended = 0;
    for (auto piece : input.pieces()) {
        driver.received(piece, now);
        auto dice = input.random.next();
        if (dice % 8 == 0) now = now + std::chrono::milliseconds{dice >> 8 & 0x1FFF};
        if (dice % 8 == 1) driver.time_passed(now);
        if (dice % 16 == 2)
            driver.run({.id = ++job, .deadline = now.steady + std::chrono::seconds{3}}, GetInputs{}, now);
        if (dice % 16 == 3) driver.cancel(job, now);
        for (auto signals = std::exchange(driver.signals(), {}); !signals.empty();
             signals = std::exchange(driver.signals(), {}))
            for (auto& signal : signals) {
                ended += std::holds_alternative<JobEnded>(signal) ? 1u : 0u;
                if (std::holds_alternative<Identified>(signal)) driver.admitted({}, now);
            }
        for (auto& report : driver.reports()) {
            demand(report.ticket == ++last);
            for (auto& each : report.observations)
                demand(each.tag.size >= 1 && each.tag.size <= event::TagId::max_size && each.reads >= 1);
        }
        driver.reports().clear();
        if (dice % 4 == 0 && committed < last) driver.committed(committed = last, now);
        demand(driver.output().size() <= 16 * input.bytes.size() + 4096);
        if (driver.finished()) demand(!driver.finish_reason().empty());
    }
    driver.link_lost(now);
    for (auto& signal : driver.signals())
        ended += std::holds_alternative<JobEnded>(signal) ? 1u : 0u;
    demand(ended == job);
}

// Changes an input, then sets the length and the checksum of its frames right again, so that mutations reach
// what lies behind them.
inline std::size_t repaired(std::uint8_t* data, std::size_t size, wire::Direction direction) {
    if (size <= 8) return size;
    ByteView bytes(data + 8, size - 8);
    std::size_t head = direction == wire::Direction::to_host ? 10 : 6;
    auto first = direction == wire::Direction::to_host ? std::uint8_t{0xFF} : std::uint8_t{0xEE};
    if (bytes.size() < head) return size;
    auto* at = data + 8;
    at[0] = first;
    if (direction == wire::Direction::to_reader)
        at[1] = 0;
    else
        at[1] = static_cast<std::uint8_t>(std::min<std::size_t>(at[1] % 16, bytes.size() - head));
    std::size_t crc = (at[5] & flag_crc) != 0 && bytes.size() >= head + at[1] + 2u ? 2 : 0;
    if (crc == 0) at[5] &= static_cast<std::uint8_t>(~flag_crc);
    auto length = std::min<std::size_t>(bytes.size() - head - at[1] - crc, 65535);
    at[2] = static_cast<std::uint8_t>(length >> 8);
    at[3] = static_cast<std::uint8_t>(length);
    if (crc != 0) {
        auto end = head + at[1] + length;
        auto right = crc_bytes(CrcKind::modbus, bytes.first(end));
        at[end] = right[0];
        at[end + 1] = right[1];
    }
    return size;
}

}  // namespace gantry::silion::fuzz
