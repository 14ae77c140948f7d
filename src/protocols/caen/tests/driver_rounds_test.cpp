#include "driver_support.hpp"

// Rounds of InventoryTag and RawReadIDs, and which way a reader is read.
namespace gantry::caen::driver_test {

static const std::string tag_a = "3074257BF7194E4000001A85", tag_b = "3074257BF7194E4000001A86";

static Bytes both(std::string_view point = "Ant0") {
    auto pairs = tag_pairs(tag_a, point);
    append_tag(pairs, tag_b, point);
    return pairs;
}

// --- rounds ------------------------------------------------------------------------------------------------

TEST(CaenDriver, SendsTheFramesOfTheManual) {
    Ours raw(Given{{"mode", "raw"}, {"sources", "Source_0"}}, "A948EU");
    raw.starts();
    auto first = raw.all(Command::raw_read_ids).at(0);
    EXPECT_EQ(to_hex(first.bytes).substr(8), "00005358002100000008000100120000000F00FB536F757263655F3000");
    Ours plain(Given{{"mode", "inventory"}, {"rssi", "false"}});
    plain.starts();
    EXPECT_EQ(to_hex(plain.all(Command::inventory_tag).at(0).bytes).substr(8),
              "00005358002100000008000100130000000F00FB536F757263655F3000");
}

TEST(CaenDriver, FlagsAndMaskGoIntoInventoryTag) {
    Ours ours(Given{{"mode", "inventory"},
                    {"tid", "true"},
                    {"compact", "true"},
                    {"mask", "3034"},
                    {"mask_bank", "epc"},
                    {"mask_start", "32"},
                    {"mask_bits", "12"}});
    ours.starts();
    auto heard = ours.all(Command::inventory_tag).at(0);
    EXPECT_EQ(heard.number(Attribute::bitmask), flag_rssi | flag_tid | flag_compact);
    std::vector<std::uint16_t> order;
    for (auto parsed = heard.parsed(); auto& pair : parsed.avps)
        order.push_back(pair.type);
    EXPECT_EQ(order, (std::vector<std::uint16_t>{0xFB, 0x71, 0x50, 0x11, 0x4E, 0x67}));
    EXPECT_EQ(heard.number(Attribute::memory_bank), 1);
    EXPECT_EQ(heard.number(Attribute::length), 12);
    EXPECT_EQ(heard.number(Attribute::tag_address), 32);
    Ours all_bits(Given{{"mode", "inventory"}, {"mask", "3034"}});
    all_bits.starts();
    EXPECT_EQ(all_bits.all(Command::inventory_tag).at(0).number(Attribute::length), 16);
}

TEST(CaenDriver, PcAndXpcAreAskedForWhereTheyAreWanted) {
    for (auto [settings, flags] : std::initializer_list<std::pair<Given, unsigned>>{
             {{}, flag_rssi},
             {{{"xpc", "true"}}, flag_rssi | flag_xpc},
             {{{"pc", "true"}, {"rssi", "false"}}, flag_pc},
             {{{"pc", "true"}, {"xpc", "true"}, {"tid", "true"}, {"compact", "true"}},
              flag_rssi | flag_pc | flag_xpc | flag_tid | flag_compact}}) {
        for (std::string_view mode : {"inventory", "framed"}) {
            auto given = settings;
            given.emplace_back("mode", mode);
            Ours ours(given);
            ours.starts();
            auto stream = mode == "framed" ? flag_framed | flag_continuous : 0u;
            EXPECT_EQ(ours.all(Command::inventory_tag).at(0).number(Attribute::bitmask), flags | stream);
            EXPECT_EQ(ours.detail().find("only InventoryTag"), std::string::npos);
        }
    }
}

TEST(CaenDriver, WhatRawReadIdsCannotGiveIsSaid) {
    Ours ours(Given{{"mode", "raw"}, {"pc", "true"}, {"xpc", "true"}, {"sources", "Source_0"}}, "A948EU");
    ours.starts();
    EXPECT_EQ(ours.all(Command::raw_read_ids).at(0).number(Attribute::bitmask), -1);
    EXPECT_NE(ours.detail().find("reads with RawReadIDs rounds; only InventoryTag gives xpc and pc"),
              std::string::npos)
        << ours.detail();
}

TEST(CaenDriver, ReportsTagsWithEverythingTheReaderSaid) {
    Ours ours(Given{{"mode", "inventory"}});
    ours.tags = tag_pairs(tag_a, "Ant2", 1'700'000'000'000'005);
    append_number(ours.tags, Attribute::rssi, 0xFDF0);
    append_bytes(ours.tags, Attribute::xpc, hex("08000000"));
    append_bytes(ours.tags, Attribute::pc, hex("3200"));
    ours.starts();
    ASSERT_EQ(ours.seen.size(), 1u);
    EXPECT_EQ(ours.seen[0].pc, 0x3200);
    EXPECT_EQ(ours.seen[0].xpc, 0x08000000u);
    EXPECT_EQ(ours.seen[0].tag, epc(tag_a));
    EXPECT_EQ(ours.seen[0].antenna, 2);
    EXPECT_EQ(ours.seen[0].rssi, -528);
    EXPECT_EQ(ours.seen[0].reader_time_us, 1'700'000'000'000'005);
    EXPECT_EQ(ours.seen[0].technology, event::Technology::epc_gen2);
    EXPECT_EQ(ours.count(Count::reads), 1u);
    EXPECT_EQ(ours.reports[0].received.wall, ours.now.wall);
}

TEST(CaenDriver, AClockThatWasNeverSetIsNoTime) {
    Ours ours(Given{{"mode", "inventory"}});
    ours.tags = tag_pairs(tag_a, "Ant0", 1'400'000'000);  // 1400 s after 1970
    ours.starts();
    EXPECT_EQ(ours.seen.at(0).reader_time_us, 0);
}

TEST(CaenDriver, TagsWithoutAKindAreOfTheReadersProtocol) {
    Ours ours(Given{{"mode", "raw"}, {"protocol", "ISO18000-6B"}}, "A828EU");
    append_bytes(ours.tags, Attribute::tag_id, hex("E00112345678ABCD"));
    ours.starts();
    EXPECT_EQ(ours.seen.at(0).technology, event::Technology::iso18000_6b);
    EXPECT_EQ(ours.seen[0].antenna, Observation::no_antenna);
}

TEST(CaenDriver, GoesRoundTheSourcesAndKeepsThePeriod) {
    Ours ours(Given{{"mode", "raw"}, {"poll", "2s"}, {"sources", "Source_0,Source_2"}}, "A948EU");
    ours.starts();
    auto before = ours.all(Command::raw_read_ids);
    ASSERT_EQ(before.size(), 2u);
    EXPECT_EQ(before[0].text(Attribute::source_name), "Source_0");
    EXPECT_EQ(before[1].text(Attribute::source_name), "Source_2");
    ours.waits(1999ms);
    EXPECT_EQ(ours.all(Command::raw_read_ids).size(), 2u);
    ours.waits(1ms);
    EXPECT_EQ(ours.all(Command::raw_read_ids).size(), 4u);
}

TEST(CaenDriver, ASourceThatIsNotThereIsLeftOut) {
    Ours ours(Given{{"mode", "raw"}}, "A948EU");
    ours.answers[Command::raw_read_ids] = [&](auto& heard, Bytes& pairs) {
        if (heard.text(Attribute::source_name) == "Source_1") return ResultCode::source_not_found;
        pairs = both();
        return ResultCode::success;
    };
    ours.starts();
    ours.waits(500ms);
    unsigned asked = 0;
    for (auto& each : ours.heard)
        asked += each.command == Command::raw_read_ids && each.text(Attribute::source_name) == "Source_1";
    EXPECT_EQ(asked, 1u);
    ASSERT_EQ(ours.faults.size(), 1u);
    EXPECT_EQ(ours.faults[0].text, "the inventory of Source_1 failed: source not found (120)");
    EXPECT_GT(ours.all(Command::raw_read_ids).size(), 10u);
}

TEST(CaenDriver, AFailingInventoryIsSaidOnceAndTriedAgainAfterAPause) {
    Ours ours(Given{{"mode", "inventory"}});
    ours.refuses(Command::inventory_tag, ResultCode::unknown_error);
    ours.starts();
    ours.waits(10s);
    EXPECT_EQ(ours.faults.size(), 1u);
    auto tries = ours.all(Command::inventory_tag).size();
    EXPECT_GE(tries, 9u);
    EXPECT_LE(tries, 11u);
    ours.answers.erase(Command::inventory_tag);
    ours.waits(2s);
    ours.refuses(Command::inventory_tag, ResultCode::unknown_error);
    ours.waits(2s);
    EXPECT_EQ(ours.faults.size(), 2u) << "it had gone away";
}

TEST(CaenDriver, NoTagIsNoFault) {
    Ours ours(Given{{"mode", "inventory"}});
    ours.refuses(Command::inventory_tag, ResultCode::tag_not_present);
    ours.starts();
    ours.waits(1s);
    EXPECT_TRUE(ours.faults.empty());
    EXPECT_TRUE(ours.reports.empty());
    EXPECT_GT(ours.all(Command::inventory_tag).size(), 50u);
}

TEST(CaenDriver, AMalformedAnswerIsDeliveredAsFarAsItGoesAndKept) {
    Ours ours(Given{{"mode", "inventory"}});
    ours.tags = both();
    for (auto byte : hex("0000000500FB"))
        ours.tags.push_back(byte);
    ours.starts();
    EXPECT_EQ(ours.seen.size(), 2u);
    ASSERT_EQ(ours.faults.size(), 1u);
    EXPECT_EQ(ours.faults[0].code, fault_malformed);
    EXPECT_FALSE(ours.faults[0].bytes.empty());
    EXPECT_EQ(ours.count(Count::malformed), 1u);
}

TEST(CaenDriver, TheSameFaultOfAnswersIsToldOnceAMinuteWithItsCountAndLittleOfTheFrame) {
    Ours ours(Given{{"mode", "inventory"}});
    for (int i = 0; i < 100; ++i)
        append_bytes(ours.tags, Attribute::tag_id, {});
    ours.starts();
    ours.waits(59s);
    ASSERT_EQ(ours.faults.size(), 1u);
    EXPECT_EQ(ours.faults[0].text, "a tag whose id is empty, too long or not all there");
    EXPECT_EQ(ours.faults[0].bytes.size(), 256u);
    auto rounds = ours.all(Command::inventory_tag).size();
    EXPECT_EQ(ours.count(Count::malformed), 100 * rounds);
    ours.waits(2s);
    ASSERT_EQ(ours.faults.size(), 2u);
    EXPECT_NE(ours.faults[1].text.find(" more since the last of these)"), std::string::npos);
}

TEST(CaenDriver, FaultsWithEverDifferentTextsAreFewToo) {
    OncePerMinute gate;
    Now now = testkit::script_start;
    unsigned passed = 0;
    for (int i = 0; i < 1000; ++i)
        passed += gate.pass(std::to_string(i), now).has_value();
    EXPECT_EQ(passed, OncePerMinute::most_texts);
    EXPECT_FALSE(gate.pass("0", now));
    EXPECT_EQ(gate.pass("0", now + 1min), "0 (1 more since the last of these)");
    EXPECT_TRUE(gate.pass("another", now + 1min));
}

// --- modes -------------------------------------------------------------------------------------------------

TEST(CaenDriver, WhatTheReaderRefusesFallsBackToTheNextAndIsSaid) {
    for (auto code :
         {ResultCode::invalid_function, ResultCode::invalid_command, ResultCode::invalid_parameter}) {
        Ours ours({}, "all");
        ours.refuses(Command::inventory_tag, code);
        ours.tags = both();
        ours.starts();
        EXPECT_FALSE(ours.seen.empty());
        EXPECT_EQ(ours.described.size(), 2u);
        EXPECT_NE(ours.detail().find("reads with RawReadIDs rounds; not with InventoryTag rounds: "),
                  std::string::npos)
            << ours.detail();
    }
}

TEST(CaenDriver, OneSourceIsStreamedAndSeveralAreRead) {
    Ours one({}, "R1260I");
    one.starts();
    EXPECT_NE(one.detail().find("the framed stream"), std::string::npos);
    Ours four({}, "R4300P");
    four.starts();
    EXPECT_NE(four.detail().find("InventoryTag rounds"), std::string::npos);
    Ours forced(Given{{"mode", "framed"}}, "R4300P");
    forced.starts();
    EXPECT_NE(forced.detail().find("InventoryTag rounds; a framed stream has one source only"),
              std::string::npos);
    Ours old(Given{{"mode", "raw"}}, "R1260I");
    old.starts();
    EXPECT_NE(old.detail().find("has no RawReadIDs"), std::string::npos) << old.detail();
}

TEST(CaenDriver, AReaderThatOffersNoWayIsSaidOnceAndAskedAgainLater) {
    Ours ours(Given{{"mode", "inventory"}});
    ours.refuses(Command::inventory_tag);
    ours.starts();
    ASSERT_EQ(ours.faults.size(), 1u);
    EXPECT_EQ(ours.faults[0].code, fault_reading);
    ours.waits(5min);
    EXPECT_EQ(ours.faults.size(), 1u);
    EXPECT_FALSE(ours.driver.finished());
    auto tries = ours.all(Command::inventory_tag).size();
    EXPECT_GE(tries, 9u);
    EXPECT_LE(tries, 11u);
    ours.answers.erase(Command::inventory_tag);
    ours.waits(31s);
    EXPECT_GT(ours.all(Command::inventory_tag).size(), tries + 10);
}

TEST(CaenDriver, ARefusalOfWhatHasWorkedIsAFaultAndNoReasonToFallBack) {
    Ours ours(Given{{"mode", "inventory"}}, "all");
    ours.starts();
    ours.refuses(Command::inventory_tag, ResultCode::invalid_parameter);
    ours.waits(3s);
    EXPECT_FALSE(ours.faults.empty());
    EXPECT_TRUE(ours.all(Command::raw_read_ids).empty());
}

}  // namespace gantry::caen::driver_test
