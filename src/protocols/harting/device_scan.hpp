#pragma once
#include "protocols/harting/device_config.hpp"
#include "protocols/harting/records.hpp"

namespace gantry::harting {

// Scan mode: what a reader sends over its serial line after one cycle (section 8.5): the prefix once, then of
// each tag UID, separator, data, end characters.
void append_scan(const std::vector<TagRecord>& tags, const Setup& setup, Bytes& out);

}  // namespace gantry::harting
