#pragma once
#include "reader/plugin.hpp"

namespace gantry::caen {

extern const Plugin plugin;

}  // namespace gantry::caen
