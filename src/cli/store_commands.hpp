#pragma once
#include "cli/cli.hpp"
#include "journal/upkeep.hpp"

// The subcommands of `gantry store`, one file for two that belong together.
namespace gantry::cli {

void add_store_backup(CLI::App& store, Context& context);   // backup, restore
void add_store_compact(CLI::App& store, Context& context);  // compact
void add_store_downgrade(CLI::App& store, Context& context);

// What a store holds, as the members of a JSON object without its braces, and as a line for people.
std::string checked_json(const journal::Checked& checked);
std::string checked_text(const journal::Checked& checked);

}  // namespace gantry::cli
