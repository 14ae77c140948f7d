#include "sinks/postgres/rows.hpp"
#include "server.hpp"

namespace gantry::sinks::postgres::tests {
namespace {

using event::Type;

// One event of every kind, every field filled, with microseconds that end in no zero (JSON and PostgreSQL
// differ in that).
void add_one_of_each(Lent& lent) {
    auto time = [](std::int64_t us) { return from_us(1'795'000'000'000'001 + 1'000'000 * us); };
    auto& read = lent.add(Type::tag_observed);
    read.technology = event::Technology::epc_gen2;
    read.reader = "dock-1";
    read.antenna = "Ant0";
    read.zone = "dock";
    read.tag = event::TagId(Bytes{0x30, 0x74, 0x25});
    read.epc = "urn:epc:id:sgtin:0614141.812345.6789";
    read.gs1 = "(01)80614141123458(21)6789";
    read.link = "https://id.gs1.org/01/80614141123458/21/6789";
    read.pc = 0x3400;
    read.xpc = 0x82000000;
    read.rssi = -528;
    read.reads = 17;
    read.first_seen = time(1);
    read.last_seen = time(2);
    read.reader_time = time(3);
    read.possible_repeat = true;
    read.tid = {0xE2, 0x80};
    read.user = {0x00, 0xFF};
    auto& moved = lent.add(Type::tag_moved);
    moved.tag = read.tag;
    moved.from = "yard";
    moved.to = "dock";
    moved.user = {1};
    auto& fault = lent.add(Type::reader_fault);
    fault.code = -7;
    fault.text = "an error \"quoted\" \\ and\ta tab";
    fault.bytes = {1, 2, 0xFE};
    auto& gpi = lent.add(Type::gpi_changed);
    gpi.input = 3;
    gpi.state = false;
    auto& overflow = lent.add(Type::overflow);
    overflow.scope = "store";
    overflow.count = 12345;
    overflow.since = time(4);
    lent.add(Type::clock_jumped).by = "-1h";
    auto& lost = lent.add(Type::tag_lost);
    lost.reason = "reader_offline";
    lost.rssi = 5;
}

TEST(PostgresRows, EveryFieldOfTheJsonIsAColumnOfItsNameWithItsValue) {
    Server server;
    server.start();
    Lent lent;
    add_one_of_each(lent);
    auto items = lent.items();
    expect_all_accepted(sink_of(server)->deliver(items, patience(20s)));
    for (auto& item : items) {
        auto differences = server.sql(
            "SELECT key, sent.value, stored.value FROM jsonb_each_text(" + quoted_text(item.payload) +
            ") sent FULL JOIN (SELECT key, replace(value, '+00:00', 'Z') AS value FROM gantry.events e, "
            "jsonb_each_text(jsonb_strip_nulls(to_jsonb(e))) WHERE id = " +
            quoted_text(item.id) + ") stored USING (key) WHERE sent.value IS DISTINCT FROM stored.value");
        for (auto& row : differences)
            ADD_FAILURE() << item.id << " " << *row[0] << ": " << row[1].value_or("-") << " became "
                          << row[2].value_or("-");
    }
    EXPECT_EQ(server.value("SELECT count(*) FROM gantry.events"), std::to_string(items.size()));
}

TEST(PostgresRows, WhatATextColumnCannotShowIsKeptAsJson) {
    Server server;
    server.start();
    Lent lent;
    lent.add(Type::reader_fault).text = std::string("a\0b\0", 4);
    lent.add(Type::reader_fault).text = "broken \xC3( and \xED\xA0\x80 end\xF0\x9F";
    lent.add(Type::reader_fault).text = "\xE2\x90\x80 of its own";
    auto items = lent.items();
    expect_all_accepted(sink_of(server)->deliver(items, patience(20s)));
    auto rows = server.sql("SELECT text, convert_from(exact, 'UTF8') FROM gantry.events ORDER BY seq");
    EXPECT_EQ(rows[0][0],
              "a\xE2\x90\x80"
              "b\xE2\x90\x80");
    EXPECT_EQ(rows[0][1], items[0].payload);
    EXPECT_EQ(rows[1][0],
              "broken \xEF\xBF\xBD( and \xEF\xBF\xBD\xEF\xBF\xBD\xEF\xBF\xBD end\xEF\xBF\xBD\xEF\xBF\xBD");
    EXPECT_FALSE(rows[1][1]) << "JSON shows no more than the column";
    EXPECT_EQ(rows[2][0], "\xE2\x90\x80 of its own");
    EXPECT_FALSE(rows[2][1]);
}

TEST(PostgresRows, NumbersAndTimesBeyondWhatTheServerKnowsAreClamped) {
    Server server;
    server.start();
    Lent lent;
    auto& event = lent.add(Type::tag_read);
    event.time = Wall::max();
    event.first_seen = Wall::min();
    event.reads = std::numeric_limits<std::uint64_t>::max();
    expect_all_accepted(sink_of(server)->deliver(lent.items(), patience(20s)));
    auto rows = server.sql("SELECT time, first_seen, reads FROM gantry.events");
    EXPECT_EQ(rows[0][0], "9999-12-31 23:59:59.999999+00");
    EXPECT_EQ(rows[0][1], "0001-01-01 00:00:00+00 BC");
    EXPECT_EQ(rows[0][2], "9223372036854775807");
}

TEST(PostgresRows, ABatchLongerThanAPieceOfTheCopyArrivesWhole) {
    Server server;
    server.start();
    testkit::LentEvents events(20'000);
    expect_all_accepted(sink_of(server)->deliver(events.items(), patience(60s)));
    EXPECT_EQ(server.value("SELECT count(*) || ' ' || sum(seq) FROM gantry.events"), "20000 200010000");
}

TEST(PostgresRows, TheEpochIsReadFromTheId) {
    EXPECT_EQ(epoch_of("site-7:184467", "site-7"), 0u);
    EXPECT_EQ(epoch_of("site-7:3:184467", "site-7"), 3u);
    EXPECT_EQ(epoch_of("a:b:12:5", "a:b"), 12u);
    EXPECT_EQ(epoch_of("site-7:x:5", "site-7"), 0u);
    EXPECT_EQ(epoch_of("other:3:5", "site-7"), 0u);
    EXPECT_EQ(epoch_of("", "site-7"), 0u);
}

}  // namespace
}  // namespace gantry::sinks::postgres::tests
