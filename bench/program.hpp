#pragma once
#include <csignal>
#include <exception>
#include <string_view>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

namespace gantry::bench {

// What every program of measurements does with its command line; the exit code.
inline int run_program(CLI::App& app, std::string_view name, int argc, char** argv) {
    ::signal(SIGPIPE, SIG_IGN);
    app.require_subcommand(1);
    try {
        app.parse(argc, argv);
    } catch (const CLI::ParseError& error) {
        return app.exit(error) == 0 ? 0 : 2;
    } catch (const std::exception& error) {
        fmt::print(stderr, "{}: {}\n", name, error.what());
        return 1;
    }
    return 0;
}

}  // namespace gantry::bench
