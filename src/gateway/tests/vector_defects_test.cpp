// Proof R7: six defects that the disk buffer of another program was found to have, in 2026 and by its own
// makers, each turned into a test of ours.
#include <algorithm>
#include <limits>

#include "gateway/writer.hpp"
#include "link/link.hpp"
#include "sink_bench.hpp"
#include "toy_makes.hpp"

namespace gantry::gateway {
namespace {

using test::ids;
using test::SinkBench;
using testkit::eventually;

journal::Options small_store() {
    journal::Options options;
    options.max_size = 512 << 10;
    options.on_full = journal::OnFull::drop_oldest;
    options.sinks = {"box"};
    return options;
}

struct Left {
    std::uint64_t events = 0, dropped = 0;
    journal::Seq oldest = 0;
};

// Events come until the store has dropped some that the box never had.
Left fill_until_dropped(SinkBench& bench) {
    Left left;
    for (int rounds = 0; left.dropped == 0 && rounds < 1000; ++rounds) {
        bench.happen(200);
        for (bool more = true; more;) {
            auto retained = bench.journal->retain(from_us(1'795'000'000'000'000));
            EXPECT_TRUE(retained);
            if (!retained) return left;
            left.dropped += retained->dropped;
            EXPECT_LE(retained->deleted, bench.cursor().value_or(0))
                << "only what was delivered goes uncounted";
            more = retained->more;
        }
    }
    auto reader = journal::Reader::open(bench.dir.path() + "/gantry.db");
    EXPECT_TRUE((*reader)->query({}, [&](const event::Event& event) {
        if (left.oldest == 0) left.oldest = event.seq;
        ++left.events;
        return true;
    }));
    return left;
}

// There: a segment file was removed before the place in it was moved on disk, and every start after that
// crashed.
TEST(VectorDefects, ACursorBeforeEventsThatAreGoneGoesOnWithWhatIsLeft) {
    SinkBench bench(small_store());
    bench.happen(10);
    bench.start();
    ASSERT_TRUE(bench.cursor_gets_to(10));
    bench.box.with([](auto& box) { box.away = true; });
    bench.runner.reset();
    auto left = fill_until_dropped(bench);
    ASSERT_GT(left.dropped, 0u);
    ASSERT_GT(left.oldest, 11u) << "the cursor stands before what is there";
    EXPECT_EQ(bench.cursor(), 10u);
    bench.start();
    bench.restart();
    bench.box.with([](auto& box) { box.away = false; });
    bench.config.batch = 1000;
    bench.restart();
    auto last = bench.last_seq();
    ASSERT_TRUE(bench.cursor_gets_to(last));
    auto expected = ids(1, 10);
    std::ranges::copy(ids(left.oldest, last), std::back_inserter(expected));
    EXPECT_EQ(bench.box.taken(), expected);
}

// There: events that the buffer dropped were in no counter.
TEST(VectorDefects, WhatIsDroppedIsCountedToTheLastEvent) {
    SinkBench bench(small_store());
    auto left = fill_until_dropped(bench);
    EXPECT_GT(left.dropped, 0u);
    EXPECT_EQ(left.events + left.dropped, bench.journal->last_seq());
    EXPECT_EQ(bench.journal->untold().count, left.dropped);
}

// There: a size went below zero, became enormous, and the writer waited for room that would never come.
TEST(VectorDefects, NoSizeGoesBelowZero) {
    SinkBench bench(small_store());
    auto left = fill_until_dropped(bench);
    ASSERT_GT(left.dropped, 0u);
    auto last = bench.journal->last_seq();
    EXPECT_LE(bench.journal->size().bytes, small_store().max_size);
    // A cursor that is further than the newest event: nothing waits for that sink.
    bench.store({.sink = "box", .cursor = last + 1000});
    bench.start();
    ASSERT_TRUE(eventually([&] { return bench.runner->status().state.starts_with("up to date"); }));
    EXPECT_EQ(bench.runner->status().behind, 0u);
    EXPECT_EQ(bench.runner->status().backlog_bytes, 0u);
    bench.happen(10);
    EXPECT_EQ(bench.last_seq(), last + 10) << "and the store takes more";
}

// There: the writer was dropped without a flush, and what it had taken went with it.
TEST(VectorDefects, AWriterThatEndsHasStoredAllThatItTook) {
    constexpr std::size_t items = 3000;
    testkit::TempDir dir;
    journal::Options options;
    options.path = dir.path() + "/gantry.db";
    ReaderConfig config;
    config.name = "r-1";
    config.address.plugin = &test::knock;
    Roster roster;
    auto* entry = roster.admit("r-1", config);
    auto journal = journal::Journal::open(options);
    ASSERT_TRUE(journal);
    Writer writer(std::move(*journal), roster, {.tag_read = true, .rules = {}, .zones = {}});
    std::atomic<Ticket> told = 0;
    auto& channel = writer.add_channel([&](const std::vector<Answer>& answers) {
        for (auto& answer : answers)
            told = std::max<Ticket>(told, answer.ticket);
    });
    ASSERT_TRUE(writer.start(link::read_clocks()));
    for (Ticket ticket = 1; ticket <= items; ++ticket) {
        Item item;
        item.reader = entry->index;
        item.session = 1;
        item.report.ticket = ticket;
        item.report.received = link::read_clocks();
        auto& seen = item.report.observations.emplace_back();
        const Bytes tag = {0xE2, static_cast<std::uint8_t>(ticket >> 8), static_cast<std::uint8_t>(ticket)};
        seen.tag = event::TagId(tag);
        seen.antenna = 1;
        seen.reads = 1;
        ASSERT_TRUE(channel.push(item));
    }
    writer.stop();
    EXPECT_EQ(told, items);
    auto reader = journal::Reader::open(options.path);
    ASSERT_TRUE(reader);
    journal::Filter reads;
    reads.types = {event::Type::tag_read};
    std::size_t stored = 0;
    EXPECT_TRUE((*reader)->query(reads, [&](const event::Event&) {
        ++stored;
        return true;
    }));
    EXPECT_EQ(stored, items);
}

// There: a delivery that the destination had refused was acknowledged all the same.
TEST(VectorDefects, ARefusalMovesTheCursorOnlyInOneCommitWithItsDeadLetter) {
    SinkBench bench;
    bench.storing = false;  // it crashes before anything is on disk
    bench.box.with([](auto& box) { box.poison = {"g:3"}; });
    bench.happen(5);
    bench.start();
    ASSERT_TRUE(eventually([&] {
        std::lock_guard lock(bench.mutex);
        return !bench.left.empty() && bench.left.back().cursor == 5u;
    }));
    bench.runner.reset();
    for (auto& delivery : bench.left) {
        if (!delivery.cursor || *delivery.cursor < 3) continue;
        ASSERT_EQ(delivery.letters.size(), 1u) << "the cursor passes it with its letter";
        EXPECT_EQ(delivery.letters.front().seq, 3u);
        break;
    }
    EXPECT_EQ(bench.cursor(), std::nullopt);
    EXPECT_TRUE(bench.letters().empty());
    bench.storing = true;
    bench.start();
    ASSERT_TRUE(bench.cursor_gets_to(5));
    ASSERT_EQ(bench.letters().size(), 1u) << "after the crash it was offered again, and refused again";
    EXPECT_EQ(bench.letters().front().seq, 3u);
}

// There: numbers of files were compared in a width in which they wrap.
TEST(VectorDefects, NumbersGoOnInOrderWhereTheyWouldWrap) {
    SinkBench bench;
    std::vector<std::string> expected;
    std::uint64_t epoch = 0;
    for (auto bits : {16, 31, 32, 53, 62}) {
        auto from = (journal::Seq{1} << bits) - 5;
        ASSERT_TRUE(bench.journal->raise_epoch(++epoch, from));
        bench.happen(10);
        for (auto seq = from; seq < from + 10; ++seq)
            expected.push_back("g:" + std::to_string(epoch) + ":" + std::to_string(seq));
    }
    bench.start();
    ASSERT_TRUE(bench.cursor_gets_to(bench.last_seq()));
    EXPECT_EQ(bench.box.taken(), expected);
    bench.restart();
    bench.happen(1);
    ASSERT_TRUE(bench.cursor_gets_to((journal::Seq{1} << 62) + 5));
    EXPECT_EQ(bench.box.taken().size(), expected.size() + 1) << "nothing comes again";
}

}  // namespace
}  // namespace gantry::gateway
