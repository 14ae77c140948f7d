#include "cli/commands.hpp"

#include <array>

namespace gantry::cli {

std::span<const AddCommand> all_commands() {
    static constexpr std::array<AddCommand, 16> all = {
        add_run,  add_demo,   add_emulate, add_field,  add_reader, add_tag, add_gpio,   add_job,
        add_sink, add_events, add_store,   add_decode, add_encode, add_epc, add_config, add_completion,
    };
    return all;
}

}  // namespace gantry::cli
