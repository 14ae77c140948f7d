#pragma once
#include <string_view>

#include "base/error.hpp"
#include "event/event.hpp"

namespace gantry::event {

// The event that append_json() wrote. Not for hot paths. Members that no event has are ignored; an error when
// it is no JSON object, `seq`, `type` or `time` is missing, or a known member has the wrong kind.
Result<Event> parse_event(std::string_view json);

}  // namespace gantry::event
