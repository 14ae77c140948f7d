#pragma once
#include "cli/cli.hpp"

// One line a subcommand; commands.cpp puts them in the order of `--help`.
namespace gantry::cli {

void add_run(CLI::App& app, Context& context);
void add_demo(CLI::App& app, Context& context);
void add_emulate(CLI::App& app, Context& context);
void add_field(CLI::App& app, Context& context);
void add_reader(CLI::App& app, Context& context);
void add_tag(CLI::App& app, Context& context);
void add_gpio(CLI::App& app, Context& context);
void add_job(CLI::App& app, Context& context);
void add_sink(CLI::App& app, Context& context);
void add_events(CLI::App& app, Context& context);
void add_store(CLI::App& app, Context& context);
void add_decode(CLI::App& app, Context& context);
void add_encode(CLI::App& app, Context& context);
void add_epc(CLI::App& app, Context& context);
void add_config(CLI::App& app, Context& context);
void add_completion(CLI::App& app, Context& context);

}  // namespace gantry::cli
