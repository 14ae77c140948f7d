#pragma once
#include "document/check.hpp"

// Every key of gantry.toml, once. The checker, the JSON Schema and the example file are made from these rows;
// what a make adds to [[reader]] comes from its own rows (Plugin::driver_settings).
namespace gantry::gateway {

using document::Entry;
using document::Findings;
using document::Node;
using document::Place;
using document::Section;
using ConfigRow = document::Row;
using ConfigSection = document::SectionRows;

std::span<const ConfigSection> config_sections();
const ConfigSection& config_section(std::string_view path);  // must be one of them

}  // namespace gantry::gateway
