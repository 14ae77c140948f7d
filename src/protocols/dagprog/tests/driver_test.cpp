#include "support.hpp"

namespace gantry::dagprog::test {

// --- who is there ------------------------------------------------------------------------------------------

TEST(DagprogDriver, FindsOutWhoIsThereAndHowItWantsValues) {
    Ours ours;
    EXPECT_EQ(ours.says(), "") << "a unit that is just starting says so first";
    ours.gets(said({"#0\tDAGProg ISO V1", "#6"}));
    EXPECT_EQ(ours.says(), "\r") << "ends half a line";
    ours.gets(said({"??"}));
    ours.waits(200ms);
    const std::vector<std::pair<std::string, std::string>> dialog = {
        {"v?\r", "V=\tV1.00A"},       {"SO\r", "SO"},
        {"tl\r", "TL\t00000"},        {"bk\r", "BK\t00003"},
        {"nb\r", "NB\t00000"},        {"tx\r", "TX\t00001"},
        {"BK\t00002\r", "BK\t00002"}, {"bk\r", "BK\t00002"},
        {"BK\t00003\r", "BK\t00003"}, {"bk\r", "BK\t00003"},
        {"TX\t00005\r", "TX\t00005"}, {"UR\r", "UR"}};
    for (auto& [says, gets] : dialog) {
        EXPECT_EQ(ours.says(), says);
        ours.gets(said({gets}));
    }
    EXPECT_EQ(ours.says(), "");
    EXPECT_EQ(ours.detail(), "DAGProg ISO15693, V1.00A, commands without STX, values after tab");
    EXPECT_EQ(ours.faults(), "");
    EXPECT_FALSE(ours.mark().empty());
}

TEST(DagprogDriver, WaitsForABannerTwoSecondsAndNoLonger) {
    Ours ours;
    ours.waits(1900ms);
    EXPECT_EQ(ours.says(), "");
    ours.waits(200ms);
    EXPECT_EQ(ours.says(), "\r");
}

TEST(DagprogDriver, TriesStxWhereAQuestionWithoutItIsNotUnderstood) {
    for (bool silent : {true, false}) {
        Ours ours;
        ours.gets(said({"#6"}));
        ours.says();
        ours.waits(200ms);
        EXPECT_EQ(ours.says(), "v?\r");
        if (silent)
            ours.waits(600ms);
        else
            ours.gets(said({"??"}));
        EXPECT_EQ(ours.says(), "\x02v?\r");
        ours.gets(said({"V=\tV1.00A"}));
        EXPECT_EQ(ours.says(), "\x02SO\r");
    }
    Ours told(Given{{"stx", "yes"}});
    told.gets(said({"#6"}));
    told.says();
    told.waits(200ms);
    EXPECT_EQ(told.says(), "\x02v?\r");
}

TEST(DagprogDriver, GivesUpWhereNobodyAnswers) {
    Ours ours;
    ours.waits(30s);
    EXPECT_TRUE(ours.driver.finished());
    EXPECT_NE(std::string(ours.driver.finish_reason()).find("nobody answers"), std::string::npos);
    Ours stranger;
    for (int i = 0; i < 100 && !stranger.driver.finished(); ++i) {
        stranger.waits(500ms);
        if (!stranger.says().empty()) stranger.gets(said({"??"}));
    }
    EXPECT_TRUE(stranger.driver.finished());
    EXPECT_NE(std::string(stranger.driver.finish_reason()).find("answers ??"), std::string::npos);
}

TEST(DagprogDriver, KnowsAnIcode1UnitByItsMissingPowerUpMode) {
    Ours ours;
    ours.identifies("icode1");
    EXPECT_NE(ours.detail().find("DAGProg ICODE1"), std::string::npos);
    Ours told(Given{{"family", "icode1"}});
    told.identifies("iso15693");
    EXPECT_NE(told.detail().find("DAGProg ICODE1"), std::string::npos);
    EXPECT_EQ(std::ranges::count(told.heard, "tl\r"), 0) << "it was said already";
}

TEST(DagprogDriver, ProbesEachFormAndBelievesOnlyEchoAndQuestion) {
    struct Case {
        std::string separator, set, form;
    };
    for (auto& [separator, set, form] :
         {Case{"none", "BK00002\r", "none"}, Case{"space", "BK 00002\r", "space"}}) {
        Ours ours;
        ours.gets(said({"#6"}));
        auto table = Ours::registers("iso15693");
        std::string now = "00003";
        for (unsigned i = 0; i < 60; ++i) {
            auto line = ours.says();
            if (line.empty()) break;
            if (line == "\r") {
                ours.waits(200ms);
            } else if (line == "bk\r") {
                ours.gets(said({"BK\t" + now}));
            } else if (line == set) {
                now = "00002";
                ours.gets(said({"BK\t00002"}));
            } else if (line.ends_with("00003\r") && line.starts_with(set.substr(0, set.size() - 6))) {
                now = "00003";
                ours.gets(said({"BK\t00003"}));
            } else if (line.starts_with("BK")) {
                ours.gets(said({"??"}));
            } else {
                for (auto& [begin, answer] : table)
                    if (line.starts_with(begin)) {
                        ours.gets(answer);
                        break;
                    }
            }
        }
        EXPECT_NE(ours.detail().find("values after " + form), std::string::npos) << ours.detail();
        EXPECT_EQ(now, "00003") << "what was tried is put back";
    }
}

TEST(DagprogDriver, AFormThatOnlyEchoesIsNotBelieved) {
    Ours ours;
    auto table = Ours::registers("iso15693");
    ours.gets(said({"#6"}));
    table.insert(table.begin(), {"BK", "echo any"});
    table.insert(table.begin(), {"bk\r", said({"BK\t00003"})});  // whatever was set
    ours.answers(table, 60);
    EXPECT_NE(ours.detail().find("no writing"), std::string::npos) << ours.detail();
    EXPECT_NE(ours.faults().find("in none of the forms"), std::string::npos);
    ours.run(1, WriteTag{.access = access_to(tag_a), .offset = 5, .data = hex("11223344")});
    ours.run(2, command("WriteData", {{"Block", wire::Value(5)}, {"Data", words("11223344")}}));
    ours.run(3, SetParameter{"FirstBlock", "4"});
    ours.waits(100ms);
    ASSERT_EQ(ours.ended().size(), 3u);
    for (auto& each : ours.ended()) {
        EXPECT_EQ(each.result.status, Status::failed);
        EXPECT_NE(each.result.text.find("nothing is set or written"), std::string::npos) << each.result.text;
    }
    EXPECT_EQ(ours.mark(), Bytes{}) << "nothing to remember";
    for (auto& line : ours.heard)
        EXPECT_FALSE(line.starts_with("WD")) << line;
}

TEST(DagprogDriver, AFormThatSetsSomethingElseEndsTheTrial) {
    Ours ours;
    auto table = Ours::registers("iso15693");
    ours.gets(said({"#6"}));
    std::string value = "00003";
    for (unsigned i = 0; i < 40; ++i) {
        auto line = ours.says();
        if (line.empty()) break;
        ours.heard.push_back(line);
        if (line == "\r")
            ours.waits(200ms);
        else if (line.starts_with("BK"))
            value = "00009", ours.gets(said({"BK\t00009"}));
        else if (line == "bk\r")
            ours.gets(said({"BK\t" + value}));
        else
            ours.answers({}, 0), ours.gets(std::ranges::find_if(table, [&](auto& each) {
                                               return line.starts_with(each.first);
                                           })->second);
    }
    EXPECT_NE(ours.faults().find("in another way"), std::string::npos) << ours.faults();
    EXPECT_NE(ours.detail().find("no writing"), std::string::npos);
    EXPECT_EQ(std::ranges::count_if(ours.heard, [](auto& line) { return line.starts_with("BK"); }), 1);
}

TEST(DagprogDriver, RemembersTheFormsOfAUnitOfTheSameVersion) {
    Ours first;
    first.identifies();
    auto mark = first.mark();
    ASSERT_FALSE(mark.empty());
    EXPECT_TRUE(std::ranges::any_of(first.heard, [](auto& line) { return line.starts_with("BK\t00002"); }));
    Ours again(Given{}, {.mark = mark});
    again.identifies();
    EXPECT_FALSE(std::ranges::any_of(again.heard, [](auto& line) { return line.starts_with("BK\t"); }));
    EXPECT_NE(again.detail().find("values after tab"), std::string::npos);
    EXPECT_EQ(again.mark(), Bytes{}) << "nothing new";
    mark.push_back('X');  // another version
    Ours other(Given{}, {.mark = mark});
    other.identifies();
    EXPECT_TRUE(std::ranges::any_of(other.heard, [](auto& line) { return line.starts_with("BK\t"); }));
    Ours damaged(Given{}, {.mark = hex("01FF")});
    damaged.identifies();
    EXPECT_NE(damaged.detail().find("values after tab"), std::string::npos);
    Ours told(Given{{"separator", "space"}});
    told.identifies();
    EXPECT_NE(told.detail().find("values after space"), std::string::npos);
    EXPECT_FALSE(std::ranges::any_of(told.heard, [](auto& line) { return line.starts_with("BK"); }));
}

// --- reading -----------------------------------------------------------------------------------------------

TEST(DagprogDriver, DeliversTagsAsTheyCome) {
    Ours ours;
    ours.gets(said({"SN\tE004010012345678", "00\t00\t00000000"}));
    ASSERT_EQ(ours.observations().size(), 1u) << "a unit that reads by itself before it was asked";
    EXPECT_EQ(ours.observations()[0].technology, event::Technology::iso15693) << "as its number says";
    ours.identifies();
    ours.waits(50ms);
    ours.gets(said({"SN\tE004010012345678", "00\t1B\t0012341F"}));
    EXPECT_EQ(ours.reports.back().received.steady, ours.now.steady) << "when it came";
    ours.waits(50ms);
    ours.gets(
        "SN\tE0040100AABBCCDD\r\x02"
        "00\t1c\tdeadbeef\r");
    ours.gets(said({"SN\tE004010012345678"}));
    ours.waits(200ms);
    auto seen = ours.observations();
    ASSERT_EQ(seen.size(), 4u);
    EXPECT_EQ(to_hex(seen[1].tag.view()), tag_a);
    EXPECT_EQ(seen[1].technology, event::Technology::iso15693);
    EXPECT_EQ(seen[1].data_size, 4);
    EXPECT_EQ(to_hex(seen[2].tag.view()), tag_b);
    EXPECT_EQ(seen[3].data_size, 0);
    EXPECT_EQ(ours.count(Count::reads), 4u);
}

TEST(DagprogDriver, ResultsAndWrongFieldsAreNeverTags) {
    Ours ours;
    ours.identifies();
    ours.gets(said(
        {"SN\t0000000000000001", "SN\t0000000000000000", "SN\tE00401001234567", "00\t1B\t00123", "ZZ\tx"}));
    ours.gets(said({"ER\t1", "ER\t2", "??"}));
    EXPECT_EQ(ours.observations().size(), 0u);
    EXPECT_EQ(ours.count(Count::malformed), 2u);
    EXPECT_EQ(ours.count(Count::unknown_code), 1u);
    EXPECT_EQ(ours.count(Count::bad_checksum), 1u);
    auto faults = ours.faults();
    for (auto text : {"no tag in the field", "cannot be read", "unknown message", "CRC8", "invalid tag",
                      "did not understand"})
        EXPECT_NE(faults.find(text), std::string::npos) << text << " in " << faults;
}

TEST(DagprogDriver, FaultsAreToldOnceAMinute) {
    Ours ours;
    ours.identifies();
    for (int i = 0; i < 50; ++i)
        ours.gets(said({"ER\t2"}));
    EXPECT_EQ(std::ranges::count(ours.faults(), '\n'), 1);
    for (int i = 0; i < 80; ++i) {
        ours.waits(1s);
        ours.answers(Ours::registers("iso15693"), 4);
    }
    ours.gets(said({"ER\t2"}));
    EXPECT_NE(ours.faults().find("49 times"), std::string::npos) << ours.faults();
}

TEST(DagprogDriver, WakesSleepingTagsByTheFieldOffForATenthOfASecond) {
    Ours ours(Given{{"mode", "sr"}, {"reread", "2s"}});
    ours.identifies();
    EXPECT_EQ(ours.heard.back(), "SR\r");
    ours.waits(1900ms);
    EXPECT_EQ(ours.says(), "");
    ours.waits(200ms);
    EXPECT_EQ(ours.says(), "AP0\r");
    ours.gets(said({"AP0"}));
    EXPECT_EQ(ours.says(), "");
    ours.waits(90ms);
    EXPECT_EQ(ours.says(), "");
    ours.waits(20ms);
    EXPECT_EQ(ours.says(), "AP1\r");
    ours.gets(said({"AP1"}));
    ours.waits(1900ms);
    EXPECT_EQ(ours.says(), "");
    Ours never(Given{{"mode", "sr"}, {"reread", "0s"}, {"alive", "1h"}});
    never.identifies();
    never.waits(30min);
    EXPECT_EQ(never.says(), "");
}

TEST(DagprogDriver, ReadsInTheModeThatIsWanted) {
    for (auto [mode, family, command, fault] :
         {std::tuple{"ur", "iso15693", "UR\r", ""}, std::tuple{"rc", "iso15693", "RC\r", ""},
          std::tuple{"sr", "iso15693", "SR\r", ""}, std::tuple{"auto", "icode1", "UR\r", ""},
          std::tuple{"as", "icode1", "AS\r", ""}, std::tuple{"sr", "icode1", "UR\r", "have no mode \"sr\""},
          std::tuple{"as", "iso15693", "UR\r", "have no mode \"as\""}}) {
        Ours ours(Given{{"mode", mode}});
        ours.identifies(family);
        EXPECT_EQ(ours.heard.back(), command) << mode;
        EXPECT_NE(ours.faults().find(fault), std::string::npos) << ours.faults();
    }
}

TEST(DagprogDriver, AsksAnIcode1UnitForSerialNumbersAgainAndAgain) {
    Ours ours(Given{{"mode", "as"}, {"poll", "300ms"}});
    ours.identifies("icode1");
    ours.gets(said({"AS", "SN\t0102030405060708"}));
    EXPECT_EQ(ours.says(), "");
    ours.waits(310ms);
    EXPECT_EQ(ours.says(), "AS\r");
    ours.gets(said({"AS", "SN\t0000000000000001"}));
    ours.waits(310ms);
    EXPECT_EQ(ours.says(), "AS\r");
    auto seen = ours.observations();
    ASSERT_EQ(seen.size(), 1u);
    EXPECT_EQ(to_hex(seen[0].tag.view()), icode_a);
    EXPECT_EQ(seen[0].technology, event::Technology::icode1);
}

TEST(DagprogDriver, WhereTheUnitSendsDataAloneTheyTellTheTags) {
    Ours ours(Given{{"first_block", "4"}, {"blocks", "2"}});
    ours.identifies("icode1");
    EXPECT_TRUE(std::ranges::find(ours.heard, "NB\t00001\r") != ours.heard.end());
    EXPECT_TRUE(std::ranges::find(ours.heard, "BK\t00004\r") != ours.heard.end());
    ours.gets(said({"00\t01\t11223344", "00\t01\t55667788", "00\t02\t11223344", "00\t03\t11223344"}));
    auto seen = ours.observations();
    ASSERT_EQ(seen.size(), 1u);
    EXPECT_EQ(to_hex(seen[0].tag.view()), "1122334455667788");
    EXPECT_EQ(seen[0].technology, event::Technology::icode1);
}

// --- restarts, silence, settings
// ----------------------------------------------------------------------------

TEST(DagprogDriver, ABannerIsARestartAndTheUnitIsSetUpAgain) {
    for (std::string banner : {"\x02#0\tDAGProg V2\r", "#0\tDAGProg V2\r",
                               "\x02"
                               "0\tDAGProg V2\r",
                               "\x02#0\r"}) {
        Ours ours(Given{{"first_block", "5"}});
        ours.identifies();
        ours.heard.clear();
        ours.gets(banner);
        EXPECT_NE(ours.faults().find("the unit restarted"), std::string::npos);
        EXPECT_EQ(ours.says(), "") << "it is not ready yet";
        ours.first_block = "00000";
        ours.gets(said({"#6"}));
        ours.answers(Ours::registers("iso15693"), 40);
        EXPECT_TRUE(std::ranges::find(ours.heard, "BK\t00005\r") != ours.heard.end());
        EXPECT_EQ(ours.heard.back(), "UR\r");
    }
}

TEST(DagprogDriver, AJobThatARestartInterruptsIsNotKnownAndOneThatWaitsIsDoneLater) {
    Ours ours;
    ours.identifies();
    ours.run(1, GetParameter{"Version"});
    ours.run(2, GetParameter{"Version"});
    EXPECT_EQ(ours.says(), "v?\r");
    ours.gets(said({"#0\tDAGProg"}));
    ASSERT_EQ(ours.ended().size(), 1u);
    EXPECT_EQ(ours.ended()[0].result.status, Status::unknown);
    ours.gets(said({"#6"}));
    ours.answers(Ours::registers("iso15693"), 40);
    ASSERT_EQ(ours.ended().size(), 2u);
    EXPECT_EQ(ours.ended()[1].result.status, Status::done);
}

TEST(DagprogDriver, SilenceIsAskedAboutAndEndsTheLink) {
    Ours ours(Given{{"alive", "5s"}});
    ours.identifies();
    ours.waits(5100ms);
    EXPECT_EQ(ours.says(), "v?\r");
    ours.gets(said({"V=\tV1.00A"}));
    EXPECT_FALSE(ours.driver.finished());
    ours.waits(1min);
    EXPECT_TRUE(ours.driver.finished());
    EXPECT_EQ(ours.driver.finish_reason(), "the unit answers no more");
}

TEST(DagprogDriver, ASettingThatIsRefusedIsToldAndReadingGoesOn) {
    Ours ours(Given{{"first_block", "15"}});
    auto table = Ours::registers("iso15693");
    table.insert(table.begin(), {"BK\t00015\r", said({"??"})});
    ours.gets(said({"#6"}));
    ours.answers(table, 40);
    EXPECT_NE(ours.faults().find("setting FirstBlock to 15"), std::string::npos) << ours.faults();
    EXPECT_EQ(ours.heard.back(), "UR\r");
}

TEST(DagprogDriver, StopsAndStartsReadingWhenTold) {
    Known known;
    known.reading = false;
    Ours ours({}, known);
    ours.identifies();
    EXPECT_TRUE(std::ranges::find(ours.heard, "UR\r") == ours.heard.end()) << "somebody stopped it";
    ours.run(1, StartReading{});
    ours.answers(Ours::registers("iso15693"), 4);
    EXPECT_EQ(ours.heard.back(), "UR\r");
    ours.run(2, StopReading{});
    EXPECT_EQ(ours.says(), "SO\r");
    ours.gets(said({"SN\tE004010012345678"}));  // late ones still count
    ours.gets(said({"SO"}));
    ours.waits(1s);
    EXPECT_EQ(ours.observations().size(), 1u);
    EXPECT_EQ(ours.says(), "");
    EXPECT_EQ(ours.ended().size(), 2u);
}

TEST(DagprogDriver, OpenTicketsHoldItBackAndLetItGoOn) {
    Ours ours;
    ours.identifies();
    ours.commits = false;
    for (int i = 0; i < 100 && !ours.driver.stalled(); ++i)
        ours.gets(said({"SN\tE004010012345678", "00\t00\t00000000"}));
    EXPECT_TRUE(ours.driver.stalled());
    EXPECT_FALSE(ours.driver.wants_input());
    ours.driver.committed(ours.last_ticket, ours.now);
    EXPECT_TRUE(ours.driver.wants_input());
}

TEST(DagprogDriver, GarbageIsSkippedCountedAndTooMuchOfItEndsTheLink) {
    Ours ours;
    ours.identifies();
    ours.gets("\x01\x05garbage");
    ours.gets(said({"SN\tE004010012345678", "00\t00\t00000000"}));
    EXPECT_EQ(ours.observations().size(), 1u);
    EXPECT_EQ(ours.count(Count::resyncs), 1u);
    EXPECT_EQ(ours.count(Count::skipped_bytes), 9u);
    std::string noise(1000, '\xF0');
    for (int i = 0; i < 100 && !ours.driver.finished(); ++i)
        ours.gets(noise);
    EXPECT_TRUE(ours.driver.finished());
    EXPECT_NE(std::string(ours.driver.finish_reason()).find("baud rate"), std::string::npos);
}

TEST(DagprogDriver, EveryAnswerMayBeMissingOrGarbage) {
    using testkit::gets;
    using testkit::sends;
    using testkit::waits;
    auto line = [](std::string_view text) { return to_hex(as_bytes(said({text}))); };
    auto command = [](std::string_view text) { return to_hex(as_bytes(std::string(text) + "\r")); };
    testkit::Script script = {gets(line("#6")), sends("0D"), waits(200ms)};
    for (auto& [says, answer] : std::vector<std::pair<std::string, std::string>>{{"v?", "V=\tV1.00A"},
                                                                                 {"SO", "SO"},
                                                                                 {"tl", "TL\t00000"},
                                                                                 {"bk", "BK\t00003"},
                                                                                 {"nb", "NB\t00000"},
                                                                                 {"tx", "TX\t00005"},
                                                                                 {"BK\t00002", "BK\t00002"},
                                                                                 {"bk", "BK\t00002"},
                                                                                 {"BK\t00003", "BK\t00003"},
                                                                                 {"bk", "BK\t00003"},
                                                                                 {"UR", "UR"}}) {
        script.push_back(sends(command(says)));
        script.push_back(gets(line(answer)));
    }
    script.push_back(gets(line("SN\tE004010012345678") + line("00\t00\t00000000")));
    auto make = [] { return std::make_unique<DagprogDriver>(DriverOptions{.settings = driver_with()}); };
    testkit::play(*make(), script);
    testkit::survives_every_reply_missing(make, script);
}

}  // namespace gantry::dagprog::test
