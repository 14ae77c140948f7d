#pragma once
#include "reader/plugin.hpp"

namespace gantry::silion {

extern const Plugin plugin;

}  // namespace gantry::silion
