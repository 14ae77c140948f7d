#include <cstdlib>
#include <fstream>
#include <iterator>
#include <map>
#include <random>

#include "journal/sqlite.hpp"
#include "journal/tests/fixtures.hpp"
#include "journal/upkeep.hpp"

namespace gantry::journal::tests {
namespace {

std::string read_file(const std::filesystem::path& path) {
    std::ifstream in(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
}

// A closed store of rows, reads and presence, and what is in it.
struct Original {
    std::string bytes;
    std::map<Seq, std::string> events;
    std::map<std::uint64_t, std::string> presence;

    Original() {
        Folder folder;
        {
            auto journal = open_store(folder.store());
            auto point = journal->read_point("dock-1", "Ant0", "dock");
            for (int commit = 0; commit < 20; ++commit) {
                auto batch = next_batch(*journal);
                for (int i = 0; i < 60; ++i) {
                    auto& event = add_tag_event(batch, batch.next_seq);
                    event.reason = i % 3 == 0 ? "a reason" : "";
                    event.pc = 0x3200;
                    event.xpc = 0x08000000;
                    auto number = batch.next_seq;
                    add_read(batch, number, point);
                    PresenceRow row;
                    row.id = number;
                    row.tag = tag_number(number);
                    row.reader = "dock-1";
                    batch.presence.push_back(row);
                }
                if (!journal->commit(batch)) throw std::runtime_error("commit failed");
            }
            if (!journal->load_presence(
                    [&](const PresenceRow& row) { presence[row.id] = to_hex(row.tag.view()); }))
                throw std::runtime_error("no presence");
        }
        for (auto& event : read_all(folder.store()))
            events[event.seq] = describe(event);
        bytes = read_file(folder.store());
    }
};

// Opens what is left of it. Errors are fine, and so is a part; anything that was never stored is not.
enum class Found { all, part, error };
Found look(const Original& original, const std::string& bytes) {
    Folder folder;
    std::ofstream(folder.store(), std::ios::binary) << bytes;
    Options options;
    options.path = folder.store();
    auto journal = Journal::open(options);
    if (!journal) {
        EXPECT_FALSE(journal.error().error.what.empty());
        return Found::error;
    }
    auto reader = Reader::open(folder.store());
    if (!reader) return Found::error;
    Seq last = 0;
    std::size_t count = 0;
    auto read = (*reader)->query({}, [&](const event::Event& event) {
        EXPECT_GT(event.seq, last);
        last = event.seq;
        ++count;
        auto it = original.events.find(event.seq);
        EXPECT_TRUE(it != original.events.end() && it->second == describe(event))
            << "made up: " << describe(event);
        return true;
    });
    auto restored = (*journal)->load_presence([&](const PresenceRow& row) {
        auto it = original.presence.find(row.id);
        EXPECT_TRUE(it != original.presence.end() && it->second == to_hex(row.tag.view()))
            << "made up: " << row.id;
    });
    // It may refuse to go on, but must not fall over.
    auto batch = next_batch(**journal);
    add_tag_event(batch, 1);
    auto written = (*journal)->commit(batch);
    if (!read || !restored || !written) return Found::error;
    return count == original.events.size() ? Found::all : Found::part;
}

TEST(Damage, FlippedBytesAreNoticedOrHarmless) {
    Original original;
    std::mt19937 dice(11);
    std::map<Found, int> found;
    for (int i = 0; i < 200; ++i) {
        auto bytes = original.bytes;
        for (auto flips = dice() % 3 + 1; flips > 0; --flips) {
            auto at = i < 20 ? dice() % 200 : dice() % bytes.size();  // some into the header
            bytes[at] = static_cast<char>(bytes[at] ^ static_cast<char>(1 + dice() % 255));
        }
        SCOPED_TRACE(i);
        ++found[look(original, bytes)];
    }
    EXPECT_GT(found[Found::error], 50) << "most of a store is data: damage must be noticed";
}

TEST(Damage, ATruncatedStoreIsNoticed) {
    Original original;
    auto step = std::max<std::size_t>(512, original.bytes.size() / 100 / 512 * 512);
    int cases = 0;
    for (std::size_t size = 512; size < original.bytes.size(); size += step, ++cases) {
        SCOPED_TRACE(size);
        EXPECT_EQ(look(original, original.bytes.substr(0, size)), Found::error);
    }
    EXPECT_GT(cases, 60);
}

// How many files each of the following tests damages; proof R6 takes thousands.
int files_to_damage(int usual) {
    const char* asked = std::getenv("GANTRY_DAMAGED_FILES");
    return asked != nullptr ? std::atoi(asked) : usual;
}

// The gateway can go on: with what is left, or with a new store and the damaged one kept as it is. Only where
// the damage makes it look like another program's or a newer one's it is not touched.
Found go_on(const Original& original, const std::string& bytes, const std::string& log = {}) {
    Folder folder;
    std::ofstream(folder.store(), std::ios::binary) << bytes;
    if (!log.empty()) std::ofstream(folder.store().string() + "-wal", std::ios::binary) << log;
    Options options;
    options.path = folder.store();
    auto opened = open_or_set_aside(options, start_time);
    if (!opened) {
        bool looks_foreign =
            bytes.substr(68, 4) != "GNTR" || opened.error().kind == StoreError::Kind::foreign ||
            opened.error().error.what.find("this program knows versions up to") != std::string::npos;
        EXPECT_TRUE(looks_foreign) << opened.error().error.text();
        EXPECT_EQ(read_file(folder.store()).size(), bytes.size());
        return Found::error;
    }
    auto found = Found::error;
    if (opened->aside.empty()) {
        found = Found::part;
        Filter filter;
        filter.on_damage = [](const std::string& what) { EXPECT_FALSE(what.empty()); };
        std::size_t count = 0;
        auto reader = Reader::open(folder.store());
        auto read = !reader ? StoreResult<void>(tl::unexpected(reader.error()))
                            : (*reader)->query(filter, [&](const event::Event& event) {
                                  ++count;
                                  auto it = original.events.find(event.seq);
                                  EXPECT_TRUE(it != original.events.end() && it->second == describe(event))
                                      << "made up: " << describe(event);
                                  return true;
                              });
        EXPECT_TRUE(read || read.error().kind == StoreError::Kind::corrupt);
        if (count == original.events.size()) found = Found::all;
    } else {
        EXPECT_NE(opened->damage, "");
        EXPECT_EQ(read_file(opened->aside / "gantry.db").size(), bytes.size()) << "what was there is kept";
        EXPECT_TRUE(read_all(folder.store()).empty());
        EXPECT_NE(opened->journal->id_prefix().find(':'), opened->journal->id_prefix().size() - 1)
            << "no id of before comes again: " << opened->journal->id_prefix();
    }
    auto batch = next_batch(*opened->journal);
    auto number = batch.next_seq;
    add_tag_event(batch, 1);
    auto stored = opened->journal->commit(batch);
    EXPECT_TRUE(stored) << stored.error().error.text();
    Filter newest;
    newest.after = number - 1;
    if (opened->aside.empty()) return found;
    EXPECT_EQ(read_all(folder.store(), newest).size(), 1u);
    return found;
}

TEST(Damage, WithAnyFlippedByteTheGatewayGoesOn) {
    Original original;
    std::mt19937 dice(12);
    std::map<Found, int> found;
    auto files = files_to_damage(200);
    for (int i = 0; i < files && !::testing::Test::HasFailure(); ++i) {
        auto bytes = original.bytes;
        for (auto flips = dice() % 8 + 1; flips > 0; --flips) {
            auto at = i % 10 == 0 ? dice() % 200 : dice() % bytes.size();  // some into the header
            bytes[at] = static_cast<char>(bytes[at] ^ static_cast<char>(1 + dice() % 255));
        }
        SCOPED_TRACE(i);
        ++found[go_on(original, bytes)];
    }
    EXPECT_GT(found[Found::error], 0) << "some must be set aside";
    EXPECT_GT(found[Found::part] + found[Found::all], 0) << "and most can be used";
}

TEST(Damage, CutOffAnywhereTheStoreIsSetAside) {
    Original original;
    auto files = static_cast<std::size_t>(files_to_damage(60));
    auto step = std::max<std::size_t>(512, original.bytes.size() / files / 512 * 512);
    for (std::size_t size = 512; size < original.bytes.size() && !::testing::Test::HasFailure();
         size += step) {
        SCOPED_TRACE(size);
        EXPECT_EQ(go_on(original, original.bytes.substr(0, size)), Found::error);
    }
}

TEST(Damage, OfALogWithFlippedBytesTheBeginningIsThere) {
    Folder folder;
    auto journal = open_store(folder.store());
    auto file = read_file(folder.store());
    for (int commit = 0; commit < 20; ++commit) {
        auto batch = next_batch(*journal);
        add_tag_event(batch, 1);
        ASSERT_TRUE(journal->commit(batch));
    }
    auto log = read_file(folder.store().string() + "-wal");
    Original original;
    original.bytes.clear();
    original.events.clear();
    for (auto& event : read_all(folder.store()))
        original.events[event.seq] = describe(event);
    std::mt19937 dice(13);
    auto files = files_to_damage(100);
    for (int i = 0; i < files && !::testing::Test::HasFailure(); ++i) {
        auto bytes = log;
        for (auto flips = dice() % 4 + 1; flips > 0; --flips) {
            auto at = dice() % bytes.size();
            bytes[at] = static_cast<char>(bytes[at] ^ static_cast<char>(1 + dice() % 255));
        }
        SCOPED_TRACE(i);
        EXPECT_NE(go_on(original, file, bytes), Found::error);
    }
}

TEST(Damage, WhatIsSetAsideIsFollowedByANewEpochOfTheSameGateway) {
    Folder folder;
    {
        auto journal = open_store(folder.store());
        ASSERT_TRUE(journal->set_gateway_id("site-7"));
        auto batch = next_batch(*journal);
        for (int i = 0; i < 5; ++i)
            add_tag_event(batch, 1);
        PresenceRow row;
        row.id = 1;
        batch.presence.push_back(row);
        ASSERT_TRUE(journal->commit(batch));
    }
    Options options;
    options.path = folder.store();
    for (std::uint64_t round = 1; round <= 4; ++round) {
        {
            auto db = Database::open(folder.store(), Database::Access::write);
            ASSERT_TRUE(
                db &&
                db->run(
                    "INSERT OR REPLACE INTO presence(id, state, tag, technology, zone_key, antenna_number, "
                    "reads, first_seen_us, last_seen_us, first_is_new, sum) VALUES(9, 1, x'', 0, '', 0, 0, "
                    "0, 0, 0, 7)"));
        }
        auto opened = open_or_set_aside(options, start_time);
        if (round == 4) {
            ASSERT_FALSE(opened) << "a machine that damages every store must not fill its disk with them";
            EXPECT_NE(opened.error().error.hint.find("3 stores are set aside in"), std::string::npos);
            break;
        }
        ASSERT_TRUE(opened) << opened.error().error.text();
        EXPECT_EQ(opened->aside, folder.path() / ("set-aside-" + std::to_string(round)));
        EXPECT_NE(opened->damage.find("presence row 9"), std::string::npos);
        EXPECT_EQ(opened->journal->id_prefix(), "site-7:" + std::to_string(round) + ":");
        EXPECT_EQ(opened->journal->last_seq(), 4 + round);
        EXPECT_EQ(opened->journal->check(), "");
        auto batch = next_batch(*opened->journal);
        add_tag_event(batch, 1);
        ASSERT_TRUE(opened->journal->commit(batch));
    }
}

TEST(Damage, AQueryMayPassOverWhatIsDamagedAndIsToldOfItOnce) {
    Folder folder;
    {
        auto journal = open_store(folder.store());
        for (int commit = 0; commit < 3; ++commit) {
            auto batch = next_batch(*journal);
            auto point = journal->read_point("dock-1", "Ant0", "dock");
            for (int i = 0; i < 10; ++i) {
                add_tag_event(batch, static_cast<std::uint64_t>(commit * 100 + i));
                add_read(batch, static_cast<std::uint64_t>(commit * 100 + 50 + i), point);
            }
            ASSERT_TRUE(journal->commit(batch));
        }
    }
    {
        auto db = Database::open(folder.store(), Database::Access::write);
        ASSERT_TRUE(db &&
                    db->run("UPDATE event_rows SET rssi = 1 WHERE seq = 7; "
                            "UPDATE read_batches SET sum = 1 WHERE first_seq = 22; "
                            "UPDATE tags SET epc = 'x' WHERE tag = (SELECT tag FROM tags WHERE id = 41)"));
    }
    for (auto newest_first : {false, true}) {
        std::vector<std::string> told;
        Filter filter;
        filter.newest_first = newest_first;
        filter.on_damage = [&](const std::string& what) { told.push_back(what.substr(what.find(": ") + 2)); };
        auto events = read_all(folder.store(), filter);
        EXPECT_EQ(events.size(), 60u - 1 - 10 - 1);
        std::ranges::sort(told);
        EXPECT_EQ(told, (std::vector<std::string>{"event 7 is not as it was stored",
                                                  "tag row 41 is not as it was stored",
                                                  "the reads 22 to 40 are not as they were stored"}));
    }
}

TEST(Damage, ATornLogLosesOnlyItsEnd) {
    Folder folder;
    auto journal = open_store(folder.store());
    for (int commit = 0; commit < 20; ++commit) {
        auto batch = next_batch(*journal);
        add_tag_event(batch, 1);
        ASSERT_TRUE(journal->commit(batch));
    }
    auto file = read_file(folder.store()), log = read_file(folder.store().string() + "-wal");
    ASSERT_GT(log.size(), 20u * 4096);
    Seq before = 0;
    for (std::size_t size = 0; size <= log.size(); size += 1000) {
        Folder copy;
        std::ofstream(copy.store(), std::ios::binary) << file;
        std::ofstream(copy.store().string() + "-wal", std::ios::binary) << log.substr(0, size);
        auto opened = open_store(copy.store());
        EXPECT_GE(opened->last_seq(), before);
        before = opened->last_seq();
        EXPECT_EQ(read_all(copy.store()).size(), before);
    }
    EXPECT_GE(before, 19u);
}

TEST(Damage, ALogWithoutItsStoreIsNotDeletedByANewStore) {
    Folder folder, crashed;
    auto log = crashed.store().string() + "-wal";
    {
        auto journal = open_store(folder.store());
        auto batch = next_batch(*journal);
        add_tag_event(batch, 1);
        ASSERT_TRUE(journal->commit(batch));
        std::filesystem::copy_file(folder.store(), crashed.store());
        std::filesystem::copy_file(folder.store().string() + "-wal", log);
    }
    auto size = std::filesystem::file_size(log);
    ASSERT_GT(size, 0u);
    std::filesystem::rename(crashed.store(), crashed.path() / "kept.db");
    for (int tries = 0; tries < 2; ++tries) {
        auto opened = Journal::open({.path = crashed.store()});
        ASSERT_FALSE(opened);
        EXPECT_NE(opened.error().error.hint.find("put gantry.db back beside gantry.db-wal"),
                  std::string::npos)
            << opened.error().error.hint;
        EXPECT_FALSE(std::filesystem::exists(crashed.store()));
        ASSERT_EQ(std::filesystem::file_size(log), size);
    }
    std::filesystem::rename(crashed.path() / "kept.db", crashed.store());
    EXPECT_EQ(open_store(crashed.store())->last_seq(), 1u);
}

TEST(Damage, TheHintNamesAllFilesOfTheStore) {
    Folder folder;
    std::ofstream(folder.store(), std::ios::binary) << std::string(8192, 'x');
    auto opened = Journal::open({.path = folder.store()});
    ASSERT_FALSE(opened);
    EXPECT_NE(opened.error().error.hint.find("move gantry.db, gantry.db-wal and gantry.db-shm together"),
              std::string::npos)
        << opened.error().error.text();
}

// Not knowing what was stored last is not the same as having stored nothing.
TEST(Damage, ADamagedMarkIsAnErrorAndNoMarkIsNone) {
    Folder folder;
    {
        auto journal = open_store(folder.store());
        auto batch = next_batch(*journal);
        batch.marks = {{"dock-1", {1, 2}}, {"dock-2", {3}}, {"dock-3", {4}}};
        ASSERT_TRUE(journal->commit(batch));
        EXPECT_EQ(journal->mark("new-1"), Bytes{});
    }
    {
        auto db = Database::open(folder.store(), Database::Access::write);
        ASSERT_TRUE(db && db->run("UPDATE marks SET mark = x'0103' WHERE reader = 'dock-1'"));
    }
    {
        auto journal = open_store(folder.store());
        auto mark = journal->mark("dock-1");
        ASSERT_FALSE(mark);
        EXPECT_EQ(mark.error().kind, StoreError::Kind::corrupt);
        EXPECT_NE(mark.error().error.what.find("what came last from dock-1 is not known"), std::string::npos)
            << mark.error().error.what;
        EXPECT_EQ(journal->mark("dock-2"), Bytes{3});
        EXPECT_FALSE(journal->mark("new-1")) << "the damaged row may have been its own";
        auto batch = next_batch(*journal);
        batch.marks = {{"dock-1", {5}}, {"new-1", {6}}};
        ASSERT_TRUE(journal->commit(batch));
        EXPECT_EQ(journal->mark("dock-1"), Bytes{5});
    }
    auto journal = open_store(folder.store());
    EXPECT_EQ(journal->mark("dock-1"), Bytes{5}) << "the next mark mends it";
    EXPECT_EQ(journal->mark("dock-2"), Bytes{3});
    EXPECT_EQ(journal->mark("dock-3"), Bytes{4});
    EXPECT_EQ(journal->mark("new-1"), Bytes{6});
    EXPECT_EQ(journal->mark("new-2"), Bytes{});
}

TEST(Damage, AMarkWhoseReaderIsDamagedTakesNoOtherReadersPlace) {
    Folder folder;
    {
        auto journal = open_store(folder.store());
        auto batch = next_batch(*journal);
        batch.marks = {{"dock-1", {1}}, {"dock-2", {2}}, {"dock-3", {3}}};
        ASSERT_TRUE(journal->commit(batch));
    }
    {
        auto db = Database::open(folder.store(), Database::Access::write);
        ASSERT_TRUE(db && db->run("UPDATE marks SET reader = 'dock-1' WHERE reader = 'dock-2'"));
    }
    auto journal = open_store(folder.store());
    EXPECT_FALSE(journal->mark("dock-2"));
    auto batch = next_batch(*journal);
    batch.marks = {{"dock-2", {7}}};
    ASSERT_TRUE(journal->commit(batch));
    EXPECT_EQ(journal->mark("dock-1"), Bytes{1});
    EXPECT_EQ(journal->mark("dock-2"), Bytes{7});
    EXPECT_EQ(journal->mark("dock-3"), Bytes{3});
}

}  // namespace
}  // namespace gantry::journal::tests
