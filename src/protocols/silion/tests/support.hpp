#pragma once
#include <gtest/gtest.h>

#include <map>
#include <memory>
#include <set>

#include "link/memory_link.hpp"
#include "protocols/silion/device.hpp"
#include "protocols/silion/driver.hpp"
#include "protocols/silion/plugin.hpp"
#include "testkit/script.hpp"
#include "testkit/vectors.hpp"

// What the tests of this make share: frames, a small air, a host that stores reports, and a site where a
// virtual reader dials it again and again.
namespace gantry::silion::test {

using testkit::hex;
using Given = std::vector<std::pair<std::string, std::string>>;  // settings

// Frames of a reader named "silion"; the first three are SIL-01, SIL-02 and SIL-10 of vectors.tsv.
inline constexpr std::string_view heartbeat_0 = "FF06000C04000000000073696C696F6E010A0A000000010200000000";
inline constexpr std::string_view heartbeat_1 = "FF06000C04000000000073696C696F6E010A0A000000010200000001";
inline constexpr std::string_view tags_plain =
    "FF06003801000000000073696C696F6E00030201D8050CE20041453116003820703FB7000201C1050CE20041453116004520703F"
    "9B"
    "000201C2050CE20041453116002720703FE300";
inline constexpr std::string_view tags_a =
    "FF06003801010000000073696C696F6E00030201D8050CE20041453116003820703FB7000201C1050CE20041453116004520703F"
    "9B"
    "000201C2050CE20041453116002720703FE300";
inline constexpr std::string_view tags_b =
    "FF06001401010000000073696C696F6E00010201D8050CE20041453116003820703FB700";
inline constexpr std::string_view no_tags = "FF06000201000000000073696C696F6E0000";
inline constexpr std::string_view inputs_1011 = "FF06000902000000000073696C696F6E040101020003010401";
inline constexpr std::string_view inputs_1001 = "FF06000902000000000073696C696F6E040101020003000401";
inline constexpr std::string_view fault_11 =
    "FF0600180500000186AB73696C696F6E000000000000000000000000000000000000000000000000";
inline constexpr std::string_view heartbeat_fault_11 =
    "FF06000C0400000186AB73696C696F6E010A0A000000010200000002";
inline constexpr std::string_view ack = "EE0000000100";

inline Settings driver_with(Given given = {}) {
    auto settings = Settings::make(plugin.driver_settings, given);
    if (!settings) throw std::invalid_argument(settings.error().text());
    return *settings;
}
inline Settings device_with(Given given = {}) {
    auto settings = Settings::make(plugin.device_settings, given);
    if (!settings) throw std::invalid_argument(settings.error().text());
    return *settings;
}

inline Bytes take_output(Party& party) {
    Bytes out(party.output().begin(), party.output().end());
    party.output_sent(out.size());
    return out;
}

// A driver with a hand on each of its faces.
struct Ours {
    explicit Ours(Given settings = {}, Bytes mark = {}) : driver(driver_with(std::move(settings))) {
        known.mark = std::move(mark);
        driver.start(now);
    }
    void gets(std::string_view text) { gets_bytes(hex(text)); }
    void gets_bytes(ByteView bytes) {
        driver.received(bytes, now);
        collect();
    }
    void collect() {
        for (auto& signal : driver.signals()) {
            if (std::get_if<Identified>(&signal) != nullptr && let_in) to_admit = true;
            signals.push_back(std::move(signal));
        }
        driver.signals().clear();
        take_reports();
        if (to_admit) {
            to_admit = false;
            driver.admitted(known, now);
            collect();
        }
    }
    void take_reports() {
        for (auto& report : driver.reports())
            reports.push_back(std::move(report));
        driver.reports().clear();
    }
    void waits(std::chrono::microseconds time) {
        auto end = now + time;
        for (auto due = driver.deadline(); due && *due <= end.steady && !driver.finished();
             due = driver.deadline()) {
            now = now + std::chrono::ceil<std::chrono::microseconds>(std::max(*due, now.steady) - now.steady);
            driver.time_passed(now);
            collect();
            auto again = driver.deadline();
            ASSERT_TRUE(!again || *again > now.steady) << "a deadline that does not move on";
        }
        now = end;
        driver.time_passed(now);
        collect();
    }
    void commits() {
        if (!reports.empty()) driver.committed(reports.back().ticket, now);
    }
    std::string says() { return to_hex(take_output(driver)); }
    std::uint64_t count(Count which) const { return driver.counters()[static_cast<std::size_t>(which)]; }
    std::vector<JobEnded> ended() const {
        std::vector<JobEnded> out;
        for (auto& signal : signals)
            if (auto* job = std::get_if<JobEnded>(&signal)) out.push_back(*job);
        return out;
    }
    std::size_t tags() const {
        std::size_t sum = 0;
        for (auto& report : reports)
            sum += report.observations.size();
        return sum;
    }

    Now now = testkit::script_start;
    Known known;
    bool let_in = true, to_admit = false;
    SilionDriver driver;
    std::vector<Report> reports;
    std::vector<Signal> signals;
};

// Tags that stand in front of antennas and are heard at a fixed beat. With `numbered` every sighting has an
// id of its own, so that nothing can hide in a count.
class TestAir final : public Air {
public:
    struct Tag {
        event::TagId id;
        std::uint16_t antenna = 1;
        std::int16_t rssi = -500;
        std::chrono::microseconds beat = 50ms;
        bool numbered = false;
    };
    std::vector<Tag> tags;
    std::uint64_t heard = 0;
    std::uint64_t inventories = 0;

    void inventory(const Carrier& carrier, Steady from, Steady to, std::vector<AirSighting>& out) override {
        ++inventories;
        for (auto& tag : tags) {
            if (tag.antenna != carrier.antenna) continue;
            auto beat = std::chrono::duration_cast<Steady::duration>(tag.beat);
            auto at = Steady{} + (from.time_since_epoch() + beat - Steady::duration{1}) / beat * beat;
            for (; at < to; at += beat) {
                auto id = tag.id;
                if (tag.numbered)
                    for (std::size_t i = 0; i < 8; ++i)
                        id.data[4 + i] = static_cast<std::uint8_t>(heard >> (8 * (7 - i)));
                ++heard;
                out.push_back({id, event::Technology::epc_gen2, tag.rssi, at});
            }
        }
    }
    std::vector<std::uint16_t> antennas() const override { return {1, 2}; }
    AirResult<Bytes> read(const AirAccess& access, Bank bank, std::uint32_t, std::uint32_t words) override {
        if (bank != Bank::user) return tl::unexpected(AirError::bad_address);
        Bytes data(2 * std::size_t{words});
        for (std::size_t i = 0; i < data.size(); ++i)
            data[i] = static_cast<std::uint8_t>(access.tag.data[0] + i);
        return data;
    }
};

inline event::TagId epc(std::string_view text) {
    return event::TagId(hex(text));
}

// A virtual reader and a host, joined in memory. Each connection has a driver of its own; what was committed
// stays.
class Site {
public:
    explicit Site(Given device_settings = {}, Given driver_settings = {})
        : device_options{"silion", 7, device_with(std::move(device_settings))},
          driver_options(driver_with(std::move(driver_settings))) {}

    void power_on() {
        device = std::make_unique<SilionDevice>(device_options, air);
        device->power_on(now);
    }
    void run_for(std::chrono::microseconds time) {
        if (!device) power_on();
        auto end = now.steady + time;
        while (now.steady < end) {
            if (link == nullptr && reachable && device->dial_at() && *device->dial_at() <= now.steady)
                connect();
            auto slice = std::min<std::chrono::microseconds>(
                50ms, std::chrono::ceil<std::chrono::microseconds>(end - now.steady));
            if (link != nullptr)
                slice_with_link(slice);
            else
                slice_alone(slice);
        }
    }
    void disconnect() {
        if (link == nullptr) return;
        link->cut();
        driver->link_lost(now);
        collect();
        // The host hands a reader over only when what the old connection reported is safe.
        commit_all();
        for (std::size_t i = 0; i < count_size; ++i)
            counters_[i] += driver->counters()[i];
        link.reset();
        driver.reset();
        device->link_lost(now);
    }
    std::uint64_t total(Count which) const {
        auto i = static_cast<std::size_t>(which);
        return counters_[i] + (driver != nullptr ? driver->counters()[i] : 0);
    }
    std::int64_t state(std::string_view name) const {
        auto fields = device->state();
        auto* value = wire::find(fields, name);
        EXPECT_NE(value, nullptr) << name;
        if (auto* yes = value->get<bool>()) return *yes ? 1 : 0;
        return *value->get<std::int64_t>();
    }

    TestAir air;
    DeviceOptions device_options;
    Settings driver_options;
    Now now = testkit::script_start;
    std::unique_ptr<SilionDevice> device;
    std::unique_ptr<SilionDriver> driver;
    std::unique_ptr<link::MemoryLink> link;
    std::size_t piece = 0;
    bool reachable = true;
    std::chrono::microseconds commit_time{};
    std::function<bool(ByteView, bool from_device)> drop;  // bytes that vanish
    std::function<void(SilionDriver&)> on_connect;

    std::vector<Report> stored;
    std::vector<Signal> signals;
    std::map<Bytes, std::uint64_t> reads;  // by id
    std::uint64_t all_reads = 0;
    std::vector<std::string> reasons;  // why drivers finished
    unsigned connections = 0;

private:
    struct Pending {
        Report report;
        Steady due;
    };

    void connect() {
        driver = std::make_unique<SilionDriver>(driver_options);
        link = std::make_unique<link::MemoryLink>(*driver, *device, now);
        link->piece = piece;
        link->after_turn = [this] { collect(); };
        link->drop = [this](ByteView bytes, bool from_driver) { return drop && drop(bytes, !from_driver); };
        ++connections;
        link->connect();
        if (on_connect) on_connect(*driver);
    }
    void slice_with_link(std::chrono::microseconds slice) {
        link->run_for(slice);
        now = link->now();
        commit_due();
        link->exchange();
        if (!driver->finished() && !device->finished()) return;
        if (driver->finished()) reasons.emplace_back(driver->finish_reason());
        disconnect();
    }
    void slice_alone(std::chrono::microseconds slice) {
        auto end = now + slice;
        for (auto due = device->deadline(); due && *due <= end.steady; due = device->deadline()) {
            now = now + std::chrono::ceil<std::chrono::microseconds>(std::max(*due, now.steady) - now.steady);
            device->time_passed(now);
        }
        now = end;
    }
    void collect() {
        bool admit = false;
        for (auto& signal : driver->signals()) {
            admit = admit || std::holds_alternative<Identified>(signal);
            signals.push_back(std::move(signal));
        }
        driver->signals().clear();
        auto at = link != nullptr ? link->now() : now;
        for (auto& report : driver->reports())
            pending_.push_back({std::move(report), at.steady + commit_time});
        driver->reports().clear();
        if (admit) {
            driver->admitted(known_, at);
            collect();
        }
        if (commit_time.count() == 0) commit_due();
    }
    void commit_due() {
        auto at = link != nullptr ? link->now() : now;
        while (!pending_.empty() && pending_.front().due <= at.steady)
            commit_one();
    }
    void commit_all() {
        while (!pending_.empty())
            commit_one();
    }
    void commit_one() {
        auto report = std::move(pending_.front().report);
        pending_.pop_front();
        if (report.mark) known_.mark = *report.mark;
        for (auto& each : report.observations) {
            auto id = each.tag.view();
            reads[Bytes(id.begin(), id.end())] += each.reads;
            all_reads += each.reads;
        }
        auto ticket = report.ticket;
        stored.push_back(std::move(report));
        driver->committed(ticket, link != nullptr ? link->now() : now);
    }

    Known known_;
    std::deque<Pending> pending_;
    Counters counters_{};
};

}  // namespace gantry::silion::test
