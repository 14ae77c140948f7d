#include "driver_support.hpp"

// The framed stream (section 8): early and final result codes, the abort, what a job does to it.
namespace gantry::caen::driver_test {

static const std::string tag_a = "3074257BF7194E4000001A85", tag_b = "3074257BF7194E4000001A86";

static Bytes operator+(Bytes a, const Bytes& b) {
    a.insert(a.end(), b.begin(), b.end());
    return a;
}

// A streaming reader after its head; `ends`: what it says to an abort.
struct Streaming : Ours {
    explicit Streaming(const Bytes& after_abort = result_pair(ResultCode::success),
                       const Given& settings = {})
        : Ours(settings) {
        on_abort = [this, after_abort] { says(after_abort); };
        answers[Command::get_io] = [](auto&, Bytes& pairs) {
            append_number(pairs, Attribute::io_register, 1);
            return ResultCode::success;
        };
        starts();
    }
};

TEST(CaenStream, StartsWithAnEndlessReadCycleAndTheFlags) {
    Streaming ours;
    auto cycle = ours.all(Command::set_source_config).at(0);
    EXPECT_EQ(cycle.number(Attribute::config_parameter), 0);
    EXPECT_EQ(cycle.number(Attribute::config_value), 0);
    auto stream = ours.all(Command::inventory_tag).at(0);
    EXPECT_EQ(stream.number(Attribute::bitmask), flag_rssi | flag_framed | flag_continuous);
    EXPECT_EQ(ours.detail(), "serial 0000123; reads with the framed stream");
    EXPECT_FALSE(ours.driver.finished());
}

TEST(CaenStream, TagsAreReportedAsTheyCome) {
    Streaming ours;
    ours.gets(tag_pairs(tag_a, "Ant1"));
    ours.waits(30ms);
    ASSERT_EQ(ours.seen.size(), 1u);
    EXPECT_EQ(ours.seen[0].antenna, 1);
    ours.gets(tag_pairs(tag_b) + tag_pairs(tag_a));
    ours.waits(30ms);
    EXPECT_EQ(ours.seen.size(), 3u);
    EXPECT_EQ(ours.count(Count::reads), 3u);
    EXPECT_EQ(ours.streams(), 1u);
}

TEST(CaenStream, ATagInPiecesKeepsItsSignalStrength) {
    Streaming ours;
    Bytes all;
    for (int i = 0; i < 300; ++i) {
        append_tag(all, i % 2 == 0 ? tag_a : tag_b);
        append_number(all, Attribute::rssi, 0xFDF0);
    }
    for (std::size_t at = 0; at < all.size(); at += 7) {
        ours.gets(ByteView(all).subspan(at, std::min<std::size_t>(7, all.size() - at)));
        ours.waits(1ms);
    }
    ours.waits(1s);
    ASSERT_EQ(ours.seen.size(), 300u);
    unsigned without = 0;
    for (auto& each : ours.seen)
        without += each.rssi != -528;
    EXPECT_LE(without, 30u) << "only where a tag was cut for a quarter of a second";
    Streaming fast;
    fast.gets(all);
    fast.waits(1s);
    ASSERT_EQ(fast.seen.size(), 300u);
    for (auto& each : fast.seen)
        EXPECT_EQ(each.rssi, -528);
    EXPECT_GE(fast.reports.size(), 4u) << "reports stay small";
}

TEST(CaenStream, AnEarlyResultCodeMeansThatItHasBegun) {
    Streaming ours;
    ours.gets(result_pair(ResultCode::success));
    ours.waits(5s);
    ours.gets(tag_pairs(tag_a));
    ours.waits(1s);
    EXPECT_EQ(ours.seen.size(), 1u);
    EXPECT_EQ(ours.aborts, 0u);
    EXPECT_EQ(ours.streams(), 1u);
}

TEST(CaenStream, AFinalResultCodeEndsItAndItIsStartedAgain) {
    Streaming ours;
    ours.gets(tag_pairs(tag_a) + result_pair(ResultCode::success));
    ours.waits(100ms);
    EXPECT_EQ(ours.streams(), 2u);
    ours.gets(tag_pairs(tag_b) + result_pair(ResultCode::success));
    ours.waits(100ms);
    EXPECT_EQ(ours.streams(), 3u);
    EXPECT_EQ(ours.seen.size(), 2u);
    EXPECT_TRUE(ours.faults.empty());
    EXPECT_EQ(ours.count(Count::skipped_bytes), 0u);
}

TEST(CaenStream, AnEarlyZeroFromAReaderWithoutAnEndlessCycleIsLookedAt) {
    Ours ours;
    ours.refuses(Command::set_source_config);
    ours.starts();
    ours.gets(result_pair(ResultCode::success));
    ours.waits(900ms);
    EXPECT_EQ(ours.aborts, 0u);
    ours.waits(2s);
    EXPECT_GE(ours.all(Command::inventory_tag).size(), 2u) << "it was the end";
}

TEST(CaenStream, AnErrorAtOnceFallsBackAndALaterOneIsAFault) {
    Streaming ours;
    ours.gets(result_pair(ResultCode::invalid_parameter));
    EXPECT_NE(ours.detail().find("InventoryTag rounds; not with the framed stream: invalid parameter (200)"),
              std::string::npos)
        << ours.detail();
    ours.waits(20ms);
    auto cycles = ours.all(Command::set_source_config);
    ASSERT_EQ(cycles.size(), 2u);
    EXPECT_EQ(cycles[1].number(Attribute::config_value), 1) << "rounds are not endless";

    Streaming later;
    later.gets(tag_pairs(tag_a) + result_pair(ResultCode::unknown_error));
    later.waits(1500ms);
    ASSERT_EQ(later.faults.size(), 1u);
    EXPECT_EQ(later.faults[0].code, 102);
    EXPECT_EQ(later.streams(), 2u);
}

TEST(CaenStream, AnAnswerInsteadOfAStreamFallsBack) {
    Ours ours;
    ours.tags = tag_pairs(tag_a);
    ours.answers[Command::inventory_tag] = [&](auto&, Bytes& pairs) {
        pairs = ours.tags;
        return ResultCode::success;
    };
    ours.starts();
    ours.waits(100ms);
    EXPECT_GT(ours.seen.size(), 2u);
    EXPECT_NE(ours.detail().find("the reader answers without a stream"), std::string::npos);
}

TEST(CaenStream, AJobAbortsItIsDoneAndReadingGoesOn) {
    for (auto& last : {result_pair(ResultCode::success), tag_pairs(tag_b) + result_pair(ResultCode::success),
                       Bytes{}, tag_pairs(tag_b)}) {
        Streaming ours(last);
        ours.gets(tag_pairs(tag_a));
        auto before = ours.now;
        ours.answers[Command::get_io] = [](auto&, Bytes& pairs) {
            append_number(pairs, Attribute::io_register, 1);
            return ResultCode::success;
        };
        EXPECT_EQ(ours.does(GetInputs{}).status, JobResult::Status::done);
        EXPECT_LE(ours.now.steady - before.steady, 1s);
        EXPECT_EQ(ours.aborts, 1u);
        ours.waits(100ms);
        EXPECT_EQ(ours.streams(), 2u);
        bool more = last.size() > 10;
        EXPECT_EQ(ours.seen.size(), more ? 2u : 1u) << "what came on the way is kept";
        EXPECT_EQ(ours.count(Count::skipped_bytes), 0u);
    }
}

TEST(CaenStream, AReaderThatDoesNotStopIsLeft) {
    Streaming ours(Bytes{});
    ours.runs(GetInputs{});
    for (int i = 0; i < 100 && !ours.driver.finished(); ++i) {
        ours.gets(tag_pairs(tag_a));
        ours.waits(200ms);
    }
    EXPECT_TRUE(ours.driver.finished());
    EXPECT_EQ(ours.driver.finish_reason(), "the reader does not stop its inventory");
}

TEST(CaenStream, ASilentStreamIsLookedAt) {
    Streaming ours;
    ours.waits(14s);
    EXPECT_EQ(ours.aborts, 0u);
    ours.waits(2s);
    EXPECT_EQ(ours.aborts, 1u);
    EXPECT_EQ(ours.streams(), 2u);

    Streaming wordless(Bytes{});
    wordless.waits(17s);
    EXPECT_EQ(wordless.streams(), 2u);

    Streaming dead(Bytes{});
    dead.silences(Command::get_firmware_release);
    dead.silences(Command::inventory_tag);
    dead.waits(1min);
    EXPECT_TRUE(dead.driver.finished());
}

TEST(CaenStream, StalledItWantsNoInputAndStillDoesJobs) {
    Ours ours;
    ours.commits = false;
    ours.on_abort = [&] { ours.says(result_pair(ResultCode::success)); };
    ours.starts();
    while (ours.driver.wants_input()) {
        ours.gets(tag_pairs(tag_a));
        ours.waits(30ms);
        ASSERT_LE(ours.tickets, Reports::max_open);
    }
    EXPECT_TRUE(ours.driver.stalled());
    ours.waits(1min);
    EXPECT_FALSE(ours.driver.finished()) << "stalled is not silent";
    EXPECT_EQ(ours.aborts, 0u);
    ours.runs(GetInputs{});
    EXPECT_EQ(ours.aborts, 1u);
    EXPECT_EQ(ours.ended.size(), 1u);
    EXPECT_EQ(ours.all(Command::inventory_tag).size(), 1u) << "not before something is committed";
    ours.driver.committed(ours.tickets, ours.now);
    ours.turn();
    ours.waits(20ms);
    EXPECT_EQ(ours.all(Command::inventory_tag).size(), 2u);
}

TEST(CaenStream, GarbageInsideEndsItAndItIsStartedAgain) {
    for (auto byte :
         {std::uint8_t{0x00}, std::uint8_t{0xEE}}) {  // a pair without a length, and one that never ends
        Streaming ours;
        ours.gets(tag_pairs(tag_a) + Bytes(20, byte));
        ours.waits(2s);
        EXPECT_EQ(ours.aborts, 1u);
        EXPECT_EQ(ours.streams(), 2u);
        EXPECT_EQ(ours.seen.size(), 1u);
        EXPECT_GT(ours.count(Count::skipped_bytes), 0u);
    }
}

TEST(CaenStream, AStreamThatNobodyAskedForIsAbortedAndItsReadsCount) {
    Ours ours(Given{{"mode", "inventory"}});
    ours.on_abort = [&] { ours.says(tag_pairs(tag_b) + result_pair(ResultCode::success)); };
    ours.starts();
    ours.silences(Command::inventory_tag);
    ours.waits(20ms);
    ours.gets(Ours::stream_head(999) + tag_pairs(tag_a));
    ours.waits(1s);
    EXPECT_EQ(ours.aborts, 1u);
    EXPECT_EQ(ours.count(Count::unknown_code), 1u);
    EXPECT_FALSE(ours.driver.finished());
    EXPECT_EQ(ours.seen.size(), 2u);
    EXPECT_EQ(ours.count(Count::skipped_bytes), 0u);
}

TEST(CaenStream, AHeadThatComesTooLateIsAbortedAndItsReadsCount) {
    Ours ours;
    ours.silences(Command::inventory_tag);
    ours.on_abort = [&] { ours.says(tag_pairs(tag_b) + result_pair(ResultCode::success)); };
    ours.starts();
    ours.waits(13s);
    EXPECT_EQ(ours.streams(), 2u);
    ours.gets(Ours::stream_head(ours.all(Command::inventory_tag)[0].id) + tag_pairs(tag_a));
    ours.waits(1s);
    EXPECT_EQ(ours.aborts, 1u);
    EXPECT_EQ(ours.seen.size(), 2u);
    EXPECT_EQ(ours.count(Count::unknown_code), 0u);
    ours.gets(Ours::stream_head(ours.all(Command::inventory_tag)[1].id) + tag_pairs(tag_a));
    ours.waits(1s);
    EXPECT_EQ(ours.aborts, 1u);
    EXPECT_EQ(ours.seen.size(), 3u);
    EXPECT_FALSE(ours.driver.finished());
}

TEST(CaenStream, APairThatClaimsMoreThanAnyHasIsLostStep) {
    Streaming ours;
    ours.gets(tag_pairs(tag_a) + hex("0000FFFF0011"));
    EXPECT_EQ(ours.aborts, 1u) << "nobody waits for 65535 bytes";
}

// All four ways to begin and to end: a code that was sent at the start must not be taken for the answer to
// the abort.
TEST(CaenStream, QueuedJobsDoNotMistakeAnEarlyCodeForTheEnd) {
    for (bool early : {false, true})
        for (bool late : {false, true}) {
            SCOPED_TRACE(testing::Message() << early << late);
            Ours ours;
            bool streaming = false;
            ours.answers[Command::inventory_tag] = [&](auto& asked, Bytes&) -> std::optional<ResultCode> {
                EXPECT_FALSE(streaming) << "asked while it streams";
                streaming = true;
                ours.says(Ours::stream_head(asked.id));
                if (early) ours.says(result_pair(ResultCode::success));
                return {};
            };
            unsigned too_soon = 0;
            ours.answers[Command::get_io] = [&](auto&, Bytes& pairs) {
                too_soon += streaming;
                append_number(pairs, Attribute::io_register, 1);
                return ResultCode::success;
            };
            bool ends = false;
            ours.on_abort = [&] { ends = true; };
            ours.starts();
            for (int i = 0; i < 3; ++i)
                ours.driver.run({.id = static_cast<JobId>(i) + 1, .deadline = ours.now.steady + 30s},
                                GetInputs{}, ours.now);
            ours.turn();
            for (int i = 0; i < 600 && ours.ended.size() < 3; ++i) {
                if (ends) {  // the abort takes 200 ms
                    ours.waits(200ms);
                    streaming = ends = false;
                    ours.gets(tag_pairs(tag_a) + (late ? result_pair(ResultCode::success) : Bytes{}));
                }
                ours.waits(10ms);
            }
            EXPECT_EQ(ours.ended.size(), 3u);
            for (auto& each : ours.ended)
                EXPECT_EQ(each.result.status, JobResult::Status::done) << each.result.text;
            EXPECT_EQ(too_soon, 0u);
            EXPECT_EQ(ours.count(Count::skipped_bytes), 0u);
            EXPECT_EQ(ours.seen.size(), ours.aborts);
            EXPECT_TRUE(ours.faults.empty());
        }
}

TEST(CaenStream, AReaderThatEndsWithACodeIsWaitedForAndTagsAfterTheSilenceStillCount) {
    Streaming ours;
    ours.gets(tag_pairs(tag_a));
    EXPECT_EQ(ours.does(GetInputs{}).status, JobResult::Status::done);  // it has ended with a code now
    ours.waits(100ms);
    ours.gets(tag_pairs(tag_a));
    ours.on_abort = nullptr;
    ours.runs(GetInputs{});
    ours.waits(2s);
    EXPECT_EQ(ours.ended.size(), 1u) << "the code has not come yet";
    ours.gets(tag_pairs(tag_b) + result_pair(ResultCode::success));
    EXPECT_EQ(ours.ended.size(), 2u);
    EXPECT_EQ(ours.seen.size(), 3u);

    Streaming unknown(Bytes{});
    unknown.gets(tag_pairs(tag_a));
    unknown.silences(Command::get_io);
    unknown.runs(GetInputs{});
    unknown.waits(1s);  // the drain is over, the job's command is under way
    EXPECT_EQ(unknown.all(Command::get_io).size(), 1u);
    unknown.gets(tag_pairs(tag_b) + result_pair(ResultCode::success));
    EXPECT_EQ(unknown.seen.size(), 2u);
    EXPECT_EQ(unknown.count(Count::skipped_bytes), 0u);
}

TEST(CaenStream, ARestartBehindASilentStreamIsFoundByTheReadCycleAndByAMissingCode) {
    Streaming wordless(Bytes{});
    std::uint32_t cycle = 0;
    wordless.answers[Command::get_source_config] = [&](auto&, Bytes& pairs) {
        append_number(pairs, Attribute::config_value, cycle);
        return ResultCode::success;
    };
    wordless.waits(17s);
    EXPECT_EQ(wordless.streams(), 2u);
    EXPECT_EQ(wordless.all(Command::get_reader_info).size(), 1u);
    cycle = 1;
    wordless.waits(17s);
    EXPECT_EQ(wordless.all(Command::get_reader_info).size(), 2u);
    EXPECT_EQ(wordless.all(Command::set_source_config).size(), 2u);
    ASSERT_EQ(wordless.faults.size(), 1u);
    EXPECT_NE(wordless.faults[0].text.find("has lost its ReadCycle"), std::string::npos);

    Streaming coded;
    coded.gets(tag_pairs(tag_a));
    EXPECT_EQ(coded.does(GetInputs{}).status, JobResult::Status::done);
    coded.on_abort = nullptr;
    coded.waits(25s);
    EXPECT_EQ(coded.all(Command::get_reader_info).size(), 2u);
}

TEST(CaenStream, AJobThatSetsReadCycleIsFollowedByAnEndlessOneAgain) {
    Streaming ours;
    ours.gets(tag_pairs(tag_a));
    EXPECT_EQ(ours.does(SetParameter{"Source_0.ReadCycle", "5"}).status, JobResult::Status::done);
    ours.waits(100ms);
    auto cycles = ours.all(Command::set_source_config);
    ASSERT_EQ(cycles.size(), 3u);
    EXPECT_EQ(cycles[1].number(Attribute::config_value), 5);
    EXPECT_EQ(cycles[2].number(Attribute::config_value), 0);
    EXPECT_EQ(ours.streams(), 2u);
}

TEST(CaenStream, CompactTagsAreTold) {
    Streaming ours(result_pair(ResultCode::success), Given{{"compact", "true"}});
    Bytes tags;
    for (int i = 0; i < 200; ++i)
        append_bytes(tags, Attribute::tag_id, hex(tag_a));
    ours.gets(tags);
    ours.waits(1s);
    EXPECT_EQ(ours.seen.size(), 200u);
    EXPECT_EQ(ours.seen[0].technology, event::Technology::epc_gen2) << "the reader's protocol";
}

}  // namespace gantry::caen::driver_test
