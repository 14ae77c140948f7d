// A sink's runner with a journal of the test's own: what is lent when, and what comes of it.
#include "base/log.hpp"
#include "journal/sqlite.hpp"
#include "sink_bench.hpp"

namespace gantry::gateway {
namespace {

using test::ids;
using test::SinkBench;
using testkit::eventually;

TEST(SinkRunner, DeliversAllInOrderAndGoesOnAfterARestart) {
    SinkBench bench;
    bench.happen(25);
    bench.start();
    EXPECT_TRUE(bench.cursor_gets_to(25));
    EXPECT_EQ(bench.box.taken(), ids(1, 25));
    bench.happen(3);
    EXPECT_TRUE(eventually([&] { return bench.box.taken().size() == 28; }));
    bench.restart();
    EXPECT_EQ(bench.cursor(), 28u) << "what is known is left behind at the end";
    bench.happen(2);
    EXPECT_TRUE(bench.cursor_gets_to(30));
    EXPECT_EQ(bench.box.taken(), ids(1, 30)) << "nothing twice";
    bench.box.with([](auto& box) {
        for (auto size : box.batches)
            EXPECT_LE(size, 10u);
    });
    EXPECT_TRUE(eventually([&] { return bench.runner->status().state == "up to date"; }));
    auto status = bench.runner->status();
    EXPECT_EQ(status.behind, 0u);
    EXPECT_EQ(status.delivered, 2u) << "since the start";
    EXPECT_GT(status.bytes, 0u);
    EXPECT_EQ(status.trouble, "");
    EXPECT_TRUE(status.connected);
}

TEST(SinkRunner, ANewSinkStartsNowUnlessToldOtherwise) {
    SinkBench bench;
    bench.config.from_oldest = false;
    bench.happen(7);
    bench.start();
    EXPECT_TRUE(bench.cursor_gets_to(7)) << "its place is kept at once, or a crash would move it";
    bench.happen(2);
    EXPECT_TRUE(bench.cursor_gets_to(9));
    EXPECT_EQ(bench.box.taken(), ids(8, 9));
}

TEST(SinkRunner, WhatACrashForgotIsDeliveredAgain) {
    SinkBench bench;
    bench.happen(5);
    bench.storing = false;
    bench.start();
    EXPECT_TRUE(eventually([&] { return bench.box.taken().size() == 5; }));
    bench.runner.reset();
    bench.storing = true;
    bench.start();
    EXPECT_TRUE(bench.cursor_gets_to(5));
    auto twice = ids(1, 5);
    std::ranges::copy(ids(1, 5), std::back_inserter(twice));
    EXPECT_EQ(bench.box.taken(), twice) << "at least once, under the same ids";
}

TEST(SinkRunner, WhatIsKeptBlocksTheLineUntilItIsTaken) {
    SinkBench bench;
    log::Capture said;
    bench.box.with([](auto& box) { box.away = true; });
    bench.happen(12);
    bench.start();
    EXPECT_TRUE(eventually([&] { return bench.runner->status().retried >= 30; }));
    auto status = bench.runner->status();
    EXPECT_EQ(status.trouble, "nobody answers");
    EXPECT_TRUE(status.trouble_since && status.next_try && status.oldest);
    EXPECT_EQ(status.behind, 12u);
    EXPECT_FALSE(status.connected);
    EXPECT_NE(status.state.find("12 events wait"), std::string::npos) << status.state;
    EXPECT_EQ(bench.cursor(), 0u);
    bench.box.with([](auto& box) {
        box.away = false;
        box.takes = 3;  // of each call
    });
    EXPECT_TRUE(bench.cursor_gets_to(12));
    EXPECT_EQ(bench.box.taken(), ids(1, 12)) << "in order, nothing twice";
    EXPECT_TRUE(eventually([&] { return bench.runner->status().trouble.empty(); }));
    auto lines = said.take();
    EXPECT_NE(lines.find("warn sink box: nobody answers"), std::string::npos) << lines;
    EXPECT_NE(lines.find("info sink box: delivers again after"), std::string::npos) << lines;
    EXPECT_EQ(lines.find("nobody answers"), lines.rfind("nobody answers")) << "said once";
}

TEST(SinkRunner, ASinkThatThrowsOnlyWaits) {
    SinkBench bench;
    bench.box.with([](auto& box) { box.throws = true; });
    bench.happen(3);
    bench.start();
    EXPECT_TRUE(eventually([&] { return bench.runner->status().trouble == "the client library gave up"; }));
    bench.box.with([](auto& box) { box.throws = false; });
    EXPECT_TRUE(bench.cursor_gets_to(3));
}

TEST(SinkRunner, TheDestinationMaySayHowLongToWait) {
    SinkBench bench;
    bench.box.with([](auto& box) {
        box.away = true;
        box.retry_after = 1h;
    });
    bench.happen(1);
    bench.start();
    EXPECT_TRUE(eventually([&] { return bench.runner->status().next_try.has_value(); }));
    auto status = bench.runner->status();
    EXPECT_GT(*status.next_try - *status.trouble_since, 50min);
    bench.box.with([](auto& box) { box.away = false; });
    bench.runner->retry();
    EXPECT_TRUE(bench.cursor_gets_to(1)) << "somebody who knows better has the last word";
}

TEST(SinkRunner, PoisonBecomesADeadLetterAndTheRestGoesOn) {
    SinkBench bench;
    bench.box.with([](auto& box) { box.poison = {"g:2", "g:11"}; });
    bench.happen(15);
    bench.start();
    EXPECT_TRUE(bench.cursor_gets_to(15));
    auto letters = bench.letters();
    ASSERT_EQ(letters.size(), 2u);
    EXPECT_EQ(letters[0].seq, 2u);
    EXPECT_EQ(letters[0].reason, "it is poison");
    EXPECT_EQ(letters[0].tries, 1u);
    EXPECT_EQ(letters[1].seq, 11u);
    EXPECT_EQ(bench.box.taken().size(), 13u);
    EXPECT_TRUE(eventually([&] { return bench.runner->status().dead_letters == 2; }));
    EXPECT_EQ(bench.runner->status().rejected, 2u);

    bench.runner->offer_again({2});
    EXPECT_TRUE(eventually([&] { return bench.letters()[0].tries == 2; })) << "still poison";
    bench.box.with([](auto& box) { box.poison.clear(); });
    bench.runner->offer_again({});
    EXPECT_TRUE(eventually([&] { return bench.letters().empty(); }));
    EXPECT_EQ(bench.box.taken().size(), 15u);
    EXPECT_TRUE(eventually([&] { return bench.runner->status().dead_letters == 0; }));
    bench.box.with([](auto& box) {
        auto& again = box.payloads.back();
        EXPECT_NE(again.find(R"("id":"g:11")"), std::string::npos) << again;
        EXPECT_NE(again.find(R"("tag":"E2800B")"), std::string::npos) << "the same event: " << again;
    });
}

TEST(SinkRunner, DeadLettersOutliveTheDestinationsAbsence) {
    SinkBench bench;
    bench.box.with([](auto& box) { box.poison = {"g:1"}; });
    bench.happen(1);
    bench.start();
    EXPECT_TRUE(bench.cursor_gets_to(1));
    bench.box.with([](auto& box) {
        box.poison.clear();
        box.away = true;
    });
    bench.runner->offer_again({});
    EXPECT_TRUE(eventually([&] { return bench.runner->status().retried > 3; }));
    EXPECT_EQ(bench.letters().size(), 1u);
    bench.box.with([](auto& box) { box.away = false; });
    EXPECT_TRUE(eventually([&] { return bench.letters().empty(); }));
    EXPECT_EQ(bench.box.taken(), ids(1, 1));
}

TEST(SinkRunner, ADeadLetterThatIsKeptHoldsUpNoEvent) {
    SinkBench bench;
    bench.box.with([](auto& box) { box.poison = {"g:1", "g:2"}; });
    bench.happen(2);
    bench.start();
    EXPECT_TRUE(bench.cursor_gets_to(2));
    bench.box.with([](auto& box) {
        box.poison.clear();
        box.riddles = {"g:1"};
    });
    bench.runner->offer_again({});
    EXPECT_TRUE(eventually([&] { return bench.letters().size() == 1; }));
    EXPECT_TRUE(eventually([&] { return bench.runner->status().trouble == "it is a riddle"; }));
    bench.happen(30);
    EXPECT_TRUE(bench.cursor_gets_to(32));
    EXPECT_EQ(bench.box.taken(), ids(2, 32));
}

TEST(SinkRunner, SkippingADeadLetterThatIsKeptSkipsNoEvent) {
    SinkBench bench;
    bench.config.retry_min = bench.config.retry_max = 1h;
    bench.box.with([](auto& box) { box.poison = {"g:1"}; });
    bench.happen(1);
    bench.start();
    EXPECT_TRUE(bench.cursor_gets_to(1));
    bench.box.with([](auto& box) {
        box.poison.clear();
        box.riddles = {"g:1"};
    });
    bench.runner->offer_again({});
    EXPECT_TRUE(eventually([&] { return bench.runner->status().trouble == "it is a riddle"; }));
    bench.happen(3);
    ASSERT_TRUE(bench.runner->skip());
    EXPECT_TRUE(bench.cursor_gets_to(4));
    EXPECT_EQ(bench.box.taken(), ids(2, 4));
    EXPECT_EQ(bench.letters().size(), 1u) << "it is a dead letter still";
}

TEST(SinkRunner, WhatStandsBeforeDamageIsDeliveredAndOnlyTheDamageIsSkipped) {
    SinkBench bench;
    bench.happen(9);
    auto db = journal::Database::open(bench.dir.path() + "/gantry.db", journal::Database::Access::write);
    ASSERT_TRUE(db);
    ASSERT_TRUE(db->run("UPDATE event_rows SET rssi = 7 WHERE seq IN (4, 5)"));
    bench.start();
    EXPECT_TRUE(bench.cursor_gets_to(3));
    EXPECT_TRUE(eventually([&] { return !bench.runner->status().trouble.empty(); }));
    EXPECT_EQ(bench.box.taken(), ids(1, 3));
    ASSERT_TRUE(bench.runner->skip());
    EXPECT_TRUE(bench.cursor_gets_to(9));
    auto expected = ids(1, 3);
    for (auto& id : ids(6, 9))
        expected.push_back(id);
    EXPECT_EQ(bench.box.taken(), expected);
}

TEST(SinkRunner, DeadLettersCanBeThrownAway) {
    SinkBench bench;
    bench.box.with([](auto& box) { box.poison = {"g:1", "g:2", "g:3"}; });
    bench.happen(3);
    bench.start();
    EXPECT_TRUE(bench.cursor_gets_to(3));
    bench.runner->discard({2});
    EXPECT_TRUE(eventually([&] { return bench.letters().size() == 2; }));
    bench.runner->discard({});
    EXPECT_TRUE(eventually([&] { return bench.letters().empty(); }));
    EXPECT_TRUE(bench.box.taken().empty());
}

TEST(SinkRunner, ARefusalMayTakeSeveralTries) {
    SinkBench bench;
    bench.config.tries = 3;
    bench.box.with([](auto& box) { box.poison = {"g:2"}; });
    bench.happen(4);
    bench.start();
    EXPECT_TRUE(bench.cursor_gets_to(4));
    ASSERT_EQ(bench.letters().size(), 1u);
    EXPECT_EQ(bench.letters()[0].tries, 3u);
    EXPECT_EQ(bench.box.taken().size(), 3u);
}

TEST(SinkRunner, WhatBlocksCanBeSkipped) {
    SinkBench bench;
    EXPECT_TRUE((bench.start(), eventually([&] { return bench.runner->status().state != "starting"; })));
    EXPECT_FALSE(bench.runner->skip()) << "nothing blocks";
    bench.box.with([](auto& box) { box.takes = 0; });
    bench.happen(2);
    EXPECT_TRUE(eventually([&] { return !bench.runner->status().trouble.empty(); }));
    ASSERT_TRUE(bench.runner->skip());
    EXPECT_TRUE(eventually([&] { return bench.letters().size() == 1; }));
    EXPECT_EQ(bench.letters()[0].seq, 1u);
    EXPECT_NE(bench.letters()[0].reason.find("skipped by hand"), std::string::npos);
    bench.box.with([](auto& box) { box.takes = SIZE_MAX; });
    EXPECT_TRUE(bench.cursor_gets_to(2));
    EXPECT_EQ(bench.box.taken(), ids(2, 2));
}

TEST(SinkRunner, OnlyWhatIsSelectedGoesOutButTheCursorPassesAll) {
    SinkBench bench;
    bench.config.selection.types = {event::Type::tag_lost};
    bench.config.selection.readers = {"gate-*"};
    bench.happen(5);
    bench.happen(3, event::Type::tag_lost, "gate-1");
    bench.happen(4, event::Type::tag_lost, "dock-1");
    bench.start();
    EXPECT_TRUE(bench.cursor_gets_to(12));
    EXPECT_EQ(bench.box.taken(), ids(6, 8));
    EXPECT_TRUE(eventually([&] { return bench.runner->status().behind == 0; })) << "shown with the next turn";
}

TEST(SinkRunner, EventsHaveTheShapeThatWasAskedFor) {
    SinkBench bench;
    bench.config.shape = sink::Shape::cloudevents;
    bench.happen(1);
    bench.start();
    EXPECT_TRUE(bench.cursor_gets_to(1));
    bench.box.with([](auto& box) {
        EXPECT_NE(box.payloads.at(0).find(R"("specversion":"1.0")"), std::string::npos) << box.payloads.at(0);
    });
}

TEST(SinkRunner, ARateLimitBoundsEachCall) {
    SinkBench bench;
    bench.config.max_rate = 20;
    bench.config.batch = 30;
    bench.happen(25);
    bench.start();
    EXPECT_TRUE(bench.cursor_gets_to(25));
    EXPECT_EQ(bench.box.taken(), ids(1, 25));
    bench.box.with([](auto& box) {
        EXPECT_GT(box.calls, 1u) << "not all that was there at once";
        for (auto size : box.batches)
            EXPECT_TRUE(size >= 1 && size <= 20) << "a second's worth, however late it comes: " << size;
    });
}

TEST(SinkRunner, AnIdleSinkIsAskedNowAndThen) {
    SinkBench bench;
    bench.start();
    EXPECT_TRUE(eventually([&] {
        std::size_t idles = 0;
        bench.box.with([&](auto& box) { idles = box.idles; });
        return idles >= 2;
    }));
}

}  // namespace
}  // namespace gantry::gateway
