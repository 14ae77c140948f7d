#pragma once
#include <span>
#include <string_view>

#include "reader/plugin.hpp"

namespace gantry {

std::span<const Plugin* const> plugins();                 // one per gantry_protocol() line
const Plugin* find_plugin(std::string_view name);         // nullptr: unknown
const Plugin* find_scheme(std::string_view scheme_name);  // the make that a URL scheme belongs to
const Scheme* scheme_of(const Plugin& plugin, std::string_view scheme_name);

}  // namespace gantry
