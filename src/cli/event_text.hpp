#pragma once
#include <string>

#include "event/event.hpp"

namespace gantry::cli {

// One line for people: time, what, where, which tag, and what else there is to say.
std::string for_people(const event::Event& event);

}  // namespace gantry::cli
