// The writer with hand-made items: what is answered when, and what it says of loss.
#include "gateway/writer.hpp"

#include <algorithm>
#include <array>
#include <filesystem>

#include <gtest/gtest.h>

#include "base/log.hpp"
#include "journal/sqlite.hpp"
#include "link/link.hpp"
#include "testkit/eventually.hpp"
#include "testkit/temp_dir.hpp"
#include "toy_makes.hpp"

namespace gantry::gateway {
namespace {

using testkit::eventually;

// A store, a reader that is known, and what the writer answers.
struct Bench {
    explicit Bench(std::uint64_t max_size = 8 << 20) {
        store.path = dir.path() + "/gantry.db";
        store.on_full = journal::OnFull::drop_oldest;
        store.max_size = max_size;
        config.name = "r-1";
        config.zone = "hall";
        config.address.plugin = &test::knock;
        entry = roster.admit("r-1", config);
    }
    std::unique_ptr<journal::Journal> open() const {
        auto opened = journal::Journal::open(store);
        if (!opened) throw std::runtime_error(opened.error().error.text());
        return std::move(*opened);
    }
    void start(bool tag_read = false, std::chrono::microseconds lose_after = 1h) {
        Writer::Options options;
        options.tag_read = tag_read;
        options.rules.lose_after = lose_after;
        writer = std::make_unique<Writer>(open(), roster, options);
        channel = &writer->add_channel([this](std::vector<Answer> some) {
            std::lock_guard lock(mutex);
            for (auto& answer : some) {
                version_at_answer = *reader->version();
                answers.push_back(std::move(answer));
            }
        });
        auto opened = journal::Reader::open(store.path);
        if (!opened) throw std::runtime_error(opened.error().error.text());
        reader = std::move(*opened);
        auto started = writer->start(link::read_clocks());
        if (!started) throw std::runtime_error(started.error().text());
    }
    Answer ask(Item item) {
        auto before = [this] {
            std::lock_guard lock(mutex);
            return answers.size();
        }();
        item.reader = entry->index;
        item.session = 1;
        EXPECT_TRUE(channel->push(item));
        EXPECT_TRUE(eventually([&] {
            std::lock_guard lock(mutex);
            return answers.size() > before;
        })) << "no answer";
        std::lock_guard lock(mutex);
        return answers.empty() ? Answer{} : answers.back();
    }
    Answer comes_up() {
        Item item;
        item.kind = Item::Kind::reader_up;
        item.at = link::read_clocks();
        return ask(std::move(item));
    }
    Answer reports(std::size_t tags, std::optional<Bytes> mark) {
        Item item;
        item.report.ticket = ++ticket;
        item.report.received = link::read_clocks();
        for (std::size_t i = 0; i < tags; ++i) {
            Observation seen;
            std::uint8_t id[12] = {0x30};
            id[10] = static_cast<std::uint8_t>(i >> 8);
            id[11] = static_cast<std::uint8_t>(i);
            seen.tag = event::TagId(ByteView(id));
            seen.antenna = 1;
            seen.reads = 1;
            item.report.observations.push_back(seen);
        }
        item.report.mark = std::move(mark);
        return ask(std::move(item));
    }
    std::vector<event::Event> events(std::vector<event::Type> types = {}) {
        std::vector<event::Event> out;
        journal::Filter filter;
        filter.types = std::move(types);
        auto read = reader->query(filter, [&](const event::Event& event) {
            out.push_back(event);
            return true;
        });
        EXPECT_TRUE(read);
        return out;
    }

    testkit::TempDir dir;
    journal::Options store;
    ReaderConfig config;
    Roster roster;
    RosterEntry* entry = nullptr;
    std::mutex mutex;
    std::vector<Answer> answers;
    std::uint64_t version_at_answer = 0;
    std::unique_ptr<journal::Reader> reader;
    std::unique_ptr<Writer> writer;
    Writer::Channel* channel = nullptr;
    Ticket ticket = 0;
};

TEST(Writer, AReportWithAMarkIsAnsweredAfterACommitThoughItsTagsArePresentAnyway) {
    Bench bench;
    bench.start();
    bench.comes_up();
    bench.reports(3, Bytes{1});
    for (std::uint8_t i = 2; i < 20; ++i) {
        auto before = *bench.reader->version();
        auto answer = bench.reports(3, Bytes{i});
        EXPECT_EQ(answer.ticket, bench.ticket);
        EXPECT_NE(bench.version_at_answer, before) << "answered before it was stored";
    }
}

TEST(Writer, AReportThatLeavesNothingToStoreIsAnsweredWithoutACommit) {
    Bench bench;
    bench.start();
    bench.comes_up();
    bench.reports(1, Bytes{1});
    int without = 0;
    for (int i = 0; i < 20; ++i) {
        auto before = *bench.reader->version();
        EXPECT_EQ(bench.reports(0, {}).ticket, bench.ticket);
        if (bench.version_at_answer == before) ++without;
    }
    EXPECT_GE(without, 15) << "few commits have other reasons";
}

TEST(Writer, PcAndXpcAreInTheEventsOfTheirTagAlsoAfterARestart) {
    Bench bench;
    bench.start(true);
    bench.comes_up();
    Item item;
    item.report.ticket = ++bench.ticket;
    item.report.received = link::read_clocks();
    item.report.data = {0xE2, 0x80};
    Observation seen;
    seen.tag = event::TagId(Bytes{0x30, 1});
    seen.pc = 0x0A00;
    seen.xpc = 0x08000000;
    item.report.observations.push_back(seen);
    seen.tag = event::TagId(Bytes{0x30, 2});
    seen.pc = 0x0800;
    seen.xpc = 0;
    seen.data_size = 2;
    seen.data_bank = Bank::tid;
    item.report.observations.push_back(seen);
    bench.ask(std::move(item));
    auto told = [&](std::vector<event::Type> types) {
        std::vector<std::string> out;
        for (auto& event : bench.events(std::move(types)))
            out.push_back(to_hex(event.tag.view()) + " " + to_hex(event::pc_words(event.pc).view()) + " " +
                          to_hex(event::xpc_words(event.xpc).view()) + to_hex(event.tid));
        return out;
    };
    using event::Type;
    using Lines = std::vector<std::string>;
    EXPECT_EQ(told({Type::tag_read}), (Lines{"3001 0A00 0800", "3002 0800 E280"}));
    EXPECT_EQ(told({Type::tag_observed}), (Lines{"3001 0A00 0800", "3002 0800 "}));
    bench.writer.reset();
    bench.start(true, 1ms);
    bench.comes_up();
    EXPECT_TRUE(eventually([&] { return bench.events({Type::tag_lost}).size() == 2; }));
    auto lost = told({Type::tag_lost});
    std::ranges::sort(lost);
    EXPECT_EQ(lost, (Lines{"3001 0A00 0800", "3002 0800 "}));
}

TEST(Writer, WhatAnEarlierProcessDroppedAndDidNotTellIsToldAtTheStart) {
    Bench bench(1 << 20);
    std::uint64_t untold = 0;
    {
        auto journal = bench.open();
        auto point = journal->read_point("r-1", "", "");
        while (untold == 0) {
            journal::Batch batch;
            batch.time = link::read_clocks().wall;
            batch.next_seq = journal->last_seq() + 1;
            for (int i = 0; i < 1000; ++i) {
                auto& read = batch.reads.emplace_back();
                read.seq = batch.take_seq();
                read.time = batch.time;
                read.read_point = point;
            }
            ASSERT_TRUE(journal->commit(batch));
            ASSERT_TRUE(journal->retain(batch.time));
            untold = journal->untold().count;
        }
    }
    bench.start();
    ASSERT_TRUE(eventually([&] { return !bench.events({event::Type::overflow}).empty(); }));
    auto told = bench.events({event::Type::overflow});
    EXPECT_EQ(told.front().scope, "store");
    EXPECT_GE(told.front().count, untold);
    EXPECT_TRUE(told.front().since);
}

TEST(Writer, DroppingGoesOnAndEveryEventIsStoredOrToldAtAnyTime) {
    Bench bench(1 << 20);
    log::Capture logged;
    bench.start(true);
    bench.comes_up();
    auto balance = [&] {
        std::uint64_t sum = 0, last = 0;
        for (auto& event : bench.events()) {
            sum += 1 + (event.type == event::Type::overflow ? event.count.value_or(0) : 0);
            last = event.seq;
        }
        return sum == last;
    };
    for (int i = 0; i < 300; ++i) {
        bench.reports(500, Bytes{static_cast<std::uint8_t>(i)});
        if (i % 50 == 49) {
            EXPECT_TRUE(eventually(balance)) << i;
        }
    }
    EXPECT_TRUE(eventually(balance));
    EXPECT_FALSE(bench.events({event::Type::overflow}).empty());
    auto log = logged.take();
    EXPECT_NE(log.find("the store is full: "), std::string::npos);
    EXPECT_EQ(log.find("held"), std::string::npos) << "with room made at once no reader is held: " << log;
}

TEST(Writer, AStoreThatCannotBeOpenedAgainIsSaidOnceWithItsCauseInFront) {
    Bench bench;
    log::Capture logged;
    bench.start();
    bench.comes_up();
    auto db = journal::Database::open(bench.store.path, journal::Database::Access::write);
    ASSERT_TRUE(db && db->run("DROP TABLE jobs"));
    auto away = bench.dir.path() + "/away.db";
    std::filesystem::rename(bench.store.path, away);
    journal::JobRow row;
    row.id = 1;
    bench.writer->store_job(row);
    auto trouble_says = [&](std::string_view text) {
        return eventually([&] { return bench.writer->stats().trouble.find(text) != std::string::npos; });
    };
    EXPECT_TRUE(trouble_says("is not there"));
    auto cause = bench.writer->stats().trouble;
    EXPECT_NE(cause.find("jobs"), std::string::npos) << cause;
    // Another reason not to open it shows that it is still tried.
    std::filesystem::remove(bench.store.path.string() + "-wal");
    std::filesystem::create_directory(bench.store.path);
    EXPECT_TRUE(eventually([&] { return bench.writer->stats().trouble != cause; }));
    bench.writer->stop();
    auto log = logged.take();
    EXPECT_EQ(log.find("was not opened again"), std::string::npos) << log;
    auto lines = std::ranges::count(log, '\n');
    // What is done once a second misses the table, too, if it comes before the job.
    if (log.find("old events could not be deleted") != std::string::npos) --lines;
    EXPECT_EQ(lines, 4) << "the cause, two reasons, the end: " << log;
}

TEST(Writer, ACompactionGoesOnBetweenCommitsAndEndsBeforeTheWriterIfItMust) {
    Bench bench(64 << 20);
    {
        // Much, and then hardly anything.
        auto journal = bench.open();
        for (int i = 0; i < 200; ++i) {
            journal::Batch batch;
            batch.next_seq = journal->last_seq() + 1;
            for (int each = 0; each < 100; ++each) {
                auto& event = batch.events.emplace_back();
                event.seq = batch.take_seq();
                event.type = event::Type::reader_fault;
                event.text = std::string(200, 'x');
            }
            ASSERT_TRUE(journal->commit(batch));
        }
        while (journal->retain(link::read_clocks().wall)->more) {
        }
    }
    auto before = std::filesystem::file_size(bench.store.path);
    ASSERT_GT(before, 4u << 20);
    bench.start(true);
    bench.comes_up();
    EXPECT_EQ(bench.writer->compaction().number, 0u);
    bench.writer->compact();
    bench.writer->compact();  // it runs already
    EXPECT_EQ(bench.reports(3, Bytes{1}).ticket, bench.ticket);
    EXPECT_TRUE(eventually([&] { return !bench.writer->compaction().running; }));
    auto done = bench.writer->compaction();
    EXPECT_FALSE(done.error) << done.error->text();
    // Unless the first was over before the second was asked for, which then found little to do.
    if (done.number == 1) {
        EXPECT_LT(done.bytes_after, done.bytes_before / 4);
    }
    EXPECT_EQ(bench.reports(4, Bytes{2}).ticket, bench.ticket);
    bench.writer->compact();
    EXPECT_GE(bench.writer->compaction().number, 2u);
    bench.writer->stop();
    bench.writer.reset();
    EXPECT_EQ(bench.open()->check(), "");
    EXPECT_LT(std::filesystem::file_size(bench.store.path), before / 4);
}

// Three of one sink before the writer looks: none takes the place of what it does not hold.
TEST(Writer, ACursorIsReplacedOnlyByACursor) {
    Bench bench;
    {
        Writer writer(bench.open(), bench.roster, {});
        writer.store_delivery({.sink = "box", .cursor = 3});
        writer.store_delivery({.sink = "box", .cursor = 5});
        writer.store_delivery({.sink = "box", .letters_gone = {1}});
        ASSERT_TRUE(writer.start(link::read_clocks()));
        writer.stop();
    }
    EXPECT_EQ(bench.open()->cursor("box"), 5u);
}

// One channel that is always full must not keep the other waiting.
TEST(Writer, EveryLoopHasItsTurnToComeFirst) {
    Bench bench;
    auto up = [&] {
        Item item;
        item.kind = Item::Kind::ask_known;
        item.reader = bench.entry->index;
        item.session = 1;
        item.at = link::read_clocks();
        return item;
    };
    // More than one batch takes, in both channels before the writer starts.
    std::mutex mutex;
    std::vector<int> order;
    Writer writer(bench.open(), bench.roster, {});
    std::array<Writer::Channel*, 2> channels{};
    for (int i = 0; i < 2; ++i)
        channels[static_cast<std::size_t>(i)] = &writer.add_channel([&, i](const std::vector<Answer>&) {
            std::lock_guard lock(mutex);
            order.push_back(i);
        });
    for (auto* channel : channels)
        for (int i = 0; i < 3; ++i) {
            auto item = up();
            item.reason.assign(9u << 20, 'x');
            ASSERT_TRUE(channel->push(item));
        }
    ASSERT_TRUE(writer.start(link::read_clocks()));
    EXPECT_TRUE(eventually([&] {
        std::lock_guard lock(mutex);
        return order.size() >= 2 && std::ranges::find(order, 1) != order.end();
    }));
    writer.stop();
    std::lock_guard lock(mutex);
    EXPECT_LT(std::ranges::find(order, 1) - order.begin(), 2) << "two items of the first fill a batch";
}

TEST(Writer, TheWeightOfNoticesAndMarksCounts) {
    Bench bench;
    Writer writer(bench.open(), bench.roster, {});
    auto& channel = writer.add_channel([](const std::vector<Answer>&) {});
    auto taken = [&](Item (*make)()) {
        int count = 0;
        for (auto item = make(); count < 100 && channel.push(item); item = make())
            ++count;
        return count;
    };
    auto heavy = taken([] {
        Item item;
        item.report.notices.emplace_back(FaultNotice{1, std::string(2u << 20, 'x'), Bytes(2u << 20)});
        item.report.mark = Bytes(4u << 20);
        return item;
    });
    EXPECT_LT(heavy, 6) << "8 MiB each";
    EXPECT_GT(heavy, 1);
}

TEST(Writer, AMarkThatCannotBeReadIsSaidAndTheDriverIsTold) {
    Bench bench;
    {
        auto journal = bench.open();
        journal::Batch batch;
        batch.marks = {{"r-1", Bytes{7}}};
        ASSERT_TRUE(journal->commit(batch));
    }
    bench.start();
    EXPECT_EQ(bench.comes_up().known.mark, Bytes{7});
    bench.writer.reset();
    bench.reader.reset();
    {
        auto db = journal::Database::open(bench.store.path, journal::Database::Access::write);
        ASSERT_TRUE(db && db->run("UPDATE marks SET mark = x'08'"));
    }
    log::Capture logged;
    bench.start();
    auto known = bench.comes_up().known;
    EXPECT_TRUE(known.mark.empty());
    EXPECT_TRUE(known.mark_unreadable);
    auto log = logged.take();
    EXPECT_NE(log.find("what came last from r-1 is not known"), std::string::npos) << log;
    EXPECT_NE(log.find("marked as possible repeats"), std::string::npos) << log;
    // With the next mark all is well again.
    bench.reports(1, Bytes{9});
    known = bench.comes_up().known;
    EXPECT_EQ(known.mark, Bytes{9});
    EXPECT_FALSE(known.mark_unreadable);
}

}  // namespace
}  // namespace gantry::gateway
