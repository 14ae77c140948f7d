#pragma once
#include <span>
#include <string_view>

#include "sink/sink.hpp"

namespace gantry {

std::span<const sink::Kind* const> sink_kinds();          // one per gantry_sink() line
const sink::Kind* find_sink_kind(std::string_view name);  // nullptr: unknown

}  // namespace gantry
