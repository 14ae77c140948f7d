// One synced commit after another, beside SQLite with nothing around it.
#include <benchmark/benchmark.h>
#include <fcntl.h>
#include <unistd.h>

#include <memory>

#include "bench/raw_store.hpp"
#include "bench/tag_frame.hpp"
#include "bench/temp_dir.hpp"
#include "journal/journal.hpp"

namespace gantry::bench {
namespace {

constexpr std::uint32_t population = 20'000;  // tags that are read again and again
constexpr Wall some_time{std::chrono::days{20'778}};

std::unique_ptr<journal::Journal> open(benchmark::State& state, const TempDir& dir) {
    journal::Options options;
    options.path = dir.path() / "gantry.db";
    auto opened = journal::Journal::open(options);
    if (opened) return std::move(*opened);
    state.SkipWithError(opened.error().error.what.c_str());
    return nullptr;
}

Observation observation(std::uint32_t number) {
    Observation seen;
    seen.tag = tag_of(number % population);
    seen.technology = event::Technology::epc_gen2;
    seen.antenna = 1;
    seen.rssi = -500;
    return seen;
}

// The clock runs for the commit alone: the writer fills its batch while it runs the reads through presence. A
// first commit, before the clock starts, makes all tags known to the store.
template <class Fill>
void commit_batches(benchmark::State& state, journal::Journal& journal, const Fill& fill) {
    journal::Batch batch;
    batch.next_seq = journal.last_seq() + 1;
    auto fill_batch = [&](std::int64_t size) {
        batch.time = some_time + std::chrono::microseconds(batch.next_seq);
        for (; size > 0; --size)
            fill(batch);
    };
    auto commit = [&] {
        auto done = journal.commit(batch);
        if (!done) state.SkipWithError(done.error().error.what.c_str());
        return done.has_value();
    };
    fill_batch(population);
    if (!commit()) return;
    for (auto _ : state) {
        state.PauseTiming();
        fill_batch(state.range(0));
        state.ResumeTiming();
        if (!commit()) break;
    }
    if (journal.last_seq() + 1 != batch.next_seq) state.SkipWithError("reads are missing");
    state.SetItemsProcessed(state.iterations() * state.range(0));
}

void journal_reads(benchmark::State& state) {
    TempDir dir;
    auto journal = open(state, dir);
    if (!journal) return;
    auto point = journal->read_point("dock-1", "Ant1", "dock");
    commit_batches(state, *journal, [&](journal::Batch& batch) {
        journal::Read read;
        read.seq = batch.take_seq();
        read.time = batch.time;
        read.read_point = point;
        read.observation = observation(static_cast<std::uint32_t>(read.seq) * 7919);
        batch.reads.push_back(read);
    });
}
BENCHMARK(journal_reads)->Arg(1'000)->Arg(10'000)->UseRealTime();

void journal_rows(benchmark::State& state) {
    TempDir dir;
    auto journal = open(state, dir);
    if (!journal) return;
    commit_batches(state, *journal, [&](journal::Batch& batch) {
        auto& event = batch.events.emplace_back();
        event.seq = batch.take_seq();
        event.type = event::Type::tag_observed;
        event.technology = event::Technology::epc_gen2;
        event.time = event.first_seen.emplace(batch.time);
        event.last_seen = batch.time;
        event.reader = "dock-1";
        event.antenna = "Ant1";
        event.zone = "dock";
        event.tag = tag_of(static_cast<std::uint32_t>(event.seq) * 7919 % population);
        event.rssi = -500;
        event.reads = 3;
    });
}
BENCHMARK(journal_rows)->Arg(1'000)->UseRealTime();

void bare_sqlite(benchmark::State& state, RawStore::Layout layout) {
    TempDir dir;
    RawStore store(dir.path() / "raw.db", layout);
    for (auto _ : state)
        store.commit(static_cast<std::uint32_t>(state.range(0)));
    state.SetItemsProcessed(state.iterations() * state.range(0));
}
BENCHMARK_CAPTURE(bare_sqlite, rows, RawStore::Layout::row_a_record)->Arg(1'000)->UseRealTime();
BENCHMARK_CAPTURE(bare_sqlite, blobs, RawStore::Layout::blob_a_batch)->Arg(1'000)->Arg(10'000)->UseRealTime();

// What a commit waits for whatever it does: 1,000 records of 100 bytes appended to a file and synced.
void bare_append_sync(benchmark::State& state) {
    TempDir dir;
    Bytes records(100'000, 0x5A);
    int fd = ::open((dir.path() / "log").c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600);
    for (auto _ : state) {
        if (::write(fd, records.data(), records.size()) < 0 || ::fdatasync(fd) != 0) {
            state.SkipWithError("the file cannot be written");
            break;
        }
    }
    ::close(fd);
}
BENCHMARK(bare_append_sync)->UseRealTime();

}  // namespace
}  // namespace gantry::bench
