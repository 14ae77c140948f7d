#include "cli/place.hpp"

#include <CLI/CLI.hpp>

#include "gateway/config.hpp"

namespace gantry::cli {

void add_place(CLI::App& command, Place& place) {
    command
        .add_option("-c,--config", place.config,
                    "The gateway's configuration file (default: ./gantry.toml, if it is there)")
        ->type_name("FILE");
    command
        .add_option("--data-dir", place.data_dir,
                    "The gateway's data directory, instead of the configuration's")
        ->type_name("DIR");
}

Result<std::filesystem::path> Place::directory() const {
    if (!data_dir.empty()) return std::filesystem::path(data_dir);
    std::error_code error;
    auto file = !config.empty() ? config : std::filesystem::exists("gantry.toml", error) ? "gantry.toml" : "";
    if (file.empty()) return gateway::default_config().data_dir;
    return gateway::load_data_dir(file);
}

}  // namespace gantry::cli
