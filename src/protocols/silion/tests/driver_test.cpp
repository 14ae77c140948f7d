#include "protocols/silion/driver.hpp"

#include "support.hpp"

namespace gantry::silion::test {

using testkit::gets;
using testkit::Script;
using testkit::sends;
using testkit::waits;

TEST(SilionDriver, TheNameInTheFirstFrameSaysWhoItIs) {
    Ours ours;
    ours.gets(heartbeat_0);
    ASSERT_FALSE(ours.signals.empty());
    EXPECT_EQ(std::get<Identified>(ours.signals[0]).name, "silion");
    Ours hostile;
    hostile.gets("FF03000017000000000000FF0A");
    EXPECT_EQ(std::get<Identified>(hostile.signals.at(0)).name, std::string("\x00\xFF\x0A", 3));
    Ours nameless;
    nameless.gets("FF000009160000000000040101020003010401");
    EXPECT_EQ(std::get<Identified>(nameless.signals.at(0)).name, "");
}

TEST(SilionDriver, HoldsEverythingUntilItIsAdmitted) {
    Ours ours;
    ours.let_in = false;
    auto bytes = hex(tags_a);
    auto more = hex(tags_b);
    bytes.insert(bytes.end(), more.begin(), more.begin() + 10);
    ours.gets_bytes(bytes);
    EXPECT_EQ(ours.signals.size(), 1u);
    EXPECT_TRUE(ours.reports.empty());
    EXPECT_FALSE(ours.driver.wants_input());
    auto arrived = ours.now;
    ours.waits(40s);
    EXPECT_FALSE(ours.driver.finished()) << "the host decides; nobody is silent";
    ours.gets_bytes(ByteView(more).subspan(10));
    ours.driver.admitted({}, ours.now);
    ours.collect();
    ASSERT_EQ(ours.reports.size(), 1u);
    EXPECT_EQ(ours.reports[0].observations.size(), 4u);
    EXPECT_EQ(ours.reports[0].received.steady, arrived.steady);
    EXPECT_TRUE(ours.driver.wants_input());
    ours.commits();
    EXPECT_EQ(ours.says(), std::string(ack) + std::string(ack));
}

TEST(SilionDriver, AFirstFrameThatWasHeldLongIsStillFirst) {
    Ours ours;
    ours.let_in = false;
    ours.gets(tags_a);
    ours.waits(20s);  // the old connection's reports were being written
    Known known;
    known.mark = Digest::of(hex(tags_a)).mark();
    ours.driver.admitted(known, ours.now);
    ours.collect();
    EXPECT_EQ(ours.count(Count::repeats), 1u);
    EXPECT_EQ(ours.says(), ack);
}

TEST(SilionDriver, SendingTooMuchBeforeBeingLetInEndsTheConnection) {
    Ours ours;
    ours.let_in = false;
    ours.gets(heartbeat_0);
    for (int i = 0; i < 5 && !ours.driver.finished(); ++i)
        ours.gets_bytes(Bytes(50'000, 0xFF));
    EXPECT_TRUE(ours.driver.finished());
    EXPECT_EQ(ours.driver.finish_reason(), "the reader sent too much before it was let in");
}

TEST(SilionDriver, ReportsTagsWithEverythingTheReaderSaid) {
    Ours ours;
    ours.gets("FF06001A01000000000073696C696F6E000104C8FB050C3034257BF7194E4000001A8506E28011052000");
    ASSERT_EQ(ours.reports.size(), 1u);
    auto& report = ours.reports[0];
    EXPECT_EQ(report.ticket, 1u);
    EXPECT_EQ(report.received.wall, ours.now.wall);
    ASSERT_EQ(report.observations.size(), 1u);
    EXPECT_EQ(report.observations[0].tag, epc("3034257BF7194E4000001A85"));
    EXPECT_EQ(to_hex(report.data), "E28011052000");
    EXPECT_EQ(ours.count(Count::reads), 200u);
    EXPECT_EQ(plugin.antenna_name(report.observations[0].antenna), "Ant4");
}

TEST(SilionDriver, FramesWithoutTheFlagAreReportedButNotAcknowledged) {
    Ours ours;
    ours.gets(tags_plain);
    ours.gets("FF06001403000000000073696C696F6E00010201D8050CE20041453116003820703FB700");  // first seen
    EXPECT_EQ(ours.tags(), 4u);
    ours.commits();
    EXPECT_EQ(ours.says(), "");
}

TEST(SilionDriver, AFirstSeenFrameThatAsksIsAcknowledgedLikeAnyOther) {
    Ours ours;
    ours.gets("FF06001403010000000073696C696F6E00010201D8050CE20041453116003820703FB700");
    ours.commits();
    EXPECT_EQ(ours.says(), ack);
}

TEST(SilionDriver, OnlyTagFramesAreEverAcknowledged) {
    Ours ours;
    for (auto text : {"FF06000902010000000073696C696F6E040101020003010401",        // inputs with the flag
                      "FF06000C04010000000073696C696F6E010A0A000000010200000000",  // heartbeat
                      "FF0600000501000186AB73696C696F6E"}) {                       // fault
        ours.gets(text);
        ours.commits();
    }
    EXPECT_EQ(ours.says(), "");
}

TEST(SilionDriver, AFrameWithoutTagsIsFineAndMakesNoReport) {
    Ours ours;
    ours.gets(no_tags);
    EXPECT_TRUE(ours.reports.empty());
    ours.gets(tags_plain);
    EXPECT_EQ(ours.reports.at(0).ticket, 1u) << "tickets grow by one";
}

TEST(SilionDriver, AnswersWithAChecksumExactlyWhenTheReaderUsesOne) {
    Ours ours;
    Bytes with;
    append_to_host(with, 1, flag_answer | flag_crc, 0, as_bytes("silion"), hex("0000"), CrcKind::modbus);
    ours.gets_bytes(with);
    ours.commits();
    EXPECT_EQ(ours.says(), "EE00000001029704");
    ours.driver.run({.id = 1, .deadline = ours.now.steady + 5s}, GetInputs{}, ours.now);
    auto said = hex(ours.says());
    EXPECT_EQ(said.size(), 8u);
    EXPECT_EQ(said[5], flag_answer | flag_crc);
    ours.gets(tags_b);
    ours.commits();
    EXPECT_EQ(ours.says(), ack);
}

TEST(SilionDriver, FollowsTheChecksumSetting) {
    struct Case {
        std::string_view setting;
        CrcKind sent;
        bool taken;
    };
    for (auto [setting, kind, taken] : {Case{"modbus", CrcKind::modbus, true},
                                        {"modbus", CrcKind::modbus_swapped, false},
                                        {"modbus-swapped", CrcKind::modbus_swapped, true},
                                        {"ccitt", CrcKind::ccitt, true},
                                        {"ccitt", CrcKind::modbus, false},
                                        {"auto", CrcKind::ccitt, true},
                                        {"off", CrcKind::ccitt, true}}) {
        SCOPED_TRACE(setting);
        Ours ours(Given{{"crc", std::string(setting)}});
        Bytes frame;
        append_to_host(frame, 1, flag_answer | flag_crc, 0, as_bytes("silion"), hex("0000"), kind);
        ours.gets_bytes(frame);
        EXPECT_EQ(ours.count(Count::frames), taken ? 1u : 0u);
        EXPECT_EQ(ours.count(Count::bad_checksum), taken ? 0u : 1u);
        if (!taken || setting == "off") continue;
        ours.commits();
        Bytes expected;
        append_to_reader(expected, 1, flag_crc, {}, kind);
        EXPECT_EQ(ours.says(), to_hex(expected));
    }
}

TEST(SilionDriver, AMalformedTagFrameIsDeliveredKeptAndThenAcknowledged) {
    std::string_view bad = "FF06000E01010000000073696C696F6E00020201D80502ABCD000201D805";
    Ours ours;
    ours.gets(bad);
    ASSERT_EQ(ours.reports.size(), 1u);
    auto& report = ours.reports[0];
    ASSERT_EQ(report.observations.size(), 1u);
    EXPECT_EQ(report.observations[0].tag, epc("ABCD"));
    ASSERT_EQ(report.notices.size(), 1u);
    auto& fault = std::get<FaultNotice>(report.notices[0]);
    EXPECT_EQ(fault.code, fault_malformed);
    EXPECT_EQ(to_hex(fault.bytes), bad);
    EXPECT_NE(fault.text.find("record 2 of the tags is cut off"), std::string::npos) << fault.text;
    EXPECT_EQ(ours.count(Count::malformed), 1u);
    EXPECT_FALSE(ours.driver.finished());
    EXPECT_EQ(ours.says(), "");
    ours.commits();
    EXPECT_EQ(ours.says(), ack);
}

TEST(SilionDriver, AnIdThatCannotBeIsKeptAsAFaultAndNeverShortened) {
    Ours ours;
    ours.gets(
        "FF06000F01000000000073696C696F6E00020201D8050000"
        "0201D80501AA00");
    ASSERT_EQ(ours.reports.size(), 1u);
    EXPECT_EQ(ours.reports[0].observations.size(), 1u);
    EXPECT_EQ(std::get<FaultNotice>(ours.reports[0].notices.at(0)).text,
              "1 tags with an empty or too long EPC");
}

TEST(SilionDriver, FramesOfOnePieceShareOneReportInTheirOrder) {
    Ours ours;
    Bytes all;
    for (auto text : {tags_a, tags_b, inputs_1011, tags_plain}) {
        auto frame = hex(text);
        all.insert(all.end(), frame.begin(), frame.end());
    }
    ours.gets_bytes(all);
    ASSERT_EQ(ours.reports.size(), 2u);
    EXPECT_EQ(ours.reports[0].observations.size(), 4u);
    EXPECT_EQ(ours.reports[0].notices.size(), 4u);
    EXPECT_EQ(ours.reports[1].observations.size(), 3u) << "tags behind a notice are a report of their own";
    ours.driver.committed(1, ours.now);
    EXPECT_EQ(ours.says(), std::string(ack) + std::string(ack));
}

TEST(SilionDriver, AHeartbeatDescribesTheReaderOnceUntilItChanges) {
    Ours ours;
    auto described = [&] {
        std::vector<Described> all;
        for (auto& signal : ours.signals)
            if (auto* each = std::get_if<Described>(&signal)) all.push_back(*each);
        return all;
    };
    ours.gets(heartbeat_0);
    ours.gets(heartbeat_1);
    ASSERT_EQ(described().size(), 1u);
    EXPECT_EQ(described()[0].model, "SLR1100");
    EXPECT_EQ(described()[0].firmware, "10.0.0.0");
    EXPECT_EQ(described()[0].detail, "main board Arm7, antennas 2");
    ours.gets("FF06000B04000000000073696C696F6E012C0A00000F0000000005");
    ASSERT_EQ(described().size(), 2u);
    EXPECT_EQ(described()[1].model, "module type 44");
    EXPECT_EQ(described()[1].detail, "main board Arm7");
}

TEST(SilionDriver, AHeartbeatCountThatFallsShowsARestart) {
    Ours ours;
    ours.gets(heartbeat_1);
    ours.gets(inputs_1011);
    ours.gets(heartbeat_0);
    ASSERT_EQ(ours.reports.size(), 2u);
    EXPECT_EQ(std::get<FaultNotice>(ours.reports[1].notices.at(0)).code, fault_restarted);
    ours.gets(inputs_1011);
    ASSERT_EQ(ours.reports.size(), 3u);
    EXPECT_EQ(ours.reports[2].notices.size(), 4u) << "all inputs anew";
}

TEST(SilionDriver, AHeartbeatThatCannotBeReadIsCountedAndStillHeard) {
    Ours ours;
    ours.gets("FF0600030400000186AB73696C696F6E010A0A");
    EXPECT_EQ(ours.count(Count::malformed), 1u);
    EXPECT_EQ(std::get<FaultNotice>(ours.reports.at(0).notices.at(0)).code, 11);
}

TEST(SilionDriver, AFaultIsToldOncePerChangeOfState) {
    Ours ours;
    ours.gets(heartbeat_0);
    ours.gets(fault_11);
    ours.gets(heartbeat_fault_11);
    ours.gets(heartbeat_fault_11);
    ASSERT_EQ(ours.reports.size(), 1u);
    auto& fault = std::get<FaultNotice>(ours.reports[0].notices.at(0));
    EXPECT_EQ(fault.code, 11);
    EXPECT_EQ(fault.text, "alarm: no antennas connected");
    ours.gets(heartbeat_1);
    ASSERT_EQ(ours.reports.size(), 2u);
    EXPECT_EQ(std::get<FaultNotice>(ours.reports[1].notices.at(0)).code, fault_over);
    ours.gets(
        "FF0600180500000001867"
        "3696C696F6E000000000000000000000000000000000000000000000000");
    ASSERT_EQ(ours.reports.size(), 3u);
    EXPECT_EQ(std::get<FaultNotice>(ours.reports[2].notices.at(0)).text, "unknown status 0x00000186");
}

TEST(SilionDriver, AFaultWhoseWordsSayWhatItsNumberSaysIsToldOnce) {
    Ours ours;
    ours.gets(heartbeat_0);
    ours.gets(heartbeat_fault_11);
    ours.gets(
        "FF06001C0500000186AB73696C696F6E"
        "616C61726D3A206E6F20616E74656E6E617320636F6E6E6563746564");  // "alarm: no antennas connected"
    ASSERT_EQ(ours.reports.size(), 1u);
    EXPECT_EQ(std::get<FaultNotice>(ours.reports[0].notices.at(0)).text, "alarm: no antennas connected");
}

TEST(SilionDriver, AFaultsOwnWordsAreMadePrintable) {
    Ours ours;
    ours.gets(
        "FF0600050500000186AC73696C696F6E"
        "746F6F1B68");  // "too" ESC "h"
    auto& fault = std::get<FaultNotice>(ours.reports.at(0).notices.at(0));
    EXPECT_EQ(fault.code, 12);
    EXPECT_EQ(fault.text, "alarm: temperature too high: too\\x1Bh");
}

TEST(SilionDriver, OnlyInputsThatChangedAreReported) {
    Ours ours;
    ours.gets(inputs_1011);
    ASSERT_EQ(ours.reports.size(), 1u);
    ASSERT_EQ(ours.reports[0].notices.size(), 4u);
    EXPECT_TRUE(std::get<InputNotice>(ours.reports[0].notices[0]).state);
    EXPECT_FALSE(std::get<InputNotice>(ours.reports[0].notices[1]).state);
    ours.gets(inputs_1011);
    EXPECT_EQ(ours.reports.size(), 1u);
    ours.gets(inputs_1001);
    ASSERT_EQ(ours.reports.size(), 2u);
    ASSERT_EQ(ours.reports[1].notices.size(), 1u);
    auto& input = std::get<InputNotice>(ours.reports[1].notices[0]);
    EXPECT_EQ(input.input, 3);
    EXPECT_FALSE(input.state);
    ours.gets("FF06000302000000000073696C696F6E040101");  // four inputs, one there
    EXPECT_EQ(ours.count(Count::malformed), 1u);
}

TEST(SilionDriver, UnknownCommandsAreCountedAndIgnored) {
    Ours ours;
    ours.gets(heartbeat_0);
    ours.gets("FF06000006000000000073696C696F6E");
    ours.gets("FF06000242000000000073696C696F6E0102");
    EXPECT_EQ(ours.count(Count::unknown_code), 2u);
    EXPECT_TRUE(ours.reports.empty());
    EXPECT_EQ(ours.says(), "");
    EXPECT_FALSE(ours.driver.finished());
}

TEST(SilionDriver, AnotherNameOnTheSameConnectionEndsIt) {
    Ours ours;
    ours.gets(heartbeat_0);
    ours.gets("FF000009160000000000040101020003010401");  // gen 2 leaves its name out of some answers
    EXPECT_FALSE(ours.driver.finished());
    ours.gets(
        "FF04000201010000000074686561"
        "0000");
    EXPECT_TRUE(ours.driver.finished());
    EXPECT_EQ(ours.driver.finish_reason(), "the reader changed its name from \"silion\" to \"thea\"");
    EXPECT_TRUE(ours.reports.empty());
}

TEST(SilionDriver, MoreThanItsShareOfOpenTicketsStallsItAndStalledIsNotSilent) {
    Ours ours;
    for (std::size_t i = 0; i < SilionDriver::max_open_tickets; ++i) {
        EXPECT_FALSE(ours.driver.stalled());
        ours.gets(tags_plain);
    }
    EXPECT_TRUE(ours.driver.stalled());
    EXPECT_FALSE(ours.driver.wants_input());
    ours.waits(10min);
    EXPECT_FALSE(ours.driver.finished());
    ours.driver.committed(1, ours.now);
    EXPECT_FALSE(ours.driver.stalled());
    EXPECT_TRUE(ours.driver.wants_input());
    ours.waits(29s);
    EXPECT_FALSE(ours.driver.finished()) << "silence counts from now on";
    ours.waits(1s);
    EXPECT_TRUE(ours.driver.finished());
}

TEST(SilionDriver, ThreeHeartbeatsWithoutAFrameEndTheConnection) {
    Ours ours(Given{{"heartbeat", "2s"}});
    ours.gets(heartbeat_0);
    ours.waits(5999ms);
    ours.gets(heartbeat_1);
    ours.waits(5999ms);
    EXPECT_FALSE(ours.driver.finished());
    ours.waits(1ms);
    EXPECT_TRUE(ours.driver.finished());
    EXPECT_EQ(ours.driver.finish_reason(), "no frame for 6.0 s, three heartbeat periods");
    EXPECT_FALSE(ours.driver.deadline());
}

TEST(SilionDriver, ADribbleIsSilence) {
    Ours ours;
    ours.gets(heartbeat_0);
    auto frame = hex(tags_a);
    for (std::size_t i = 0; i < 4 && !ours.driver.finished(); ++i) {
        ours.waits(9s);
        ours.gets_bytes(ByteView(frame).subspan(i, 1));
    }
    EXPECT_TRUE(ours.driver.finished());
}

TEST(SilionDriver, SaysWhatCameInsteadOfAReader) {
    Ours silent;
    silent.waits(30s);
    EXPECT_TRUE(silent.driver.finished());
    EXPECT_EQ(silent.driver.finish_reason(), "the peer said nothing for 30 s");
    Ours http;
    http.gets_bytes(as_bytes("GET / HTTP/1.1\r\n\r\n"));
    EXPECT_FALSE(http.driver.finished());
    http.waits(30s);
    EXPECT_TRUE(http.driver.finished());
    EXPECT_EQ(
        http.driver.finish_reason(),
        "no Silion frame within 30 s: the connection began with \"GET / HTTP/1.1\\x0D\\x0A\\x0D\\x0A\"");
    Ours flood(Given{{"identify_within", "5s"}});
    flood.gets_bytes(Bytes(5000, 'x'));
    EXPECT_TRUE(flood.driver.finished());
    EXPECT_NE(flood.driver.finish_reason().find("no Silion reader"), std::string_view::npos);
    EXPECT_EQ(flood.count(Count::skipped_bytes), 5000u);
    Ours impatient;
    impatient.gets_bytes(as_bytes("GET / HTTP/1.1\r\n\r\n"));
    impatient.driver.link_lost(impatient.now);
    EXPECT_EQ(impatient.driver.finish_reason(),
              "no Silion frame: the connection began with \"GET / HTTP/1.1\\x0D\\x0A\\x0D\\x0A\"");
}

TEST(SilionDriver, LosingStepThriceEndsTheConnection) {
    Ours ours;
    auto bad = hex("FF06000C04020000000073696C696F6E010A0A0000000102000000001234");
    ours.gets(heartbeat_0);
    for (int i = 0; i < 3; ++i) {
        EXPECT_FALSE(ours.driver.finished());
        ours.gets_bytes(bad);
        if (i < 2) ours.gets(heartbeat_1);
    }
    EXPECT_TRUE(ours.driver.finished());
    EXPECT_EQ(ours.count(Count::bad_checksum), 3u);
    EXPECT_EQ(ours.count(Count::resyncs), 3u);
    ours.gets(tags_a);
    EXPECT_TRUE(ours.reports.empty()) << "what comes after the end is not taken";
}

TEST(SilionDriver, TooManyBytesWithoutAFrameEndTheConnection) {
    Ours ours;
    ours.gets(heartbeat_0);
    for (int i = 0; i < 70 && !ours.driver.finished(); ++i)
        ours.gets_bytes(Bytes(1000, 0x41));
    EXPECT_TRUE(ours.driver.finished());
    EXPECT_NE(ours.driver.finish_reason().find("bytes without a frame"), std::string_view::npos);
}

TEST(SilionDriver, CountsBytesAndFrames) {
    Ours ours;
    ours.gets(heartbeat_0);
    ours.gets(tags_a);
    EXPECT_EQ(ours.count(Count::bytes), hex(heartbeat_0).size() + hex(tags_a).size());
    EXPECT_EQ(ours.count(Count::frames), 2u);
    EXPECT_EQ(ours.count(Count::reads), 3u);
}

TEST(SilionDriver, PiecesChangeNothing) {
    Bytes all;
    for (auto text : {heartbeat_0, tags_a, inputs_1011, fault_11, tags_b}) {
        auto frame = hex(text);
        all.insert(all.end(), frame.begin(), frame.end());
    }
    testkit::for_each_split(all, [&](const std::vector<ByteView>& pieces) {
        Ours ours;
        for (auto piece : pieces)
            ours.gets_bytes(piece);
        ours.commits();
        EXPECT_EQ(ours.says(), std::string(ack) + std::string(ack));
        EXPECT_EQ(ours.tags(), 4u);
        std::size_t notices = 0;
        for (auto& report : ours.reports)
            notices += report.notices.size();
        EXPECT_EQ(notices, 5u);
    });
}

TEST(SilionDriver, NothingIsSaidOnALostLink) {
    Ours ours;
    ours.gets(tags_a);
    ours.driver.link_lost(ours.now);
    ours.commits();
    EXPECT_EQ(ours.says(), "");
    EXPECT_TRUE(ours.driver.finished());
    EXPECT_EQ(ours.driver.finish_reason(), "") << "the link knows why";
}

// A dialog as data, so that it can be played with silence and garbage in place of each thing the reader says.
static Script usual_dialog() {
    auto admits =
        testkit::does([](Party& party, Now now) { dynamic_cast<SilionDriver&>(party).admitted({}, now); });
    auto commits = testkit::does([](Party& party, Now now) {
        auto& driver = dynamic_cast<SilionDriver&>(party);
        if (!driver.reports().empty()) driver.committed(driver.reports().back().ticket, now);
    });
    return {
        gets(heartbeat_0), admits,  gets(tags_a), sends(""), commits,           sends(ack), waits(2s),
        gets(tags_b),      commits, sends(ack),   waits(8s), gets(heartbeat_1), waits(5s),  gets(inputs_1011),
        sends("")};
}

TEST(SilionDriver, TheUsualDialog) {
    SilionDriver driver(driver_with());
    auto now = testkit::play(driver, usual_dialog());
    EXPECT_TRUE(testkit::ends_in_silence(driver, now));
}

TEST(SilionDriver, SurvivesEveryFrameMissing) {
    testkit::survives_every_reply_missing([] { return std::make_unique<SilionDriver>(driver_with()); },
                                          usual_dialog());
}

}  // namespace gantry::silion::test
