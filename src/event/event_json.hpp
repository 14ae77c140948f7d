#pragma once
#include <string>
#include <string_view>

#include "event/event.hpp"

namespace gantry::event {

// Appends the event as one JSON object without a line end: the one shape everywhere (README.md, "An event").
// `id_prefix` is "<gateway id>:" or "<gateway id>:<epoch>:"; the id is the prefix and seq.
// This is the one JSON writer of ours; it is on the hot path (goal G7).
void append_json(std::string& out, const Event& event, std::string_view id_prefix);

}  // namespace gantry::event
