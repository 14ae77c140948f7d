#pragma once
#include <map>

#include "protocols/caen/codec.hpp"
#include "protocols/caen/device.hpp"
#include "protocols/caen/driver.hpp"
#include "protocols/caen/message.hpp"
#include "protocols/caen/plugin.hpp"
#include "protocols/caen/walker.hpp"
#include "testkit/fuzz_input.hpp"

// What every stream must hold to, whatever the bytes: the result does not depend on the pieces, every byte is
// accounted for, memory stays bounded, and what decodes encodes to the same bytes.
namespace gantry::caen::fuzz {

using testkit::demand;
using testkit::Input;
using wire::Direction;

struct Items {
    std::vector<std::pair<Framer::What, Bytes>> items;
    Framer::Tally tally;
};
inline Items items_of(std::uint16_t head, const std::vector<ByteView>& pieces, std::size_t given) {
    Items found;
    Framer framer(head);
    std::size_t size = 0;
    for (auto piece : pieces) {
        framer.add(piece);
        while (auto item = framer.next()) {
            found.items.emplace_back(item->what, Bytes(item->bytes.begin(), item->bytes.end()));
            size += item->bytes.size();
        }
        demand(framer.pending() < 65536);
    }
    found.tally = framer.tally();
    demand(size + found.tally.skipped_bytes + framer.pending() == given);
    return found;
}

// Tags are the same in one walk and pair by pair, and all they point at is there.
inline void check_walk(ByteView pairs) {
    std::vector<Observation> seen, one_by_one;
    Bytes data, pair_data;
    std::vector<std::uint8_t> events;
    auto walked = TagWalker().walk(pairs, header_size, seen, data, &events);
    demand(walked.tags == seen.size() && events.size() == seen.size());
    demand(data.size() <= pairs.size());
    for (auto& each : seen) {
        demand(each.tag.size >= 1 && each.tag.size <= event::TagId::max_size);
        demand(std::size_t{each.data_offset} + each.data_size <= data.size());
    }
    TagWalker walker;
    AvpReader reader(pairs);
    while (auto avp = reader.next()) {
        ByteView pair(avp->value.data() - avp_header_size, avp->value.size() + avp_header_size);
        demand(!walker.walk(pair, 0, one_by_one, pair_data).fault);
    }
    demand(reader.fault() == walked.fault);
    demand(one_by_one.size() == seen.size() && pair_data == data);
    for (std::size_t i = 0; i < seen.size(); ++i)
        demand(one_by_one[i].tag == seen[i].tag && one_by_one[i].rssi == seen[i].rssi &&
               one_by_one[i].antenna == seen[i].antenna && one_by_one[i].data_size == seen[i].data_size);
}

inline void check_codec(ByteView bytes, Direction direction) {
    std::size_t covered = 0;
    for (auto rest = bytes; !rest.empty();) {
        auto decoded = codec().decode(rest, direction, true);
        demand(decoded.length > 0 && decoded.length <= rest.size());
        if (decoded.message) {
            Bytes again;
            demand(codec().encode(*decoded.message, direction, again).has_value());
            demand(std::ranges::equal(again, rest.first(decoded.length)));
            (void)codec().check(*decoded.message, direction);
        }
        covered += decoded.length;
        rest = rest.subspan(decoded.length);
    }
    demand(covered == bytes.size());
}

inline void check_stream(const std::uint8_t* data, std::size_t size, Direction direction) {
    Input input(data, size);
    auto head = direction == Direction::to_reader ? to_reader_head : to_host_head;
    auto whole = items_of(head, {input.bytes}, input.bytes.size());
    auto cut = items_of(head, input.pieces(), input.bytes.size());
    demand(whole.items == cut.items);
    demand(whole.tally.resyncs == cut.tally.resyncs && whole.tally.skipped_bytes == cut.tally.skipped_bytes);
    for (auto& [what, bytes] : whole.items) {
        if (what != Framer::What::message) continue;
        auto parsed = parse(bytes);
        demand(parsed.fault.has_value() != codec().decode(bytes, direction, true).message.has_value());
        check_walk(ByteView(bytes).subspan(header_size));
    }
    check_walk(input.bytes);
    check_codec(input.bytes, direction);
}

// The bytes as the reader's side of a dialog, with time-outs, commits and jobs in any order. Answers are
// given the id that the driver waits for every other time, so that some of them are taken.
inline void check_driver(const std::uint8_t* data, std::size_t size) {
    static const auto settings = *Settings::make(plugin.driver_settings, {});
    Input input(data, size);
    CaenDriver driver({.settings = settings, .name = "fuzz"});
    Now now{Steady{} + std::chrono::hours{1}, Wall{} + std::chrono::years{56}};
    driver.start(now);
    Ticket last = 0, committed = 0;
    JobId job = 0;
    std::map<JobId, unsigned> ended;
    auto take_signals = [&] {
        for (auto signals = std::exchange(driver.signals(), {}); !signals.empty();
             signals = std::exchange(driver.signals(), {}))
            for (auto& signal : signals) {
                if (auto* end = std::get_if<JobEnded>(&signal)) ++ended[end->job];
                if (std::holds_alternative<Identified>(signal)) driver.admitted({}, now);
            }
    };
    for (auto piece : input.pieces()) {
        auto dice = input.random.next();
        Bytes bytes(piece.begin(), piece.end());
        auto asked = read_header(driver.output());
        if (asked && dice % 2 == 0 && plausible_header(bytes, to_host_head) && bytes.size() >= 4) {
            bytes[2] = static_cast<std::uint8_t>(asked->id >> 8);
            bytes[3] = static_cast<std::uint8_t>(asked->id & 0xFF);
        }
        driver.output_sent(driver.output().size());
        driver.received(bytes, now);
        if (dice % 8 == 0) now = now + std::chrono::milliseconds{dice >> 8 & 0x1FFF};
        if (dice % 8 == 1) driver.time_passed(now);
        JobOrder order{.id = job + 1, .deadline = now.steady + std::chrono::seconds{3}};
        if (dice % 32 == 2) driver.run(order, GetInputs{}, now);
        if (dice % 32 == 18)
            driver.run(order, Execute{{.name = "GetPower", .header = {}, .fields = {}}}, now);
        if (dice % 16 == 2) ++job;
        if (dice % 16 == 3) driver.cancel(job, now);
        take_signals();
        for (auto& report : driver.reports()) {
            demand(report.ticket == ++last);
            for (auto& each : report.observations)
                demand(each.tag.size >= 1 && each.tag.size <= event::TagId::max_size && each.reads >= 1);
        }
        driver.reports().clear();
        if (dice % 4 == 0 && committed < last) driver.committed(committed = last, now);
        demand(driver.output().size() <= 64 * 1024);
        if (driver.finished()) demand(!driver.finish_reason().empty());
    }
    driver.link_lost(now);
    take_signals();
    for (JobId id = 1; id <= job; ++id)
        demand(ended[id] == 1);
}

// One tag that is always heard and does nothing else.
class OneTag final : public Air {
public:
    void inventory(const Carrier& /*carrier*/, Steady from, Steady /*to*/,
                   std::vector<AirSighting>& out) override {
        static constexpr std::array<std::uint8_t, 12> id = {0x30};
        out.push_back({.tag = event::TagId(id), .rssi = -500, .at = from});
    }
    std::vector<std::uint16_t> antennas() const override { return {1, 2}; }
};

inline void check_device(const std::uint8_t* data, std::size_t size) {
    static const auto settings = *Settings::make(plugin.device_settings, {});
    Input input(data, size);
    OneTag air;
    CaenDevice device({.name = "fuzz", .seed = 1, .settings = settings}, air);
    Now now{Steady{} + std::chrono::hours{1}, Wall{} + std::chrono::years{56}};
    device.power_on(now);
    device.start(now);
    for (auto piece : input.pieces()) {
        device.received(piece, now);
        if (auto dice = input.random.next(); dice % 8 == 0) {
            now = now + std::chrono::milliseconds{dice >> 8 & 0x1FFF};
            device.time_passed(now);
        }
        demand(device.output().size() <= 1024 * 1024);
        if (input.random.next() % 4 == 0) device.output_sent(device.output().size());
        if (device.finished()) {
            device.link_lost(now);
            device.start(now);
        }
    }
    demand(!device.state().empty());
}

}  // namespace gantry::caen::fuzz
