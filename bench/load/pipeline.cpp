#include <algorithm>

#include <fmt/format.h>

#include "bench/load/measurements.hpp"
#include "bench/load/outcome.hpp"
#include "bench/load/site.hpp"
#include "bench/load/store_check.hpp"
#include "bench/machine.hpp"

namespace gantry::bench {

using namespace std::chrono_literals;

namespace {
std::string name_of(const PipelineOptions& options) {
    std::string name = options.tag_read ? "e2e_durable" : "e2e_presence";
    if (options.shape.new_tags) name += "_new_tags";
    if (options.shape.records == 1) name += "_single";
    return name;
}

// Everybody has said its name, all tags have come, memory is there. Not counted.
void warm_up(Fleet& fleet) {
    auto least = [&fleet] {
        auto frames = fleet.frames_acknowledged(0);
        for (std::uint32_t i = 1; i < fleet.shape().readers; ++i)
            frames = std::min(frames, fleet.frames_acknowledged(i));
        return frames;
    };
    auto give_up = Clock::now() + 60s;
    while (least() < fleet.shape().turns) {
        if (Clock::now() >= give_up) throw Failure("the readers' first frames took more than a minute");
        fleet.run(100ms, 0);
    }
}

void print_latency(Fleet::Phase& phase, const std::string& suffix) {
    if (phase.latency_ms.empty()) throw Failure("not one frame was acknowledged in the time");
    print_figure("ack_latency_p50_ms" + suffix, quantile(phase.latency_ms, 0.5), "ms");
    print_figure("ack_latency_p99_ms" + suffix, quantile(phase.latency_ms, 0.99), "ms");
}
}  // namespace

void measure_pipeline(const PipelineOptions& options) {
    Site site(options.program, options.tag_read);
    site.start();
    Fleet fleet(options.shape, site.port());
    warm_up(fleet);
    auto name = name_of(options);
    for (auto rate : options.rates) {
        auto before = usage_of(site.pid());
        auto phase = fleet.run(options.time, rate);
        auto cpu = usage_of(site.pid()).cpu_s - before.cpu_s;
        auto reads = static_cast<double>(phase.reads);
        if (rate == 0) {
            print_figure(name + "_reads_per_s", reads / phase.seconds, "reads/s");
            if (cpu > 0) print_figure(name + "_reads_per_core_s", reads / cpu, "reads/core-s");
            if (!phase.latency_ms.empty())
                print_figure(name + "_latency_p99_ms", quantile(phase.latency_ms, 0.99), "ms");
            continue;
        }
        print_figure(fmt::format("{}_held_percent_at_{:.0f}k", name, rate / 1000),
                     reads / (rate * phase.seconds) * 100, "%");
        if (options.tag_read && !options.shape.new_tags && options.shape.records > 1)
            print_latency(phase, rate == 50'000 ? "" : fmt::format("_at_{:.0f}k", rate / 1000));
        print_figure(fmt::format("{}_cpu_percent_at_{:.0f}k", name, rate / 1000), cpu / phase.seconds * 100,
                     "%");
    }
    print_figure(name + "_rss_bytes", static_cast<double>(usage_of(site.pid()).resident), "bytes");
    site.stop();
    if (options.tag_read)
        check_reads(site.store(), fleet);
    else
        check_presence(site.store(), fleet);
}

}  // namespace gantry::bench
