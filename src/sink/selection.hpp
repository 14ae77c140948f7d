#pragma once
#include <string>
#include <string_view>
#include <vector>

#include "event/event.hpp"

namespace gantry::sink {

// Which events a sink gets. An empty list does not restrict.
struct Selection {
    std::vector<event::Type> types = {};
    std::vector<std::string> readers = {},
                             zones = {};  // exact, or patterns with *; events without one match none
    // Patterns with *: hex of the tag, or its EPC URI when they start with "urn:". Events that are about no
    // tag pass.
    std::vector<std::string> tags = {};

    bool everything() const { return types.empty() && readers.empty() && zones.empty() && tags.empty(); }
    bool takes(const event::Event& event) const;
};

}  // namespace gantry::sink
