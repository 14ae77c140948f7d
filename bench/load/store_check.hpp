#pragma once
#include <filesystem>

#include "bench/load/fleet.hpp"

namespace gantry::bench {

// A benchmark that loses reads has measured nothing. Both throw Failure with what is missing.

// With tag.read on: reader by reader, the store holds exactly the records that were sent, in order, each
// once, at least up to the last acknowledged frame.
void check_reads(const std::filesystem::path& store, const Fleet& fleet);
// Without: every tag of every reader is present, came once and never left.
void check_presence(const std::filesystem::path& store, const Fleet& fleet);

}  // namespace gantry::bench
