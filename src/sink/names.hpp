#pragma once
#include <string>
#include <string_view>

namespace gantry::sink {

// A name as one level of a topic or one token of a subject, whatever is in it: "%" and the characters of
// `special` become %XX, and so do the bytes of controls, of characters that reorder or hide text, and of
// what is no UTF-8. Different names stay different.
std::string encode_name(std::string_view name, std::string_view special);

}  // namespace gantry::sink
