#include <gtest/gtest.h>

#include "presence/tests/presence_world.hpp"

namespace gantry::presence::testing {
namespace {

const Rules at_once{};
const Rules by_count{.observe_after_reads = 3};
const Rules give_up{.offline_lose_after = 30s};

TEST(PresenceOffline, ACutCableLosesNothing) {
    expect_story(at_once,
                 "0s online r1\n"
                 "0s see A in Z by r1\n"
                 "1500ms offline r1\n"
                 "1000s online r1\n"
                 "1000499ms end\n",
                 "0s new A Z\n"
                 "0s observed A Z\n");
}

TEST(PresenceOffline, TimersGoOnWhereTheyStoodWhenTheReaderIsBack) {
    expect_story(at_once,
                 "0s online r1\n"
                 "0s see A in Z by r1\n"
                 "1500ms offline r1\n"
                 "1000s online r1\n"
                 "1000100ms offline r1\n"
                 "2000s online r1\n"
                 "3000s end\n",
                 "0s new A Z\n"
                 "0s observed A Z\n"
                 "2000400ms lost A Z\n");
}

TEST(PresenceOffline, WhatIsDueWhenTheReaderGoesIsLost) {
    expect_story(at_once,
                 "0s online r1\n"
                 "0s see A in Z by r1\n"
                 "2s offline r1\n"
                 "10s end\n",
                 "0s new A Z\n"
                 "0s observed A Z\n"
                 "2s lost A Z\n");
}

TEST(PresenceOffline, AGlimpseFreezesToo) {
    expect_story(by_count,
                 "0s online r1\n"
                 "0s see A in Z by r1\n"
                 "1s offline r1\n"
                 "100s online r1\n"
                 "102s end\n",
                 "0s new A Z\n"
                 "101s purged A Z glimpse_timeout\n");
}

TEST(PresenceOffline, APurgeFreezesToo) {
    expect_story(Rules{.purge_after = 10s},
                 "0s online r1\n"
                 "0s see A in Z by r1\n"
                 "7s offline r1\n"
                 "1000s online r1\n"
                 "2000s end\n",
                 "0s new A Z\n"
                 "0s observed A Z\n"
                 "2s lost A Z\n"
                 "1005s purged A Z\n");
}

TEST(PresenceOffline, OneReaderThatSawItKeepsTheTimersRunning) {
    expect_story(at_once,
                 "0s online r1\n"
                 "0s online r2\n"
                 "0s see A in Z by r1\n"
                 "1s see A in Z by r2\n"
                 "1500ms offline r2\n"
                 "10s end\n",
                 "0s new A Z\n"
                 "0s observed A Z\n"
                 "3s lost A Z\n");
}

TEST(PresenceOffline, AReaderThatNeverSawItDoesNotKeepTheTimersRunning) {
    expect_story(at_once,
                 "0s online r1\n"
                 "0s online r2\n"
                 "0s see A in Z by r1\n"
                 "500ms see A in Y by r2\n"
                 "1s offline r1\n"
                 "10s online r1\n"
                 "20s end\n",
                 "0s new A Z\n"
                 "0s observed A Z\n"
                 "500ms new A Y\n"
                 "500ms observed A Y\n"
                 "500ms moved A Y from Z\n"
                 "2500ms lost A Y\n"
                 "11s lost A Z\n");
}

TEST(PresenceOffline, TheTimersStandOnlyWhileBothReadersAreOffline) {
    expect_story(at_once,
                 "0s online r1\n"
                 "0s online r2\n"
                 "0s see A in Z by r1\n"
                 "0s see A in Z by r2\n"
                 "500ms offline r1\n"
                 "1s offline r2\n"  // half of two seconds is over
                 "50s online r1\n"  // and it goes on
                 "50.4s online r2\n"
                 "50.5s offline r1\n"
                 "50.6s offline r2\n"
                 "90s online r2\n"
                 "99s end\n",
                 "0s new A Z\n"
                 "0s observed A Z\n"
                 "90400ms lost A Z\n");
}

TEST(PresenceOffline, AReaderOfAnEarlierLifeDoesNotKeepTheTimersRunning) {
    expect_story(at_once,
                 "0s online r1\n"
                 "0s online r2\n"
                 "0s see A in Z by r1\n"
                 "5s see A in Z by r2\n"
                 "6s offline r2\n"
                 "100s end\n",
                 "0s new A Z\n"
                 "0s observed A Z\n"
                 "2s lost A Z\n"
                 "5s observed A Z\n");
}

TEST(PresenceOffline, ATagSeenElsewhereInTheZoneGoesOn) {
    expect_story(at_once,
                 "0s online r1\n"
                 "0s online r2\n"
                 "0s see A in Z by r1\n"
                 "1s offline r1\n"
                 "60s see A in Z by r2\n"
                 "70s end\n",
                 "0s new A Z\n"
                 "0s observed A Z\n"
                 "62s lost A Z\n");
}

TEST(PresenceOffline, AfterOfflineLoseAfterTheTagIsLostWithTheReason) {
    expect_story(give_up,
                 "0s online r1\n"
                 "0s see A in Z by r1\n"
                 "1s offline r1\n"
                 "30999999us end\n",
                 "0s new A Z\n"
                 "0s observed A Z\n");
    expect_story(give_up,
                 "0s online r1\n"
                 "0s see A in Z by r1\n"
                 "1s offline r1\n"
                 "9000s online r1\n"
                 "9001s end\n"
                 "99999s end\n",
                 "0s new A Z\n"
                 "0s observed A Z\n"
                 "31s lost A Z reader_offline\n"
                 "210min purged A Z\n");  // its hour starts when the reader is back
}

TEST(PresenceOffline, OfflineLoseAfterMayBeShorterThanWhatRuns) {
    expect_story(Rules{.lose_after = 1h, .offline_lose_after = 5s},
                 "0s online r1\n"
                 "0s see A in Z by r1\n"
                 "1s offline r1\n"
                 "4s online r1\n"
                 "10s offline r1\n"
                 "50s end\n",
                 "0s new A Z\n"
                 "0s observed A Z\n"
                 "15s lost A Z reader_offline\n");
    expect_story(Rules{.offline_lose_after = 0s},
                 "0s online r1\n"
                 "0s see A in Z by r1\n"
                 "1s offline r1\n"
                 "1s end\n",
                 "0s new A Z\n"
                 "0s observed A Z\n"
                 "1s lost A Z reader_offline\n");
}

TEST(PresenceOffline, WhatWasNeverObservedIsPurgedWithTheReason) {
    auto rules = by_count;
    rules.offline_lose_after = 30s;
    expect_story(rules,
                 "0s online r1\n"
                 "0s see A in Z by r1\n"
                 "1s offline r1\n"
                 "60s end\n",
                 "0s new A Z\n"
                 "31s purged A Z reader_offline\n");
}

TEST(PresenceOffline, ATransitionFoundWhenAReaderComesOrGoesWaitsForTheNextCall) {
    Presence presence;
    presence.add_zone(at_once);
    auto reader = presence.add_reader();
    presence.reader_online(reader, start);
    std::vector<Transition> out;
    presence.sighted({.tag = tag_of("A")}, start, out);
    Presence::Changes changes;
    presence.take_changes(changes);
    presence.reader_offline(reader, start + 3s);
    ASSERT_TRUE(presence.deadline());
    EXPECT_LE(*presence.deadline(), (start + 3s).steady);
    presence.take_changes(changes);
    EXPECT_TRUE(changes.stored.empty()) << "its loss would be stored without its event";
    out.clear();
    presence.time_passed(start + 3s, out);
    ASSERT_EQ(out.size(), 1u);
    EXPECT_EQ(to_line(out[0]), "2s lost A Z");
    presence.take_changes(changes);
    EXPECT_EQ(changes.stored.size(), 1u);
    out.clear();
    presence.time_passed(start + 30h, out);
    EXPECT_TRUE(out.empty()) << "the purge is frozen";
    EXPECT_FALSE(presence.deadline());
}

TEST(PresenceOffline, ManySetsOfReadersComeAndGo) {
    // Each tag is seen by a set of readers of its own; sets that nobody needs are swept and used again.
    Presence presence;
    presence.add_zone({.lose_after = 1s, .purge_after = 1s});
    std::vector<Transition> out;
    for (int reader = 0; reader < 12; ++reader)
        presence.reader_online(presence.add_reader(), start);
    auto now = start;
    for (unsigned mask = 1; mask < 4096; ++mask) {
        auto tag = tag_of("T" + std::to_string(mask));
        for (ReaderIndex reader = 0; reader < 12; ++reader)
            if ((mask >> reader & 1) != 0) presence.sighted({.tag = tag, .reader = reader}, now, out);
        now = now + 10ms;
        presence.time_passed(now, out);
    }
    for (ReaderIndex reader = 0; reader < 12; ++reader)
        presence.reader_offline(reader, now);
    auto still = presence.size();
    EXPECT_GT(still, 100u);
    presence.time_passed(now + 1h, out);
    EXPECT_EQ(presence.size(), still);
    presence.reader_online(3, now + 1h);
    presence.time_passed(now + 2h, out);
    EXPECT_LT(presence.size(), still);
    for (ReaderIndex reader = 0; reader < 12; ++reader)
        presence.reader_online(reader, now + 2h);
    presence.time_passed(now + 3h, out);
    EXPECT_EQ(presence.size(), 0u);
    EXPECT_EQ(out.size(), 4095u * 4);  // new, observed, lost, purged: each tag had its whole life
}

}  // namespace
}  // namespace gantry::presence::testing
