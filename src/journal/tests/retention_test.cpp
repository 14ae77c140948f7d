#include "journal/sqlite.hpp"
#include "journal/tests/fixtures.hpp"

namespace gantry::journal::tests {
namespace {

Options options_of(const Folder& folder) {
    Options options;
    options.path = folder.store();
    options.keep = std::chrono::days{30};
    return options;
}

// One commit of some rows and reads, all of the same time.
void store(Journal& journal, Wall time, int rows, int reads, std::uint64_t first_tag = 0) {
    auto batch = next_batch(journal, time);
    auto point = journal.read_point("dock-1", "Ant0", "dock");
    for (int i = 0; i < rows; ++i)
        add_tag_event(batch, first_tag++, time).reason = "kept";
    for (int i = 0; i < reads; ++i)
        add_read(batch, first_tag++, point, time);
    auto done = journal.commit(batch);
    ASSERT_TRUE(done) << done.error().error.text();
}

Retained retain_all(Journal& journal, Wall now) {
    Retained sum;
    for (int slices = 0; slices < 10'000; ++slices) {
        auto slice = journal.retain(now);
        EXPECT_TRUE(slice) << slice.error().error.text();
        if (!slice) break;
        if (slice->dropped != 0 && sum.dropped == 0) sum.dropped_since = slice->dropped_since;
        sum.deleted += slice->deleted;
        sum.dropped += slice->dropped;
        if (!slice->more) return sum;
    }
    ADD_FAILURE() << "retention does not come to an end";
    return sum;
}

std::int64_t count(const Folder& folder, const std::string& table) {
    auto db = Database::open(folder.store(), Database::Access::read);
    return *db->number("SELECT count(*) FROM " + table);
}

TEST(Retention, WhatIsTooOldGoesAndNothingElse) {
    Folder folder;
    auto journal = open_store(options_of(folder));
    store(*journal, start_time, 6000, 5000, 0);
    store(*journal, start_time + 24h, 10, 10, 20'000);
    EXPECT_EQ(retain_all(*journal, start_time + std::chrono::days{30}).deleted, 0u);
    auto done = retain_all(*journal, start_time + std::chrono::days{30} + 1us);
    EXPECT_EQ(done.deleted, 11'000u);
    EXPECT_EQ(done.dropped, 0u);
    auto left = read_all(folder.store());
    ASSERT_EQ(left.size(), 20u);
    EXPECT_EQ(left.front().seq, 11'001u);
    EXPECT_EQ(count(folder, "event_details"), 10);
    EXPECT_EQ(journal->check(), "");
}

TEST(Retention, TagsThatNobodyRefersToAnyMoreGoToo) {
    Folder folder;
    auto journal = open_store(options_of(folder));
    for (int day = 0; day < 40; ++day)
        store(*journal, start_time + std::chrono::days{day}, 100, 100, static_cast<std::uint64_t>(day) * 200);
    retain_all(*journal, start_time + std::chrono::days{65} + 1us);
    EXPECT_EQ(read_all(folder.store()).size(), 4u * 200);
    EXPECT_LT(count(folder, "tags"), 2000);
    EXPECT_LT(count(folder, "generations"), 4);
    EXPECT_EQ(journal->check(), "");
    // A tag that is seen all the time does not hold its first row.
    retain_all(*journal, start_time + std::chrono::days{80});
    EXPECT_TRUE(read_all(folder.store()).empty());
    store(*journal, start_time + std::chrono::days{80}, 1, 1);
    EXPECT_EQ(journal->last_seq(), 8002u) << "numbers go on though all events are gone";
    journal.reset();
    EXPECT_EQ(open_store(options_of(folder))->last_seq(), 8002u);
}

TEST(Retention, NothingGoesPastTheSlowestCursor) {
    Folder folder;
    auto options = options_of(folder);
    options.sinks = {"mqtt", "kafka"};
    auto journal = open_store(options);
    store(*journal, start_time, 100, 100);
    auto much_later = start_time + std::chrono::days{365};
    EXPECT_EQ(retain_all(*journal, much_later).deleted, 0u)
        << "a sink that has no cursor yet has been given nothing";
    auto batch = next_batch(*journal);
    batch.cursors = {{"mqtt", 200}, {"kafka", 50}, {"removed", 7}};
    ASSERT_TRUE(journal->commit(batch));
    EXPECT_EQ(retain_all(*journal, much_later).deleted, 50u);
    EXPECT_EQ(read_all(folder.store()).front().seq, 51u);
    batch.cursors = {{"kafka", 150}};
    ASSERT_TRUE(journal->commit(batch));
    EXPECT_EQ(retain_all(*journal, much_later).deleted, 50u) << "a blob of reads goes whole or not at all";
    batch.cursors = {{"kafka", 200}};
    ASSERT_TRUE(journal->commit(batch));
    EXPECT_EQ(retain_all(*journal, much_later).deleted, 100u);
}

TEST(Retention, EventsOfAClockThatWasAheadDoNotBlockTheOthers) {
    Folder folder;
    auto journal = open_store(options_of(folder));
    store(*journal, start_time + std::chrono::days{3650}, 10'000, 10'000);
    store(*journal, start_time, 10, 10);
    store(*journal, start_time + std::chrono::days{20}, 10, 10);
    EXPECT_EQ(retain_all(*journal, start_time + std::chrono::days{31}).deleted, 20'020u);
    EXPECT_EQ(read_all(folder.store()).size(), 20u);
}

TEST(Retention, DeliveredEventsMakeRoomWhenSpaceIsShort) {
    Folder folder;
    auto options = options_of(folder);
    options.sinks = {"mqtt"};
    options.max_size = 4 << 20;
    auto journal = open_store(options);
    while (journal->size().bytes * 100 < options.max_size * 91)
        store(*journal, start_time, 100, 400);
    EXPECT_EQ(retain_all(*journal, start_time).deleted, 0u);
    auto batch = next_batch(*journal);
    batch.cursors = {{"mqtt", journal->last_seq() - 1000}};
    ASSERT_TRUE(journal->commit(batch));
    auto done = retain_all(*journal, start_time);
    EXPECT_GT(done.deleted, 0u);
    EXPECT_EQ(done.dropped, 0u);
    EXPECT_LE(journal->size().bytes * 100, options.max_size * 85);
    EXPECT_GE(read_all(folder.store()).size(), 1000u);
    EXPECT_EQ(read_all(folder.store()).size(), journal->last_seq() - done.deleted);
}

TEST(Retention, DroppingTheOldestIsCountedExactly) {
    Folder folder;
    auto options = options_of(folder);
    options.sinks = {"mqtt"};
    options.on_full = OnFull::drop_oldest;
    options.max_size = 2 << 20;
    auto journal = open_store(options);
    auto cursor = next_batch(*journal);
    cursor.cursors = {{"mqtt", 150}};  // in the middle of a blob
    ASSERT_TRUE(journal->commit(cursor));
    Retained sum;
    auto point = journal->read_point("dock-1", "Ant0", "dock");
    auto batch = next_batch(*journal);
    for (int commit = 0; commit < 400; ++commit) {
        auto time = start_time + std::chrono::seconds(commit);
        batch.time = time;
        for (int i = 0; i < 400; ++i) {
            if (i % 4 == 0) add_tag_event(batch, static_cast<std::uint64_t>(i), time);
            add_read(batch, static_cast<std::uint64_t>(i), point, time);
        }
        for (int tries = 0;; ++tries) {
            auto done = journal->commit(batch);
            if (done) break;
            ASSERT_EQ(done.error().kind, StoreError::Kind::full);
            ASSERT_LT(tries, 100);
            auto made = retain_all(*journal, time);
            if (made.dropped != 0 && sum.dropped == 0) sum.dropped_since = made.dropped_since;
            sum.deleted += made.deleted;
            sum.dropped += made.dropped;
        }
    }
    auto left = read_all(folder.store());
    EXPECT_GT(sum.dropped, 1000u);
    EXPECT_EQ(sum.deleted, 150u);
    EXPECT_EQ(left.size() + sum.deleted + sum.dropped, journal->last_seq())
        << "stored = kept + deleted + dropped";
    EXPECT_EQ(sum.dropped_since, start_time);
    EXPECT_LE(std::filesystem::file_size(folder.store()), options.max_size);
    EXPECT_EQ(left.back().seq, journal->last_seq());
    EXPECT_EQ(journal->check(), "");
}

Options small_options(const Folder& folder) {
    auto options = options_of(folder);
    options.on_full = OnFull::drop_oldest;
    options.max_size = 1 << 20;
    return options;
}

// As the gateway does it: what is untold goes into the batch as one event, kept up to date while the commit
// finds no room.
void tell(const Journal& journal, Batch& batch, std::optional<std::size_t>& at) {
    auto untold = journal.untold();
    if (untold.count == 0) return;
    if (!at) {
        at = batch.events.size();
        add_event(batch, event::Type::overflow, batch.time).scope = store_scope;
    }
    batch.events[*at].count = untold.count;
    batch.events[*at].since = untold.since;
}

// A commit of reads that tells what was dropped, with as much retention as it needs.
void store_and_tell(Journal& journal, Wall time, int rows, int reads) {
    auto batch = next_batch(journal, time);
    auto point = journal.read_point("dock-1", "Ant0", "dock");
    for (int i = 0; i < rows; ++i)
        add_tag_event(batch, static_cast<std::uint64_t>(i), time);
    for (int i = 0; i < reads; ++i)
        add_read(batch, static_cast<std::uint64_t>(i), point, time);
    std::optional<std::size_t> overflow;
    for (int tries = 0; tries < 100; ++tries) {
        tell(journal, batch, overflow);
        auto done = journal.commit(batch);
        if (done) return;
        ASSERT_EQ(done.error().kind, StoreError::Kind::full) << done.error().error.text();
        ASSERT_TRUE(journal.retain(time));
    }
    FAIL() << "no room is made";
}

struct Books {
    std::uint64_t stored = 0, told = 0;
    std::size_t telling = 0;
    std::optional<Wall> since;
};
Books books_of(const Folder& folder) {
    Books books;
    for (auto& event : read_all(folder.store())) {
        ++books.stored;
        if (event.type != event::Type::overflow || event.scope != store_scope) continue;
        ++books.telling;
        books.told += event.count.value_or(0);
        if (!books.since || *event.since < *books.since) books.since = event.since;
    }
    return books;
}
void expect_balance(const Folder& folder, const Journal& journal) {
    auto books = books_of(folder);
    EXPECT_EQ(books.stored + books.told + journal.untold().count, journal.last_seq())
        << books.stored << " stored, " << books.told << " told, " << journal.untold().count << " untold";
}

TEST(Retention, WhatIsStoredToldAndUntoldIsAllThereWasThoughEventsThatTellAreDroppedInTheirTurn) {
    Folder folder;
    auto journal = open_store(small_options(folder));
    std::size_t most_telling = 0;
    for (int commit = 0; commit < 600; ++commit) {
        auto time = start_time + std::chrono::seconds(commit);
        store_and_tell(*journal, time, 20, 200);
        // Retention between the commits, too: so an event that tells is the oldest again and again.
        if (commit % 3 == 0) {
            ASSERT_TRUE(journal->retain(time));
        }
        if (commit % 20 != 0) continue;
        expect_balance(folder, *journal);
        most_telling = std::max(most_telling, books_of(folder).telling);
    }
    EXPECT_GT(most_telling, 1u);
    store_and_tell(*journal, start_time + 1h, 1, 0);
    EXPECT_EQ(journal->untold().count, 0u);
    expect_balance(folder, *journal);
    auto books = books_of(folder);
    EXPECT_GT(books.told, 100'000u);
    EXPECT_EQ(books.since, start_time) << "what was told first is carried over with its time";
    EXPECT_EQ(journal->check(), "");
}

// Drops until something is untold, and returns how much.
Untold drop_some(Journal& journal) {
    while (journal.untold().count == 0) {
        store(journal, start_time, 20, 400);
        auto done = journal.retain(start_time + 1s);
        EXPECT_TRUE(done) << done.error().error.text();
        if (!done || ::testing::Test::HasFatalFailure()) break;
    }
    return journal.untold();
}

TEST(Retention, WhatWasDroppedIsStillToBeToldAfterACrash) {
    Folder folder;
    auto journal = open_store(small_options(folder));
    auto untold = drop_some(*journal);
    ASSERT_GT(untold.count, 0u);
    EXPECT_EQ(untold.since, start_time);
    journal.reset();  // nothing was told
    journal = open_store(small_options(folder));
    EXPECT_EQ(journal->untold().count, untold.count);
    EXPECT_EQ(journal->untold().since, start_time);
    expect_balance(folder, *journal);
    store_and_tell(*journal, start_time + 2s, 0, 1);
    EXPECT_EQ(journal->untold().count, 0u);
    EXPECT_EQ(books_of(folder).told, untold.count);
    journal.reset();
    journal = open_store(small_options(folder));
    EXPECT_EQ(journal->untold().count, 0u) << "told once";
    expect_balance(folder, *journal);
}

TEST(Retention, ACommitThatFailsTellsNothing) {
    Folder folder;
    auto journal = open_store(small_options(folder));
    auto untold = drop_some(*journal);
    auto batch = next_batch(*journal, start_time);
    std::optional<std::size_t> overflow;
    tell(*journal, batch, overflow);
    ASSERT_TRUE(overflow);
    ++batch.next_seq;  // a number without an event
    ASSERT_FALSE(journal->commit(batch));
    EXPECT_EQ(journal->untold().count, untold.count);
    --batch.next_seq;
    ASSERT_TRUE(journal->commit(batch));
    EXPECT_EQ(journal->untold().count, 0u);
    expect_balance(folder, *journal);
}

TEST(Retention, AReadersOwnOverflowIsAnEventLikeOthers) {
    Folder folder;
    auto journal = open_store(small_options(folder));
    auto batch = next_batch(*journal);
    auto& lost_in_reader = add_event(batch, event::Type::overflow);
    lost_in_reader.scope = "reader buffer";
    lost_in_reader.count = 1'000'000;
    ASSERT_TRUE(journal->commit(batch));
    EXPECT_LT(drop_some(*journal).count, 100'000u);
    expect_balance(folder, *journal);
}

TEST(Retention, WhatIsTooOldGoesUntold) {
    Folder folder;
    auto journal = open_store(small_options(folder));
    store_and_tell(*journal, start_time, 100, 1000);
    auto done = retain_all(*journal, start_time + std::chrono::days{31});
    EXPECT_EQ(done.deleted, 1100u);
    EXPECT_EQ(done.dropped, 0u);
    EXPECT_EQ(journal->untold().count, 0u);
}

TEST(Retention, AStoreThatPresentTagsFillSaysSo) {
    Folder folder;
    auto journal = open_store(small_options(folder));
    StoreError error;
    auto batch = next_batch(*journal);
    std::optional<std::size_t> overflow;
    std::uint64_t id = 0;
    for (int tries = 0; tries < 1000; ++tries) {
        if (batch.presence.empty())
            for (int i = 0; i < 200; ++i) {
                auto& row = batch.presence.emplace_back();
                row.id = ++id;
                row.tag = tag_number(row.id);
                row.reader = "dock-1";
                add_tag_event(batch, row.id);
            }
        tell(*journal, batch, overflow);
        auto done = journal->commit(batch);
        if (done) {
            overflow.reset();
            continue;
        }
        error = done.error();
        ASSERT_EQ(error.kind, StoreError::Kind::full) << error.error.text();
        auto retained = retain_all(*journal, start_time);
        if (retained.dropped == 0 && error.error.what.find("tags present now") != std::string::npos) break;
    }
    EXPECT_NE(error.error.text().find("tags present now fill it, store.max_size is too small"),
              std::string::npos)
        << error.error.text();
    EXPECT_LE(books_of(folder).stored, 1u) << "all but the event that tells went to make room";
    expect_balance(folder, *journal);
    // It ends when the tags go.
    for (std::uint64_t gone = 1; gone < id; ++gone)
        batch.presence_deleted.push_back(gone);
    batch.presence.clear();
    auto done = journal->commit(batch);
    EXPECT_TRUE(done) << done.error().error.text();
}

}  // namespace
}  // namespace gantry::journal::tests
