// gantry_load: one run of one end-to-end measurement; prints its figures as JSON lines. tools/bench.py runs
// them in turn.
#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "bench/load/measurements.hpp"
#include "bench/machine.hpp"
#include "bench/program.hpp"

namespace {
using namespace gantry::bench;

struct Options {
    PipelineOptions pipeline;
    bool presence = false;
    double seconds = 2;
    unsigned frames_a_send = 1;
    std::vector<std::uint32_t> counts = {1000};

    std::chrono::milliseconds time() const {
        return std::chrono::milliseconds(static_cast<std::int64_t>(seconds * 1e3));
    }
};

void add_shape(CLI::App& command, Fleet::Shape& shape) {
    command.add_option("--readers", shape.readers, "virtual readers")->check(CLI::Range(1, 20'000));
    command.add_option("--records", shape.records, "tag records a frame")->check(CLI::Range(1, 200));
}

void add_commands(CLI::App& app, Options& options) {
    auto& pipeline = options.pipeline;
    auto add = [&](const char* name, const char* help, auto run) {
        auto* command = app.add_subcommand(name, help);
        command->callback(run);
        command->add_option("--seconds", options.seconds, "of each measurement")
            ->check(CLI::Range(0.01, 86'400.0));
        return command;
    };
    auto add_gateway = [&](const char* name, const char* help, auto run) {
        auto* command = add(name, help, run);
        command->add_option("--gantry", pipeline.program, "the program to measure")
            ->required()
            ->check(CLI::ExistingFile);
        return command;
    };
    auto* loopback = add("loopback", "frames of 64 bytes through the bare loopback", [&] {
        measure_loopback(pipeline.shape.readers, options.frames_a_send, options.time());
    });
    loopback->add_option("--connections", pipeline.shape.readers)->check(CLI::Range(1, 20'000));
    loopback->add_option("--frames-a-send", options.frames_a_send)->check(CLI::Range(1, 100));
    auto* bare = add("acknowledge", "the readers against a host that only acknowledges",
                     [&] { measure_bare_acknowledge(pipeline.shape, options.time()); });
    add_shape(*bare, pipeline.shape);
    add("store", "SQLite alone, a blob a batch", [&] { measure_bare_store(options.time()); });
    auto* whole = add_gateway("pipeline", "readers, gateway, store; checks that nothing is lost", [&] {
        pipeline.tag_read = !options.presence;
        pipeline.time = options.time();
        measure_pipeline(pipeline);
    });
    add_shape(*whole, pipeline.shape);
    whole->add_option("--turns", pipeline.shape.turns, "frames of different tags a reader")
        ->check(CLI::Range(1, 1000));
    whole
        ->add_option("--rates", pipeline.rates, "reads a second, one measurement each; 0: as fast as it goes")
        ->delimiter(',')
        ->check(CLI::Range(0.0, 1e9));
    whole->add_flag("--presence", options.presence, "keep no single reads (tag_read off)");
    whole->add_flag("--new-tags", pipeline.shape.new_tags, "every read is a tag never seen before");
    add_gateway("ready", "start to ready on an empty store", [&] { measure_ready(pipeline.program); });
    auto* idle = add_gateway("idle", "memory and processor time with quiet readers",
                             [&] { measure_idle(pipeline.program, options.counts, options.time()); });
    idle->add_option("--readers", options.counts, "how many; several numbers must grow")
        ->delimiter(',')
        ->check(CLI::Range(1, 20'000));
    app.add_subcommand("machine", "what this runs on, as JSON")->callback([] {
        fmt::print("{}\n", machine_json());
    });
}
}  // namespace

int main(int argc, char** argv) {
    CLI::App app("End-to-end measurements of gantry. One run each; `./dev bench` runs them all.");
    Options options;
    add_commands(app, options);
    return run_program(app, "gantry_load", argc, argv);
}
