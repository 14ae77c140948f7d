#pragma once
#include "reader/plugin.hpp"

namespace gantry::dagprog {

extern const Plugin plugin;

}  // namespace gantry::dagprog
