#pragma once
#include <span>

#include "gateway/config.hpp"
#include "gateway/config_rows.hpp"
#include "sink/sink.hpp"

// The configuration with the makes and the kinds of sinks as arguments: those of the registries, or a test's.
namespace gantry::gateway {

using Makes = std::span<const Plugin* const>;
using Kinds = std::span<const sink::Kind* const>;

Result<Address> parse_address(std::string_view url, Makes makes);
Result<Config> parse_config(std::string_view toml, std::string_view file_name, Makes makes, Kinds kinds = {});
std::string config_schema(Makes makes, Kinds kinds = {});
Result<std::string> config_example(std::string_view name, Makes makes, Kinds kinds = {});

// A setting that lets time pass between two sightings of a tag that stands still.
struct ReadGap {
    std::size_t reader = 0;  // its place among the readers
    Place at;
    std::string_view name;
    std::chrono::microseconds gap{};
};

// The [[reader]] sections: what the rows cannot say (addresses, names, antennas, the makes' own settings).
std::vector<ReaderConfig> check_readers(const Node::List& readers, Makes makes, Findings& findings,
                                        std::vector<ReadGap>& gaps);

// The [[sink]] sections.
std::vector<SinkConfig> check_sinks(const Node::List& sinks, Kinds kinds, Findings& findings);

// "caen, silion-listen": every scheme there is.
std::string scheme_list(Makes makes);

}  // namespace gantry::gateway
