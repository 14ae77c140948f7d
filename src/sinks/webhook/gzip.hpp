#pragma once
#include <string>
#include <string_view>

namespace gantry::sinks::webhook {

// gzip.cpp alone knows zlib.
std::string gzipped(std::string_view text);

}  // namespace gantry::sinks::webhook
