// Readers on a serial line: our end, theirs, and both.
#include "support.hpp"

namespace gantry::silion::test {

// Our end of a line that was just opened.
struct OnLine {
    explicit OnLine(Given settings = {}, Bytes mark = {})
        : driver(driver_with(std::move(settings)), LinkKind::serial) {
        driver.admitted({.mark = std::move(mark)}, now);
        driver.start(now);
    }
    void gets(ByteView bytes) {
        driver.received(bytes, now);
        collect();
    }
    void waits(std::chrono::microseconds time) {
        now = now + time;
        driver.time_passed(now);
        collect();
    }
    void collect() {
        for (auto& report : std::exchange(driver.reports(), {})) {
            for (auto& each : report.observations)
                reads += each.reads;
            driver.committed(report.ticket, now);
        }
        for (auto& signal : std::exchange(driver.signals(), {}))
            identified = identified || std::holds_alternative<Identified>(signal);
    }
    std::uint64_t count(Count which) const { return driver.counters()[static_cast<std::size_t>(which)]; }

    Now now = testkit::script_start;
    SilionDriver driver;
    std::uint64_t reads = 0;
    bool identified = false;
};

static Bytes tag_frame(CrcKind kind, std::string_view name = "silion") {
    Bytes frame;
    append_to_host(frame, 1, flag_answer | flag_crc, 0, as_bytes(name),
                   hex("00010201D8050CE20041453116003820703FB700"), kind);
    return frame;
}

TEST(SilionLine, WhoItIsIsKnownByTheLine) {
    OnLine ours;
    ours.gets(tag_frame(CrcKind::modbus, "any name"));
    EXPECT_EQ(ours.reads, 1u);
    EXPECT_FALSE(ours.identified);
}

TEST(SilionLine, ALineOpenedInTheMiddleOfAFrameIsReadFromTheNextOn) {
    for (auto kind : {CrcKind::modbus, CrcKind::modbus_swapped, CrcKind::ccitt}) {
        auto frame = tag_frame(kind);
        OnLine ours;
        ours.gets(ByteView(frame).last(20));
        ours.gets(frame);
        EXPECT_EQ(ours.reads, 1u);
        Bytes answer;
        append_to_reader(answer, 1, flag_crc, {}, kind);
        EXPECT_EQ(to_hex(take_output(ours.driver)), to_hex(answer)) << "the way it was found to compute it";
    }
}

TEST(SilionLine, BytesOneByOneAreFramesUnlessAPauseIsTooLong) {
    auto frame = tag_frame(CrcKind::modbus);
    OnLine ours(Given{{"identify_within", "2min"}});
    for (auto& byte : frame) {
        ours.waits(900ms);
        ours.gets({&byte, 1});
    }
    EXPECT_EQ(ours.reads, 1u);
    EXPECT_EQ(ours.count(Count::resyncs), 0u);
}

TEST(SilionLine, AFrameThatLostAByteIsGivenUpBeforeTheNextOneComes) {
    auto frame = tag_frame(CrcKind::modbus);
    auto shorter = frame;
    shorter.erase(shorter.begin() + 20);
    OnLine ours;
    ours.gets(shorter);
    ASSERT_TRUE(ours.driver.deadline());
    EXPECT_EQ(*ours.driver.deadline(), ours.now.steady + SilionDriver::character_gap);
    ours.waits(SilionDriver::character_gap);
    EXPECT_EQ(ours.count(Count::skipped_bytes), shorter.size());
    // Over TCP no byte is ever lost, and a slow sender is only slow.
    Ours tcp;
    tcp.gets_bytes(shorter);
    tcp.waits(5s);
    EXPECT_EQ(tcp.count(Count::skipped_bytes), 0u);
    ours.gets(frame);
    EXPECT_EQ(ours.reads, 1u);
}

TEST(SilionLine, WhatWasNotAcknowledgedComesAgainWhenTheReadersWaitIsOver) {
    auto frame = tag_frame(CrcKind::modbus);
    for (auto [wait, wanted] : {std::pair("15s", 0u), std::pair("5s", 1u)}) {
        OnLine ours({{"ack_wait", wait}}, Digest::of(frame).mark());
        ours.waits(14s);
        ours.gets(frame);
        EXPECT_EQ(ours.reads, wanted) << wait;
        EXPECT_EQ(ours.count(Count::acknowledged), 1u);
    }
}

// --- both --------------------------------------------------------------------------------------------------

static std::string first_crc(Given settings) {
    TestAir air;
    settings.emplace_back("serial", "true");
    SilionDevice device({"silion", 7, device_with(std::move(settings))}, air);
    auto now = testkit::script_start;
    device.power_on(now);
    device.start(now);
    for (int i = 0; i < 60 && device.output().empty(); ++i) {
        now = now + 100ms;
        device.time_passed(now);
    }
    auto frame = take_output(device);
    for (auto [kind, name] :
         {std::pair(CrcKind::modbus, "modbus"), std::pair(CrcKind::modbus_swapped, "swapped"),
          std::pair(CrcKind::ccitt, "ccitt")})
        if (auto look = look_at(frame, wire::Direction::to_host, CrcRule::only(kind));
            look.what == Look::What::frame && look.frame.has_crc())
            return name;
    return "none";
}

TEST(SilionLine, AVirtualReaderThereSendsAChecksum) {
    EXPECT_EQ(first_crc({}), "modbus");
    EXPECT_EQ(first_crc({{"generation", "1"}}), "swapped");
    EXPECT_EQ(first_crc({{"crc", "ccitt"}}), "ccitt");
    EXPECT_EQ(first_crc({{"crc", "off"}}), "none");
}

TEST(SilionLine, AVirtualReaderThatRestartsKeepsItsLine) {
    TestAir air;
    SilionDevice device({"silion", 7, device_with({{"serial", "true"}})}, air);
    auto now = testkit::script_start;
    device.power_on(now);
    device.start(now);
    EXPECT_FALSE(take_output(device).empty()) << "a heartbeat";
    ASSERT_TRUE(device.inject("reboot", now));
    EXPECT_FALSE(device.finished());
    device.received(hex("EE0000001601"), now);
    EXPECT_TRUE(device.output().empty()) << "nobody is there yet";
    now = now + 3s;
    device.time_passed(now);
    EXPECT_FALSE(take_output(device).empty()) << "a heartbeat";
}

}  // namespace gantry::silion::test
