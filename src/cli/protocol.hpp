#pragma once
#include <string>

#include "cli/cli.hpp"
#include "cli/frames.hpp"
#include "reader/plugin.hpp"

namespace gantry::cli {

// -p PROTOCOL -d to-reader|to-host, for the commands that work on frames.
struct Protocol {
    std::string name, direction_name;

    const Plugin& plugin() const;  // only once the command line was parsed
    const wire::Codec& codec() const;
    wire::Direction direction() const;
    Frames frames() const { return {codec(), plugin().name, direction()}; }
};
void add_protocol(CLI::App& command, Context& context, Protocol& protocol);

// A make to show in examples.
std::string_view example_make();

}  // namespace gantry::cli
