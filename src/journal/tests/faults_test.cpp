#include <algorithm>
#include <cstdlib>
#include <set>

#include "journal/tests/faulty_vfs.hpp"
#include "journal/tests/fixtures.hpp"

namespace gantry::journal::tests {
namespace {
using Kind = StoreError::Kind;

// Each commit has its own tag, so that what is stored can be told apart.
void fill(Batch& batch, std::uint64_t commit, ReadPointId point) {
    for (int i = 0; i < 20; ++i)
        add_read(batch, commit, point);
    add_tag_event(batch, commit).reason = "commit";
    add_tag_event(batch, commit);
    PresenceRow row;
    row.id = commit;
    row.tag = tag_number(commit);
    row.zone = row.zone_key = "dock";
    batch.presence.push_back(row);
    batch.marks = {{"dock-1", Bytes(300, static_cast<std::uint8_t>(commit))}};
}

struct Outcome {
    int commits = 0;   // reported as done
    int failures = 0;  // reported as failed
    bool fired = false;
};

// Commits in a loop as a writer does it, mends as it must, with one fault somewhere. Ends with a look at what
// is there.
Outcome run_with_fault(FaultyVfs::Call call, int at, int code, int more, std::uint64_t commits) {
    Folder folder;
    Options options;
    options.path = folder.store();
    options.max_size = 1 << 20;  // small, so that the log goes into the file often
    Outcome outcome;
    {
        FaultyVfs vfs;
        auto journal = open_store(options);
        vfs.fail(call, at, code, more);
        for (std::uint64_t commit = 1; commit <= commits; ++commit) {
            auto batch = next_batch(*journal, start_time + std::chrono::seconds(commit));
            fill(batch, commit, journal->read_point("dock-1", "Ant" + std::to_string(commit), "dock"));
            // Files are opened when something has failed; here it has, each time.
            if (call == FaultyVfs::Call::open)
                for (int opens = 0; opens < 100 && !journal->reopen(); ++opens)
                    ++outcome.failures;
            for (int tries = 0;; ++tries) {
                auto done = journal->commit(batch);
                if (done) break;
                ++outcome.failures;
                EXPECT_EQ(batch.reads.size(), 20u) << "a failed commit leaves the batch alone";
                EXPECT_FALSE(done.error().error.what.empty());
                EXPECT_LT(tries, 100);
                if (tries >= 100) return outcome;
                if (done.error().kind != Kind::full)
                    for (int opens = 0; opens < 100 && !journal->reopen(); ++opens) {
                    }
            }
            ++outcome.commits;
            EXPECT_EQ(journal->last_seq(), commit * 22);
        }
        outcome.fired = vfs.fired();
        vfs.heal();
    }
    auto journal = open_store(options);
    EXPECT_EQ(journal->last_seq(), commits * 22);
    EXPECT_EQ(journal->check(), "");
    auto events = read_all(folder.store());
    EXPECT_EQ(events.size(), commits * 22) << "nothing lost, nothing doubled";
    for (std::size_t i = 0; i < events.size(); ++i) {
        EXPECT_EQ(events[i].seq, i + 1);
        EXPECT_EQ(events[i].tag, tag_number(i / 22 + 1));
        EXPECT_EQ(events[i].antenna, i % 22 < 20 ? "Ant" + std::to_string(i / 22 + 1) : "Ant0");
    }
    std::set<std::uint64_t> present;
    EXPECT_TRUE(journal->load_presence([&](const PresenceRow& row) { present.insert(row.id); }));
    EXPECT_EQ(present.size(), commits);
    EXPECT_EQ(journal->mark("dock-1"), Bytes(300, static_cast<std::uint8_t>(commits)));
    return outcome;
}

void sweep(FaultyVfs::Call call, int code, int more, int last, int at_least, int commits = 40) {
    int fired = 0, failures = 0;
    for (int at = 1; at <= last; ++at) {
        SCOPED_TRACE(at);
        auto outcome = run_with_fault(call, at, code, more, static_cast<std::uint64_t>(commits));
        EXPECT_EQ(outcome.commits, commits);
        fired += outcome.fired;
        failures += outcome.failures;
        if (::testing::Test::HasFailure()) return;
    }
    EXPECT_GE(fired, at_least) << "the faults must have happened";
    EXPECT_GE(failures, at_least / 2) << "and must have been told to the writer";
}

// Up to which call each fault is tried; proof R5 goes further.
int last_call(int usual) {
    const char* asked = std::getenv("GANTRY_FAULTS_UP_TO");
    return asked != nullptr ? std::atoi(asked) : usual;
}

TEST(Faults, AFailedWriteLosesAndDoublesNothing) {
    sweep(FaultyVfs::Call::write, SQLITE_IOERR_WRITE, 0, 200, 200);
}
TEST(Faults, AFailedSyncLosesAndDoublesNothing) {
    auto last = last_call(40);
    sweep(FaultyVfs::Call::sync, SQLITE_IOERR_FSYNC, 0, last, last, std::max(last, 40));
}
TEST(Faults, AFailedOpenLosesAndDoublesNothing) {
    auto last = last_call(20);
    sweep(FaultyVfs::Call::open, SQLITE_CANTOPEN, 0, last, last, std::max(last, 20));
}
TEST(Faults, AFullDiskLosesAndDoublesNothing) {
    sweep(FaultyVfs::Call::write, SQLITE_FULL, 0, 200, 200);
}
TEST(Faults, FaultsThatLastLoseAndDoubleNothing) {
    sweep(FaultyVfs::Call::write, SQLITE_IOERR_WRITE, 5, 60, 60);
    sweep(FaultyVfs::Call::sync, SQLITE_IOERR_FSYNC, 5, 40, 40);
    sweep(FaultyVfs::Call::write, SQLITE_FULL, 25, 60, 60);
}

TEST(Faults, AfterAnIoErrorNothingIsWrittenBeforeReopen) {
    Folder folder;
    FaultyVfs vfs;
    auto journal = open_store(folder.store());
    auto batch = next_batch(*journal);
    fill(batch, 1, journal->read_point("a", "b", "c"));
    vfs.fail(FaultyVfs::Call::sync, 1, SQLITE_IOERR_FSYNC);
    auto failed = journal->commit(batch);
    ASSERT_FALSE(failed);
    EXPECT_EQ(failed.error().kind, Kind::io);
    EXPECT_TRUE(vfs.fired());
    auto again = journal->commit(batch);
    ASSERT_FALSE(again);
    EXPECT_EQ(again.error().kind, Kind::io);
    vfs.fail(FaultyVfs::Call::open, 1, SQLITE_CANTOPEN);
    auto reopened = journal->reopen();
    ASSERT_FALSE(reopened);
    EXPECT_EQ(reopened.error().kind, Kind::io);
    EXPECT_FALSE(journal->commit(batch));
    ASSERT_TRUE(journal->reopen());
    ASSERT_TRUE(journal->commit(batch));
    EXPECT_EQ(read_all(folder.store()).size(), 22u);
}

TEST(Faults, AReopenThatFailedLeavesAStoreThatRefusesAndCanBeOpenedLater) {
    Folder folder;
    FaultyVfs vfs;
    auto journal = open_store(folder.store());
    auto batch = next_batch(*journal);
    fill(batch, 1, journal->read_point("a", "b", "c"));
    // Nothing had failed before as far as the journal knows; the writer reopens after any failure.
    vfs.fail(FaultyVfs::Call::open, 1, SQLITE_CANTOPEN);
    ASSERT_FALSE(journal->reopen());
    auto failed = journal->commit(batch);
    ASSERT_FALSE(failed);
    EXPECT_EQ(failed.error().kind, Kind::io);
    EXPECT_EQ(batch.reads.size(), 20u);
    EXPECT_FALSE(journal->set_gateway_id("other"));
    EXPECT_FALSE(journal->stopped_readers());
    auto retained = journal->retain(start_time);
    ASSERT_TRUE(retained);
    EXPECT_EQ(retained->deleted, 0u);
    EXPECT_EQ(journal->size().bytes, 0u);
    ASSERT_TRUE(journal->reopen());
    ASSERT_TRUE(journal->commit(batch));
    EXPECT_EQ(read_all(folder.store()).size(), 22u);
}

// The writer is told that the commit failed, but the file that it opens again has it.
TEST(Faults, ACommitThatArrivedAfterAllIsNotStoredTwice) {
    Folder folder, other;
    auto journal = open_store(folder.store());
    auto batch = next_batch(*journal);
    fill(batch, 1, journal->read_point("dock-1", "Ant1", "dock"));
    auto later = batch;
    ASSERT_TRUE(journal->commit(batch));
    journal.reset();
    // The same in memory as before that commit, while the file is one further.
    auto behind = open_store(other.store());
    ASSERT_EQ(behind->read_point("dock-1", "Ant1", "dock"), 1u);
    ASSERT_EQ(behind->read_point("dock-1", "Ant0", "dock"), 2u);
    ASSERT_EQ(behind->read_point("", "", "dock"), 3u);
    for (auto* end : {"-wal", "-shm"})
        std::filesystem::remove(other.store().string() + end);
    std::filesystem::rename(folder.store(), other.store());
    ASSERT_TRUE(behind->reopen());
    EXPECT_EQ(behind->last_seq(), 22u);
    // Meanwhile more has come in behind what was in doubt.
    add_tag_event(later, 2);
    ASSERT_TRUE(behind->commit(later));
    EXPECT_EQ(behind->last_seq(), 23u);
    EXPECT_EQ(read_all(other.store()).size(), 23u);
    EXPECT_EQ(behind->check(), "");
}

TEST(Faults, TheLogIsBoundedWhenAnotherProgramKeepsAnOldStateOpen) {
    Folder folder;
    Options options;
    options.path = folder.store();
    options.max_size = 1 << 20;
    options.keep = 1s;
    auto journal = open_store(options);
    sqlite3* shell = nullptr;
    ASSERT_EQ(sqlite3_open(folder.store().c_str(), &shell), SQLITE_OK);
    ASSERT_EQ(sqlite3_exec(shell, "BEGIN; SELECT * FROM state", nullptr, nullptr, nullptr), SQLITE_OK);
    auto batch = next_batch(*journal);
    std::string said;
    for (int commits = 0; said.empty() && commits < 10'000; ++commits) {
        auto now = start_time + std::chrono::seconds(commits);
        for (int i = 0; i < 500; ++i)
            add_read(batch, 1, 0, now);
        if (auto done = journal->commit(batch); !done) {
            EXPECT_EQ(done.error().kind, Kind::other);
            said = done.error().error.text();
        } else {
            ASSERT_TRUE(journal->retain(now));  // the events themselves find room
        }
    }
    EXPECT_NE(said.find("keeps an old state open"), std::string::npos) << said;
    EXPECT_LT(std::filesystem::file_size(folder.store().string() + "-wal"), 5u << 20);
    ASSERT_TRUE(journal->reopen());
    EXPECT_FALSE(journal->commit(batch));
    sqlite3_close(shell);
    EXPECT_TRUE(journal->commit(batch));
    EXPECT_EQ(journal->check(), "");
}

TEST(Faults, AFullStoreTakesNothingAndLosesNothing) {
    Folder folder;
    Options options;
    options.path = folder.store();
    options.max_size = 1 << 20;
    auto journal = open_store(options);
    auto point = journal->read_point("dock-1", "Ant0", "dock");
    auto batch = next_batch(*journal);
    Seq stored = 0;
    for (std::uint64_t commit = 1;; ++commit) {
        ASSERT_LT(commit, 10'000u);
        for (int i = 0; i < 500; ++i)
            add_read(batch, commit * 1000 + static_cast<std::uint64_t>(i), point);
        auto done = journal->commit(batch);
        if (!done) {
            EXPECT_EQ(done.error().kind, Kind::full);
            EXPECT_FALSE(done.error().error.hint.empty());
            break;
        }
        stored = journal->last_seq();
    }
    EXPECT_LE(std::filesystem::file_size(folder.store()), options.max_size);
    EXPECT_EQ(journal->retain(start_time)->deleted, 0u);
    EXPECT_FALSE(journal->commit(batch));
    EXPECT_EQ(read_all(folder.store()).size(), stored);
    EXPECT_EQ(journal->check(), "");
    journal.reset();
    options.max_size = 2 << 20;  // the user gives it more
    journal = open_store(options);
    ASSERT_EQ(journal->read_point("dock-1", "Ant0", "dock"), point);
    EXPECT_TRUE(journal->commit(batch));
    EXPECT_EQ(read_all(folder.store()).size(), stored + 500);
}

}  // namespace
}  // namespace gantry::journal::tests
