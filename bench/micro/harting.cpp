// The hot path of an RF-R400 in its buffered and notification modes: frames, CRC and records to observations.
#include <benchmark/benchmark.h>

#include "bench/tag_frame.hpp"
#include "protocols/harting/frame.hpp"
#include "protocols/harting/records.hpp"

namespace gantry::bench {
namespace {

constexpr std::uint16_t records = 20;
constexpr std::size_t frames_a_give = 64;

// Replies to Read Buffer with identifier, time and antenna of each tag (docs/protocols/harting.md section 8).
Bytes harting_stream() {
    using namespace harting;
    constexpr std::uint8_t parts = tr1_idd | tr1_timer | tr1_antenna;
    Bytes out;
    for (std::uint32_t i = 0; i < frames_a_give; ++i) {
        Bytes data;
        append_buffer_head(parts, 0, records, data);
        for (std::uint32_t tag = 0; tag < records; ++tag) {
            TagRecord record;
            record.idd = gen2_idd(tag_of(i * records + tag).view(), {}, {});
            record.antennas = {{.number = 1}};
            append_record(record, parts, 0, {}, data);
        }
        append_reply(out, 0, 0x22, 0, data);
    }
    return out;
}

void harting_decode(benchmark::State& state) {
    auto bytes = harting_stream();
    harting::Framer framer(wire::Direction::to_host);
    harting::WalkOptions options{.now = Wall{} + std::chrono::years{56}};
    std::vector<Observation> out;
    std::vector<harting::InputEvent> inputs;
    Bytes bank;
    std::size_t tags = 0;
    for (auto _ : state) {
        framer.add(bytes);
        while (auto frame = framer.next()) {
            out.clear();
            auto walked = harting::walk_buffer(frame->data, frame->data_offset(), options, out, bank, inputs);
            if (walked.fault || walked.unusable != 0) state.SkipWithError("a good reply was refused");
            tags += out.size();
            benchmark::DoNotOptimize(out.data());
        }
    }
    if (tags != static_cast<std::size_t>(state.iterations()) * frames_a_give * records)
        state.SkipWithError("tags are missing");
    state.SetItemsProcessed(static_cast<std::int64_t>(tags));
}
BENCHMARK(harting_decode);

}  // namespace
}  // namespace gantry::bench
