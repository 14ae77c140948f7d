#include "journal/tests/rich_store.hpp"
#include "journal/upkeep.hpp"

namespace gantry::journal::tests {
namespace {

// 4 MB of events, of which the oldest nine tenths are deleted.
struct Emptied {
    Folder folder;
    Options options;
    std::unique_ptr<Journal> journal;

    Emptied() {
        options.path = folder.store();
        journal = open_store(options);
        grow(450, start_time);
        grow(50, start_time + 24h);
        auto batch = next_batch(*journal, start_time + 24h);
        batch.cursors = {{"broker", journal->last_seq()}};
        if (!journal->commit(batch)) throw std::runtime_error("commit failed");
        while (journal->retain(start_time + options.keep + 1h)->more) {
        }
    }
    void grow(int commits, Wall time) const {
        auto point = journal->read_point("dock-1", "Ant0", "dock");
        for (int i = 0; i < commits; ++i) {
            auto batch = next_batch(*journal, time);
            for (int each = 0; each < 50; ++each) {
                add_tag_event(batch, static_cast<std::uint64_t>(each), time).reason = std::string(40, 'r');
                add_read(batch, static_cast<std::uint64_t>(each), point, time);
            }
            if (!journal->commit(batch)) throw std::runtime_error("commit failed");
        }
    }
    std::uintmax_t file_size() const { return std::filesystem::file_size(folder.store()); }
};

TEST(Compact, InSlicesBesideCommitsTheFileShrinksAndHoldsTheSame) {
    Emptied store;
    auto before = store.file_size();
    auto events = described(store.folder.store());
    int slices = 0;
    for (bool more = true; more; ++slices) {
        auto done = store.journal->compact();
        ASSERT_TRUE(done) << done.error().error.text();
        more = *done;
        store.grow(1, start_time + 24h);
        ASSERT_LT(slices, 100);
    }
    EXPECT_GT(slices, 1);
    EXPECT_LT(store.file_size(), before / 4);
    auto after = described(store.folder.store());
    ASSERT_GE(after.size(), events.size());
    EXPECT_EQ(std::vector(after.begin(), after.begin() + std::ssize(events)), events);
    EXPECT_EQ(store.journal->check(), "");
    EXPECT_FALSE(*store.journal->compact()) << "there is nothing left to give back";
}

TEST(Compact, AReaderInTheMiddleOfAQueryIsNotDisturbed) {
    Emptied store;
    auto reader = Reader::open(store.folder.store());
    std::size_t seen = 0;
    ASSERT_TRUE((*reader)->query({}, [&](const event::Event&) {
        if (++seen % 500 == 0) {
            EXPECT_TRUE(store.journal->compact());
        }
        return true;
    }));
    EXPECT_EQ(seen, 50u * 100);
    while (*store.journal->compact()) {
    }
    EXPECT_EQ(store.journal->check(), "");
}

TEST(Compact, WithoutAGatewayItIsDoneInOne) {
    Emptied store;
    auto events = described(store.folder.store());
    store.journal.reset();
    auto before = store.file_size();
    auto compacted = compact_store(store.folder.store());
    ASSERT_TRUE(compacted) << compacted.error().error.text();
    EXPECT_EQ(compacted->bytes_before, before);
    EXPECT_EQ(compacted->bytes_after, store.file_size());
    EXPECT_LT(compacted->bytes_after, before / 4);
    EXPECT_EQ(described(store.folder.store()), events);
    EXPECT_EQ(open_store(store.folder.store())->check(), "");
}

TEST(Compact, AStoreOfAnOlderProgramIsWrittenAnewOnce) {
    Emptied store;
    auto events = described(store.folder.store());
    store.journal.reset();
    run_sql(store.folder.store(), "PRAGMA journal_mode=DELETE; PRAGMA auto_vacuum=NONE; VACUUM");
    auto before = store.file_size();
    auto live = open_store(store.folder.store())->compact();
    ASSERT_FALSE(live);
    EXPECT_NE(live.error().error.hint.find("stop the gateway, run `gantry store compact`"),
              std::string::npos);
    ASSERT_TRUE(compact_store(store.folder.store()));
    EXPECT_LE(store.file_size(), before + 4096 * 2);
    EXPECT_EQ(described(store.folder.store()), events);
    auto journal = open_store(store.folder.store());
    EXPECT_EQ(journal->check(), "");
    EXPECT_FALSE(*journal->compact());
}

}  // namespace
}  // namespace gantry::journal::tests
