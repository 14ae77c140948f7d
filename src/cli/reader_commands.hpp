#pragma once
#include "cli/cli.hpp"

// The subcommands of `gantry reader`, one file each.
namespace gantry::cli {

void add_reader_config(CLI::App& reader, Context& context);
void add_reader_config_file(CLI::App& config, Context& context);  // dump, diff
void add_reader_config_apply(CLI::App& config, Context& context);
void add_reader_exec(CLI::App& reader, Context& context);
void add_reader_state(CLI::App& reader, Context& context);  // start, stop, restart
void add_reader_watch(CLI::App& reader, Context& context);

}  // namespace gantry::cli
