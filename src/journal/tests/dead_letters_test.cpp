#include "journal/sqlite.hpp"
#include "journal/tests/fixtures.hpp"

namespace gantry::journal::tests {
namespace {

DeadLetter letter(std::string sink, Seq seq, Wall time = start_time) {
    DeadLetter out;
    out.sink = std::move(sink);
    out.seq = seq;
    out.time = time;
    out.reason = "too \"large\"";
    out.event = R"({"seq":1})";
    return out;
}

void bury(Journal& journal, std::vector<DeadLetter> letters) {
    auto batch = next_batch(journal);
    batch.dead_letters = std::move(letters);
    EXPECT_FALSE(batch.empty());
    ASSERT_TRUE(journal.commit(batch));
    EXPECT_TRUE(batch.empty());
}

std::vector<DeadLetter> letters_of(const Folder& folder, std::string_view sink, Seq after = 0) {
    auto reader = Reader::open(folder.store());
    EXPECT_TRUE(reader);
    std::vector<DeadLetter> out;
    EXPECT_TRUE((*reader)->dead_letters(sink, after, [&](const DeadLetter& each) {
        out.push_back(each);
        return true;
    }));
    EXPECT_TRUE(after != 0 || (*reader)->count_dead_letters(sink) == out.size());
    return out;
}

TEST(DeadLetters, AreKeptBySinkAndEvent) {
    Folder folder;
    auto journal = open_store(folder.store());
    bury(*journal, {letter("hook", 7), letter("hook", 3), letter("broker", 3)});
    auto again = letter("hook", 3, start_time + 1min);
    again.tries = 2;
    again.reason = "still too large";
    bury(*journal, {again});
    auto found = letters_of(folder, "hook");
    ASSERT_EQ(found.size(), 2u) << "one of an event";
    EXPECT_EQ(found[0].seq, 3u);
    EXPECT_EQ(found[0].tries, 2u);
    EXPECT_EQ(found[0].reason, "still too large");
    EXPECT_EQ(found[0].time, start_time + 1min);
    EXPECT_EQ(found[1].seq, 7u);
    EXPECT_EQ(found[1].reason, "too \"large\"");
    EXPECT_EQ(found[1].event, R"({"seq":1})");
    EXPECT_EQ(letters_of(folder, "hook", 3).size(), 1u);
    EXPECT_EQ(letters_of(folder, "broker").size(), 1u);
    EXPECT_EQ(letters_of(folder, "nobody").size(), 0u);

    auto batch = next_batch(*journal);
    batch.dead_letters_deleted = {{"hook", 3}, {"hook", 99}};
    EXPECT_FALSE(batch.empty());
    ASSERT_TRUE(journal->commit(batch));
    EXPECT_EQ(letters_of(folder, "hook").size(), 1u);
    EXPECT_EQ(letters_of(folder, "broker").size(), 1u);
}

TEST(DeadLetters, GoByAgeAndNumber) {
    Folder folder;
    Options options;
    options.path = folder.store();
    options.keep = std::chrono::days{30};
    auto journal = open_store(options);
    std::vector<DeadLetter> many;
    for (Seq seq = 1; seq <= max_dead_letters + 10; ++seq)
        many.push_back(letter("hook", seq, start_time + std::chrono::days{20}));
    bury(*journal, {letter("broker", 1), letter("broker", 2)});
    EXPECT_EQ(letters_of(folder, "broker").size(), 2u);
    auto by_age = journal->retain(start_time + std::chrono::days{31});
    ASSERT_TRUE(by_age);
    EXPECT_EQ(by_age->dead_letters, 0u) << "age is a wish";
    EXPECT_EQ(letters_of(folder, "broker").size(), 0u);
    bury(*journal, std::move(many));
    auto by_number = journal->retain(start_time + std::chrono::days{31});
    ASSERT_TRUE(by_number);
    EXPECT_EQ(by_number->dead_letters, 10u);
    auto left = letters_of(folder, "hook");
    ASSERT_EQ(left.size(), max_dead_letters);
    EXPECT_EQ(left.front().seq, 11u);
}

// Numbers of rows that are long gone do not count.
TEST(DeadLetters, OfOneSinkAreNotPushedOutByThoseOfAnotherThatWereThrownAway) {
    Folder folder;
    auto journal = open_store(folder.store());
    bury(*journal, {letter("broker", 1)});
    std::vector<DeadLetter> many;
    for (Seq seq = 1; seq <= max_dead_letters; ++seq)
        many.push_back(letter("hook", seq));
    bury(*journal, std::move(many));
    auto batch = next_batch(*journal);
    for (Seq seq = 1; seq < max_dead_letters; ++seq)
        batch.dead_letters_deleted.emplace_back("hook", seq);
    ASSERT_TRUE(journal->commit(batch));
    auto retained = journal->retain(start_time);
    ASSERT_TRUE(retained);
    EXPECT_EQ(retained->dead_letters, 0u);
    EXPECT_EQ(letters_of(folder, "broker").size(), 1u);
}

TEST(DeadLetters, ADamagedOneIsNotGivenOut) {
    Folder folder;
    auto journal = open_store(folder.store());
    bury(*journal, {letter("hook", 1), letter("hook", 2)});
    auto db = Database::open(folder.store(), Database::Access::write);
    ASSERT_TRUE(db);
    ASSERT_TRUE(db->run("UPDATE dead_letters SET event = 'another' WHERE seq = 1"));
    auto reader = Reader::open(folder.store());
    ASSERT_TRUE(reader);
    std::vector<Seq> found;
    auto read = (*reader)->dead_letters("hook", 0, [&](const DeadLetter& each) {
        found.push_back(each.seq);
        return true;
    });
    EXPECT_EQ(found, std::vector<Seq>{2});
    ASSERT_FALSE(read);
    EXPECT_EQ(read.error().kind, StoreError::Kind::corrupt);
}

TEST(Cursors, AreSeenByReadersToo) {
    Folder folder;
    auto journal = open_store(folder.store());
    auto batch = next_batch(*journal);
    batch.cursors = {{"hook", 0}, {"broker", 0}};
    ASSERT_TRUE(journal->commit(batch));
    EXPECT_EQ(journal->sinks_with_cursor(), (std::vector<std::string>{"broker", "hook"}));
    auto reader = Reader::open(folder.store());
    ASSERT_TRUE(reader);
    EXPECT_EQ((*reader)->cursor("hook").value(), std::optional<Seq>(0));
    EXPECT_EQ((*reader)->cursor("none").value(), std::nullopt);
}

}  // namespace
}  // namespace gantry::journal::tests
