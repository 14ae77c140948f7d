#include "journal/schema.hpp"

#include "journal/tests/fixtures.hpp"

namespace gantry::journal::tests {
namespace {

Database open_file(const std::filesystem::path& path) {
    auto db = Database::open(path, Database::Access::write);
    if (!db) throw std::runtime_error(db.error().error.text());
    return std::move(*db);
}

void make_store(const std::filesystem::path& path) {
    auto journal = open_store(path);
    auto batch = next_batch(*journal);
    add_tag_event(batch, 1);
    ASSERT_TRUE(journal->commit(batch));
}

TEST(Schema, AStoreOfANewerGantryIsRefusedByWriterAndReader) {
    Folder folder;
    make_store(folder.store());
    ASSERT_TRUE(open_file(folder.store()).run("PRAGMA user_version=1000"));
    Options options;
    options.path = folder.store();
    auto journal = Journal::open(options);
    ASSERT_FALSE(journal);
    EXPECT_NE(journal.error().error.text().find("version 1000"), std::string::npos);
    auto reader = Reader::open(folder.store());
    ASSERT_FALSE(reader);
    EXPECT_NE(reader.error().error.text().find("version 1000"), std::string::npos);
}

TEST(Schema, AnotherProgramsFileIsRefusedAndNotTouched) {
    Folder folder;
    make_store(folder.store());
    ASSERT_TRUE(open_file(folder.store()).run("PRAGMA application_id=7"));
    Options options;
    options.path = folder.store();
    auto journal = Journal::open(options);
    ASSERT_FALSE(journal);
    EXPECT_NE(journal.error().error.text().find("another program"), std::string::npos);
    EXPECT_EQ(open_file(folder.store()).number("SELECT count(*) FROM event_rows"), 1);
}

TEST(Schema, AReaderDoesNotTouchAnOlderStore) {
    Folder folder;
    make_store(folder.store());
    ASSERT_TRUE(open_file(folder.store()).run("PRAGMA user_version=0"));
    auto reader = Reader::open(folder.store());
    ASSERT_FALSE(reader);
    EXPECT_NE(reader.error().error.text().find("start the gateway once"), std::string::npos);
}

TEST(Schema, StepsRunInOrderAndOnlyOnce) {
    Folder folder;
    make_store(folder.store());
    auto db = open_file(folder.store());
    std::vector<Migration> steps(migrations().begin(), migrations().end());
    steps.push_back({schema_version() + 1, "CREATE TABLE extra(n); INSERT INTO extra VALUES(1)"});
    steps.push_back({schema_version() + 2, "UPDATE extra SET n = n + 10"});
    ASSERT_TRUE(migrate(db, steps));
    ASSERT_TRUE(migrate(db, steps));
    EXPECT_EQ(db.number("SELECT n FROM extra"), 11);
    EXPECT_EQ(db.number("PRAGMA user_version"), schema_version() + 2);
    EXPECT_EQ(db.number("SELECT count(*) FROM events"), 1);
}

TEST(Schema, AFailedStepLeavesTheFileAsItWas) {
    Folder folder;
    make_store(folder.store());
    {
        auto db = open_file(folder.store());
        std::vector<Migration> steps(migrations().begin(), migrations().end());
        steps.push_back({schema_version() + 1, "CREATE TABLE extra(n); DELETE FROM event_rows"});
        steps.push_back({schema_version() + 2, "DELETE FROM no_such_table"});
        auto done = migrate(db, steps);
        ASSERT_FALSE(done);
        EXPECT_NE(done.error().error.what.find("it is as it was"), std::string::npos);
        EXPECT_EQ(done.error().kind, StoreError::Kind::other)
            << "the store is good: it must not be set aside";
        EXPECT_EQ(db.number("PRAGMA user_version"), schema_version());
        EXPECT_EQ(db.number("SELECT count(*) FROM sqlite_master WHERE name = 'extra'"), 0);
    }
    EXPECT_EQ(read_all(folder.store()).size(), 1u);
}

TEST(Schema, AVersionThatTheTablesContradictIsDamage) {
    for (int version : {0, 1, 3, schema_version() - 1}) {
        SCOPED_TRACE(version);
        Folder folder;
        make_store(folder.store());
        ASSERT_TRUE(open_file(folder.store()).run("PRAGMA user_version=" + std::to_string(version)));
        auto db = open_file(folder.store());
        auto done = migrate(db, migrations());
        ASSERT_FALSE(done);
        EXPECT_EQ(done.error().kind, StoreError::Kind::corrupt) << done.error().error.text();
        EXPECT_NE(done.error().error.what.find("is not as it was stored"), std::string::npos);
        EXPECT_EQ(db.number("SELECT count(*) FROM event_rows"), 1);
    }
}

TEST(Schema, ViewsOfAnOlderProgramAreReplaced) {
    Folder folder;
    make_store(folder.store());
    ASSERT_TRUE(open_file(folder.store()).run("DROP VIEW events; CREATE VIEW events AS SELECT 1 AS old"));
    auto journal = open_store(folder.store());
    EXPECT_EQ(open_file(folder.store()).number("SELECT count(*) FROM events WHERE type = 'tag.observed'"), 1);
}

TEST(Schema, AStoreOfVersion1IsBroughtUpToDateAndGoesOn) {
    Folder folder;
    make_store(folder.store());
    {
        auto db = open_file(folder.store());
        ASSERT_TRUE(downgrade(db, migrations(), 1));
    }
    {
        auto journal = open_store(folder.store());
        EXPECT_EQ(journal->untold().count, 0u);
        auto batch = next_batch(*journal);
        add_tag_event(batch, 2);
        ASSERT_TRUE(journal->commit(batch));
    }
    EXPECT_EQ(open_file(folder.store()).number("PRAGMA user_version"), schema_version());
    EXPECT_EQ(open_store(folder.store())->last_seq(), 2u);
    EXPECT_EQ(read_all(folder.store()).size(), 2u);
}

TEST(Schema, AStoreOfVersion4KeepsItsTagsAndPresenceAndTakesPcAndXpc) {
    Folder folder;
    {
        auto journal = open_store(folder.store());
        auto batch = next_batch(*journal);
        add_tag_event(batch, 1);
        add_read(batch, 1, 0);
        batch.presence.emplace_back().id = 1;
        batch.presence.back().tag = tag_number(1);
        ASSERT_TRUE(journal->commit(batch));
    }
    {
        auto db = open_file(folder.store());
        ASSERT_TRUE(downgrade(db, migrations(), 4));
    }
    auto journal = open_store(folder.store());
    auto batch = next_batch(*journal);
    auto& event = add_tag_event(batch, 1);
    event.pc = 0x3200;
    event.xpc = 0x08000000;
    batch.presence.emplace_back().id = 2;
    batch.presence.back().tag = tag_number(2);
    batch.presence.back().pc = 0x3000;
    ASSERT_TRUE(journal->commit(batch));
    auto events = read_all(folder.store());
    ASSERT_EQ(events.size(), 3u);
    EXPECT_EQ(events[0].pc, 0);
    EXPECT_EQ(events[1].xpc, 0u);
    EXPECT_EQ(events[2].pc, 0x3200);
    EXPECT_EQ(events[2].xpc, 0x08000000u);
    std::vector<std::uint16_t> pcs;
    ASSERT_TRUE(journal->load_presence([&](const PresenceRow& row) { pcs.push_back(row.pc); }));
    EXPECT_EQ(pcs, (std::vector<std::uint16_t>{0, 0x3000}));
    EXPECT_EQ(journal->check(), "");
}

TEST(Schema, ADamagedCountOfWhatIsUntoldIsNoticed) {
    Folder folder;
    make_store(folder.store());
    ASSERT_TRUE(open_file(folder.store()).run("UPDATE state SET untold = 1"));
    Options options;
    options.path = folder.store();
    auto journal = Journal::open(options);
    ASSERT_FALSE(journal);
    EXPECT_EQ(journal.error().kind, StoreError::Kind::corrupt);
}

}  // namespace
}  // namespace gantry::journal::tests
