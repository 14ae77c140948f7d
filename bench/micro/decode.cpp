// Bytes to observations: the link's hot path, part by part, beside loops that do only what must be done.
#include <benchmark/benchmark.h>

#include <array>
#include <cstring>
#include <memory>
#include <vector>

#include <fmt/format.h>

#include "bench/tag_frame.hpp"
#include "protocols/caen/message.hpp"
#include "protocols/caen/walker.hpp"
#include "protocols/dagprog/framer.hpp"
#include "protocols/dagprog/walker.hpp"
#include "protocols/registry.hpp"
#include "protocols/silion/framer.hpp"
#include "protocols/silion/walker.hpp"
#include "wire/crc.hpp"

namespace gantry::bench {
namespace {

constexpr std::uint16_t records = 20;
constexpr std::size_t frames_a_give = 64;  // about 25 KB: what one receive call brings under load

Bytes stream(bool crc) {
    Bytes out;
    for (std::uint32_t i = 0; i < frames_a_give; ++i) {
        auto frame = tag_frame("reader-0001", {.first_tag = i * records, .records = records, .crc = crc});
        out.insert(out.end(), frame.begin(), frame.end());
    }
    return out;
}

// Takes all frames that are there; returns the tags in them, or fails the run.
std::size_t decode(benchmark::State& state, silion::Framer& framer, std::vector<Observation>& out,
                   Bytes& bank) {
    std::size_t tags = 0;
    while (auto frame = framer.next()) {
        out.clear();
        auto walked = silion::walk_tags(frame->data, frame->data_offset(), out, bank);
        if (walked.fault) state.SkipWithError("a good frame was refused");
        tags += walked.records;
        benchmark::DoNotOptimize(out.data());
    }
    framer.settle();
    return tags;
}

void expect_tags(benchmark::State& state, std::size_t tags, std::size_t frames_an_iteration) {
    auto iterations = static_cast<std::size_t>(state.iterations());
    if (tags != iterations * frames_an_iteration * records) state.SkipWithError("tags are missing");
    state.SetItemsProcessed(static_cast<std::int64_t>(tags));
}

void silion_decode(benchmark::State& state, bool crc) {
    auto bytes = stream(crc);
    silion::Framer framer(wire::Direction::to_host, silion::CrcRule::only(silion::CrcKind::modbus));
    std::vector<Observation> out;
    Bytes bank;
    std::size_t tags = 0;
    for (auto _ : state) {
        framer.give(bytes);
        tags += decode(state, framer, out, bank);
    }
    expect_tags(state, tags, frames_a_give);
}
BENCHMARK_CAPTURE(silion_decode, crc, true);
BENCHMARK_CAPTURE(silion_decode, no_crc, false);

// One frame a call, whole; and the same frame in two pieces, cut at every place in turn.
void silion_decode_one_by_one(benchmark::State& state, bool cut) {
    auto frame = tag_frame("reader-0001", {.records = records});
    silion::Framer framer(wire::Direction::to_host, silion::CrcRule::only(silion::CrcKind::modbus));
    std::vector<Observation> out;
    Bytes bank;
    std::size_t tags = 0, at = 1;
    for (auto _ : state) {
        if (cut) {
            framer.give(ByteView(frame).first(at));
            tags += decode(state, framer, out, bank);
        }
        framer.give(ByteView(frame).subspan(cut ? at : 0));
        tags += decode(state, framer, out, bank);
        if (++at == frame.size()) at = 1;
    }
    expect_tags(state, tags, 1);
}
BENCHMARK_CAPTURE(silion_decode_one_by_one, whole, false);
BENCHMARK_CAPTURE(silion_decode_one_by_one, cut, true);

// The whole driver: frames, the rule of repeats, reports, commits and acknowledgements.
void silion_driver(benchmark::State& state) {
    const auto* plugin = find_plugin("silion");
    auto settings = Settings::make(plugin->driver_settings, {});
    auto driver = plugin->make_driver({.settings = *settings});
    Now now{Steady{} + 1h, Wall{} + std::chrono::years{56}};
    driver->start(now);
    driver->admitted({}, now);
    // Two frames in turn, so that neither is the repeat of the one before it.
    std::array frames = {tag_frame("reader-0001", {.first_tag = 0, .records = records}),
                         tag_frame("reader-0001", {.first_tag = records, .records = records})};
    std::size_t tags = 0, next = 0;
    for (auto _ : state) {
        now = now + 1ms;
        driver->received(frames[next], now);
        next = 1 - next;
        for (auto& report : driver->reports()) {
            tags += report.observations.size();
            driver->committed(report.ticket, now);
        }
        driver->reports().clear();
        driver->signals().clear();
        driver->output_sent(driver->output().size());
    }
    expect_tags(state, tags, 1);
}
BENCHMARK(silion_driver);

// Answers to InventoryTag with RSSI, 20 tags each, as many a receive call (docs/protocols/caen.md section 7).
Bytes caen_stream() {
    using caen::Attribute;
    Bytes out;
    for (std::uint32_t i = 0; i < frames_a_give; ++i) {
        caen::Builder answer(out, caen::to_host_head, static_cast<std::uint16_t>(i));
        answer.command(caen::Command::inventory_tag);
        for (std::uint32_t tag = 0; tag < records; ++tag)
            answer.text(Attribute::source_name, "Source_0")
                .text(Attribute::read_point_name, "Ant0")
                .time(Attribute::time_stamp, 1'700'000'000'000'000 + tag)
                .number(Attribute::tag_type, 3)
                .number(Attribute::tag_id_len, 12)
                .bytes(Attribute::tag_id, tag_of(i * records + tag).view())
                .number(Attribute::rssi, 0xFE0C);
        answer.result(caen::ResultCode::success);
        if (!answer.finish()) return {};
    }
    return out;
}
void caen_decode(benchmark::State& state) {
    auto bytes = caen_stream();
    caen::Framer framer(caen::to_host_head);
    caen::TagWalker walker;
    std::vector<Observation> out;
    Bytes data;
    std::size_t tags = 0;
    for (auto _ : state) {
        framer.add(bytes);
        while (auto item = framer.next()) {
            out.clear();
            walker.restart();
            auto walked = walker.walk(item->bytes.subspan(caen::header_size), caen::header_size, out, data);
            if (walked.fault || walked.result != 0) state.SkipWithError("a good answer was refused");
            tags += walked.tags;
            benchmark::DoNotOptimize(out.data());
        }
    }
    expect_tags(state, tags, frames_a_give);
}
BENCHMARK(caen_decode);

// Serial numbers and blocks in turn, as a DAGProg unit sends them in transmission mode 5
// (docs/protocols/dagprog.md section 4).
Bytes dagprog_stream(std::size_t tags) {
    Bytes out;
    for (std::size_t i = 0; i < tags; ++i) {
        auto text = fmt::format("\x02SN\tE0040100{:08X}\r\x02{:02X}\t{:02X}\t{:08X}\r", i, 0, i % 256, i);
        out.insert(out.end(), text.begin(), text.end());
    }
    return out;
}
void dagprog_decode(benchmark::State& state) {
    constexpr std::size_t tags_a_give = 700;  // about 25 KB
    auto bytes = dagprog_stream(tags_a_give);
    dagprog::Framer framer(wire::Direction::to_host);
    dagprog::TagWalker walker;
    walker.set_up({.technology = event::Technology::iso15693, .serials = true, .data = true});
    std::vector<Observation> out;
    Bytes data;
    std::size_t tags = 0;
    for (auto _ : state) {
        out.clear();
        data.clear();
        framer.give(bytes);
        auto before = walker.lines();
        auto used = walker.walk(framer.front(), Steady{} + 1h, out, data);
        framer.took(used, walker.lines() - before);
        if (framer.next()) state.SkipWithError("a good line was refused");
        framer.settle();
        tags += out.size();
        benchmark::DoNotOptimize(out.data());
    }
    auto iterations = static_cast<std::size_t>(state.iterations());
    if (tags != iterations * tags_a_give) state.SkipWithError("tags are missing");
    state.SetItemsProcessed(static_cast<std::int64_t>(2 * tags));  // lines
}
BENCHMARK(dagprog_decode);

// One pass by hand over frames that are known to be whole tag uploads: length checks, the CRC, a flat record
// a tag.
struct FlatRecord {
    std::array<std::uint8_t, 12> epc;
    std::uint8_t antenna, reads, protocol;
    std::int8_t rssi;
};
std::size_t bare_pass(ByteView in, std::vector<FlatRecord>& out) {
    std::size_t at = 0;
    out.clear();
    while (in.size() - at >= 10) {
        const auto* head = in.data() + at;
        std::size_t data = std::size_t{10} + head[1];
        std::size_t end = data + (static_cast<std::size_t>(head[2]) << 8 | head[3]);
        if (in.size() - at < end + 2) return 0;
        auto crc = wire::crc16_modbus(in.subspan(at, end));
        if (head[end] != (crc & 0xFF) || head[end + 1] != crc >> 8) return 0;
        for (auto record = data + 2; record < end;) {
            if (end - record < 6 || head[record + 4] != 12 || end - record < 18) return 0;
            FlatRecord flat;
            std::memcpy(flat.epc.data(), head + record + 5, 12);
            flat.antenna = head[record];
            flat.reads = head[record + 1];
            flat.rssi = static_cast<std::int8_t>(head[record + 2]);
            flat.protocol = head[record + 3];
            out.push_back(flat);
            record += std::size_t{18} + head[record + 17];
        }
        at += end + 2;
    }
    return out.size();
}
void bare_decode(benchmark::State& state) {
    auto bytes = stream(true);
    std::vector<FlatRecord> out;
    std::size_t tags = 0;
    for (auto _ : state) {
        tags += bare_pass(bytes, out);
        benchmark::DoNotOptimize(out.data());
    }
    expect_tags(state, tags, frames_a_give);
}
BENCHMARK(bare_decode);

void crc16(benchmark::State& state) {
    Bytes bytes(static_cast<std::size_t>(state.range(0)), 0x5A);
    for (auto _ : state) {
        benchmark::DoNotOptimize(bytes.data());
        benchmark::DoNotOptimize(wire::crc16_modbus(bytes));
    }
    state.SetBytesProcessed(state.iterations() * state.range(0));
}
BENCHMARK(crc16)->Arg(64)->Arg(384)->Arg(8192);

// The textbook loop: one byte, one look-up.
void bare_crc16_bytewise(benchmark::State& state) {
    static const auto table = [] {
        std::array<std::uint16_t, 256> made{};
        for (std::uint32_t i = 0; i < 256; ++i) {
            auto crc = i;
            for (int bit = 0; bit < 8; ++bit)
                crc = (crc & 1) != 0 ? (crc >> 1) ^ 0xA001u : crc >> 1;
            made[i] = static_cast<std::uint16_t>(crc);
        }
        return made;
    }();
    Bytes bytes(static_cast<std::size_t>(state.range(0)), 0x5A);
    std::uint16_t crc = 0;
    for (auto _ : state) {
        benchmark::DoNotOptimize(bytes.data());
        crc = 0xFFFF;
        for (auto byte : bytes)
            crc = static_cast<std::uint16_t>((crc >> 8) ^ table[(crc ^ byte) & 0xFF]);
        benchmark::DoNotOptimize(crc);
    }
    if (crc != wire::crc16_modbus(bytes)) state.SkipWithError("the two CRCs differ");
    state.SetBytesProcessed(state.iterations() * state.range(0));
}
BENCHMARK(bare_crc16_bytewise)->Arg(64);

void bare_memcpy(benchmark::State& state) {
    Bytes from(static_cast<std::size_t>(state.range(0)), 1), to(from.size());
    for (auto _ : state) {
        std::memcpy(to.data(), from.data(), from.size());
        benchmark::DoNotOptimize(to.data());
        benchmark::ClobberMemory();
    }
    state.SetBytesProcessed(state.iterations() * state.range(0));
}
BENCHMARK(bare_memcpy)->Arg(64 << 20);

}  // namespace
}  // namespace gantry::bench
