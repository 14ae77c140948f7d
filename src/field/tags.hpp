#pragma once
#include "field/field.hpp"

namespace gantry::field {

// The SGTIN-96 of GS1's example company 0614141, for an item of six digits and a serial number below 2^38.
event::TagId sgtin96(std::uint32_t item, std::uint64_t serial);

// Tags with ids of their own for each seed.
std::vector<TagSpec> traffic_tags(std::uint64_t seed, std::uint32_t count);

}  // namespace gantry::field
