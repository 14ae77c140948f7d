#pragma once
#include "reader/plugin.hpp"

namespace gantry::harting {

extern const Plugin plugin;

}  // namespace gantry::harting
