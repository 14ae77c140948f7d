#include "cli/protocol.hpp"

#include <stdexcept>

#include <CLI/CLI.hpp>

#include "api/message_json.hpp"
#include "protocols/registry.hpp"

namespace gantry::cli {

const Plugin& Protocol::plugin() const {
    auto* found = find_plugin(name);
    if (found == nullptr)
        throw std::logic_error("no protocol " + name);  // the command line's check missed it
    return *found;
}

const wire::Codec& Protocol::codec() const {
    return plugin().codec();
}

wire::Direction Protocol::direction() const {
    return direction_name == api::to_text(wire::Direction::to_reader) ? wire::Direction::to_reader
                                                                      : wire::Direction::to_host;
}

void add_protocol(CLI::App& command, Context& context, Protocol& protocol) {
    add_choice(command, context, "-p,--protocol", protocol.name, make_names(), "The reader's protocol")
        ->type_name("PROTOCOL")
        ->required();
    std::vector<std::string> ways = {std::string(api::to_text(wire::Direction::to_reader)),
                                     std::string(api::to_text(wire::Direction::to_host))};
    add_choice(command, context, "-d,--direction", protocol.direction_name, std::move(ways),
               "Which way the frames travel")
        ->type_name("DIRECTION")
        ->required();
}

std::string_view example_make() {
    return plugins().front()->name;
}

}  // namespace gantry::cli
