#pragma once
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "gateway/sink_runner.hpp"
#include "testkit/eventually.hpp"
#include "testkit/temp_dir.hpp"
#include "toy_sink.hpp"

namespace gantry::gateway::test {

// A sink's runner beside a journal of the test's own.
struct SinkBench {
    testkit::TempDir dir;
    std::string url = "box://" + dir.path();
    Box& box = Box::at(url);
    std::mutex mutex;
    std::unique_ptr<journal::Journal> journal;
    SinkConfig config;
    bool storing = true;                 // else what the runner leaves gets lost, as in a crash
    std::vector<Delivery> left;          // by the runner, stored or not; without what is called back
    std::unique_ptr<SinkRunner> runner;  // behind all that it uses until it has ended

    explicit SinkBench(journal::Options options = {}) {
        options.path = dir.path() + "/gantry.db";
        auto opened = journal::Journal::open(options);
        if (!opened) throw std::runtime_error(opened.error().error.text());
        journal = std::move(*opened);
        EXPECT_TRUE(journal->set_gateway_id("g"));
        config.name = "box";
        config.kind = &test::box;
        config.url = url;
        config.from_oldest = true;
        config.batch = 10;
        config.retry_min = 1ms;
        config.retry_max = 5ms;
    }

    void happen(std::size_t count, event::Type type = event::Type::tag_observed,
                std::string reader = "dock-1") {
        {
            std::lock_guard lock(mutex);
            journal::Batch batch;
            batch.next_seq = journal->last_seq() + 1;
            batch.time = from_us(1'795'000'000'000'000);
            for (std::size_t i = 0; i < count; ++i) {
                auto& event = batch.events.emplace_back();
                event.seq = batch.take_seq();
                event.type = type;
                event.time = batch.time;
                event.reader = reader;
                const Bytes tag = {0xE2, 0x80, static_cast<std::uint8_t>(event.seq)};
                event.tag = event::TagId(tag);
            }
            ASSERT_TRUE(journal->commit(batch));
        }
        if (runner) runner->committed();
    }

    void start() {
        auto sink = make_box({.name = "box",
                              .gateway_id = "g",
                              .url = url,
                              .settings = *Settings::make(box_settings, {}),
                              .batch = 10},
                             host);
        runner = std::make_unique<SinkRunner>(
            config, std::move(*sink),
            SinkRunner::Start{dir.path() + "/gantry.db", "g", journal->cursor("box"), journal->last_seq()},
            [this](Delivery delivery) { store(std::move(delivery)); });
        runner->start();
    }
    void restart() {
        runner.reset();
        start();
    }
    void store(Delivery delivery) {
        std::lock_guard lock(mutex);
        left.push_back({delivery.sink, delivery.cursor, delivery.letters, delivery.letters_gone, {}});
        if (!storing) return;
        journal::Batch batch;
        batch.next_seq = journal->last_seq() + 1;
        if (delivery.cursor) batch.cursors.emplace_back(delivery.sink, *delivery.cursor);
        batch.dead_letters = std::move(delivery.letters);
        for (auto seq : delivery.letters_gone)
            batch.dead_letters_deleted.emplace_back(delivery.sink, seq);
        EXPECT_TRUE(journal->commit(batch));
        if (delivery.stored) delivery.stored();
    }
    std::optional<journal::Seq> cursor() {
        std::lock_guard lock(mutex);
        return journal->cursor("box");
    }
    journal::Seq last_seq() {
        std::lock_guard lock(mutex);
        return journal->last_seq();
    }
    bool cursor_gets_to(journal::Seq seq) {
        return testkit::eventually([&] { return cursor() == seq; });
    }
    std::vector<journal::DeadLetter> letters() {
        auto reader = journal::Reader::open(dir.path() + "/gantry.db");
        std::vector<journal::DeadLetter> out;
        EXPECT_TRUE((*reader)->dead_letters("box", 0, [&](auto& letter) {
            out.push_back(letter);
            return true;
        }));
        return out;
    }

    struct : sink::Host {
        std::vector<sink::ReaderState> readers() override { return {}; }
        void request(std::string_view, std::string, std::function<void(std::string)>) override {}
    } host;
};

inline std::vector<std::string> ids(std::size_t from, std::size_t to) {
    std::vector<std::string> out;
    for (auto seq = from; seq <= to; ++seq)
        out.push_back("g:" + std::to_string(seq));
    return out;
}

}  // namespace gantry::gateway::test
