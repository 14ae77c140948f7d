// A tag's id in words, and an event as JSON.
#include <benchmark/benchmark.h>

#include <cstring>
#include <vector>

#include "bench/tag_frame.hpp"
#include "epc/epc.hpp"
#include "event/event_json.hpp"

namespace gantry::bench {
namespace {

void epc_sgtin96(benchmark::State& state) {
    std::vector<event::TagId> tags;
    for (std::uint32_t i = 0; i < 1024; ++i)
        tags.push_back(tag_of(i * 7919));
    std::size_t next = 0;
    for (auto _ : state) {
        auto decoded = epc::decode(tags[next].view());
        if (!decoded || decoded->uri.empty()) state.SkipWithError("a good EPC was refused");
        benchmark::DoNotOptimize(decoded);
        next = (next + 1) % tags.size();
    }
    state.SetItemsProcessed(state.iterations());
}
BENCHMARK(epc_sgtin96);

event::Event observed() {
    event::Event event;
    event.seq = 184467;
    event.type = event::Type::tag_observed;
    event.technology = event::Technology::epc_gen2;
    event.time = *parse_rfc3339("2026-11-21T23:04:00.123456Z");
    event.reader = "dock-1";
    event.antenna = "Ant1";
    event.zone = "dock";
    event.tag = tag_of(6789);
    if (auto decoded = epc::decode(event.tag.view())) {
        event.epc = decoded->uri;
        event.gs1 = decoded->gs1;
        event.link = decoded->link;
    }
    event.rssi = -528;
    event.reads = 17;
    event.first_seen = event.time - 2s;
    event.last_seen = event.time;
    return event;
}

void event_json(benchmark::State& state) {
    auto event = observed();
    std::string out;
    for (auto _ : state) {
        out.clear();
        event::append_json(out, event, "site-7:");
        benchmark::DoNotOptimize(out.data());
        ++event.seq;
        event.time += 1us;
    }
    state.SetItemsProcessed(state.iterations());
    state.SetBytesProcessed(state.iterations() * static_cast<std::int64_t>(out.size()));
}
BENCHMARK(event_json);

// The same bytes, already made: what any writer must at least do.
void bare_event_copy(benchmark::State& state) {
    std::string ready, out;
    event::append_json(ready, observed(), "site-7:");
    for (auto _ : state) {
        out.clear();
        benchmark::DoNotOptimize(ready.data());
        out.append(ready);
        benchmark::DoNotOptimize(out.data());
        benchmark::ClobberMemory();
    }
    state.SetItemsProcessed(state.iterations());
}
BENCHMARK(bare_event_copy);

}  // namespace
}  // namespace gantry::bench
