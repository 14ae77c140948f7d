#pragma once
#include <chrono>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "cli/cli.hpp"
#include "cli/emulation.hpp"

namespace gantry::cli {

// What `gantry emulate` was told.
struct EmulateOptions {
    std::string make, tags, name, generation, model, family, pty, scenario, reader;
    std::optional<link::Endpoint> connect, listen;
    std::optional<std::uint32_t> baud;  // nothing: what is usual for the make
    std::vector<std::string> settings, faults;
    unsigned count = 1;
    std::uint64_t seed = 1;
    double speed = 1;
    std::optional<std::chrono::milliseconds> run_for;
    bool no_ack = false, moving = false, json = false;
};
// In place of a make: of each reader of a scenario its own.
inline constexpr std::string_view every_make = "any";

// The settings of a virtual reader: those of the command line, and before them `others`. The error says which
// option it is about.
Result<Settings> settings_of(const EmulateOptions& options, const Plugin& plugin,
                             std::vector<std::pair<std::string, std::string>> others = {});
// What a virtual reader must be told of its link: whom it dials, that it is on a serial line.
std::vector<std::pair<std::string, std::string>> link_settings(const Plugin& plugin,
                                                               const std::optional<link::Endpoint>& connect,
                                                               bool serial);
// Is there exactly one way for readers of this make to be reached, and one that they can go?
Result<void> check_link(const EmulateOptions& options, const Plugin& plugin, std::size_t count);
// Gives a reader the link that the command line names, if any. Ports count up from the one that was given;
// for port 0 each reader gets a free one.
void reach(VirtualReader& reader, const EmulateOptions& options, unsigned number, std::size_t count);

inline constexpr std::string_view baud_without_line = "--baud is for a serial line, and there is none",
                                  add_a_line = "add --pty FILE";

// Readers of a scenario, to be started. Errors of its file are lines that name it; those of the command line
// are not.
struct ScenarioRefused {
    Error error;
    enum class Fault : std::uint8_t { command_line, file } fault{};
};
tl::expected<std::size_t, ScenarioRefused> build_scenario(Context& context, Emulation& emulation,
                                                          const EmulateOptions& options);

}  // namespace gantry::cli
