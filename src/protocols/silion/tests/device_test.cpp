#include "protocols/silion/device.hpp"

#include "protocols/silion/codec.hpp"
#include "support.hpp"

namespace gantry::silion::test {

// A virtual reader with a hand on each of its faces.
struct Reader {
    explicit Reader(Given settings = {}, bool tag = true)
        : device({"silion", 3, device_with(std::move(settings))}, air) {
        if (tag) air.tags.push_back({epc("E20041453116003820703FB7"), 1, -400, 500ms});
        device.power_on(now);
    }
    void connects() { device.start(now); }
    void gets(std::string_view text) { device.received(hex(text), now); }
    void does(std::string_view fault) {
        auto done = device.inject(fault, now);
        EXPECT_TRUE(done) << done.error().text();
    }
    void waits(std::chrono::microseconds time) {
        auto end = now + time;
        for (auto due = device.deadline(); due && *due <= end.steady; due = device.deadline()) {
            ASSERT_GE(*due, now.steady) << "a deadline in the past";
            now = now + std::chrono::ceil<std::chrono::microseconds>(*due - now.steady);
            device.time_passed(now);
            auto again = device.deadline();
            ASSERT_TRUE(!again || *again > now.steady) << "a deadline that does not move on";
        }
        now = end;
    }
    // What it said since last asked: the names of the messages.
    std::vector<std::string> says() {
        said.clear();
        std::vector<std::string> names;
        auto bytes = take_output(device);
        for (ByteView rest = bytes; !rest.empty();) {
            auto decoded = codec().decode(rest, wire::Direction::to_host, true);
            names.push_back(decoded.message ? decoded.message->name : decoded.message.error().text());
            if (decoded.message) said.push_back(*decoded.message);
            rest = rest.subspan(decoded.length);
        }
        return names;
    }
    std::int64_t state(std::string_view name) const {
        auto fields = device.state();
        auto* value = wire::find(fields, name);
        EXPECT_NE(value, nullptr) << name;
        if (auto* yes = value->get<bool>()) return *yes ? 1 : 0;
        return *value->get<std::int64_t>();
    }
    std::string text(std::string_view name) const {
        auto fields = device.state();
        return *wire::find(fields, name)->get<std::string>();
    }
    std::int64_t status() const { return *wire::find(said.at(0).header, "status")->get<std::int64_t>(); }

    TestAir air;
    Now now = testkit::script_start;
    SilionDevice device;
    std::vector<wire::Message> said;
};
using Names = std::vector<std::string>;

TEST(SilionDevice, DialsAtPowerOnAndEveryTwoSeconds) {
    Reader reader;
    EXPECT_EQ(reader.device.dial_at(), reader.now.steady);
    reader.device.dial_failed(reader.now);
    EXPECT_EQ(reader.device.dial_at(), reader.now.steady + 2s);
    reader.connects();
    EXPECT_FALSE(reader.device.dial_at());
    reader.device.link_lost(reader.now);
    EXPECT_EQ(reader.device.dial_at(), reader.now.steady + 2s);
}

TEST(SilionDevice, GreetsWithAHeartbeat) {
    Reader reader({}, false);
    reader.connects();
    EXPECT_EQ(reader.says(), Names{"Heartbeat"});
    EXPECT_EQ(*wire::find(reader.said[0].header, "reader"), wire::Value(std::string("silion")));
    EXPECT_EQ(*wire::find(reader.said[0].fields, "Count"), wire::Value(0));
    reader.waits(25s);
    EXPECT_EQ(reader.says(), (Names{"Heartbeat", "Heartbeat"}));
    EXPECT_EQ(*wire::find(reader.said[1].fields, "Count"), wire::Value(2));
}

TEST(SilionDevice, GenerationOneWaitsALittleBeforeItsFirstByte) {
    Reader reader(Given{{"generation", "1"}}, false);
    reader.connects();
    reader.waits(99ms);
    EXPECT_EQ(reader.says(), Names{});
    reader.waits(5s);
    EXPECT_EQ(reader.says(), Names{"Heartbeat"});
}

TEST(SilionDevice, GathersReadsAndAsksForAnAcknowledgement) {
    Reader reader;
    reader.connects();
    reader.says();
    reader.waits(2s);
    ASSERT_EQ(reader.says(), Names{"TagUpload"});
    EXPECT_EQ(*wire::find(reader.said[0].header, "flags"), wire::Value(1));
    auto list = *wire::find(reader.said[0].fields, "Tags")->get<wire::Value::List>();
    ASSERT_EQ(list.size(), 1u);
    auto record = *list[0].get<wire::Fields>();
    EXPECT_EQ(*wire::find(record, "Antenna"), wire::Value(1));
    EXPECT_EQ(*wire::find(record, "ReadCount"), wire::Value(static_cast<std::int64_t>(reader.air.heard)));
    EXPECT_GE(reader.air.heard, 2u);
    EXPECT_EQ(*wire::find(record, "Rssi"), wire::Value(-40));
}

TEST(SilionDevice, WithoutAcknowledgementsItGoesOn) {
    Reader reader(Given{{"ack", "false"}, {"heartbeat", "60s"}});
    reader.connects();
    reader.says();
    reader.waits(6s);
    EXPECT_EQ(reader.says(), (Names{"TagUpload", "TagUpload", "TagUpload"}));
    EXPECT_EQ(*wire::find(reader.said[0].header, "flags"), wire::Value(0));
}

TEST(SilionDevice, WhileItWaitsItRepeatsTheFrameAndSendsNothingElse) {
    Reader reader;
    reader.connects();
    reader.waits(2s);
    reader.says();
    auto first = reader.said.at(1);
    reader.does("input 1=1");
    reader.does("error 11");
    reader.waits(20s);  // two heartbeats would have been due
    EXPECT_EQ(reader.says(), (Names{"TagUpload", "TagUpload", "TagUpload", "TagUpload"}));
    EXPECT_EQ(reader.said[3], first);
    EXPECT_EQ(reader.state("resent"), 4);
    reader.gets("EE0000001601");
    EXPECT_EQ(reader.says(), Names{"GetGpi"}) << "commands are answered all the same";
    reader.gets(ack);
    EXPECT_EQ(reader.says(), (Names{"Heartbeat", "Fault", "GpiUpload"})) << "faulty: no tags";
    EXPECT_EQ(reader.state("acks"), 1);
    reader.does("clear");
    EXPECT_EQ(reader.says(), Names{"TagUpload"}) << "what was gathered meanwhile";
}

TEST(SilionDevice, AnAcknowledgementNobodyWaitsForIsIgnored) {
    Reader reader({}, false);
    reader.connects();
    reader.gets(ack);
    EXPECT_EQ(reader.state("acks"), 0);
}

TEST(SilionDevice, TheUnacknowledgedFrameGoesFirstOnANewConnection) {
    Reader reader;
    reader.connects();
    reader.waits(2s);
    reader.says();
    auto frame = reader.said.at(1);
    reader.device.link_lost(reader.now);
    reader.waits(30s);
    reader.connects();
    ASSERT_EQ(reader.says(), Names{"TagUpload"});
    EXPECT_EQ(reader.said[0], frame);
}

TEST(SilionDevice, GoesOnReadingWhileNobodyIsConnectedAndDropsTheOldestWhenFull) {
    Reader reader(Given{{"buffer", "10"}});
    reader.waits(60s);
    EXPECT_EQ(reader.state("buffered"), 10);
    EXPECT_EQ(reader.state("dropped"), 20);
}

TEST(SilionDevice, AReadCountNeverWraps) {
    Reader reader(Given{{"batch", "120s"}, {"heartbeat", "600s"}}, false);
    reader.air.tags.push_back({epc("AB"), 1, -400, 50ms});
    reader.connects();
    reader.says();
    reader.waits(120s);
    ASSERT_EQ(reader.says(), Names{"TagUpload"});
    std::int64_t reads = 0;
    for (auto& item : *wire::find(reader.said[0].fields, "Tags")->get<wire::Value::List>())
        reads += *wire::find(*item.get<wire::Fields>(), "ReadCount")->get<std::int64_t>();
    EXPECT_GT(reads, 256);
    EXPECT_EQ(reads, static_cast<std::int64_t>(reader.air.heard));
}

TEST(SilionDevice, ReadsBankDataWhenToldTo) {
    Reader reader(Given{{"bank_words", "3"}});
    reader.connects();
    reader.waits(2s);
    reader.says();
    auto list = *wire::find(reader.said.at(1).fields, "Tags")->get<wire::Value::List>();
    EXPECT_EQ(*wire::find(*list.at(0).get<wire::Fields>(), "BankData"), wire::Value(hex("E2E3E4E5E6E7")));
}

TEST(SilionDevice, ManyTagsFillSeveralFramesOfARealReadersSize) {
    for (auto generation : {"1", "2"}) {
        Reader reader(
            Given{{"generation", generation}, {"ack", "false"}, {"batch", "2s"}, {"heartbeat", "60s"}},
            false);
        for (int i = 0; i < 200; ++i) {
            auto id = epc("E20041453116003820703F00");
            id.data[11] = static_cast<std::uint8_t>(i);
            reader.air.tags.push_back({id, 1, -400, 100ms});
        }
        reader.connects();
        reader.waits(9s);
        reader.device.time_passed(reader.now);
        auto bytes = take_output(reader.device);
        std::size_t tags = 0;
        for (ByteView rest = bytes; !rest.empty();) {
            auto decoded = codec().decode(rest, wire::Direction::to_host, true);
            ASSERT_TRUE(decoded.message);
            EXPECT_LE(decoded.length, std::string(generation) == "1" ? 384u : 1580u);
            if (auto* list = wire::find(decoded.message->fields, "Tags"))
                tags += list->get<wire::Value::List>()->size();
            rest = rest.subspan(decoded.length);
        }
        EXPECT_GE(tags, 200u);
    }
}

TEST(SilionDevice, SaysAtOnceThatATagIsThereWhenToldTo) {
    Reader reader(Given{{"first_seen", "true"}, {"ack", "false"}});
    reader.connects();
    reader.waits(1900ms);
    EXPECT_EQ(reader.says(), (Names{"Heartbeat", "TagFirstSeen"}));
    reader.waits(6s);
    EXPECT_EQ(reader.says(), (Names{"TagUpload", "TagUpload", "TagUpload"}));
}

TEST(SilionDevice, SetsOutputsAndTurnsThemBack) {
    Reader reader({}, false);
    reader.connects();
    reader.says();
    reader.gets("EE000004170101010107");
    EXPECT_EQ(reader.says(), Names{"SetGpo"}) << "generation 2 answers at once";
    EXPECT_EQ(reader.text("outputs"), "10000");
    reader.gets("EE000004170101020100");
    reader.says();
    EXPECT_EQ(reader.status(), 16) << "a timed output is still running";
    reader.waits(7s);
    EXPECT_EQ(reader.text("outputs"), "00000");
    reader.gets(
        "EE00000417010102"
        "0100");
    reader.says();
    EXPECT_EQ(reader.status(), 0);
    reader.waits(300s);
    EXPECT_EQ(reader.text("outputs"), "01000");
}

TEST(SilionDevice, GenerationOneAnswersWhenTheTimeIsOverAndIsSilentUntilThen) {
    Reader reader(Given{{"generation", "1"}, {"ack", "false"}, {"heartbeat", "1s"}});
    reader.connects();
    reader.waits(6s);
    reader.says();
    reader.gets(
        "EE000004170101010107"
        "EE0000001601");
    reader.waits(6999ms);
    EXPECT_EQ(reader.says(), Names{});
    reader.waits(1ms);
    auto names = reader.says();
    ASSERT_GE(names.size(), 2u);
    EXPECT_EQ(names[0], "SetGpo");
    EXPECT_EQ(names[1], "GetGpi") << "what came meanwhile was kept";
    EXPECT_EQ(reader.text("outputs"), "0000");
}

TEST(SilionDevice, TwoHundredFiftyFiveSecondsMeanForEverToGenerationOneOnly) {
    for (auto [generation, after] : {std::pair{"1", "1000"}, {"2", "00000"}}) {
        Reader reader(Given{{"generation", generation}}, false);
        reader.connects();
        reader.gets("EE0000041701010101FF");
        reader.waits(256s);
        EXPECT_EQ(reader.text("outputs"), after);
    }
}

TEST(SilionDevice, RefusesWrongOutputsInItsOwnCoding) {
    for (auto [generation, status] : {std::pair{"1", 100007}, {"2", 7}})
        for (auto text : {"EE000001170100", "EE000004170101060100", "EE000004170101010200",
                          "EE000004170102010100", "EE0000001701"}) {
            Reader reader(Given{{"generation", generation}}, false);
            reader.connects();
            reader.waits(6s);
            reader.says();
            reader.gets(text);
            reader.says();
            EXPECT_EQ(reader.status(), status) << text;
        }
    Reader two({}, false);
    two.connects();
    two.says();
    two.gets("EE000007170102010100010000");
    two.says();
    EXPECT_EQ(two.status(), 7) << "generation 2 wants each output once";
}

TEST(SilionDevice, GenerationTwoChecksTheChecksumOfACommandAndAnswersWithOne) {
    Reader reader({}, false);
    reader.connects();
    reader.says();
    reader.gets("EE0000001602FFFF");
    EXPECT_EQ(reader.says(), Names{});
    reader.gets("EE000000160298F4");
    ASSERT_EQ(reader.says(), Names{"GetGpi"});
    EXPECT_EQ(*wire::find(reader.said[0].header, "flags"), wire::Value(2));
}

TEST(SilionDevice, UnknownCommandsAreIgnoredSilently) {
    Reader reader({}, false);
    reader.connects();
    reader.says();
    reader.gets(
        "EE0000001401"
        "EE00000302010203");
    EXPECT_EQ(reader.says(), Names{});
}

TEST(SilionDevice, RestartsAfterItsAnswerAndLosesItsMemory) {
    for (auto [generation, delay] : {std::pair{"1", 1500ms}, {"2", 400ms}}) {
        Reader reader(Given{{"generation", generation}, {"batch", "1s"}});
        reader.connects();
        reader.waits(8s);
        reader.gets(
            "EE0000041701010401"
            "00");
        reader.says();
        EXPECT_EQ(reader.state("waiting_for_ack"), 1);
        reader.gets("EE0000001801");
        EXPECT_EQ(reader.says(), Names{"Restart"});
        reader.waits(delay - 1ms);
        EXPECT_FALSE(reader.device.finished());
        reader.waits(1ms);
        EXPECT_TRUE(reader.device.finished());
        reader.device.link_lost(reader.now);
        EXPECT_GT(reader.state("lost_at_restart"), 0);
        EXPECT_EQ(reader.state("buffered"), 0);
        EXPECT_EQ(reader.state("waiting_for_ack"), 0);
        EXPECT_EQ(reader.text("outputs").find('1'), std::string::npos);
        auto dial = reader.device.dial_at();
        ASSERT_TRUE(dial);
        EXPECT_EQ(*dial, reader.now.steady + 3s);
        reader.waits(3s);
        reader.connects();
        reader.waits(5s);
        ASSERT_FALSE(reader.says().empty());
        EXPECT_EQ(*wire::find(reader.said[0].fields, "Count"), wire::Value(0)) << "it counts from 0 again";
    }
}

TEST(SilionDevice, RaisesFaultsInItsGenerationsWay) {
    Reader one(Given{{"generation", "1"}}, false);
    one.connects();
    one.waits(6s);
    one.says();
    one.does("error 12");
    ASSERT_EQ(one.says(), Names{"Fault"});
    EXPECT_EQ(one.status(), 100012);
    EXPECT_EQ(*wire::find(one.said[0].fields, "Text"), wire::text_value(Bytes(24, 0)));
    one.waits(10s);
    EXPECT_EQ(one.says(), Names{"Heartbeat"});
    EXPECT_EQ(one.status(), 100012);
    Reader two({}, false);
    two.connects();
    two.says();
    two.does("error 12");
    two.says();
    EXPECT_EQ(*wire::find(two.said.at(0).fields, "Text"),
              wire::Value(std::string("alarm: temperature too high")));
}

TEST(SilionDevice, MisbehavesOnDemand) {
    Reader reader(Given{{"heartbeat", "1h"}});
    reader.connects();
    reader.waits(2s);
    reader.says();
    auto frame = reader.said.at(1);
    reader.does("duplicate");
    ASSERT_EQ(reader.says(), Names{"TagUpload"});
    EXPECT_EQ(reader.said[0], frame);
    reader.does("stuck_ack on");
    reader.gets(ack);
    EXPECT_EQ(reader.state("waiting_for_ack"), 1);
    reader.does("stuck_ack off");
    reader.does("bad_crc");
    reader.waits(5s);
    auto names = reader.says();
    ASSERT_EQ(names.size(), 1u);
    EXPECT_NE(names[0].find("bad checksum"), std::string::npos);
    reader.waits(5s);
    EXPECT_EQ(reader.says(), Names{"TagUpload"}) << "the copy in its memory is good";
    reader.does("garbage");
    EXPECT_EQ(take_output(reader.device).size(), 64u);
    reader.does("half_open on");
    reader.gets("EE0000001601");
    reader.waits(60s);
    EXPECT_TRUE(reader.device.output().empty());
    reader.does("half_open off");
    reader.does("drop");
    EXPECT_TRUE(reader.device.finished());
    reader.device.link_lost(reader.now);
    EXPECT_EQ(reader.device.dial_at(), reader.now.steady + 2s);
    EXPECT_EQ(reader.state("waiting_for_ack"), 1) << "a cut cable costs it no memory";
}

TEST(SilionDevice, RefusesUnknownFaultsWithTheListOfThoseKnown) {
    Reader reader;
    for (auto text :
         {"explode", "", "error", "error x", "error 0", "input 5=1", "input 1=2", "input", "stuck_ack yes"}) {
        auto done = reader.device.inject(text, reader.now);
        ASSERT_FALSE(done) << text;
        EXPECT_FALSE(done.error().hint.empty()) << text;
    }
    EXPECT_NE(reader.device.inject("explode", reader.now).error().hint.find("half-open"), std::string::npos);
}

TEST(SilionDevice, InputsAreSentWhenTheyChange) {
    Reader reader({}, false);
    reader.connects();
    reader.says();
    reader.does("input 3=1");
    EXPECT_EQ(reader.says(), Names{"GpiUpload"});
    reader.does("input 3=1");
    EXPECT_EQ(reader.says(), Names{});
    EXPECT_EQ(reader.text("inputs"), "0010");
}

TEST(SilionDevice, SurvivesAnyBytes) {
    for (auto generation : {"1", "2"}) {
        Reader reader(Given{{"generation", generation}, {"batch", "1s"}});
        reader.connects();
        std::uint64_t state = 88172645463325252u;
        for (int i = 0; i < 2000; ++i) {
            Bytes noise(1 + state % 40);
            for (auto& byte : noise) {
                state = state * 6364136223846793005u + 1442695040888963407u;
                byte = static_cast<std::uint8_t>(state >> 56);
                if ((state >> 40 & 3) == 0) byte = 0xEE;
                if ((state >> 40 & 3) == 1) byte = 0x00;
            }
            reader.device.received(noise, reader.now);
            if (i % 50 == 0) reader.waits(500ms);
            ASSERT_LT(take_output(reader.device).size(), 1'000'000u);
        }
    }
}

TEST(SilionDevice, WithoutANameItHasOneOfTheVendorsKind) {
    TestAir air;
    SilionDevice device({"", 0x4C77, device_with()}, air);
    auto fields = device.state();
    EXPECT_EQ(*wire::find(fields, "name"), wire::Value(std::string("0826ae104c77")));
}

}  // namespace gantry::silion::test
