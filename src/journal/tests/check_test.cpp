#include <atomic>
#include <fstream>
#include <iterator>
#include <random>
#include <thread>

#include "journal/tests/rich_store.hpp"
#include "journal/upkeep.hpp"

namespace gantry::journal::tests {
namespace {

Checked check(const std::filesystem::path& path) {
    auto checked = check_store(path);
    if (!checked) throw std::runtime_error(checked.error().error.text());
    return *checked;
}

// Closed, with the tables of all versions in use.
struct Filled {
    Folder folder;
    explicit Filled(int commits = 20) {
        auto journal = open_store(folder.store());
        if (!journal->set_gateway_id("site-7")) throw std::runtime_error("no id");
        fill(*journal, commits);
        add_newer(*journal);
        if (!journal->raise_epoch(1, 1000)) throw std::runtime_error("no epoch");
        fill(*journal, 1);
    }
    const std::filesystem::path path() const { return folder.store(); }
};

TEST(Check, ASoundStoreSaysWhatIsInIt) {
    Filled store;
    auto checked = check(store.path());
    EXPECT_EQ(checked.problems, std::vector<std::string>{});
    EXPECT_TRUE(checked.sound());
    EXPECT_EQ(checked.events, 20u * 20 + 2 + 20);
    EXPECT_EQ(checked.last_seq, 1019u);
    EXPECT_EQ(checked.deleted, 0u) << "the numbers that a restore leaves out were never there";
    EXPECT_EQ(checked.id_prefix, "site-7:1:");
    EXPECT_EQ(checked.bytes, std::filesystem::file_size(store.path()));
}

TEST(Check, WhatRetentionHasDeletedIsNoGap) {
    Folder folder;
    Options options;
    options.path = folder.store();
    auto journal = open_store(options);
    fill(*journal, 50);
    auto batch = next_batch(*journal, start_time + 24h);
    auto point = journal->read_point("dock-1", "Ant0", "dock");
    for (int i = 0; i < 5; ++i) {
        add_read(batch, 1, point, start_time + 24h);
        add_tag_event(batch, 1, start_time + 24h);
    }
    batch.cursors = {{"broker", batch.next_seq - 1}};
    ASSERT_TRUE(journal->commit(batch));
    while (journal->retain(start_time + options.keep + 1h)->more) {
    }
    auto checked = check(folder.store());
    EXPECT_EQ(checked.problems, std::vector<std::string>{});
    EXPECT_EQ(checked.events, 10u);
    EXPECT_EQ(checked.deleted, 1000u);
}

TEST(Check, EveryKindOfDamageIsNamed) {
    struct Case {
        std::string sql, named;
    };
    for (auto& [sql, named] : std::vector<Case>{
             {"UPDATE state SET untold = 1", "its state fails its checksum"},
             {"UPDATE read_points SET zone = 'dorm' WHERE id = 1", "read point 1 is not as it was stored"},
             {"UPDATE tags SET epc = 'urn:other' WHERE id = 2", "tag row 2 is not as it was stored"},
             {"UPDATE event_rows SET rssi = -1 WHERE seq = 7", "event 7 is not as it was stored"},
             {"UPDATE event_details SET reason = 'who' WHERE seq = 7", "event 7 is not as it was stored"},
             {"UPDATE read_batches SET time_us = time_us + 1 WHERE first_seq = 22",
              "the reads 22 to 40 are not as they were stored"},
             {"UPDATE presence SET reads = 5 WHERE id = 41", "presence row 41 is not as it was stored"},
             {"UPDATE marks SET mark = x'FF'", "mark 1 is not as it was stored"},
             {"UPDATE jobs SET state = 'failed' WHERE id = 2", "job 2 is not as it was stored"},
             {"UPDATE dead_letters SET reason = 'too short'", "dead letter 1 is not as it was stored"},
             {"UPDATE tags SET pc = 1 WHERE pc = 12288", "is not as it was stored"},
             {"UPDATE presence SET xpc = 1 WHERE id = 1000000",
              "presence row 1000000 is not as it was stored"},
             {"UPDATE earlier_ids SET epoch = 9",
              "which ids the events up to 402 have is not as it was stored"},
             {"UPDATE cursors SET seq = 5000", "the cursor of broker is at 5000, where no event was yet"},
             {"DELETE FROM numbers WHERE n = 80", "the table `numbers` has not all of its rows"},
             {"DROP VIEW events; CREATE VIEW events AS SELECT 1 AS seq", "the view `events` is not"},
             {"DELETE FROM event_details WHERE seq = 1", "event 1 is not as it was stored"},
             {"DELETE FROM event_rows WHERE seq = 101", "1 rows of event_details belong to no event"},
             {"DELETE FROM event_rows WHERE seq = 101",
              "event 101 is missing, and nothing says that it was deleted"},
             {"DELETE FROM event_rows WHERE seq > 1010",
              "event 1018 is missing, and nothing says that it was deleted"},
             {"DELETE FROM read_batches WHERE first_seq = 42",
              "event 42 is missing, and nothing says that it was deleted"},
             {"DELETE FROM tags WHERE id = 3", "the tag of event 5 is missing"},
             {"DELETE FROM tags WHERE id = 11", "tags are missing of the reads 2 to 20"},
             {"DELETE FROM read_points WHERE id = 1", "the read point of event 1 is missing"},
             {"DELETE FROM read_points WHERE id = 3", "read points are missing of the reads 22 to 40"},
             {"UPDATE event_rows SET seq = 2 WHERE seq = 1", "the number 2 is there twice"},
         }) {
        SCOPED_TRACE(sql);
        Filled store;
        run_sql(store.path(), sql);
        auto checked = check(store.path());
        EXPECT_FALSE(checked.sound());
        auto has = [&, &what = named](const std::string& problem) {
            return problem.find(what) != std::string::npos;
        };
        EXPECT_TRUE(std::ranges::any_of(checked.problems, has)) << ::testing::PrintToString(checked.problems);
    }
}

TEST(Check, TooManyProblemsAreCountedAndTheFirstTold) {
    Filled store(200);
    run_sql(store.path(), "UPDATE event_rows SET reads = 77");
    auto checked = check(store.path());
    EXPECT_EQ(checked.problem_count, 200u * 10 + 2 + 10);
    EXPECT_EQ(checked.problems.size(), Checked::most_problems);
}

TEST(Check, ItCanBeStopped) {
    Filled store;
    auto checked = check_store(store.path(), [](std::uint64_t, std::uint64_t) { return false; });
    ASSERT_FALSE(checked);
    EXPECT_NE(checked.error().error.what.find("stopped"), std::string::npos);
}

TEST(Check, AStoreOfAnotherVersionIsNotJudged) {
    Filled store;
    run_sql(store.path(), "PRAGMA user_version=1");
    auto checked = check_store(store.path());
    ASSERT_FALSE(checked);
    EXPECT_NE(checked.error().error.text().find("start the gateway once"), std::string::npos);
}

TEST(Check, BesideAWriterThatStoresAndDeletesAllIsSound) {
    Folder folder;
    Options options;
    options.path = folder.store();
    options.keep = 10s;
    auto journal = open_store(options);
    fill(*journal, 100);
    std::atomic<bool> stop{false};
    std::thread writer([&] {
        for (int round = 1; !stop; ++round) {
            auto now = start_time + std::chrono::milliseconds(100 * round);
            fill(*journal, 1, now);
            EXPECT_TRUE(journal->retain(now));
        }
    });
    std::uint64_t deleted = 0;
    for (int times = 0; times < 30 || deleted == 0; ++times) {
        auto checked = check(folder.store());
        EXPECT_EQ(checked.problems, std::vector<std::string>{});
        deleted = checked.deleted;
        if (::testing::Test::HasFailure()) break;
    }
    stop = true;
    writer.join();
}

// What a check calls sound is exactly what was stored.
TEST(Check, NothingThatReadsOtherwiseIsCalledSound) {
    Filled original;
    std::ifstream in(original.path(), std::ios::binary);
    std::string bytes{std::istreambuf_iterator<char>(in), {}};
    auto events = described(original.path());
    auto ids = ids_in_view(original.path());
    std::mt19937 dice(5);
    int sound = 0, damaged = 0;
    for (int i = 0; i < 150; ++i) {
        SCOPED_TRACE(i);
        auto copy = bytes;
        auto at = dice() % copy.size();
        copy[at] = static_cast<char>(copy[at] ^ static_cast<char>(1 << dice() % 8));
        Folder folder;
        std::ofstream(folder.store(), std::ios::binary) << copy;
        auto checked = check_store(folder.store());
        if (!checked || !checked->sound()) {
            ++damaged;
            continue;
        }
        ++sound;
        EXPECT_EQ(described(folder.store()), events);
        EXPECT_EQ(ids_in_view(folder.store()), ids);
    }
    EXPECT_GT(damaged, 50);
    EXPECT_GT(sound, 0) << "a page that nothing uses may be anything";
}

}  // namespace
}  // namespace gantry::journal::tests
