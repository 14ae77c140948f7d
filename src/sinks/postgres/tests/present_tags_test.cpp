#include "server.hpp"

namespace gantry::sinks::postgres::tests {
namespace {

using event::Type;

struct PostgresPresentTags : testing::Test {
    Server server;
    std::unique_ptr<sink::Sink> sink;
    void SetUp() override {
        server.start();
        sink = sink_of(server, {{"present_tags", "true"}});
    }
    // "zone reader tag": what a test says in one word each; "-" for none.
    static event::Event& tell(Lent& lent, std::uint64_t seq, Type type, const std::string& zone,
                              std::uint8_t tag, const std::string& reader = "dock-1") {
        auto& event = lent.add(type);
        event.seq = seq;
        event.zone = zone;
        event.reader = reader;
        event.technology = event::Technology::epc_gen2;
        event.tag = event::TagId(Bytes{tag});
        event.antenna = "Ant0";
        event.rssi = -500;
        event.reads = seq;
        event.first_seen = event.last_seen = event.time;
        return event;
    }
    void deliver(Lent& lent, const std::string& prefix = "suite:") {
        expect_all_accepted(sink->deliver(lent.items(prefix), patience(20s)));
    }
    std::string present() {
        return server.value(
            "SELECT coalesce(string_agg(concat_ws(' ', zone, reader, tag, reads), ', ' ORDER BY zone, "
            "reader, tag), '') FROM gantry.present_tags");
    }
};

TEST_F(PostgresPresentTags, TheWordsBeforeATagsIdAreShown) {
    Lent lent;
    tell(lent, 1, Type::tag_new, "dock", 0xA1).pc = 0x3000;
    auto& newer = tell(lent, 2, Type::tag_observed, "dock", 0xA1);
    newer.pc = 0x3400;
    newer.xpc = 0x80010000;
    tell(lent, 3, Type::tag_new, "dock", 0xB2);
    deliver(lent);
    EXPECT_EQ(server.value("SELECT string_agg(concat_ws(' ', tag, pc, xpc), ', ' ORDER BY tag) FROM "
                           "gantry.present_tags"),
              "A1 3400 8001, B2");
}

TEST_F(PostgresPresentTags, ATableOfTheFirstVersionIsUpgradedWithItsRows) {
    Lent first;
    tell(first, 1, Type::tag_new, "dock", 0xA1);
    deliver(first);
    server.sql(
        "DROP VIEW gantry.present_tags; ALTER TABLE gantry.tag_presence DROP COLUMN pc, DROP COLUMN xpc; "
        "CREATE "
        "VIEW gantry.present_tags AS SELECT gateway, tag, technology, epc, zone, reader, antenna, "
        "first_seen, "
        "last_seen, reads, rssi_dbm FROM gantry.tag_presence WHERE present; ALTER VIEW gantry.present_tags "
        "OWNER TO gantry; UPDATE gantry.gantry_versions SET version = 1 WHERE name = 'present_tags'");
    sink = sink_of(server, {{"present_tags", "true"}});
    Lent second;
    tell(second, 2, Type::tag_new, "dock", 0xB2).pc = 0x3000;
    deliver(second);
    EXPECT_EQ(present(), "dock dock-1 A1 1, dock dock-1 B2 2");
    EXPECT_EQ(server.value("SELECT pc FROM gantry.present_tags WHERE tag = 'B2'"), "3000");
    EXPECT_EQ(server.value("SELECT version FROM gantry.gantry_versions WHERE name = 'present_tags'"), "2");
}

TEST_F(PostgresPresentTags, ATagIsThereFromItsFirstEventUntilItIsLostOrPurged) {
    Lent first;
    tell(first, 1, Type::tag_new, "dock", 0xA1);
    tell(first, 2, Type::tag_observed, "dock", 0xA1);
    tell(first, 3, Type::tag_new, "dock", 0xB2);
    deliver(first);
    EXPECT_EQ(present(), "dock dock-1 A1 2, dock dock-1 B2 3");
    Lent second;
    tell(second, 4, Type::tag_lost, "dock", 0xA1);
    tell(second, 5, Type::tag_purged, "dock", 0xB2);
    tell(second, 6, Type::tag_new, "dock", 0xC3);
    deliver(second);
    EXPECT_EQ(present(), "dock dock-1 C3 6");
    Lent back;
    tell(back, 7, Type::tag_observed, "dock", 0xA1);
    deliver(back);
    EXPECT_EQ(present(), "dock dock-1 A1 7, dock dock-1 C3 6");
    EXPECT_EQ(server.value("SELECT technology || ' ' || antenna || ' ' || rssi_dbm || ' ' || gateway FROM "
                           "gantry.present_tags WHERE tag = 'A1'"),
              "epc-gen2 Ant0 -50 suite");
}

TEST_F(PostgresPresentTags, AMovedTagIsAtBothPlacesUntilTheFirstHasLostIt) {
    Lent lent;
    tell(lent, 1, Type::tag_observed, "yard", 0xA1);
    tell(lent, 2, Type::tag_observed, "dock", 0xA1);
    auto& moved = tell(lent, 3, Type::tag_moved, "dock", 0xA1);
    moved.from = "yard";
    moved.to = "dock";
    deliver(lent);
    EXPECT_EQ(present(), "dock dock-1 A1 3, yard dock-1 A1 1");
    Lent lost;
    tell(lost, 4, Type::tag_lost, "yard", 0xA1);
    deliver(lost);
    EXPECT_EQ(present(), "dock dock-1 A1 3");
}

TEST_F(PostgresPresentTags, AReaderWithoutAZoneIsAPlaceOfItsOwn) {
    Lent lent;
    tell(lent, 1, Type::tag_new, "", 0xA1, "gate-1");
    tell(lent, 2, Type::tag_new, "", 0xA1, "gate-2");
    tell(lent, 3, Type::tag_new, "gate-2", 0xA1, "other");
    tell(lent, 4, Type::tag_lost, "", 0xA1, "gate-2");
    deliver(lent);
    EXPECT_EQ(present(), "gate-2 other A1 3, gate-1 A1 1");
}

TEST_F(PostgresPresentTags, AnOldEventChangesNothingWheneverItComes) {
    Lent late, lent;
    tell(late, 2, Type::tag_observed, "dock", 0xA1);
    tell(late, 3, Type::tag_lost, "dock", 0xB2);
    tell(lent, 1, Type::tag_new, "dock", 0xA1);
    tell(lent, 4, Type::tag_lost, "dock", 0xA1);
    tell(lent, 5, Type::tag_observed, "dock", 0xB2);
    deliver(lent);
    deliver(late);
    EXPECT_EQ(present(), "dock dock-1 B2 5");
    deliver(lent);
    deliver(late);
    EXPECT_EQ(present(), "dock dock-1 B2 5");
    EXPECT_EQ(server.value("SELECT count(*) FROM gantry.events"), "5") << "but it is stored";
}

TEST_F(PostgresPresentTags, AfterARestoreSmallerNumbersAreNewer) {
    Lent lent, restored;
    tell(lent, 900, Type::tag_observed, "dock", 0xA1);
    deliver(lent);
    tell(restored, 7, Type::tag_lost, "dock", 0xA1);
    deliver(restored, "suite:1:");
    EXPECT_EQ(present(), "");
    deliver(lent);
    EXPECT_EQ(present(), "");
}

TEST_F(PostgresPresentTags, GatewaysDoNotDisturbEachOther) {
    Lent lent;
    tell(lent, 5, Type::tag_observed, "dock", 0xA1);
    deliver(lent);
    auto other = make_sink(server.url(), {{"present_tags", "true"}}, "site'9");
    ASSERT_TRUE(other);
    Lent theirs;
    tell(theirs, 9, Type::tag_lost, "dock", 0xA1);
    expect_all_accepted((*other)->deliver(theirs.items("site'9:"), patience(20s)));
    EXPECT_EQ(present(), "dock dock-1 A1 5");
}

TEST_F(PostgresPresentTags, ARefusedEventDoesNotCount) {
    expect_all_accepted(sink->deliver({}, patience(20s)));
    server.sql("ALTER TABLE gantry.events ADD CHECK (seq <> 2)");
    Lent lent;
    tell(lent, 1, Type::tag_new, "dock", 0xA1);
    tell(lent, 2, Type::tag_lost, "dock", 0xA1);
    tell(lent, 3, Type::tag_new, "dock", 0xB2);
    auto outcome = sink->deliver(lent.items(), patience(20s));
    EXPECT_EQ(count(outcome, sink::Fate::rejected), 1);
    EXPECT_EQ(present(), "dock dock-1 A1 1, dock dock-1 B2 3");
}

TEST_F(PostgresPresentTags, ReadsAndOtherEventsDoNotTouchIt) {
    Lent lent;
    tell(lent, 1, Type::tag_read, "dock", 0xA1);
    lent.add(Type::reader_connected).reader = "dock-1";
    deliver(lent);
    EXPECT_EQ(present(), "");
}

TEST_F(PostgresPresentTags, WhoIsLongGoneIsForgotten) {
    Lent lent;
    tell(lent, 1, Type::tag_new, "dock", 0xA1);
    tell(lent, 2, Type::tag_lost, "dock", 0xB2);
    tell(lent, 3, Type::tag_lost, "dock", 0xC3);
    deliver(lent);
    server.sql("UPDATE gantry.tag_presence SET updated = now() - interval '31 days' WHERE tag <> 'C3'");
    sink = sink_of(server, {{"present_tags", "true"}});  // the first thing that a new one does
    expect_all_accepted(sink->deliver({}, patience(20s)));
    EXPECT_EQ(server.value("SELECT string_agg(tag, ' ' ORDER BY tag) FROM gantry.tag_presence"), "A1 C3");
}

}  // namespace
}  // namespace gantry::sinks::postgres::tests
