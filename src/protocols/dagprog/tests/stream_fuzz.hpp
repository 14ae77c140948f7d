#pragma once
#include <algorithm>
#include <utility>

#include "protocols/dagprog/codec.hpp"
#include "protocols/dagprog/device.hpp"
#include "protocols/dagprog/driver.hpp"
#include "protocols/dagprog/plugin.hpp"
#include "testkit/fuzz_input.hpp"

// What every stream must hold to, whatever the bytes: the result does not depend on the pieces, every byte is
// accounted for, memory stays bounded, and what decodes encodes to the same bytes.
namespace gantry::dagprog::fuzz {

using testkit::demand;
using testkit::Input;

inline std::vector<std::string> lines_of(Framer& framer, const std::vector<ByteView>& pieces,
                                         std::size_t given) {
    std::vector<std::string> lines;
    for (auto piece : pieces) {
        framer.give(piece);
        while (auto line = framer.next())
            lines.emplace_back(line->body);
        framer.settle();
        demand(framer.kept() <= max_line + 1);
    }
    auto& tally = framer.tally();
    demand(tally.line_bytes + tally.skipped + framer.kept() == given);
    return lines;
}

inline void check_stream(const std::uint8_t* data, std::size_t size, wire::Direction direction) {
    Input input(data, size);
    auto pieces = input.pieces();
    Framer whole(direction), cut(direction);
    demand(lines_of(whole, {input.bytes}, input.bytes.size()) == lines_of(cut, pieces, input.bytes.size()));
    for (auto rest = input.bytes; !rest.empty();) {
        auto decoded = codec().decode(rest, direction, true);
        demand(decoded.length > 0 && decoded.length <= rest.size());
        if (decoded.message) {
            Bytes again;
            demand(codec().encode(*decoded.message, direction, again).has_value());
            demand(std::ranges::equal(again, rest.first(decoded.length)));
        }
        rest = rest.subspan(decoded.length);
    }
}

inline Settings settings_of(std::span<const SettingRow> rows) {
    return *Settings::make(rows, {});
}

// The driver under lines, time-outs, commits and jobs in any order.
inline void check_driver(const std::uint8_t* data, std::size_t size) {
    static const auto settings = settings_of(plugin.driver_settings);
    Input input(data, size);
    DagprogDriver driver({.settings = settings});
    Now now{Steady{} + std::chrono::hours{1}, Wall{}};
    driver.admitted({}, now);
    driver.start(now);
    Ticket last = 0, committed = 0;
    JobId job = 0;
    std::size_t ended = 0;
    TagAccess access;
    access.tag = event::TagId(Bytes{0xE0, 4, 1, 0, 0, 0, 0, 1});
    for (auto piece : input.pieces()) {
        driver.received(piece, now);
        auto dice = input.random.next();
        if (dice % 4 == 0) now = now + std::chrono::milliseconds{dice >> 8 & 0x7FF};
        if (dice % 4 == 1) driver.time_passed(now);
        JobOrder order{.id = job + 1, .deadline = now.steady + std::chrono::seconds{3}};
        if (dice % 16 == 2) driver.run(order, GetParameter{}, now), ++job;
        if (dice % 16 == 3)
            driver.run(order, WriteTag{.access = access, .offset = 5, .data = Bytes(4)}, now), ++job;
        if (dice % 16 == 6) driver.cancel(job, now);
        for (auto& signal : std::exchange(driver.signals(), {}))
            ended += std::holds_alternative<JobEnded>(signal) ? 1u : 0u;
        for (auto& report : driver.reports()) {
            demand(report.ticket == ++last);
            for (auto& each : report.observations) {
                demand(each.tag.size >= 1 && each.tag.size <= event::TagId::max_size && each.reads >= 1);
                demand(std::size_t{each.data_offset} + each.data_size <= report.data.size());
            }
        }
        driver.reports().clear();
        if (dice % 4 == 0 && committed < last) driver.committed(committed = last, now);
        demand(driver.output().size() <= 64 * input.bytes.size() + 4096);
        if (driver.finished()) demand(!driver.finish_reason().empty());
    }
    driver.link_lost(now);
    for (auto& signal : driver.signals())
        ended += std::holds_alternative<JobEnded>(signal) ? 1u : 0u;
    demand(ended == job);
}

// A tag that is always there.
class OneTag final : public Air {
public:
    void inventory(const Carrier&, Steady from, Steady to, std::vector<AirSighting>& out) override {
        if (from < to) out.push_back({tag, event::Technology::iso15693, -500, from});
    }
    std::vector<std::uint16_t> antennas() const override { return {1}; }
    AirResult<Bytes> read(const AirAccess&, Bank, std::uint32_t, std::uint32_t words) override {
        return Bytes(2 * std::size_t{words});
    }
    event::TagId tag{Bytes{0xE0, 4, 1, 0, 0, 0, 0, 1}};
};

inline void check_device(const std::uint8_t* data, std::size_t size) {
    static const auto settings = settings_of(plugin.device_settings);
    Input input(data, size);
    OneTag air;
    DagprogDevice device({"desk", 1, settings}, air);
    Now now{Steady{} + std::chrono::hours{1}, Wall{}};
    device.power_on(now);
    device.start(now);
    now = now + std::chrono::seconds{1};
    device.time_passed(now);
    for (auto piece : input.pieces()) {
        device.received(piece, now);
        if (auto dice = input.random.next(); dice % 8 == 0) {
            now = now + std::chrono::milliseconds{dice >> 8 & 0x3FF};
            device.time_passed(now);
        }
        demand(device.output().size() <= 64 * input.bytes.size() + 65536);
        device.output_sent(device.output().size());
    }
    demand(!device.state().empty());
}

}  // namespace gantry::dagprog::fuzz
