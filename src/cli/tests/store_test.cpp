#include <filesystem>
#include <fstream>
#include <iterator>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "cli/tests/ran.hpp"
#include "gateway/data_lock.hpp"
#include "journal/journal.hpp"
#include "testkit/temp_dir.hpp"

namespace gantry::cli {
namespace {

// A stopped gateway's data directory.
class StoreCommands : public ::testing::Test {
protected:
    void SetUp() override { grow(100); }
    void grow(int events) const {
        auto journal = journal::Journal::open({.path = db()});
        ASSERT_TRUE(journal) << journal.error().error.text();
        ASSERT_TRUE((*journal)->set_gateway_id("site-7"));
        journal::Batch batch;
        batch.time = *parse_rfc3339("2026-11-21T23:04:00Z");
        batch.next_seq = (*journal)->last_seq() + 1;
        for (int i = 0; i < events; ++i) {
            auto& event = batch.events.emplace_back();
            event.seq = batch.take_seq();
            event.type = event::Type::reader_connected;
            event.time = batch.time;
            event.reader = "dock-1";
        }
        ASSERT_TRUE((*journal)->commit(batch));
    }
    std::string db() const { return dir_.path() + "/gantry.db"; }
    std::string backup() const { return other_.path() + "/backup.db"; }
    Ran store(std::vector<std::string> arguments) const {
        arguments.insert(arguments.begin(), "store");
        arguments.insert(arguments.end(), {"--data-dir", dir_.path()});
        return gantry(std::move(arguments));
    }
    void damage() const {
        std::fstream file(db(), std::ios::in | std::ios::out | std::ios::binary);
        std::string bytes{std::istreambuf_iterator<char>(file), {}};
        auto at = bytes.find("dock-1");
        ASSERT_NE(at, std::string::npos);
        file.seekp(static_cast<std::streamoff>(at + 5));
        file << '2';
    }
    testkit::TempDir dir_, other_;
};

TEST_F(StoreCommands, CheckSaysWhatIsThere) {
    auto ran = store({"check"});
    EXPECT_EQ(ran.code, done) << ran.err;
    EXPECT_TRUE(ran.out.starts_with(db() + ": 100 events, numbers up to 100; ")) << ran.out;
    auto json = store({"check", "--json"});
    EXPECT_NE(json.out.find("\"sound\":true"), std::string::npos) << json.out;
    EXPECT_NE(json.out.find("\"last_seq\":100,\"deleted\":0,\"id_prefix\":\"site-7:\",\"problem_count\":0"),
              std::string::npos)
        << json.out;
}

TEST_F(StoreCommands, CheckOfADamagedStoreFailsAndSaysWhatToDo) {
    damage();
    auto ran = store({"check"});
    EXPECT_EQ(ran.code, failed);
    EXPECT_NE(ran.out.find("\n  read point 1 is not as it was stored\n"), std::string::npos) << ran.out;
    EXPECT_NE(ran.err.find(
                  "is damaged in 1 place; stop the gateway and put a backup in its place with `gantry store "
                  "restore FILE`"),
              std::string::npos)
        << ran.err;
    auto json = store({"check", "--json"});
    EXPECT_EQ(json.code, failed);
    EXPECT_NE(json.out.find("\"sound\":false"), std::string::npos);
    EXPECT_NE(json.out.find("\"problems\":[\"read point 1 is not as it was stored\"]"), std::string::npos);
    std::ofstream(db()) << std::string(20'000, 'x');
    auto garbage = store({"check"});
    EXPECT_EQ(garbage.code, failed);
    EXPECT_NE(garbage.err.find("put a backup in its place"), std::string::npos) << garbage.err;
}

TEST_F(StoreCommands, BackupAndRestore) {
    auto made = store({"backup", backup()});
    EXPECT_EQ(made.code, done) << made.err;
    EXPECT_TRUE(made.out.starts_with(backup() + ": 100 events")) << made.out;
    auto again = store({"backup", backup()});
    EXPECT_EQ(again.code, failed);
    EXPECT_NE(again.err.find("is there already; give another name, or --force to replace it"),
              std::string::npos);
    grow(20);
    auto restored = store({"restore", backup()});
    EXPECT_EQ(restored.code, done) << restored.err;
    EXPECT_NE(restored.out.find("the next event is site-7:1:121\n"), std::string::npos) << restored.out;
    EXPECT_NE(restored.out.find("the store before is in " + dir_.path() + "/set-aside-1;"),
              std::string::npos);
    EXPECT_EQ(store({"backup", "--force", backup(), "--json"}).code, done);
    auto json = store({"restore", backup(), "--json"});
    EXPECT_NE(json.out.find("\"epoch\":2,\"next_id\":\"site-7:2:121\",\"numbers_go_on\":true,\"set_aside\":"),
              std::string::npos)
        << json.out;
    grow(1);
    auto last = gantry({"events", "export", "--after", "99", "--db", db()});
    EXPECT_NE(last.out.find("\"id\":\"site-7:100\""), std::string::npos);
    EXPECT_NE(last.out.find("\"id\":\"site-7:2:121\""), std::string::npos) << last.out;
}

TEST_F(StoreCommands, WhatNeedsTheStoreForItselfWaitsForNobody) {
    ASSERT_EQ(store({"backup", backup()}).code, done);
    for (auto& who : {"gantry run", "gantry store compact"}) {
        auto lock = gateway::DataLock::take(dir_.path(), who);
        ASSERT_TRUE(lock);
        for (auto& arguments : std::vector<std::vector<std::string>>{
                 {"restore", backup()}, {"downgrade", "--to", "1"}, {"compact"}}) {
            auto ran = store(arguments);
            EXPECT_EQ(ran.code, failed);
            auto held = std::string_view(who) == "gantry run"
                            ? "another gateway is running in " + dir_.path()
                            : "`gantry store compact` is at work in " + dir_.path();
            EXPECT_NE(ran.err.find(held), std::string::npos) << ran.err;
        }
        EXPECT_EQ(store({"check"}).code, done);
        EXPECT_EQ(store({"backup", "--force", backup()}).code, done);
    }
}

TEST_F(StoreCommands, CompactTellsBothSizes) {
    auto ran = store({"compact", "--json"});
    EXPECT_EQ(ran.code, done) << ran.err;
    auto size = std::filesystem::file_size(db());
    EXPECT_EQ(ran.out, fmt::format("{{\"bytes_before\":{0},\"bytes_after\":{0}}}\n", size));
    EXPECT_EQ(store({"compact"}).out, fmt::format("{0} bytes before, {0} bytes after\n", size));
}

TEST_F(StoreCommands, DowngradeAsksBeforeItLosesAnything) {
    ASSERT_EQ(store({"backup", backup()}).code, done);
    ASSERT_EQ(store({"restore", backup()}).code, done);
    auto refused = store({"downgrade", "--to", "1"});
    EXPECT_EQ(refused.code, failed);
    EXPECT_NE(refused.err.find("version 1 has no place for: 100 ids of events from before a restore"),
              std::string::npos)
        << refused.err;
    EXPECT_NE(refused.err.find("nothing was changed; make a backup, then say --yes"), std::string::npos);
    auto gone = store({"downgrade", "--to", "1", "--yes"});
    EXPECT_EQ(gone.code, done) << gone.err;
    EXPECT_NE(gone.out.find("has version 1 now; lost: 100 ids"), std::string::npos) << gone.out;
    EXPECT_EQ(store({"check"}).code, failed);
    grow(1);
    EXPECT_EQ(store({"check"}).code, done);
}

TEST_F(StoreCommands, WhatIsNotThereIsSaid) {
    auto nothing = store({"restore", other_.path() + "/no.db"});
    EXPECT_EQ(nothing.code, failed);
    EXPECT_NE(nothing.err.find("there is no file"), std::string::npos) << nothing.err;
    std::filesystem::remove(db());
    for (auto& arguments : std::vector<std::vector<std::string>>{
             {"check"}, {"compact"}, {"downgrade", "--to", "1"}, {"backup", backup()}}) {
        auto ran = store(arguments);
        EXPECT_EQ(ran.code, failed);
        EXPECT_NE(ran.err.find("there is no store " + db()), std::string::npos) << ran.err;
    }
}

}  // namespace
}  // namespace gantry::cli
