#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <random>

#include "journal/tests/fixtures.hpp"

namespace gantry::journal::tests {
namespace {

struct Child {
    pid_t id = -1;
    int acknowledgements = -1;
};

Child start(const std::function<int(int)>& work) {
    int ends[2];
    if (pipe(ends) != 0) throw std::runtime_error("no pipe");
    Child child{fork(), ends[0]};
    if (child.id == 0) {
        close(ends[0]);
        _exit(work(ends[1]));
    }
    close(ends[1]);
    return child;
}

// Commits until it is killed; says every number it was told is safe.
int commit_for_ever(const Options& options, int said) {
    auto journal = Journal::open(options);
    if (!journal) return 1;
    std::mt19937 dice(static_cast<unsigned>((*journal)->last_seq()));
    auto batch = next_batch(**journal);
    for (std::uint64_t round = 0;; ++round) {
        auto point = (*journal)->read_point("dock", "Ant" + std::to_string(dice() % 50), "dock");
        for (auto count = dice() % 300 + 1; count > 0; --count) {
            if (dice() % 4 == 0)
                add_tag_event(batch, batch.next_seq % 1000).reason = dice() % 2 == 0 ? "why" : "";
            auto number = batch.next_seq % 1000;
            add_read(batch, number, point);
        }
        if (!(*journal)->commit(batch)) return 2;
        if (round % 8 == 7 && !(*journal)->retain(start_time)) return 3;
        auto last = (*journal)->last_seq();
        if (write(said, &last, sizeof last) != sizeof last) return 4;
    }
}

TEST(Crash, ACommitSurvivesSigkill) {
    Folder folder;
    Options options;
    options.path = folder.store();
    options.max_size = 64 << 20;
    std::mt19937 dice(7);
    Seq safe = 0;
    for (int kill_number = 0; kill_number < 25; ++kill_number) {
        auto child = start([&](int said) { return commit_for_ever(options, said); });
        // Killed while it works on the one after the last it said.
        auto before = dice() % 40;
        for (unsigned i = 0; i <= before; ++i)
            ASSERT_EQ(read(child.acknowledgements, &safe, sizeof safe), static_cast<ssize_t>(sizeof safe));
        kill(child.id, SIGKILL);
        int status = 0;
        waitpid(child.id, &status, 0);
        ASSERT_TRUE(WIFSIGNALED(status)) << "exit " << WEXITSTATUS(status);
        while (read(child.acknowledgements, &safe, sizeof safe) == static_cast<ssize_t>(sizeof safe)) {
        }
        close(child.acknowledgements);

        auto journal = open_store(options);
        ASSERT_GE(journal->last_seq(), safe);
        auto events = read_all(folder.store());
        ASSERT_EQ(events.size(), journal->last_seq());
        for (std::size_t i = 0; i < events.size(); ++i) {
            ASSERT_EQ(events[i].seq, i + 1);
            ASSERT_EQ(events[i].tag, tag_number((i + 1) % 1000));
        }
        if (kill_number % 5 == 0) {
            ASSERT_EQ(journal->check(), "");
        }
    }
    EXPECT_GT(safe, 1000u);
}

TEST(Crash, AReaderSeesWholeCommitsWhileAnotherProcessWrites) {
    Folder folder;
    Options options;
    options.path = folder.store();
    open_store(options);
    auto child = start([&](int said) { return commit_for_ever(options, said); });
    auto reader = Reader::open(folder.store());
    ASSERT_TRUE(reader);
    Seq seen = 0;
    std::uint64_t version = 0;
    int versions = 0;
    while (seen < 50'000 || versions <= 2) {  // the other one may be far ahead at the first look
        auto now = (*reader)->version();
        ASSERT_TRUE(now);
        if (*now == version) {
            Seq acknowledged = 0;  // nothing new: wait for the next commit
            ASSERT_EQ(read(child.acknowledgements, &acknowledged, sizeof acknowledged),
                      static_cast<ssize_t>(sizeof acknowledged));
            continue;
        }
        version = *now;
        ++versions;
        auto last = (*reader)->last_seq();
        ASSERT_TRUE(last);
        Filter filter;
        filter.after = seen;
        auto read = (*reader)->query(filter, [&](const event::Event& event) {
            EXPECT_EQ(event.seq, ++seen);
            return event.seq == seen;
        });
        ASSERT_TRUE(read);
        EXPECT_GE(seen, *last);
    }
    kill(child.id, SIGKILL);
    waitpid(child.id, nullptr, 0);
    close(child.acknowledgements);
    EXPECT_GT(versions, 2);
}

TEST(Crash, ASlowConsumerHoldsNothingUp) {
    Folder folder;
    Options options;
    options.path = folder.store();
    options.max_size = 4 << 20;
    auto journal = open_store(options);
    auto point = journal->read_point("dock", "Ant0", "dock");
    auto commit = [&] {
        auto batch = next_batch(*journal);
        for (int i = 0; i < 100; ++i)
            add_read(batch, 1, point);
        ASSERT_TRUE(journal->commit(batch)) << "seq " << batch.next_seq;
    };
    for (int i = 0; i < 100; ++i)
        commit();
    auto reader = Reader::open(folder.store());
    std::size_t read = 0;
    auto done = (*reader)->query({}, [&](const event::Event&) {
        if (++read <= 500) commit();  // the log stays short although the query is not at its end
        return true;
    });
    ASSERT_TRUE(done);
    EXPECT_EQ(read, journal->last_seq());
    auto log = std::filesystem::file_size(folder.store().string() + "-wal");
    EXPECT_LT(log, 2u << 20);
}

}  // namespace
}  // namespace gantry::journal::tests
