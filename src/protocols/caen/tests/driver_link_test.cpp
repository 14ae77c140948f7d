#include "driver_support.hpp"

// Late and missing answers, back-pressure, restarts, and what else comes over the link.
namespace gantry::caen::driver_test {

static const std::string tag_a = "3074257BF7194E4000001A85", tag_b = "3074257BF7194E4000001A86";

static Bytes both(std::string_view point = "Ant0") {
    auto pairs = tag_pairs(tag_a, point);
    append_tag(pairs, tag_b, point);
    return pairs;
}

TEST(CaenDriver, ThreeCommandsWithoutAnAnswerEndTheLink) {
    Ours ours(Given{{"mode", "inventory"}});
    ours.starts();
    ours.silences(Command::inventory_tag);
    auto quiet_since = ours.now;
    ours.waits(28s);
    EXPECT_TRUE(ours.driver.finished()) << "whoever is silent is offline within half a minute";
    EXPECT_EQ(ours.driver.finish_reason(),
              "the reader left 3 commands in a row without an answer, the last InventoryTag");
    EXPECT_EQ(ours.count(Count::timeouts), 3u);
    EXPECT_GE(ours.now.steady - quiet_since.steady, 15s);
}

TEST(CaenDriver, TheFirstInventoryMayTakeTwelveSecondsAndSilenceDoublesThePatience) {
    Ours ours(Given{{"mode", "inventory"}});
    ours.silences(Command::inventory_tag);
    ours.starts();
    ours.waits(11900ms);
    EXPECT_EQ(ours.count(Count::timeouts), 0u);
    ours.waits(200ms);
    EXPECT_EQ(ours.count(Count::timeouts), 1u);
    ours.waits(9s);
    EXPECT_EQ(ours.count(Count::timeouts), 1u);
    ours.waits(1s);
    EXPECT_EQ(ours.count(Count::timeouts), 2u);
}

static Bytes inventory_answer(std::uint16_t id, const Bytes& pairs) {
    Bytes answer;
    Builder builder(answer, to_host_head, id);
    builder.command(Command::inventory_tag);
    answer.insert(answer.end(), pairs.begin(), pairs.end());
    EXPECT_TRUE(builder.result(ResultCode::success).finish());
    return answer;
}

TEST(CaenDriver, ALateInventoryIsReadAndTheNextOneHasTheTimeThatItTook) {
    Ours ours(Given{{"mode", "inventory"}});
    ours.starts();
    ours.silences(Command::inventory_tag);
    ours.waits(20ms);
    for (int i = 0; i < 4; ++i) {  // longer and longer, and the reader is not dead
        auto asked = ours.all(Command::inventory_tag).back().id;
        ours.waits(18s + i * 4s);
        ours.gets(inventory_answer(asked, both()));
        ASSERT_FALSE(ours.driver.finished()) << ours.driver.finish_reason();
        EXPECT_EQ(ours.seen.size(), 2u * (static_cast<std::size_t>(i) + 1));
    }
    EXPECT_EQ(ours.count(Count::unknown_code), 0u);
    EXPECT_EQ(ours.all(Command::get_reader_info).size(), 1u) << "it was busy and has not restarted";
    EXPECT_LE(ours.count(Count::timeouts), 3u) << "only until it was known";
}

TEST(CaenDriver, ALateAnswerToAnythingElseIsNobodys) {
    Ours ours(Given{{"mode", "inventory"}});
    ours.starts();
    ours.silences(Command::inventory_tag);
    ours.waits(6s);
    auto answer = inventory_answer(12345, both());
    ours.gets(answer);
    ours.gets(inventory_answer(ours.all(Command::get_reader_info)[0].id, both()));
    EXPECT_TRUE(ours.seen.empty());
    EXPECT_EQ(ours.count(Count::unknown_code), 2u);
}

TEST(CaenDriver, AnAnswerThatStillFlowsIsWaitedFor) {
    Ours ours(Given{{"mode", "inventory"}});
    ours.starts();
    ours.silences(Command::inventory_tag);
    ours.waits(20ms);
    auto answer = inventory_answer(ours.all(Command::inventory_tag).back().id, both());
    for (std::size_t at = 0; at < answer.size(); at += 10) {  // a slow line
        ours.waits(700ms);
        ours.gets(ByteView(answer).subspan(at, std::min<std::size_t>(10, answer.size() - at)));
    }
    EXPECT_EQ(ours.seen.size(), 2u);
    EXPECT_EQ(ours.count(Count::timeouts), 0u);
}

TEST(CaenDriver, WholeTagsOfAnAnswerThatIsCutShortAreReadAndTheRestIsCounted) {
    for (bool silence : {false, true}) {
        Ours ours(Given{{"mode", "inventory"}});
        ours.starts();
        ours.silences(Command::inventory_tag);
        ours.waits(20ms);
        auto answer = inventory_answer(ours.all(Command::inventory_tag).back().id, both());
        answer.resize(answer.size() - 20);  // the end of the second id
        ours.gets(answer);
        EXPECT_TRUE(ours.seen.empty());
        if (silence) {
            ours.waits(6s);
        } else {
            ours.driver.link_lost(ours.now);
            ours.collect();
        }
        ASSERT_EQ(ours.seen.size(), 1u);
        EXPECT_EQ(ours.seen[0].tag, epc(tag_a));
        EXPECT_EQ(ours.count(Count::reads), 1u);
        EXPECT_EQ(ours.count(Count::skipped_bytes), 6u);
        EXPECT_TRUE(ours.faults.empty());
    }
    Ours other(Given{{"mode", "inventory"}});
    other.starts();
    other.silences(Command::inventory_tag);
    other.waits(20ms);
    auto answer = inventory_answer(777, both());
    answer.pop_back();
    other.gets(answer);
    other.driver.link_lost(other.now);
    other.collect();
    EXPECT_TRUE(other.seen.empty());
    EXPECT_EQ(other.count(Count::skipped_bytes), answer.size());
}

TEST(CaenDriver, AHeaderThatClaimsTooMuchDoesNotSwallowTheNextAnswers) {
    Ours ours(Given{{"mode", "inventory"}});
    ours.tags = both();
    ours.starts();
    auto before = ours.seen.size();
    ours.says(hex("000100FF00005358FFFF"));
    ours.waits(8s);
    EXPECT_GT(ours.seen.size(), before + 2);
    EXPECT_GE(ours.count(Count::skipped_bytes), 10u);
    EXPECT_EQ(ours.count(Count::timeouts), 1u);
}

TEST(CaenDriver, AReaderThatWasSilentIsSetUpAgainAndNotAllTheTime) {
    Ours ours(Given{{"mode", "inventory"}, {"session", "1"}});
    ours.starts();
    EXPECT_EQ(ours.all(Command::set_source_config).size(), 1u);
    auto answer = ours.answers[Command::inventory_tag];
    for (int i = 0; i < 2; ++i) {
        ours.silences(Command::inventory_tag);
        ours.waits(6s);
        ours.answers[Command::inventory_tag] = answer;
        ours.waits(16s);
        EXPECT_EQ(ours.all(Command::set_source_config).size(), 2u);
    }
    ours.waits(1min);
    EXPECT_EQ(ours.all(Command::set_source_config).size(), 3u);
    EXPECT_TRUE(ours.faults.empty());
}

TEST(CaenDriver, SixteenOpenTicketsStopThePollingAndNotTheDialog) {
    Ours ours(Given{{"mode", "inventory"}});
    ours.commits = false;
    ours.tags = both();
    ours.starts();
    ours.waits(5s);
    EXPECT_EQ(ours.tickets, Reports::max_open);
    EXPECT_TRUE(ours.driver.stalled());
    EXPECT_TRUE(ours.driver.wants_input());
    EXPECT_EQ(ours.does(Execute{{.name = "GetPower", .header = {}, .fields = {}}}).status,
              JobResult::Status::done);
    ours.waits(1min);
    EXPECT_FALSE(ours.driver.finished());
    EXPECT_GE(ours.all(Command::get_firmware_release).size(), 5u) << "kept alive";
    EXPECT_EQ(ours.tickets, Reports::max_open);
    ours.driver.committed(1, ours.now);
    ours.turn();
    EXPECT_EQ(ours.tickets, Reports::max_open + 1);
    ours.commits = true;
    ours.turn();
    ours.waits(1s);
    EXPECT_GT(ours.tickets, Reports::max_open + 10);
}

TEST(CaenDriver, AStoppedReaderIsKeptAliveAndReadsNothing) {
    Ours ours(Given{{"mode", "inventory"}});
    ours.driver.admitted({.mark = {}, .reading = false}, ours.now);
    ours.starts();
    ours.waits(1min);
    EXPECT_TRUE(ours.all(Command::inventory_tag).empty());
    EXPECT_GE(ours.all(Command::get_firmware_release).size(), 5u);
    EXPECT_EQ(ours.does(StartReading{}).status, JobResult::Status::done);
    EXPECT_FALSE(ours.all(Command::inventory_tag).empty());
    EXPECT_EQ(ours.does(StopReading{}).status, JobResult::Status::done);
    auto asked = ours.all(Command::inventory_tag).size();
    ours.waits(5s);
    EXPECT_EQ(ours.all(Command::inventory_tag).size(), asked);
}

TEST(CaenDriver, SomethingElseOnThePortIsNamed) {
    Ours ours;
    for (auto command : {Command::get_reader_info, Command::get_firmware_release, Command::set_protocol})
        ours.silences(command);
    ours.starts();
    ours.gets(as_bytes("SSH-2.0-OpenSSH_9.2\r\n"));
    ours.waits(1min);
    EXPECT_TRUE(ours.driver.finished());
    EXPECT_EQ(ours.driver.finish_reason(),
              "no CAEN reader: the connection began with \"SSH-2.0-OpenSSH_9.2\\x0D\\x0A\"");
}

TEST(CaenDriver, AReaderThatFloodsWithGarbageIsGivenUp) {
    Ours ours(Given{{"mode", "inventory"}});
    ours.starts();
    ours.gets(Bytes(CaenDriver::max_astray + 1, 0xEE));
    EXPECT_TRUE(ours.driver.finished());
    EXPECT_NE(ours.driver.finish_reason().find("bytes without a message"), std::string::npos);
}

TEST(CaenDriver, AClockThatFallsBackMeansARestartAndEverythingIsAppliedAgain) {
    Ours ours(Given{{"mode", "inventory"}, {"session", "1"}});
    ours.tags = tag_pairs(tag_a, "Ant0", 5'000'000'000);
    ours.starts();
    ours.waits(20s);
    EXPECT_EQ(ours.all(Command::set_source_config).size(), 1u);
    ours.tags = tag_pairs(tag_a, "Ant0", 3'000'000);
    ours.waits(1s);
    EXPECT_EQ(ours.all(Command::set_source_config).size(), 2u);
    ASSERT_EQ(ours.faults.size(), 1u);
    EXPECT_EQ(ours.faults[0].code, fault_reading);
    EXPECT_EQ(ours.described.size(), 1u) << "nothing about it changed";
}

TEST(CaenDriver, AnOldStreamOnASerialLineIsAbortedFirst) {
    Ours ours(Given{{"mode", "inventory"}});
    bool streaming = true;
    ours.on_abort = [&] { streaming = false; };
    auto info = ours.answers[Command::get_reader_info];
    ours.answers[Command::get_reader_info] = [&](auto& heard, Bytes& pairs) -> std::optional<ResultCode> {
        if (streaming) return {};
        return info(heard, pairs);
    };
    ours.starts();
    for (int i = 0; i < 5 && streaming; ++i)
        ours.gets(both());
    EXPECT_EQ(ours.aborts, 1u);
    ours.waits(1s);
    EXPECT_EQ(ours.count(Count::timeouts), 0u);
    EXPECT_FALSE(ours.described.empty());
    EXPECT_FALSE(ours.driver.finished());
}

TEST(CaenDriver, EveryReplyMayBeMissingOrGarbage) {
    auto make = []() -> std::unique_ptr<Party> {
        return std::make_unique<CaenDriver>(options_with({}, "R1260I"));
    };
    auto any = [](Party& party, Now) { party.output_sent(party.output().size()); };
    testkit::Script script = {
        testkit::does(any),
        testkit::gets("00010000000053580029000000080001009E0000000F00765231323630492031000000000800020000"),
        testkit::does(any),
        testkit::gets("00010001000053580026000000080001007C0000000C005C342E312E30000000000800020000"),
        testkit::does(any),
        testkit::gets("0001000200005358002400000008000100790000000A0054000000030000000800020000"),
        testkit::does(any),
        testkit::gets("0001000300005358001A000000080001008A0000000800020000"),
        testkit::does(any),
        testkit::gets("000100040000535800000000000800010013"),
        testkit::gets(to_hex(both())),
        testkit::waits(30s),
    };
    testkit::survives_every_reply_missing(make, script);
}

TEST(CaenDriver, SilenceEndsIt) {
    CaenDriver driver(options_with());
    driver.start(testkit::script_start);
    EXPECT_TRUE(testkit::ends_in_silence(driver, testkit::script_start));
}

}  // namespace gantry::caen::driver_test
