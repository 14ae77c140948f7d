// What every make must pass; a new one runs through it by its line in the registry.
#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <set>

#include "base/bytes.hpp"
#include "field/field.hpp"
#include "protocols/registry.hpp"

namespace gantry {
namespace {

// A driver and its virtual reader, with the tags that this reader has when nobody names any, joined in
// memory.
struct Pair {
    explicit Pair(const Plugin& make) : plugin(make), air(field.add_reader("reader", 1)) {
        auto device_settings = *Settings::make(make.device_settings, {});
        auto kind =
            make.device_tags != nullptr ? make.device_tags(device_settings) : event::Technology::epc_gen2;
        bool hf = kind == event::Technology::iso15693 || kind == event::Technology::icode1;
        for (auto& tag : hf ? field::default_hf_tags(kind) : field::default_tags()) {
            field.place(air, tag);
            tags.insert(to_hex(tag.tag.id.view()));
        }
        device = make.make_device({.name = "reader", .seed = 1, .settings = device_settings}, air);
        driver = make.make_driver({.settings = *Settings::make(make.driver_settings, {}),
                                   .name = make.device_dials ? "" : "reader",
                                   .link = make.schemes.front().kind});
        device->power_on(now);
        for (int i = 0; i < 1500; ++i, now = now + 10ms)  // it starts, and would dial
            device->time_passed(now);
        if (!make.device_dials) driver->admitted({}, now);
        device->start(now);
        driver->start(now);
    }

    void turn() {
        for (auto& signal : std::exchange(driver->signals(), {}))
            if (std::holds_alternative<Identified>(signal)) driver->admitted({}, now);
        for (auto& report : std::exchange(driver->reports(), {})) {
            for (auto& seen : report.observations)
                heard.insert(to_hex(seen.tag.view()));
            driver->committed(report.ticket, now);
        }
        pass(*driver, *device);
        if (answers) pass(*device, *driver);
    }
    void pass(Party& from, Party& to) {
        Bytes bytes(from.output().begin(), from.output().end());
        from.output_sent(bytes.size());
        if (!bytes.empty() && !to.finished()) to.received(bytes, now);
    }
    void run_for(std::chrono::milliseconds time) {
        for (auto end = now.steady + time; now.steady < end; now = now + 10ms) {
            device->time_passed(now);
            driver->time_passed(now);
            turn();
        }
    }

    const Plugin& plugin;
    field::Field field;
    Air& air;
    std::set<std::string> tags, heard;
    std::unique_ptr<Device> device;
    std::unique_ptr<Driver> driver;
    Now now{Steady{} + 1h, Wall{std::chrono::days{20'000}}};
    bool answers = true;
};

TEST(EveryMake, SeesTheTagsOfItsVirtualReader) {
    for (const auto* make : plugins()) {
        SCOPED_TRACE(make->name);
        Pair pair(*make);
        pair.run_for(30s);
        EXPECT_FALSE(pair.driver->finished()) << pair.driver->finish_reason();
        EXPECT_FALSE(pair.tags.empty());
        EXPECT_TRUE(std::ranges::includes(pair.heard, pair.tags));
    }
}

TEST(EveryMake, NeverWaitsForEverForAReaderThatFellSilent) {
    for (const auto* make : plugins()) {
        SCOPED_TRACE(make->name);
        Pair pair(*make);
        pair.run_for(30s);
        pair.answers = false;
        pair.run_for(10min);
        EXPECT_TRUE(pair.driver->finished());
        EXPECT_FALSE(pair.driver->finish_reason().empty());
    }
}

TEST(EveryMake, SurvivesGarbageOnBothSides) {
    std::mt19937 random(1);
    for (const auto* make : plugins())
        for (int round = 0; round < 20; ++round) {
            SCOPED_TRACE(make->name);
            Pair pair(*make);
            for (int i = 0; i < 20; ++i) {
                Bytes noise(random() % 400);
                for (auto& byte : noise)
                    byte = static_cast<std::uint8_t>(random());
                if (!pair.driver->finished()) pair.driver->received(noise, pair.now);
                if (!pair.device->finished()) pair.device->received(noise, pair.now);
                pair.run_for(50ms);
            }
            EXPECT_LT(pair.driver->output().size() + pair.device->output().size(), 1'000'000u);
        }
}

TEST(EveryMake, DecodesAllThatItSendsAndEncodesItBack) {
    for (const auto* make : plugins()) {
        SCOPED_TRACE(make->name);
        Pair pair(*make);
        auto& codec = make->codec();
        std::size_t messages = 0;
        auto both_ways = [&](const Party& party, wire::Direction way) {
            auto bytes = party.output();
            while (!bytes.empty()) {
                auto one = codec.decode(bytes, way, true);
                ASSERT_TRUE(one.message) << to_hex(bytes) << " " << one.message.error().text();
                Bytes again;
                ASSERT_TRUE(codec.encode(*one.message, way, again));
                ASSERT_EQ(to_hex(again), to_hex(bytes.first(one.length)));
                bytes = bytes.subspan(one.length);
                ++messages;
            }
        };
        for (int i = 0; i < 3000; ++i) {
            pair.device->time_passed(pair.now);
            pair.driver->time_passed(pair.now);
            both_ways(*pair.driver, wire::Direction::to_reader);
            both_ways(*pair.device, wire::Direction::to_host);
            pair.turn();
            pair.now = pair.now + 10ms;
        }
        EXPECT_GT(messages, 5u);
    }
}

}  // namespace
}  // namespace gantry
