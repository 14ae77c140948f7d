#pragma once
#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "base/time.hpp"
#include "cli/cli.hpp"
#include "link/link.hpp"

// Values of options that are read while the command line is parsed, so that a slip is wrong usage, told
// before anything is done: "--for: 2x is no duration; write it like 10s". `into` must live as on_run() says.
namespace gantry::cli {

// The option's value must pass `check`, whose error speaks of the value.
void must(CLI::Option& option, std::function<Result<void>(const std::string&)> check);

// At least a millisecond.
void add_duration(CLI::App& command, const std::string& names, std::optional<std::chrono::milliseconds>& into,
                  const std::string& help);
// "2026-11-21T23:04:00Z", or "10min" for that long ago.
void add_moment(CLI::App& command, const std::string& names, std::optional<Wall>& into,
                const std::string& help);
// A whole number, `least` to `most`. CLI11 takes a name without dashes for a positional.
CLI::Option& add_count(CLI::App& command, const std::string& names, std::uint64_t& into, std::uint64_t least,
                       const std::string& help, std::uint64_t most = UINT64_MAX);
// HOST:PORT
void add_endpoint(CLI::App& command, const std::string& names, std::optional<link::Endpoint>& into,
                  const std::string& help);

}  // namespace gantry::cli
