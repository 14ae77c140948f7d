// What one read of a tag that is present costs, by the number of tags.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <boost/unordered/unordered_flat_map.hpp>
#include <random>
#include <vector>

#include "bench/tag_frame.hpp"
#include "presence/presence.hpp"

namespace gantry::bench {
namespace {

constexpr std::size_t zones = 100;

// Tags in an order that no cache can guess.
std::vector<event::TagId> shuffled_tags(std::size_t count) {
    std::vector<event::TagId> tags;
    tags.reserve(count);
    for (std::uint32_t i = 0; i < count; ++i)
        tags.push_back(tag_of(i));
    std::ranges::shuffle(tags, std::mt19937(20261122));
    return tags;
}

void presence_sighting(benchmark::State& state) {
    auto count = static_cast<std::size_t>(state.range(0));
    auto tags = shuffled_tags(count);
    presence::Presence presence(2'000'000);
    Now now{Steady{} + 1h, Wall{} + std::chrono::years{56}};
    std::vector<presence::ReaderIndex> readers;
    for (std::size_t i = 0; i < zones; ++i) {
        presence.add_zone({});
        readers.push_back(presence.add_reader());
        presence.reader_online(readers.back(), now);
    }
    std::vector<presence::Transition> out;
    std::size_t next = 0;
    auto see = [&] {
        auto place = static_cast<std::uint32_t>(next % zones);
        presence::Sighting sighting;
        sighting.tag = tags[next];
        sighting.technology = event::Technology::epc_gen2;
        sighting.zone = place;
        sighting.reader = readers[place];
        sighting.antenna = 1;
        sighting.rssi = -500;
        presence.sighted(sighting, now, out);
        next = next + 1 == count ? 0 : next + 1;
    };
    for (std::size_t i = 0; i < count; ++i)
        see();
    out.clear();
    // 100,000 reads a second, and a turn of the clock every 1,000: deadlines move on, and none falls.
    std::size_t turn = 0;
    for (auto _ : state) {
        see();
        if (++turn == 1000) {
            turn = 0;
            now = now + 10ms;
            presence.time_passed(now, out);
        }
    }
    if (!out.empty() || presence.present() != count) state.SkipWithError("still tags came or went");
    state.SetItemsProcessed(state.iterations());
}
BENCHMARK(presence_sighting)->Arg(1'000)->Arg(100'000);

// The least that presence must do: find a tag in a table and touch it.
void bare_lookup(benchmark::State& state) {
    auto count = static_cast<std::size_t>(state.range(0));
    auto tags = shuffled_tags(count);
    boost::unordered_flat_map<event::TagId, std::uint64_t, event::TagIdHash> table;
    for (auto& tag : tags)
        table[tag] = 0;
    std::size_t next = 0;
    for (auto _ : state) {
        benchmark::DoNotOptimize(++table.find(tags[next])->second);
        next = next + 1 == count ? 0 : next + 1;
    }
    state.SetItemsProcessed(state.iterations());
}
BENCHMARK(bare_lookup)->Arg(1'000)->Arg(100'000);

}  // namespace
}  // namespace gantry::bench
