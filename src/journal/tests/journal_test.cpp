#include "journal/journal.hpp"

#include <sys/stat.h>

#include <fstream>

#include "journal/sqlite.hpp"
#include "journal/tests/fixtures.hpp"

namespace gantry::journal::tests {
namespace {
using event::Type;

// One event of every type with all the members that type can have.
std::vector<event::Event> one_of_each(Seq first) {
    std::vector<event::Event> events;
    for (auto& [type, name] : event::all_types()) {
        event::Event e;
        e.seq = first++;
        e.type = type;
        e.time = start_time + std::chrono::seconds(e.seq);
        if (type != Type::overflow && type != Type::clock_jumped) e.reader = "dock-1";
        if (event::is_tag(type)) {
            e.antenna = "Ant0";
            e.zone = "dock";
            e.technology = event::Technology::epc_gen2;
            e.tag = tag_number(e.seq);
            e.rssi = static_cast<std::int16_t>(-528);
            e.reads = 17;
            e.first_seen = start_time;
            e.last_seen = start_time + 1s;
            e.reader_time = start_time - 24h;
        }
        events.push_back(e);
    }
    auto at = [&](Type type) -> event::Event& {
        return *std::ranges::find(events, type, &event::Event::type);
    };
    at(Type::tag_moved).from = "dock";
    at(Type::tag_moved).to = "gate";
    at(Type::tag_lost).reason = "reader_offline";
    at(Type::tag_purged).reason = "glimpse_timeout";
    at(Type::tag_read).possible_repeat = true;
    at(Type::tag_read).user = {0, 1, 254, 255};
    at(Type::tag_read).tid = {0xE2, 0x80};
    at(Type::reader_disconnected).reason = "no heartbeat for 30 s";
    at(Type::reader_fault).code = -7;
    at(Type::reader_fault).text = std::string("antenna \"1\"\n\0 <b>'; DROP TABLE state;--\xFF", 40);
    at(Type::reader_fault).bytes = {0x80, 0x00};
    at(Type::gpi_changed).input = 0;
    at(Type::gpi_changed).state = false;
    at(Type::overflow).scope = "store";
    at(Type::overflow).count = 0;
    at(Type::overflow).since = start_time;
    at(Type::clock_jumped).by = "+1h";
    return events;
}

// epc, gs1 and link come from the tag.
event::Event as_read_back(event::Event e) {
    if (e.tag.size == 0) return e;
    e.epc = "urn:epc:id:sgtin:0614141.812345." +
            std::to_string(e.tag.data[8] << 24 | e.tag.data[9] << 16 | e.tag.data[10] << 8 | e.tag.data[11]);
    return e;
}

TEST(Journal, EveryTypeOfEventComesBackWithAllItsMembers) {
    Folder folder;
    auto events = one_of_each(1);
    {
        auto journal = open_store(folder.store());
        auto batch = next_batch(*journal);
        batch.events = events;
        batch.next_seq += events.size();
        ASSERT_TRUE(journal->commit(batch));
        EXPECT_TRUE(batch.empty());
        EXPECT_EQ(journal->check(), "");
    }
    auto back = read_all(folder.store());
    ASSERT_EQ(back.size(), events.size());
    for (std::size_t i = 0; i < events.size(); ++i) {
        auto expected = as_read_back(events[i]);
        EXPECT_EQ(back[i].epc, expected.epc);
        back[i].gs1.clear();
        back[i].link.clear();
        EXPECT_EQ(describe(back[i]), describe(expected));
    }
}

TEST(Journal, OnlyTagsThatMayHoldAnEpcAreDecoded) {
    Folder folder;
    auto journal = open_store(folder.store());
    auto batch = next_batch(*journal);
    for (auto& [technology, name] : event::all_technologies())
        add_tag_event(batch, 1).technology = technology;
    ASSERT_TRUE(journal->commit(batch));
    for (auto& event : read_all(folder.store())) {
        bool decodes = event.technology == event::Technology::epc_gen2 ||
                       event.technology == event::Technology::epc_gen1 ||
                       event.technology == event::Technology::epc_1_19 ||
                       event.technology == event::Technology::unknown;
        EXPECT_EQ(!event.epc.empty(), decodes) << to_text(event.technology);
        EXPECT_EQ(!event.gs1.empty(), decodes);
        EXPECT_EQ(!event.link.empty(), decodes);
    }
}

TEST(Journal, ReadsAndEventsComeBackInTheOrderOfTheirNumbers) {
    Folder folder;
    auto journal = open_store(folder.store());
    auto dock = journal->read_point("dock-1", "Ant0", "dock");
    auto gate = journal->read_point("gate", "", "");
    EXPECT_EQ(journal->read_point("dock-1", "Ant0", "dock"), dock);
    std::uint64_t tag = 0;
    for (int commit = 0; commit < 5; ++commit) {
        auto batch = next_batch(*journal);
        for (int i = 0; i < 1000; ++i) {
            if (i % 7 == 3) add_tag_event(batch, ++tag);
            add_read(batch, ++tag % 300, i % 2 == 0 ? dock : gate);
        }
        ASSERT_TRUE(journal->commit(batch));
    }
    auto events = read_all(folder.store());
    ASSERT_EQ(events.size(), journal->last_seq());
    for (std::size_t i = 0; i < events.size(); ++i)
        ASSERT_EQ(events[i].seq, i + 1);
    Filter backwards;
    backwards.newest_first = true;
    auto reversed = read_all(folder.store(), backwards);
    std::ranges::reverse(reversed);
    EXPECT_EQ(seqs_of(reversed), seqs_of(events));
    EXPECT_EQ(journal->check(), "");
}

TEST(Journal, AReadComesBackWithAllItsMembers) {
    Folder folder;
    auto journal = open_store(folder.store());
    auto batch = next_batch(*journal);
    auto point = journal->read_point("r\n'", "a\"", "z");
    auto& plain = add_read(batch, 7, point, start_time + 5s);
    plain.possible_repeat = true;
    plain.observation.reads = 65535;
    plain.observation.reader_time_us = to_us(start_time) + 1;
    auto& bare = add_read(batch, 8, 0, start_time);  // before the one above, and from nowhere
    bare.observation.rssi = Observation::no_rssi;
    bare.observation.tag = {};
    bare.observation.technology = event::Technology::icode1;
    // These have no room in a record and become rows.
    add_read(batch, 9, point).observation.reader_time_us = std::int64_t{1} << 60;
    add_read(batch, 10, point, start_time + std::chrono::hours(24 * 365));
    ASSERT_TRUE(journal->commit(batch));

    auto events = read_all(folder.store());
    ASSERT_EQ(events.size(), 4u);
    EXPECT_EQ(events[0].reader, "r\n'");
    EXPECT_EQ(events[0].antenna, "a\"");
    EXPECT_EQ(events[0].zone, "z");
    EXPECT_TRUE(events[0].possible_repeat);
    EXPECT_EQ(events[0].reads, 65535u);
    EXPECT_EQ(events[0].reader_time, start_time + 1us);
    EXPECT_EQ(events[0].time, start_time + 5s);
    EXPECT_EQ(events[0].tag, tag_number(7));
    EXPECT_EQ(events[0].rssi, std::int16_t{-528});
    EXPECT_EQ(events[1].reader, "");
    EXPECT_EQ(events[1].time, start_time);
    EXPECT_EQ(events[1].tag.size, 0);
    EXPECT_EQ(events[1].technology, event::Technology::icode1);
    EXPECT_FALSE(events[1].rssi);
    EXPECT_FALSE(events[1].reader_time);
    EXPECT_EQ(to_rfc3339(*events[2].reader_time), "9999-12-31T23:59:59.999999Z");
    EXPECT_EQ(events[2].reader, "r\n'");
    EXPECT_EQ(events[3].time, start_time + std::chrono::hours(24 * 365));
    for (auto& event : events)
        EXPECT_EQ(event.type, Type::tag_read);
}

TEST(Journal, IdentityAndNumbersGoOnOverRestarts) {
    Folder folder;
    std::string id;
    for (int run = 0; run < 5; ++run) {
        auto journal = open_store(folder.store());
        if (run == 0) id = journal->gateway_id();
        EXPECT_EQ(journal->gateway_id(), id);
        EXPECT_EQ(journal->id_prefix(), id + ":");
        EXPECT_EQ(journal->last_seq(), static_cast<Seq>(run * 2));
        EXPECT_EQ(journal->last_commit(), run == 0 ? Wall{} : start_time + std::chrono::seconds(run));
        auto batch = next_batch(*journal, start_time + std::chrono::seconds(run + 1));
        add_tag_event(batch, 1);
        add_read(batch, 1, journal->read_point("a", "b", "c"));
        ASSERT_TRUE(journal->commit(batch));
        EXPECT_EQ(batch.next_seq, journal->last_seq() + 1);
    }
    EXPECT_EQ(id.substr(0, 3), "gw-");
    EXPECT_EQ(id.size(), 15u);
    auto journal = open_store(folder.store());
    EXPECT_FALSE(journal->set_gateway_id(""));
    ASSERT_TRUE(journal->set_gateway_id("site-7"));
    EXPECT_EQ(open_store(folder.store())->id_prefix(), "site-7:");
    EXPECT_EQ((*Reader::open(folder.store()))->id_prefix(), "site-7:");
}

TEST(Journal, PresenceMarksAndCursorsAreThereAfterARestart) {
    Folder folder;
    PresenceRow row;
    row.id = 42;
    row.tag = tag_number(1);
    row.technology = event::Technology::epc_gen2;
    row.state = 2;
    row.zone_key = "reader:dock-1";
    row.reader = "dock-1";
    row.antenna = "Ant0";
    row.antenna_number = 3;
    row.rssi = static_cast<std::int16_t>(-1);
    row.pc = 0x3200;
    row.xpc = 0x80010002;
    row.reads = 9;
    row.first_seen = start_time;
    row.last_seen = start_time + 1s;
    row.first_is_new = false;
    row.readers = {"dock-1", "", "dock\n2"};
    {
        auto journal = open_store(folder.store());
        EXPECT_EQ(journal->cursor("mqtt"), std::nullopt);
        EXPECT_EQ(journal->mark("dock-1"), Bytes{});
        auto batch = next_batch(*journal);
        batch.presence = {row};
        auto gone = row;
        gone.id = 77;
        gone.readers = {};
        batch.presence.push_back(gone);
        batch.marks = {{"dock-1", {1, 2}}, {"dock-2", {3}}, {"dock-1", {0, 255}}};
        batch.cursors = {{"mqtt", 5}, {"kafka", 0}};
        ASSERT_TRUE(journal->commit(batch));
        EXPECT_EQ(journal->last_seq(), 0u);
        auto second = next_batch(*journal);
        second.presence_deleted = {77};
        second.cursors = {{"mqtt", 6}};
        ASSERT_TRUE(journal->commit(second));
    }
    auto journal = open_store(folder.store());
    EXPECT_EQ(journal->max_presence_id(), 77u);
    EXPECT_EQ(journal->mark("dock-1"), (Bytes{0, 255}));
    EXPECT_EQ(journal->mark("dock-2"), Bytes{3});
    EXPECT_EQ(journal->mark("dock-3"), Bytes{});
    EXPECT_EQ(journal->cursor("mqtt"), 6u);
    EXPECT_EQ(journal->cursor("kafka"), 0u);
    std::vector<PresenceRow> rows;
    ASSERT_TRUE(journal->load_presence([&](const PresenceRow& r) { rows.push_back(r); }));
    ASSERT_EQ(rows.size(), 1u);
    auto& back = rows[0];
    EXPECT_EQ(back.id, 42u);
    EXPECT_EQ(back.tag, row.tag);
    EXPECT_EQ(back.technology, row.technology);
    EXPECT_EQ(back.state, row.state);
    EXPECT_EQ(back.zone_key, row.zone_key);
    EXPECT_EQ(back.zone, "");
    EXPECT_EQ(back.reader, row.reader);
    EXPECT_EQ(back.antenna, row.antenna);
    EXPECT_EQ(back.antenna_number, row.antenna_number);
    EXPECT_EQ(back.rssi, row.rssi);
    EXPECT_EQ(back.pc, row.pc);
    EXPECT_EQ(back.xpc, row.xpc);
    EXPECT_EQ(back.reads, row.reads);
    EXPECT_EQ(back.first_seen, row.first_seen);
    EXPECT_EQ(back.last_seen, row.last_seen);
    EXPECT_EQ(back.first_is_new, row.first_is_new);
    EXPECT_EQ(back.readers, row.readers);
}

// A tag's row holds its PC and XPC: a new one only where they are others, whatever the length of the id.
TEST(Journal, PcAndXpcCostATagOneRowForEachThatItHad) {
    Folder folder;
    auto journal = open_store(folder.store());
    std::vector<std::string> expected;
    for (auto tag : {tag_number(1), event::TagId(Bytes(16, 0xAB)), event::TagId(Bytes(17, 0xAB))}) {
        auto batch = next_batch(*journal);
        for (int round = 0; round < 3; ++round)
            for (auto [pc, xpc] :
                 std::initializer_list<std::pair<std::uint16_t, std::uint32_t>>{{0x3000, Observation::no_xpc},
                                                                                {0x3000, 0},
                                                                                {0x3200, 0x08000000},
                                                                                {0x3200, 0x08000001},
                                                                                {0, 0x08000000}}) {
                auto& seen = add_read(batch, 0, 0).observation;
                seen.tag = tag;
                seen.pc = pc;
                seen.xpc = xpc;
                auto& event = add_tag_event(batch, 0);
                event.tag = tag;
                event.pc = seen.pc;
                event.xpc = xpc == Observation::no_xpc ? 0 : xpc;
                auto said = to_hex(event::pc_words(event.pc).view()) + "|" +
                            to_hex(event::xpc_words(event.xpc).view());
                expected.insert(expected.end(), 2, said);
            }
        ASSERT_TRUE(journal->commit(batch));
    }
    std::vector<std::string> back;
    for (auto& event : read_all(folder.store()))
        back.push_back(to_hex(event::pc_words(event.pc).view()) + "|" +
                       to_hex(event::xpc_words(event.xpc).view()));
    EXPECT_EQ(back, expected);
    auto db = Database::open(folder.store(), Database::Access::read);
    ASSERT_TRUE(db);
    EXPECT_EQ(db->number("SELECT count(*) FROM tags"), 3 * 4);
    EXPECT_EQ(db->number("SELECT count(*) FROM event_details"), 0);
}

TEST(Journal, ABatchWithAGapOrADoubleIsRefusedWhole) {
    Folder folder;
    auto journal = open_store(folder.store());
    auto refused = [&](Batch batch) {
        auto events = batch.events.size();
        auto done = journal->commit(batch);
        return !done && done.error().kind == StoreError::Kind::other && batch.events.size() == events;
    };
    auto gap = next_batch(*journal);
    gap.take_seq();
    add_tag_event(gap, 1);
    EXPECT_TRUE(refused(gap));
    auto twice = next_batch(*journal);
    add_tag_event(twice, 1);
    twice.events.push_back(twice.events[0]);
    EXPECT_TRUE(refused(twice));
    auto beyond = next_batch(*journal);
    add_tag_event(beyond, 1);
    beyond.next_seq = 1;
    EXPECT_TRUE(refused(beyond));
    EXPECT_EQ(journal->last_seq(), 0u);
    auto good = next_batch(*journal);
    add_tag_event(good, 1);
    EXPECT_TRUE(journal->commit(good));
    EXPECT_EQ(read_all(folder.store()).size(), 1u);
}

TEST(Journal, ASecondGatewayOnOneStoreIsRefusedBeforeItCanDoHarm) {
    Folder folder;
    auto one = open_store(folder.store()), two = open_store(folder.store());
    auto first = next_batch(*one), second = next_batch(*two);
    add_tag_event(first, 1);
    ASSERT_TRUE(one->commit(first));
    second.cursors = {{"mqtt", 1}};
    second.presence_deleted = {1};
    add_tag_event(second, 2);
    auto done = two->commit(second);
    ASSERT_FALSE(done);
    EXPECT_EQ(done.error().kind, StoreError::Kind::other);
    EXPECT_EQ(read_all(folder.store()).size(), 1u);
    EXPECT_EQ(one->check(), "");
}

TEST(Journal, TheFileIsForItsOwnerOnly) {
    Folder folder;
    auto journal = open_store(folder.store());
    auto batch = next_batch(*journal);
    add_tag_event(batch, 1);
    ASSERT_TRUE(journal->commit(batch));
    for (auto* end : {"", "-wal", "-shm"}) {
        struct stat info {};
        ASSERT_EQ(stat((folder.store().string() + end).c_str(), &info), 0) << end;
        EXPECT_EQ(info.st_mode & 0777, 0600u) << end;
    }
}

TEST(Journal, WhatIsNoStoreIsRefusedWithAReason) {
    Folder folder;
    Options options;
    options.path = folder.path() / "missing" / "gantry.db";
    auto missing = Journal::open(options);
    ASSERT_FALSE(missing);
    EXPECT_NE(missing.error().error.text().find("No such file or directory"), std::string::npos)
        << missing.error().error.text();
    options.path = folder.path() / "text.db";
    std::ofstream(options.path) << std::string(5000, 'x');
    auto text = Journal::open(options);
    ASSERT_FALSE(text);
    EXPECT_EQ(text.error().kind, StoreError::Kind::corrupt);
    EXPECT_FALSE(Reader::open(folder.path() / "missing.db"));
}

}  // namespace
}  // namespace gantry::journal::tests
