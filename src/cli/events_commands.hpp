#pragma once
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "cli/store.hpp"

// The subcommands of `gantry events`, and the filters that all of them take.
namespace gantry::cli {

struct EventsOptions {
    StorePlace store;
    std::string reader, zone, tag;
    std::vector<std::string> types;
    std::optional<Wall> since, until;
    std::uint64_t after = 0, last = 10, limit = UINT64_MAX;
    bool json = false, newest_first = false;
};
journal::Filter filter_of(const EventsOptions& options);

CLI::App& add_events_verb(CLI::App& parent, Context& context, const std::shared_ptr<EventsOptions>& options,
                          std::string_view name, std::string_view about, std::string_view examples);
void add_events_export(CLI::App& events, Context& context);

}  // namespace gantry::cli
