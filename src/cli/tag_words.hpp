#pragma once
#include "base/bytes.hpp"
#include "cli/cli.hpp"

namespace gantry::cli {

// A tag's id as people have it: hex, "urn:epc:tag:…", or what else encodes without a doubt.
Result<Bytes> read_tag_id(std::string_view text);
// gantry tag list
void add_tag_list(CLI::App& tag, Context& context);

}  // namespace gantry::cli
