#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <fstream>
#include <random>

#include "journal/schema.hpp"
#include "journal/tests/dies_at.hpp"
#include "journal/tests/rich_store.hpp"
#include "journal/upkeep.hpp"

namespace gantry::journal::tests {
namespace {

Database open_to_write(const std::filesystem::path& path) {
    auto db = Database::open(path, Database::Access::write);
    if (!db) throw std::runtime_error(db.error().error.text());
    return std::move(*db);
}

// Every column of every table, as SQLite sees them.
std::vector<std::string> shape_of(const std::filesystem::path& path) {
    auto db = Database::open(path, Database::Access::read);
    if (!db) throw std::runtime_error(db.error().error.text());
    auto rows = db->prepare(
        "SELECT m.name || '.' || c.name || ' ' || c.type || ' ' || c.\"notnull\" || ' ' || c.pk || ' ' || "
        "ifnull(c.dflt_value, '-') FROM sqlite_master m JOIN pragma_table_info(m.name) c WHERE m.type = "
        "'table' "
        "ORDER BY 1");
    std::vector<std::string> out;
    while (rows->step() == Step::row)
        out.emplace_back(rows->text(0));
    return out;
}

// What a store keeps over all versions: its events with their ids, and what a restart needs.
std::vector<std::string> content_of(const std::filesystem::path& path) {
    auto journal = open_store(path);  // which brings it to this program's version
    auto all = described(path);
    all.push_back(journal->id_prefix() + std::to_string(journal->last_seq()));
    all.push_back(to_hex(journal->mark("dock-1").value()));
    all.push_back(std::to_string(journal->cursor("broker").value_or(0)));
    if (!journal->load_presence([&](const PresenceRow& row) {
            all.push_back(std::to_string(row.id) + to_hex(row.tag.view()) + row.zone + row.reader);
        }))
        throw std::runtime_error("no presence");
    return all;
}

TEST(Downgrade, EveryStepButTheFirstHasAWayBack) {
    for (auto& step : migrations().subspan(1))
        EXPECT_NE(step.back.drop, nullptr) << "version " << step.version;
}

TEST(Downgrade, AStoreOfEachOlderVersionIsAsItsProgramMadeItAndComesBackWhole) {
    for (int version = 1; version < schema_version(); ++version) {
        SCOPED_TRACE(version);
        Folder folder, fresh;
        {
            auto journal = open_store(folder.store());
            ASSERT_TRUE(journal->set_gateway_id("site-7"));
            fill(*journal, 40);
        }
        auto content = content_of(folder.store());
        auto gone = downgrade_store(folder.store(), version, false);
        ASSERT_TRUE(gone) << gone.error().error.text();
        EXPECT_TRUE(gone->done);
        EXPECT_EQ(gone->lost, std::vector<std::string>{});
        EXPECT_EQ(sql_number(folder.store(), "PRAGMA user_version"), version);
        {
            std::ofstream(fresh.store()).close();
            auto db = open_to_write(fresh.store());
            for (auto& step : migrations().first(static_cast<std::size_t>(version)))
                ASSERT_TRUE(db.run(step.sql));
        }
        EXPECT_EQ(shape_of(folder.store()), shape_of(fresh.store()));
        EXPECT_EQ(content_of(folder.store()), content);
        EXPECT_EQ(sql_number(folder.store(), "PRAGMA user_version"), schema_version());
        EXPECT_EQ(open_store(folder.store())->check(), "");
    }
}

TEST(Downgrade, WhatWouldBeLostIsNamedAndOnlyThenDeleted) {
    Folder folder;
    {
        auto journal = open_store(folder.store());
        ASSERT_TRUE(journal->set_gateway_id("site-7"));
        fill(*journal, 3);
        add_newer(*journal);
        ASSERT_TRUE(journal->raise_epoch(1, 1));
        fill(*journal, 1);
    }
    auto content = content_of(folder.store());
    auto version = schema_version();
    auto asked = downgrade_store(folder.store(), 2, false);
    ASSERT_TRUE(asked) << asked.error().error.text();
    EXPECT_FALSE(asked->done);
    auto lost = asked->lost;
    auto has = [&](std::string_view what) { return std::ranges::find(lost, what) != lost.end(); };
    EXPECT_TRUE(has("2 TIDs that came with reads")) << ::testing::PrintToString(lost);
    EXPECT_TRUE(has("3 jobs"));
    EXPECT_TRUE(has("1 dead letters"));
    EXPECT_TRUE(has("1 rows of tags with PC or XPC"));
    EXPECT_TRUE(has("1 readers that somebody stopped"));
    EXPECT_TRUE(
        has("62 ids of events from before a restore or a change of gateway.id (the events get new ones)"));
    EXPECT_EQ(content_of(folder.store()), content) << "nothing was changed";
    EXPECT_EQ(sql_number(folder.store(), "PRAGMA user_version"), version);

    auto done = downgrade_store(folder.store(), 2, true);
    ASSERT_TRUE(done) << done.error().error.text();
    EXPECT_TRUE(done->done);
    auto journal = open_store(folder.store());
    EXPECT_EQ(journal->check(), "") << "checksums are those that an older program would have made";
    auto events = read_all(folder.store());
    EXPECT_EQ(events.size(), 82u);
    for (auto& event : events)
        EXPECT_TRUE(event.tid.empty() && event.pc == 0 && event.xpc == 0);
    EXPECT_TRUE(described(folder.store())[0].starts_with("site-7:1:"));
    fill(*journal, 1);
    EXPECT_EQ(journal->check(), "");
}

TEST(Downgrade, OnlyAStoreThatIsSoundAndOfThisVersion) {
    Folder folder;
    {
        auto journal = open_store(folder.store());
        fill(*journal, 3);
    }
    auto error = [&](int to) {
        auto done = downgrade_store(folder.store(), to, true);
        return done ? "" : done.error().error.text();
    };
    EXPECT_NE(error(schema_version() + 1).find("cannot go back to version"), std::string::npos);
    EXPECT_NE(error(0).find("cannot go back to version 0"), std::string::npos);
    auto same = downgrade_store(folder.store(), schema_version(), true);
    ASSERT_TRUE(same);
    EXPECT_FALSE(same->done);
    run_sql(folder.store(), "UPDATE event_rows SET rssi = 0 WHERE seq = 7");
    EXPECT_NE(error(1).find("event 7 is not as it was stored"), std::string::npos) << error(1);
    EXPECT_EQ(sql_number(folder.store(), "PRAGMA user_version"), schema_version());
    run_sql(folder.store(), "PRAGMA user_version=1");
    EXPECT_NE(error(1).find("knows the way back only from"), std::string::npos) << error(1);
}

TEST(Downgrade, AStepWithoutAWayBackIsRefused) {
    Folder folder;
    open_store(folder.store());
    auto db = open_to_write(folder.store());
    std::vector<Migration> steps(migrations().begin(), migrations().end());
    steps.push_back({schema_version() + 1, "CREATE TABLE extra(n)"});
    ASSERT_TRUE(migrate(db, steps));
    auto refused = downgrade(db, steps, 1);
    ASSERT_FALSE(refused);
    EXPECT_NE(refused.error().error.what.find("no way back beyond version"), std::string::npos);
    steps.back().back.drop = "DROP TABLE extra";
    EXPECT_TRUE(downgrade(db, steps, schema_version()));
    EXPECT_EQ(db.number("PRAGMA user_version"), schema_version());
}

TEST(Downgrade, AnOlderProgramSaysHowToGoBack) {
    Folder folder;
    open_store(folder.store());
    auto db = open_to_write(folder.store());
    auto older = migrations().first(2);
    auto refused = migrate(db, older);
    ASSERT_FALSE(refused);
    EXPECT_NE(refused.error().error.hint.find("`gantry store downgrade --to 2`"), std::string::npos)
        << refused.error().error.hint;
}

// Proof R11: the schema goes up with a backlog, and whoever does it is killed in it.
class Upgrade : public ::testing::Test {
protected:
    void SetUp() override {
        auto journal = open_store(folder_.store());
        ASSERT_TRUE(journal->set_gateway_id("site-7"));
        fill(*journal, 300);
        journal.reset();
        content_ = content_of(folder_.store());
        auto older = downgrade_store(folder_.store(), 1, false);
        ASSERT_TRUE(older && older->done);
    }
    // Opens the store in a process that dies: by itself, or killed after a while.
    void open_and_die(const char* failpoint, std::chrono::microseconds after) {
        auto child = fork();
        if (child == 0) {
            setenv("GANTRY_FAILPOINT", failpoint, 1);
            Options options;
            options.path = folder_.store();
            auto journal = Journal::open(options);
            for (;;)
                pause();
        }
        if (after > 0us) {
            usleep(static_cast<useconds_t>(after.count()));
            kill(child, SIGKILL);
        }
        int status = 0;
        waitpid(child, &status, 0);
        ASSERT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL);
    }
    int version() const { return static_cast<int>(sql_number(folder_.store(), "PRAGMA user_version")); }

    Folder folder_;
    std::vector<std::string> content_;
};

#ifdef GANTRY_FAILPOINTS
TEST_F(Upgrade, KilledBetweenItsStepsItHasNotBegun) {
    for (const char* failpoint : {"migration_step", "migration_commit"}) {
        SCOPED_TRACE(failpoint);
        for (int times = 0; times < 5; ++times) {
            open_and_die(failpoint, 0us);
            EXPECT_EQ(version(), 1);
        }
    }
    EXPECT_EQ(content_of(folder_.store()), content_);
    EXPECT_EQ(version(), schema_version());
    EXPECT_EQ(open_store(folder_.store())->check(), "");
}
#endif

#ifdef GANTRY_FAILPOINTS
TEST_F(Upgrade, KilledOnTheWayBackItHasNotBegun) {
    EXPECT_EQ(content_of(folder_.store()), content_);
    ASSERT_TRUE(
        dies_at("downgrade_step", [&] { static_cast<void>(downgrade_store(folder_.store(), 1, true)); }));
    EXPECT_EQ(version(), schema_version());
    EXPECT_EQ(content_of(folder_.store()), content_);
    EXPECT_EQ(open_store(folder_.store())->check(), "");
}
#endif

TEST_F(Upgrade, KilledAtAnyMomentNothingIsLost) {
    std::mt19937 dice(3);
    int before = 0, after = 0;
    for (int times = 0; times < 20; ++times) {
        open_and_die("", std::chrono::microseconds(1 + dice() % 30'000));
        auto now = version();
        EXPECT_TRUE(now == 1 || now == schema_version()) << now;
        ++(now == 1 ? before : after);
        EXPECT_EQ(content_of(folder_.store()), content_);
        EXPECT_EQ(open_store(folder_.store())->check(), "");
        auto older = downgrade_store(folder_.store(), 1, false);
        ASSERT_TRUE(older && older->done) << older.error().error.text();
    }
    RecordProperty("killed_before_the_commit", before);
    RecordProperty("killed_after_the_commit", after);
    std::printf("killed before the commit: %d, after it: %d\n", before, after);
}

}  // namespace
}  // namespace gantry::journal::tests
