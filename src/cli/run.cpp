// gantry run: the gateway.
#include <ostream>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "api/api.hpp"
#include "base/log.hpp"
#include "cli/commands.hpp"
#include "cli/signals.hpp"
#include "gateway/gateway.hpp"

namespace gantry::cli {

namespace {
struct RunOptions {
    std::string config;
    std::string data_dir;
    bool json = false;
};

Result<gateway::Config> configuration(const RunOptions& options) {
    std::error_code error;
    std::string file = options.config;
    if (file.empty() && std::filesystem::exists("gantry.toml", error)) file = "gantry.toml";
    auto config = gateway::default_config();
    if (!file.empty()) {
        auto loaded = gateway::load_config(file);
        if (!loaded) return loaded;
        config = std::move(*loaded);
        log::info("gateway", "configuration {}", file);
    } else {
        log::info("gateway", "no configuration file: running on defaults, no reader is configured");
    }
    if (!options.data_dir.empty()) config.data_dir = options.data_dir;
    return config;
}

int run_gateway(Context& context, const RunOptions& options) {
    Signals signals;
    auto config = configuration(options);
    if (!config) return complain(context, "run", config.error());
    for (auto& warning : config->warnings)
        log::warn("gateway", "{}", warning);
    auto gateway = gateway::Gateway::start(std::move(*config));
    if (!gateway) return complain(context, "run", gateway.error());
    auto api = api::Api::start(**gateway);
    if (!api) return complain(context, "run", api.error());
    for (auto& listener : (*gateway)->listeners()) {
        auto local = link::to_text(listener.local);
        context.out << (options.json ? fmt::format("{{\"listening\":\"{}\"}}\n", local)
                                     : fmt::format("listening on {}\n", local));
    }
    context.out << (options.json ? "{\"ready\":true}\n" : "ready\n") << std::flush;
    log::info("gateway", "{}: data in {}", (*gateway)->id(), (*gateway)->config().data_dir.string());
    signals.wait();
    log::info("gateway", "stopping");
    (*gateway)->close_links();  // or a request that waits for a reader would hold up the end
    api->reset();
    (*gateway)->stop();
    log::info("gateway", "stopped; all that was taken is stored");
    return done;
}
}  // namespace

void add_run(CLI::App& app, Context& context) {
    auto& command = add_command(app, "run", "Run the gateway",
                                "gantry run\n"
                                "gantry run -c /etc/gantry/gantry.toml\n"
                                "gantry config example > gantry.toml && gantry run");
    auto options = std::make_shared<RunOptions>();
    command
        .add_option("-c,--config", options->config,
                    "Configuration file (default: ./gantry.toml, if it is there)")
        ->type_name("FILE");
    command
        .add_option("--data-dir", options->data_dir,
                    "Where the store and the socket are, instead of the configuration's")
        ->type_name("DIR");
    command.add_flag("--json", options->json, "Print what it listens on, and that it is ready, as JSON");
    on_run(command, context, [&context, options] { return run_gateway(context, *options); });
}

}  // namespace gantry::cli
