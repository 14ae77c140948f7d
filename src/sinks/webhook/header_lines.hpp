#pragma once
#include <string>
#include <string_view>
#include <vector>

#include "base/error.hpp"

namespace gantry::sinks::webhook {

// The lines of a setting, "Name: value" each; empty ones are left out. Refused is what is no header, and
// those that are ours to write. An error never repeats a value: it may be a secret.
Result<std::vector<std::string>> parse_headers(std::string_view setting, std::string_view text);

// May this stand in a header's value: no control characters.
bool is_header_text(std::string_view text);

}  // namespace gantry::sinks::webhook
