// gantry_sink_load: a sink beside a bare client of its library, or the drain of a backlog while live reads go
// on; prints figures as JSON lines. tools/bench_sinks.py starts the servers.
#include <CLI/CLI.hpp>

#include "bench/load/outcome.hpp"
#include "bench/program.hpp"
#include "bench/sinks/drain.hpp"
#include "bench/sinks/duel.hpp"

namespace {
using namespace gantry::bench;

std::chrono::milliseconds of_seconds(double seconds) {
    return std::chrono::milliseconds(static_cast<std::int64_t>(seconds * 1e3));
}

struct Options {
    DuelOptions duel;
    DrainOptions drain;
    double seconds = 1;
    std::vector<std::string> settings;
};

void add_commands(CLI::App& app, Options& options) {
    auto* duel = app.add_subcommand("duel", "the sink and a bare client of its library in turn");
    duel->add_option("kind", options.duel.kind)->required();
    duel->add_option("place", options.duel.place, "url, or directory")->required();
    duel->add_option("--set", options.settings, "NAME=VALUE, a setting of the sink");
    duel->add_option("--batch", options.duel.batch)->check(CLI::Range(1, 10'000));
    duel->add_option("--turns", options.duel.turns)->check(CLI::Range(1, 100));
    duel->add_option("--seconds", options.seconds, "of each side, each turn")
        ->check(CLI::Range(0.01, 3600.0));
    duel->callback([&options] {
        for (auto& each : options.settings) {
            auto equals = each.find('=');
            options.duel.settings.emplace_back(each.substr(0, equals), each.substr(equals + 1));
        }
        options.duel.time = of_seconds(options.seconds);
        measure_sink(options.duel);
    });
    auto* drain = app.add_subcommand("drain", "a backlog beside live reads, through the whole gateway");
    drain->add_option("--gantry", options.drain.program)->required()->check(CLI::ExistingFile);
    drain->add_option("--kind", options.drain.kind)->required();
    drain
        ->add_option("--sink", options.drain.section, "file with the [[sink]] section, which is called bench")
        ->required()
        ->check(CLI::ExistingFile);
    drain->add_option("--rate", options.drain.rate, "live reads a second")->check(CLI::Range(1.0, 1e6));
    drain->add_option("--seconds", options.seconds, "that the sink is away")
        ->check(CLI::Range(0.01, 86'400.0));
    drain->callback([&options] {
        options.drain.away = of_seconds(options.seconds);
        measure_drain(options.drain);
    });
}
}  // namespace

int main(int argc, char** argv) {
    CLI::App app("Sinks beside bare clients. One run each; `./dev bench` runs them all.");
    Options options;
    add_commands(app, options);
    return run_program(app, "gantry_sink_load", argc, argv);
}
