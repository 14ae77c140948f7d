#include "protocols/silion/repeats.hpp"

#include "support.hpp"

// The heart of promise P1: when an equal frame is a repeat, and what is acknowledged
// (docs/protocols/silion.md section 8). Told through the driver, as a reader sees it.
namespace gantry::silion::test {

static Bytes mark_of(std::string_view frame) {
    return Digest::of(hex(frame)).mark();
}

TEST(SilionDigest, TellsFramesApartThatDifferAnywhere) {
    auto frame = hex(tags_a);
    std::set<Bytes> marks = {Digest::of(frame).mark()};
    for (std::size_t i = 0; i < frame.size(); ++i)
        for (int bit = 0; bit < 8; ++bit) {
            auto other = frame;
            other[i] ^= static_cast<std::uint8_t>(1 << bit);
            EXPECT_TRUE(marks.insert(Digest::of(other).mark()).second);
        }
    for (std::size_t size = 0; size < frame.size(); ++size)
        EXPECT_TRUE(marks.insert(Digest::of(ByteView(frame).first(size)).mark()).second);
    auto longer = frame;
    longer.push_back(0);
    EXPECT_TRUE(marks.insert(Digest::of(longer).mark()).second);
}

TEST(SilionDigest, ComesBackFromItsMark) {
    auto digest = Digest::of(hex(tags_a));
    EXPECT_EQ(Digest::from_mark(digest.mark()), digest);
    EXPECT_FALSE(Digest::from_mark({}));
    EXPECT_FALSE(Digest::from_mark(hex("0102")));
}

TEST(SilionRepeats, AnEqualFrameWhileItsPredecessorsTicketIsOpenIsARepeat) {
    Ours ours;
    ours.gets(tags_a);
    for (auto wait : {10ms, 1000ms, 5000ms}) {
        ours.waits(wait);
        ours.gets(tags_a);
    }
    EXPECT_EQ(ours.tags(), 3u);
    EXPECT_EQ(ours.count(Count::repeats), 3u);
    EXPECT_EQ(ours.count(Count::reads), 3u);
    EXPECT_EQ(ours.says(), "") << "nothing is acknowledged before it is safe";
    ours.commits();
    EXPECT_EQ(ours.says(), ack) << "one acknowledgement for the frame and its repeats: a second one would "
                                   "acknowledge the next frame before that is safe";
}

// The store was slow: the reader waited for its place and repeated its frame into the socket all the while. A
// second acknowledgement would be taken for its next frame.
TEST(SilionRepeats, WhatPiledUpWhileTheReaderWasHeldIsAnsweredOnce) {
    for (auto hold : {5s, 20s, 120s}) {
        Repeats repeats(5s);
        auto frame = Digest::of(hex(tags_a));
        Steady start{1h};
        repeats.start(start);
        repeats.know(frame.mark());
        repeats.resumed(start, start + hold);
        auto first = repeats.judge(frame, start);  // it came when the hold began
        EXPECT_EQ(first.verdict, Repeats::Verdict::repeat);
        EXPECT_TRUE(first.acknowledge);
        for (int i = 1; i <= 3; ++i) {
            auto again = repeats.judge(frame, start + hold + i * 1ms);
            EXPECT_EQ(again.verdict, Repeats::Verdict::repeat);
            EXPECT_FALSE(again.acknowledge);
        }
        // If that one acknowledgement was lost, the reader asks again after its wait.
        auto later = repeats.judge(frame, start + hold + 5s);
        EXPECT_EQ(later.verdict, Repeats::Verdict::repeat);
        EXPECT_TRUE(later.acknowledge);
    }
}

TEST(SilionRepeats, AfterTheAckWaitAnEqualFrameIsARepeatAndIsAcknowledgedAgain) {
    Ours ours;
    ours.gets(tags_a);
    ours.commits();
    EXPECT_EQ(ours.says(), ack);
    for (int i = 0; i < 3; ++i) {  // each of our acknowledgements is lost
        ours.waits(5s);
        ours.gets(tags_a);
        EXPECT_EQ(ours.says(), ack);
    }
    EXPECT_EQ(ours.count(Count::repeats), 3u);
    EXPECT_EQ(ours.count(Count::acknowledged), 4u);
    EXPECT_EQ(ours.tags(), 3u);
}

TEST(SilionRepeats, BeforeNineTenthsOfTheAckWaitAnEqualFrameIsNew) {
    Ours ours;
    ours.gets(tags_a);
    ours.commits();
    ours.says();
    ours.waits(4499ms);
    ours.gets(tags_a);
    EXPECT_EQ(ours.tags(), 6u);
    EXPECT_EQ(ours.count(Count::repeats), 0u);
    EXPECT_EQ(ours.says(), "");
    ours.commits();
    EXPECT_EQ(ours.says(), ack);
}

TEST(SilionRepeats, TheEdgesOfTheWindowAreNineTenthsOfTheWaitAndSixtyOneSeconds) {
    for (auto [wait, repeat] : {std::pair{4500ms, true}, {61'000ms, true}, {61'001ms, false}}) {
        Ours ours(Given{{"heartbeat", "60s"}});
        ours.gets(tags_a);
        ours.commits();
        ours.waits(wait);
        ours.gets(tags_a);
        EXPECT_EQ(ours.count(Count::repeats), repeat ? 1u : 0u) << wait.count();
        EXPECT_EQ(ours.tags(), repeat ? 3u : 6u);
    }
    for (auto [wait, repeat] :
         {std::pair{89'999ms, false}, {90'000ms, true}, {101'000ms, true}, {101'001ms, false}}) {
        Ours ours(Given{{"heartbeat", "60s"}, {"ack_wait", "100s"}});
        ours.gets(tags_a);
        ours.commits();
        ours.waits(wait);
        ours.gets(tags_a);
        EXPECT_EQ(ours.count(Count::repeats), repeat ? 1u : 0u) << wait.count();
    }
}

TEST(SilionRepeats, TheWindowBeginsAtTheLastArrival) {
    Ours ours;
    ours.gets(tags_a);
    ours.waits(5s);
    ours.gets(tags_a);  // its ticket is open
    ours.commits();
    ours.says();
    ours.waits(2s);
    ours.gets(tags_a);  // 7 s after the first, 2 s after the last: the reader has gone on
    EXPECT_EQ(ours.tags(), 6u);
}

TEST(SilionRepeats, AnyOtherUploadInBetweenProvesThatTheReaderWaitsNoMore) {
    for (auto other : {heartbeat_0, inputs_1011, fault_11, tags_b, tags_plain, no_tags,
                       std::string_view("FF06000006000000000073696C696F6E")}) {
        SCOPED_TRACE(other);
        Ours ours;
        ours.gets(tags_a);
        ours.commits();
        ours.waits(1s);
        ours.gets(other);
        ours.commits();
        ours.waits(4s);
        auto before = ours.tags();
        ours.gets(tags_a);
        EXPECT_EQ(ours.tags(), before + 3) << "a new batch of the same tags";
        EXPECT_EQ(ours.count(Count::repeats), 0u);
    }
}

TEST(SilionRepeats, AnUploadBeforeTheCommitCountsAsWell) {
    Ours ours;
    ours.gets(tags_a);
    ours.gets(heartbeat_0);
    ours.commits();
    ours.waits(5s);
    ours.gets(tags_a);
    EXPECT_EQ(ours.tags(), 6u);
}

TEST(SilionRepeats, AnAnswerToACommandIsNoProof) {
    Ours ours;
    ours.gets(tags_a);
    ours.commits();
    ours.driver.run({.id = 1, .deadline = ours.now.steady + 30s}, GetInputs{}, ours.now);
    ours.says();
    ours.waits(1s);
    ours.gets("FF06000916000000000073696C696F6E040101020003010401");
    ours.waits(4s);
    ours.gets(tags_a);  // a waiting reader still answers commands
    EXPECT_EQ(ours.count(Count::repeats), 1u);
    EXPECT_EQ(ours.tags(), 3u);
}

TEST(SilionRepeats, ARepeatThatCrossesOurAcknowledgementIsNotAcknowledgedAgain) {
    Ours ours;
    ours.gets(tags_a);
    ours.waits(4990ms);
    ours.commits();
    EXPECT_EQ(ours.says(), ack);
    ours.waits(20ms);
    ours.gets(tags_a);  // sent before our acknowledgement came
    EXPECT_EQ(ours.count(Count::repeats), 1u);
    EXPECT_EQ(ours.says(), "");
    // Had it been lost, the reader would ask again.
    ours.waits(5s);
    ours.gets(tags_a);
    EXPECT_EQ(ours.count(Count::repeats), 2u);
    EXPECT_EQ(ours.says(), ack);
    EXPECT_EQ(ours.tags(), 3u);
}

TEST(SilionRepeats, FirstOnANewConnectionTheFrameCommittedLastIsARepeat) {
    for (bool heartbeat_first : {false, true})
        for (auto wait : {0ms, 10'000ms}) {
            Ours ours({}, mark_of(tags_a));
            if (heartbeat_first) ours.gets(heartbeat_0);
            ours.waits(wait);
            ours.gets(tags_a);
            EXPECT_EQ(ours.tags(), 0u);
            EXPECT_EQ(ours.count(Count::repeats), 1u);
            EXPECT_EQ(ours.says(), ack);
            ours.waits(5s);
            ours.gets(tags_a);  // and once more, when that acknowledgement is lost
            EXPECT_EQ(ours.count(Count::repeats), 2u);
            EXPECT_EQ(ours.says(), ack);
        }
}

TEST(SilionRepeats, OnlyTheFirstTagFrameOfAConnectionIsComparedWithTheMark) {
    for (auto first : {tags_b, tags_plain}) {
        Ours ours({}, mark_of(tags_a));
        ours.gets(first);
        auto before = ours.tags();
        ours.gets(tags_a);
        EXPECT_EQ(ours.tags(), before + 3);
        EXPECT_EQ(ours.count(Count::repeats), 0u);
    }
}

TEST(SilionRepeats, LaterThanTenSecondsItCannotBeToldAndTheReadsAreKeptAndMarked) {
    Ours ours({}, mark_of(tags_a));
    ours.gets(heartbeat_0);
    ours.waits(10'001ms);
    ours.gets(tags_a);
    EXPECT_EQ(ours.tags(), 3u);
    EXPECT_EQ(ours.count(Count::repeats), 0u);
    ASSERT_FALSE(ours.reports.empty());
    EXPECT_TRUE(ours.reports.back().possible_repeat);
    EXPECT_EQ(ours.says(), "");
    ours.commits();
    EXPECT_EQ(ours.says(), ack);
    ours.waits(1s);
    ours.gets(tags_b);
    EXPECT_FALSE(ours.reports.back().possible_repeat);
}

// The store is damaged where this reader's mark was, or what is there is no mark.
TEST(SilionRepeats, WithoutKnowingWhatWasStoredLastTheFirstFrameIsKeptAndMarked) {
    for (bool unreadable : {true, false}) {
        Ours ours({}, unreadable ? Bytes{} : hex("0102"));
        ours.known.mark_unreadable = unreadable;
        ours.gets(heartbeat_0);
        ours.waits(1s);
        ours.gets(tags_a);
        ASSERT_EQ(ours.tags(), 3u);
        EXPECT_TRUE(ours.reports.back().possible_repeat);
        EXPECT_EQ(ours.reports.back().mark, mark_of(tags_a)) << "it takes the place of the damaged one";
        EXPECT_EQ(ours.says(), "") << "no acknowledgement before it is safe";
        ours.commits();
        EXPECT_EQ(ours.says(), ack);
        ours.waits(1s);
        ours.gets(tags_b);
        EXPECT_EQ(ours.tags(), 4u);
        EXPECT_FALSE(ours.reports.back().possible_repeat);
    }
}

TEST(SilionRepeats, AReportThatMayRepeatStandsAlone) {
    Ours ours(Given{{"identify_within", "60s"}, {"heartbeat", "60s"}}, mark_of(tags_a));
    ours.waits(11s);
    auto all = hex(tags_a), more = hex(tags_b);
    all.insert(all.end(), more.begin(), more.end());
    ours.gets_bytes(all);
    ASSERT_EQ(ours.reports.size(), 2u);
    EXPECT_TRUE(ours.reports[0].possible_repeat);
    EXPECT_EQ(ours.reports[0].observations.size(), 3u);
    EXPECT_FALSE(ours.reports[1].possible_repeat);
    EXPECT_EQ(ours.reports[1].observations.size(), 1u);
}

TEST(SilionRepeats, AFrameThatAsksForNothingIsNeverARepeat) {
    Ours ours({}, mark_of(tags_plain));
    for (int i = 0; i < 3; ++i) {
        ours.gets(tags_plain);
        ours.waits(5s);
    }
    EXPECT_EQ(ours.tags(), 9u);
    EXPECT_EQ(ours.count(Count::repeats), 0u);
    EXPECT_EQ(ours.says(), "");
}

TEST(SilionRepeats, SeveralOutstandingFramesAreAcknowledgedInOrderOneEach) {
    Ours ours;
    ours.gets(tags_a);
    ours.gets(tags_b);
    ours.gets(tags_a);
    ASSERT_EQ(ours.reports.size(), 2u);
    ours.driver.committed(ours.reports[0].ticket, ours.now);
    EXPECT_EQ(ours.says(), ack);
    ours.driver.committed(ours.reports[1].ticket, ours.now);
    EXPECT_EQ(ours.says(), ack);
    EXPECT_EQ(ours.count(Count::repeats), 1u);
    ours.gets("FF06000201010000000073696C696F6E0000");  // no tags, but it asks
    ours.gets(tags_a);
    ours.commits();  // both at once
    EXPECT_EQ(ours.says(), std::string(ack) + std::string(ack));
}

TEST(SilionRepeats, EachReportCarriesTheMarkOfItsFrame) {
    Ours ours;
    ours.gets(tags_a);
    ASSERT_EQ(ours.reports.size(), 1u);
    EXPECT_EQ(ours.reports[0].mark, mark_of(tags_a));
    ours.gets(tags_plain);
    EXPECT_FALSE(ours.reports[1].mark) << "the acknowledgement of the first has not gone out";
}

TEST(SilionRepeats, TheMarkGoesWhenTheAcknowledgementHasArrived) {
    Ours ours;
    ours.gets(tags_a);
    ours.gets(heartbeat_0);
    EXPECT_EQ(ours.reports.size(), 1u) << "not acknowledged yet: the heartbeat proves nothing";
    ours.commits();
    ours.waits(10s);
    ours.gets(heartbeat_1);
    ASSERT_EQ(ours.reports.size(), 2u);
    EXPECT_EQ(ours.reports[1].mark, Bytes{});
    EXPECT_TRUE(ours.reports[1].observations.empty());
    EXPECT_TRUE(ours.reports[1].notices.empty());
    ours.waits(10s);
    ours.gets(heartbeat_1);
    EXPECT_EQ(ours.reports.size(), 2u) << "once is enough";
}

TEST(SilionRepeats, TheMarkGoesWithTheNextReportThereIs) {
    Ours ours;
    ours.gets(tags_a);
    ours.commits();
    ours.gets(inputs_1011);
    ASSERT_EQ(ours.reports.size(), 2u);
    EXPECT_EQ(ours.reports[1].mark, Bytes{});
    ours.gets(tags_a);
    ours.commits();
    ours.gets(tags_plain);
    ASSERT_EQ(ours.reports.size(), 4u);
    EXPECT_EQ(ours.reports[3].mark, Bytes{});
    EXPECT_EQ(ours.reports[3].observations.size(), 3u);
}

TEST(SilionRepeats, AStoredMarkStaysUntilThisConnectionKnowsBetter) {
    Ours ours({}, mark_of(tags_a));
    ours.gets(heartbeat_0);
    ours.waits(5s);
    ours.gets(heartbeat_1);
    EXPECT_TRUE(ours.reports.empty()) << "the acknowledgement went out on another connection";
    ours.gets(tags_plain);
    ASSERT_EQ(ours.reports.size(), 1u);
    EXPECT_EQ(ours.reports[0].mark, Bytes{}) << "a reader that waits would have sent the other frame first";
}

}  // namespace gantry::silion::test
