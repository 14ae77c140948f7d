#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "presence/tests/presence_world.hpp"

namespace gantry::presence::testing {
namespace {

struct World {
    explicit World(const Rules& rules = {}, std::size_t capacity = 1000, std::uint64_t first_id = 1)
        : presence(capacity, first_id) {
        presence.add_zone(rules);
        presence.add_zone(rules);
        for (int reader = 0; reader < 3; ++reader)
            presence.add_reader();
    }
    void see(std::string_view tag, Now now, ReaderIndex reader = 0, ZoneIndex zone = 0) {
        presence.sighted({.tag = tag_of(tag), .zone = zone, .reader = reader}, now, out);
    }
    std::vector<std::string> told() {
        std::vector<std::string> lines;
        for (auto& transition : out)
            lines.push_back(to_line(transition));
        out.clear();
        return lines;
    }
    Presence::Changes changes() {
        Presence::Changes changes;
        presence.take_changes(changes);
        return changes;
    }
    Presence presence;
    std::vector<Transition> out;
};
using Lines = std::vector<std::string>;
using Ids = std::vector<std::uint64_t>;

TEST(PresenceStore, ChangesNameWhatIsToBeStoredAndWhatIsToBeDeleted) {
    World world;
    world.presence.reader_online(0, start);
    world.see("A", start);
    world.see("B", start + 1s);
    auto changes = world.changes();
    EXPECT_EQ(changes.stored, (Ids{1, 2}));
    EXPECT_TRUE(changes.deleted.empty());
    world.see("A", start + 1s);
    EXPECT_TRUE(world.changes().stored.empty()) << "a sighting of a present tag is no change";
    world.presence.time_passed(start + 3s, world.out);
    EXPECT_EQ(world.changes().stored, (Ids{1, 2}));
    world.presence.time_passed(start + 2h, world.out);
    changes = world.changes();
    EXPECT_TRUE(changes.stored.empty());
    std::ranges::sort(changes.deleted);
    EXPECT_EQ(changes.deleted, (Ids{1, 2}));
    EXPECT_EQ(world.presence.find(1), nullptr);
}

TEST(PresenceStore, WhatComesAndGoesBetweenTwoCallsIsNoChange) {
    World world;
    world.presence.reader_online(0, start);
    world.see("A", start);
    world.presence.time_passed(start + 2h, world.out);
    auto changes = world.changes();
    EXPECT_TRUE(changes.stored.empty());
    EXPECT_TRUE(changes.deleted.empty());
}

TEST(PresenceStore, AnotherReaderIsAChange) {
    World world;
    world.presence.reader_online(0, start);
    world.see("A", start, 0);
    world.changes();
    world.see("A", start, 2);
    EXPECT_EQ(world.changes().stored, (Ids{1}));
    std::vector<ReaderIndex> readers;
    world.presence.readers_of(1, readers);
    EXPECT_EQ(readers, (std::vector<ReaderIndex>{0, 2}));
}

TEST(PresenceStore, EveryStaleRecordHasItsTurn) {
    World world;
    world.presence.reader_online(0, start);
    for (int tag = 0; tag < 300; ++tag)
        world.see("T" + std::to_string(tag), start);
    Ids stale;
    world.presence.take_stale(1000, stale);
    EXPECT_TRUE(stale.empty()) << "they wait to be stored as changes";
    world.changes();
    world.presence.take_stale(1000, stale);
    EXPECT_TRUE(stale.empty());

    // All are seen between any two calls, and still each comes up once a round.
    std::multiset<std::uint64_t> taken;
    for (int call = 0; call < 6; ++call) {
        for (int tag = 0; tag < 300; ++tag)
            world.see("T" + std::to_string(tag), start + 1s);
        stale.clear();
        world.presence.take_stale(100, stale);
        EXPECT_EQ(stale.size(), 100u);
        taken.insert(stale.begin(), stale.end());
    }
    for (std::uint64_t id = 1; id <= 300; ++id)
        EXPECT_EQ(taken.count(id), 2u) << id;
}

TEST(PresenceStore, IdsAreNeverUsedAgain) {
    World world({}, 1000, 41);
    world.presence.restore({.id = 77, .state = State::lost, .tag = tag_of("R")}, {}, start);
    world.presence.reader_online(0, start);
    std::set<std::uint64_t> ids;
    for (int round = 0; round < 50; ++round) {
        world.see("A", start + round * 2h);
        auto id = world.out.back().record.id;
        EXPECT_GT(id, 77u);
        EXPECT_TRUE(ids.insert(id).second) << id;
    }
}

// What a host does at a restart: all records with the readers that saw them, into a new process.
void restart(World& from, World& to, Now now) {
    for (auto id : from.changes().stored) {
        std::vector<ReaderIndex> readers;
        from.presence.readers_of(id, readers);
        to.presence.restore(*from.presence.find(id), readers, now);
    }
}

TEST(PresenceStore, ARestartContinuesWhatWasThere) {
    World before;
    before.presence.reader_online(0, start);
    before.see("A", start);
    before.see("B", start);
    before.presence.time_passed(start + 1s, before.out);

    World after;
    restart(before, after, start + 100s);
    EXPECT_EQ(after.presence.size(), 2u);
    EXPECT_EQ(after.presence.present(), 2u);
    EXPECT_FALSE(after.presence.deadline()) << "frozen: no reader is online";
    EXPECT_TRUE(after.changes().stored.empty()) << "it is in the store already";
    after.presence.time_passed(start + 1h, after.out);
    after.presence.reader_online(0, start + 2h);
    after.see("A", start + 2h + 1s);
    after.presence.time_passed(start + 2h + 10s, after.out);
    EXPECT_EQ(after.told(), (Lines{"7202s lost B Z", "7203s lost A Z"}));
    EXPECT_EQ(after.presence.find(1)->first_seen, start.wall);
    EXPECT_EQ(after.presence.find(1)->reads, 2u);
}

TEST(PresenceStore, ARestoredGlimpseIsObservedByAllThatWasSeenOfIt) {
    Rules rules{.glimpse_timeout = 10s, .observe_after = 5s};
    World before(rules);
    before.presence.reader_online(0, start);
    before.see("A", start);
    before.see("A", start + 3s);
    World after(rules);
    restart(before, after, start + 100s);
    after.presence.reader_online(0, start + 101s);
    after.see("A", start + 101s);
    after.see("A", start + 103s);
    EXPECT_EQ(after.told(), (Lines{"103s observed A Z"}));
}

TEST(PresenceStore, ARestoredTagIsNotNewAgainAndMovesFromWhereItWas) {
    World before;
    before.presence.reader_online(0, start);
    before.see("A", start, 0, 1);
    before.see("A", start + 1s, 0, 0);
    before.presence.time_passed(start + 10s, before.out);
    ASSERT_EQ(before.told().size(), 7u);

    World after;
    restart(before, after, start + 20s);
    EXPECT_EQ(after.presence.present(), 0u);
    after.presence.reader_online(0, start + 20s);
    after.see("A", start + 21s, 0, 1);
    EXPECT_EQ(after.told(), (Lines{"21s observed A Y", "21s moved A Y from Z"}));
    after.presence.time_passed(start + 2h, after.out);
    EXPECT_EQ(after.told(), (Lines{"23s lost A Y", "3620s purged A Z", "3623s purged A Y"}));
}

TEST(PresenceStore, ARestoredTagIsGivenUpAfterOfflineLoseAfter) {
    World before;
    before.presence.reader_online(0, start);
    before.see("A", start);
    World after({.offline_lose_after = 60s});
    restart(before, after, start + 5s);
    after.presence.time_passed(start + 100s, after.out);
    EXPECT_EQ(after.told(), (Lines{"65s lost A Z reader_offline"}));
}

TEST(PresenceStore, ARestoredGlimpseAfterALossStaysSilent) {
    World after({.observe_after_reads = 3});
    after.presence.restore({.id = 5, .state = State::glimpsed, .first_is_new = false, .tag = tag_of("A")}, {},
                           start);
    after.presence.reader_online(0, start);
    after.presence.time_passed(start + 1h, after.out);
    EXPECT_TRUE(after.told().empty());
    EXPECT_EQ(after.presence.find(5)->state, State::lost);
    after.presence.time_passed(start + 2h, after.out);
    EXPECT_EQ(after.told(), (Lines{"3602s purged A Z"}));
}

TEST(PresenceStore, ASecondRowForATagAndZoneIsDeletedFromTheStore) {
    World world;
    world.presence.restore({.id = 5, .state = State::observed, .tag = tag_of("A")}, {}, start);
    world.presence.restore({.id = 6, .state = State::lost, .tag = tag_of("A")}, {}, start);
    world.presence.restore({.id = 5, .state = State::lost, .tag = tag_of("B")}, {}, start);
    EXPECT_EQ(world.presence.size(), 1u);
    EXPECT_EQ(world.changes().deleted, (Ids{6}));
}

TEST(PresenceStore, AtTheBoundLostTagsGoFirstTheLongestLostFirst) {
    World world({}, 3);
    world.presence.reader_online(0, start);
    world.see("A", start);
    world.see("B", start + 1s);
    world.see("C", start + 60s);  // the others are lost by now
    world.presence.time_passed(start + 60s, world.out);
    world.told();
    world.see("D", start + 61s);
    EXPECT_EQ(world.told(), (Lines{"61s purged A Z capacity", "61s new D Z", "61s observed D Z"}));
    EXPECT_EQ(world.presence.size(), 3u);
    EXPECT_EQ(world.presence.present(), 2u);
}

TEST(PresenceStore, AtTheBoundThePresentTagWhoseDeadlineIsNearestGoes) {
    World world({.lose_after = 10s}, 3);
    world.presence.reader_online(0, start);
    world.see("A", start);
    world.see("B", start + 1s);
    world.see("C", start + 2s);
    world.see("A", start + 3s);
    world.told();
    world.see("D", start + 4s);
    EXPECT_EQ(world.told(),
              (Lines{"4s lost B Z capacity", "4s purged B Z capacity", "4s new D Z", "4s observed D Z"}));
    world.see("D", start + 5s, 0, 1);  // the same tag elsewhere is a record too
    EXPECT_EQ(world.told(), (Lines{"5s lost C Z capacity", "5s purged C Z capacity", "5s new D Y",
                                   "5s observed D Y", "5s moved D Y from Z"}));
    EXPECT_EQ(world.changes().stored.size(), 3u);
}

TEST(PresenceStore, AtTheBoundWhatIsDueAnywayGoesForItsOwnReason) {
    World world({.observe_after_reads = 2}, 2);
    world.presence.reader_online(0, start);
    world.see("A", start);
    world.see("B", start + 1s);
    world.see("C", start + 2s);
    EXPECT_EQ(world.told(),
              (Lines{"0s new A Z", "1s new B Z", "2s purged A Z glimpse_timeout", "2s new C Z"}));
    world.see("D", start + 2s);
    EXPECT_EQ(world.told(), (Lines{"2s purged B Z capacity", "2s new D Z"}));
}

TEST(PresenceStore, AtTheBoundFrozenTagsGoToo) {
    World world({}, 2);
    world.presence.reader_online(0, start);
    world.see("A", start);
    world.see("B", start);
    world.presence.reader_offline(0, start);
    world.presence.time_passed(start + 1h, world.out);
    world.presence.reader_online(1, start + 1h);
    world.told();
    world.see("C", start + 1h, 1);
    auto told = world.told();
    ASSERT_EQ(told.size(), 4u);
    EXPECT_TRUE(told[0] == "1h lost A Z capacity" || told[0] == "1h lost B Z capacity") << told[0];
    EXPECT_EQ(world.presence.size(), 2u);
}

TEST(PresenceStore, ARestartWithASmallerBoundTellsWhatItForgot) {
    World world({}, 2);
    for (std::uint64_t id = 1; id <= 3; ++id)
        world.presence.restore({.id = id, .state = State::lost, .tag = tag_of("T" + std::to_string(id))}, {},
                               start);
    EXPECT_EQ(world.presence.size(), 2u);
    ASSERT_TRUE(world.presence.deadline());
    world.presence.time_passed(start, world.out);
    EXPECT_EQ(world.told(), (Lines{"0s purged T1 Z capacity"}));
    EXPECT_EQ(world.changes().deleted, (Ids{1}));
}

TEST(PresenceStore, TimeThatRunsBackwardsALittleDoesNoHarm) {
    World world;
    world.presence.reader_online(0, start);
    world.see("A", start + 5s);
    world.see("A", start + 3s);  // another thread's report, late
    EXPECT_EQ(world.presence.find(1)->last_seen, (start + 5s).wall);
    world.see("B", start + 4s);
    world.presence.time_passed(start + 1s, world.out);
    world.presence.reader_offline(0, start + 2s);
    world.presence.reader_online(0, start + 1s);
    world.presence.time_passed(start + 6s, world.out);
    world.presence.time_passed(start + 7s, world.out);
    EXPECT_EQ(world.told(), (Lines{"5s new A Z", "5s observed A Z", "4s new B Z", "4s observed B Z",
                                   "6s lost B Z", "7s lost A Z"}));
    world.see("A", start + 6s);  // older than the loss
    EXPECT_EQ(world.told(), (Lines{"7s observed A Z"}));
    world.presence.time_passed(start + 9s, world.out);
    EXPECT_EQ(world.told(), (Lines{"9s lost A Z"}));
}

}  // namespace
}  // namespace gantry::presence::testing
