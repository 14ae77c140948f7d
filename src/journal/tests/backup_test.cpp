#include <sys/stat.h>

#include <atomic>
#include <fstream>
#include <iterator>
#include <thread>

#include "journal/tests/dies_at.hpp"
#include "journal/tests/rich_store.hpp"
#include "journal/upkeep.hpp"
#include "testkit/eventually.hpp"

namespace gantry::journal::tests {
namespace {

std::string bytes_of(const std::filesystem::path& path) {
    std::ifstream in(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
}

std::vector<std::string> names_in(const std::filesystem::path& directory) {
    std::vector<std::string> names;
    for (auto& entry : std::filesystem::directory_iterator(directory))
        names.push_back(entry.path().filename());
    std::ranges::sort(names);
    return names;
}

TEST(Backup, IsOnePrivateFileThatHoldsAllOfIt) {
    Folder folder, other;
    auto journal = open_store(folder.store());
    fill(*journal, 30);
    add_newer(*journal);
    auto backup = other.path() / "copy.db";
    auto made = back_up(folder.store(), backup, false);
    ASSERT_TRUE(made) << made.error().error.text();
    EXPECT_EQ(made->events, 602u);
    EXPECT_TRUE(made->sound());
    EXPECT_EQ(names_in(other.path()), std::vector<std::string>{"copy.db"});
    struct stat is {};
    ASSERT_EQ(::stat(backup.c_str(), &is), 0);
    EXPECT_EQ(is.st_mode & 0777, 0600u);
    EXPECT_EQ(described(backup), described(folder.store()));
    // Bytes 18 and 19 of the header: 1, no log is used.
    EXPECT_EQ(bytes_of(backup).substr(18, 2), "\1\1");
}

TEST(Backup, OverwritesOnlyWhenItIsTold) {
    Folder folder, other;
    auto journal = open_store(folder.store());
    fill(*journal, 1);
    auto backup = other.path() / "copy.db";
    std::ofstream(backup) << "mine";
    auto refused = back_up(folder.store(), backup, false);
    ASSERT_FALSE(refused);
    EXPECT_NE(refused.error().error.text().find("is there already; give another name, or --force"),
              std::string::npos)
        << refused.error().error.text();
    EXPECT_EQ(bytes_of(backup), "mine");
    ASSERT_TRUE(back_up(folder.store(), backup, true));
    EXPECT_EQ(described(backup), described(folder.store()));
    auto itself = back_up(folder.store(), folder.store(), true);
    ASSERT_FALSE(itself);
    EXPECT_NE(itself.error().error.what.find("is the store itself"), std::string::npos);
    EXPECT_EQ(names_in(other.path()), std::vector<std::string>{"copy.db"});
}

TEST(Backup, WhatACutOffOneLeftIsNoObstacle) {
    Folder folder, other;
    auto journal = open_store(folder.store());
    fill(*journal, 1);
    auto backup = other.path() / "copy.db";
    std::ofstream(backup.string() + ".part") << std::string(100'000, 'x');
    ASSERT_TRUE(back_up(folder.store(), backup, false));
    EXPECT_EQ(names_in(other.path()), std::vector<std::string>{"copy.db"});
    // But what is somebody else's is left alone.
    auto second = other.path() / "second.db";
    std::filesystem::create_symlink(folder.path() / "target", second.string() + ".part");
    EXPECT_FALSE(back_up(folder.store(), second, false));
    EXPECT_FALSE(std::filesystem::exists(folder.path() / "target"));
}

TEST(Backup, OfADamagedStoreThereIsNone) {
    Folder folder, other;
    {
        auto journal = open_store(folder.store());
        fill(*journal, 5);
    }
    run_sql(folder.store(), "UPDATE event_rows SET rssi = 0 WHERE seq = 7");
    auto made = back_up(folder.store(), other.path() / "copy.db", false);
    ASSERT_FALSE(made);
    EXPECT_EQ(made.error().kind, StoreError::Kind::corrupt);
    EXPECT_NE(made.error().error.what.find("event 7 is not as it was stored"), std::string::npos)
        << made.error().error.what;
    EXPECT_EQ(names_in(other.path()), std::vector<std::string>{});
}

TEST(Backup, StoppedOrWithoutRoomItLeavesNothing) {
    Folder folder, other;
    auto journal = open_store(folder.store());
    fill(*journal, 200);
    auto stopped = back_up(folder.store(), other.path() / "copy.db", false,
                           [](std::uint64_t, std::uint64_t) { return false; });
    ASSERT_FALSE(stopped);
    EXPECT_NE(stopped.error().error.what.find("stopped"), std::string::npos);
    auto nowhere = back_up(folder.store(), other.path() / "no" / "copy.db", false);
    ASSERT_FALSE(nowhere);
    EXPECT_NE(nowhere.error().error.what.find("copy.db.part"), std::string::npos);
    EXPECT_EQ(names_in(other.path()), std::vector<std::string>{});
}

#ifdef GANTRY_FAILPOINTS
TEST(Backup, KilledBeforeItHasItsNameIsNone) {
    Folder folder, other;
    auto journal = open_store(folder.store());
    fill(*journal, 5);
    auto backup = other.path() / "copy.db";
    std::ofstream(backup) << "the one before";
    ASSERT_TRUE(
        dies_at("backup_in_place", [&] { static_cast<void>(back_up(folder.store(), backup, true)); }));
    EXPECT_EQ(bytes_of(backup), "the one before");
    ASSERT_TRUE(back_up(folder.store(), backup, true));
    EXPECT_EQ(described(backup), described(folder.store()));
    EXPECT_EQ(names_in(other.path()), std::vector<std::string>{"copy.db"});
}
#endif

TEST(Backup, OfAStoreThatGrowsIsTheStateOfOneCommit) {
    Folder folder, other;
    auto journal = open_store(folder.store());
    fill(*journal, 10);
    std::atomic<bool> stop{false};
    std::atomic<std::size_t> filled{0};
    std::thread writer([&] {
        for (; !stop; ++filled)
            fill(*journal, 1);
    });
    Seq before = 0;
    for (int i = 0; i < 4; ++i) {
        auto backup = other.path() / std::to_string(i);
        auto made = back_up(folder.store(), backup, false);
        ASSERT_TRUE(made) << made.error().error.text();
        auto events = read_all(backup);
        EXPECT_EQ(events.size(), made->last_seq);
        EXPECT_EQ(made->last_seq % 20, 0u) << "a commit is whole";
        EXPECT_GE(made->last_seq, before);
        before = made->last_seq;
    }
    // The second from here has begun after the last backup.
    auto until = filled + 2;
    EXPECT_TRUE(testkit::eventually([&] { return filled >= until; }));
    stop = true;
    writer.join();
    EXPECT_GT(journal->last_seq(), before);
    EXPECT_EQ(journal->check(), "");
}

}  // namespace
}  // namespace gantry::journal::tests
