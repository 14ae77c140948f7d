#pragma once
#include <string>

#include "cli/cli.hpp"
#include "field/scenario.hpp"

namespace gantry::cli {

// A scenario file, or "-" for the standard input. Errors in it are "file:line:column: what; hint", a line
// each.
Result<field::Scenario> load_scenario(Context& context, const std::string& file);
// What is wrong with a scenario, for people; the exit code.
int refuse_scenario(Context& context, const Error& error);

}  // namespace gantry::cli
