#pragma once
#include <filesystem>
#include <string>

#include "base/error.hpp"
#include "cli/cli.hpp"

namespace gantry::cli {

// Where the gateway is that a command speaks to: --data-dir, else the data directory of -c FILE, else of
// ./gantry.toml if there is one, else the default.
struct Place {
    std::string config, data_dir;

    Result<std::filesystem::path> directory() const;
};
void add_place(CLI::App& command, Place& place);

}  // namespace gantry::cli
