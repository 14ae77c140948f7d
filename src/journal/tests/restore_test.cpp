#include <csignal>
#include <fstream>
#include <set>

#include "journal/tests/dies_at.hpp"
#include "journal/tests/rich_store.hpp"
#include "journal/upkeep.hpp"

namespace gantry::journal::tests {
namespace {

const RestoreOptions at_start{.now = start_time};
constexpr std::uint64_t start_second = 1'795'302'240;  // of start_time

// A store of "site-7" with 100 events, and a backup of it.
struct Site {
    Folder folder, other;
    std::filesystem::path backup = other.path() / "copy.db";

    Site() {
        auto journal = open_store(path());
        if (!journal->set_gateway_id("site-7")) throw std::runtime_error("no id");
        fill(*journal, 5);
        if (!back_up(path(), backup, false)) throw std::runtime_error("no backup");
    }
    std::filesystem::path path() const { return folder.store(); }
    void grow(int commits) const { fill(*open_store(path()), commits); }
    Restored restored(const RestoreOptions& options = at_start) const {
        auto done = restore(path(), backup, options);
        if (!done) throw std::runtime_error(done.error().error.text());
        return *done;
    }
    std::string error(const RestoreOptions& options = at_start) const {
        auto done = restore(path(), backup, options);
        return done ? "" : done.error().error.text();
    }
};

TEST(Restore, BringsTheBackupBackAndNoIdComesTwice) {
    Site site;
    site.grow(3);  // 60 events that the backup does not have
    auto before = described(site.path());
    auto ids_before = ids_in_view(site.path());
    auto restored = site.restored();
    EXPECT_EQ(restored.epoch, 1u);
    EXPECT_EQ(restored.id_prefix, "site-7:1:");
    EXPECT_EQ(restored.next_seq, 161u) << "numbers that the store before has used are not used again";
    EXPECT_TRUE(restored.numbers_go_on);
    EXPECT_EQ(restored.backup.events, 100u);
    EXPECT_EQ(described(site.path()), described(site.backup)) << "events keep their ids";
    EXPECT_EQ(described(restored.aside / "gantry.db"), before);
    EXPECT_EQ(stores_set_aside(site.path()), std::vector{restored.aside});
    for (auto& entry : std::filesystem::directory_iterator(site.folder.path()))
        EXPECT_EQ(entry.path().filename().string().find(".restor"), std::string::npos) << entry.path();

    site.grow(1);
    auto events = read_all(site.path());
    EXPECT_EQ(events.size(), 120u);
    EXPECT_EQ(events[100].seq, 161u);
    auto ids = ids_in_view(site.path());
    EXPECT_EQ(ids.front(), "site-7:1");
    EXPECT_EQ(ids[99], "site-7:100");
    EXPECT_EQ(ids[100], "site-7:1:161");
    std::set<std::string> ever(ids_before.begin(), ids_before.end());
    for (std::size_t i = 100; i < ids.size(); ++i)
        EXPECT_TRUE(ever.insert(ids[i]).second) << ids[i];
    EXPECT_EQ(open_store(site.path())->check(), "");
    EXPECT_EQ(open_store(site.path())->cursor("broker"), 180u);
}

TEST(Restore, AgainAndAgainFromOneBackupNoIdComesTwice) {
    Site site;
    std::set<std::string> ever;
    for (auto& id : ids_in_view(site.path()))
        ever.insert(id);
    for (std::uint64_t round = 1; round <= 4; ++round) {
        EXPECT_EQ(site.restored().epoch, round);
        site.grow(2);
        auto ids = ids_in_view(site.path());
        ASSERT_EQ(ids.size(), 140u);
        for (std::size_t i = 100; i < ids.size(); ++i)
            EXPECT_TRUE(ever.insert(ids[i]).second) << ids[i];
        EXPECT_EQ(described(site.path())[100].substr(0, 9), "site-7:" + std::to_string(round) + ":");
    }
    EXPECT_EQ(open_store(site.path())->check(), "");
    EXPECT_EQ(stores_set_aside(site.path()).size(), 4u);
}

TEST(Restore, ABackupOfARestoredStoreKeepsAllItsIds) {
    Site site;
    site.restored();
    site.grow(1);
    auto before = described(site.path());
    ASSERT_TRUE(back_up(site.path(), site.backup, true));
    EXPECT_EQ(site.restored().epoch, 2u);
    site.grow(1);
    auto after = described(site.path());
    ASSERT_EQ(after.size(), 140u);
    EXPECT_EQ(std::vector(after.begin(), after.begin() + 120), before);
    EXPECT_TRUE(after[100].starts_with("site-7:1:"));
    EXPECT_TRUE(after[120].starts_with("site-7:2:"));
}

TEST(Restore, WhereNothingIsKnownOfTheStoreBeforeTheEpochIsTheTime) {
    Site site;
    for (auto lost : {true, false}) {
        for (auto suffix : {"", "-wal", "-shm"})
            std::filesystem::remove(site.path().string() + suffix);
        if (!lost) std::ofstream(site.path()) << std::string(10'000, 'x');
        auto restored = site.restored({.now = start_time + (lost ? 0s : 1h)});
        EXPECT_EQ(restored.epoch, start_second + (lost ? 0 : 3600));
        EXPECT_FALSE(restored.numbers_go_on);
        EXPECT_EQ(restored.next_seq, 101u);
        EXPECT_EQ(restored.aside.empty(), lost);
        site.grow(1);
        EXPECT_EQ(ids_in_view(site.path())[100], "site-7:" + std::to_string(restored.epoch) + ":101");
    }
}

TEST(Restore, ThenTheEpochIsHigherThanThatOfAnythingSetAside) {
    Site site;
    EXPECT_EQ(site.restored().epoch, 1u);
    std::filesystem::rename(site.folder.path() / "set-aside-1", site.folder.path() / "set-aside-1795302240");
    std::filesystem::remove(site.path());
    EXPECT_EQ(site.restored().epoch, start_second + 1);
}

TEST(Restore, TakesAStoreOfAnOlderVersion) {
    Site site;
    auto events = described(site.backup);
    auto older = downgrade_store(site.backup, 1, true);
    ASSERT_TRUE(older && older->done);
    EXPECT_EQ(site.restored().backup.version, sql_number(site.path(), "PRAGMA user_version"));
    EXPECT_EQ(described(site.path()), events);
}

TEST(Restore, TakesAStoreThatWasSetAsideWithItsLog) {
    Site site;
    auto first = site.restored();
    auto journal = open_store(site.path());
    fill(*journal, 2);
    auto events = described(site.path());
    auto copy = site.other.path() / "gantry.db";
    for (auto suffix : {"", "-wal"})
        std::filesystem::copy_file(site.path().string() + suffix, copy.string() + suffix);
    journal.reset();
    auto again = restore(site.path(), copy, at_start);
    ASSERT_TRUE(again) << again.error().error.text();
    EXPECT_EQ(described(site.path()), events);
}

TEST(Restore, WhatCannotBeRestoredChangesNothing) {
    Site site;
    site.grow(1);
    auto before = described(site.path());
    auto untouched = [&] {
        EXPECT_EQ(described(site.path()), before);
        EXPECT_TRUE(stores_set_aside(site.path()).empty());
        EXPECT_FALSE(std::filesystem::exists(site.path().string() + ".restoring"));
    };
    EXPECT_NE(restore(site.path(), site.path(), at_start).error().error.what.find("is the store itself"),
              std::string::npos);
    untouched();
    run_sql(site.backup, "UPDATE event_rows SET rssi = 0 WHERE seq = 7");
    EXPECT_NE(site.error().find("event 7 is not as it was stored; nothing was changed"), std::string::npos)
        << site.error();
    EXPECT_NE(site.error().find(site.backup.string()), std::string::npos) << site.error();
    untouched();
    run_sql(site.backup, "PRAGMA user_version=1000");
    EXPECT_NE(site.error().find("has version 1000"), std::string::npos) << site.error();
    untouched();
    run_sql(site.backup, "PRAGMA application_id=7");
    EXPECT_NE(site.error().find("another program"), std::string::npos) << site.error();
    untouched();
    std::ofstream(site.backup) << "no database at all, though it is long enough to look like one";
    EXPECT_NE(site.error().find("nothing was changed"), std::string::npos) << site.error();
    untouched();
    std::ofstream(site.backup, std::ios::trunc).close();
    EXPECT_NE(site.error().find("holds no store"), std::string::npos) << site.error();
    untouched();
}

TEST(Restore, AnotherGatewaysBackupIsTakenOnlyOnDemand) {
    Site site, other;
    ASSERT_TRUE(open_store(other.path())->set_gateway_id("site-8"));
    EXPECT_NE(restore(other.path(), site.backup, at_start)
                  .error()
                  .error.text()
                  .find("is of the gateway site-7, and"),
              std::string::npos);
    auto forced = restore(other.path(), site.backup, {.now = start_time, .another = true});
    ASSERT_TRUE(forced) << forced.error().error.text();
    EXPECT_EQ(forced->id_prefix, "site-7:1:");
}

TEST(Restore, ANewGatewayIdIsForEventsToCome) {
    Site site;
    auto before = described(site.path());
    ASSERT_TRUE(open_store(site.path())->set_gateway_id("site-9"));
    EXPECT_EQ(described(site.path()), before);
    ASSERT_TRUE(open_store(site.path())->set_gateway_id("site-10"));
    EXPECT_EQ(described(site.path()), before);
    site.grow(1);
    auto ids = ids_in_view(site.path());
    EXPECT_EQ(ids[99], "site-7:100");
    EXPECT_EQ(ids[100], "site-10:101");
    auto reader = Reader::open(site.path());
    EXPECT_EQ((*reader)->id_prefix(), "site-10:");
    EXPECT_EQ((*reader)->id_prefixes()->of(100), "site-7:");
    EXPECT_EQ(open_store(site.path())->check(), "");
}

#ifdef GANTRY_FAILPOINTS
TEST(Restore, KilledAtAnyPointItIsTheOldStoreOrTheNewOne) {
    for (auto open_when_killed : {false, true})
        for (const char* failpoint : {"restore_decided", "restore_moved"}) {
            SCOPED_TRACE(failpoint);
            Site site;
            if (open_when_killed) {
                // The gateway was killed: its log is there, and holds the newest.
                ASSERT_TRUE(dies_at("never", [&] {
                    auto journal = open_store(site.path());
                    fill(*journal, 3);
                    std::raise(SIGKILL);
                }));
            } else {
                site.grow(3);
            }
            auto old = described(site.path());
            ASSERT_EQ(old.size(), 160u);
            ASSERT_TRUE(
                dies_at(failpoint, [&] { static_cast<void>(restore(site.path(), site.backup, at_start)); }));
            Options options;
            options.path = site.path();
            {
                auto opened = open_or_set_aside(options, start_time);
                ASSERT_TRUE(opened) << opened.error().error.text();
                EXPECT_EQ(opened->damage, "");
            }
            bool done = std::string_view(failpoint) == "restore_moved";
            if (done) {
                EXPECT_EQ(described(site.path()), described(site.backup));
                EXPECT_EQ(described(site.folder.path() / "set-aside-1" / "gantry.db"), old);
            } else {
                EXPECT_EQ(described(site.path()), old);
            }
            // And once more, to its end.
            EXPECT_EQ(site.restored().epoch, done ? 2u : 1u);
            EXPECT_EQ(described(site.path()), described(site.backup));
        }
}
#endif

}  // namespace
}  // namespace gantry::journal::tests
