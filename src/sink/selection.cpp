#include "sink/selection.hpp"

#include <algorithm>

#include "base/bytes.hpp"
#include "base/text.hpp"

namespace gantry::sink {

static bool any_matches(const std::vector<std::string>& patterns, std::string_view name) {
    return std::ranges::any_of(patterns, [&](auto& pattern) { return matches(pattern, name); });
}

bool Selection::takes(const event::Event& event) const {
    if (!types.empty() && std::ranges::find(types, event.type) == types.end()) return false;
    if (!readers.empty() && (event.reader.empty() || !any_matches(readers, event.reader))) return false;
    // A move concerns the zone that was left, too.
    if (!zones.empty() && !(!event.zone.empty() && any_matches(zones, event.zone)) &&
        !(!event.from.empty() && any_matches(zones, event.from)))
        return false;
    if (tags.empty() || event.tag.size == 0) return true;
    auto hex = to_hex(event.tag.view());
    return std::ranges::any_of(tags, [&](auto& pattern) {
        return pattern.starts_with("urn:") ? matches(pattern, event.epc) : matches(pattern, hex);
    });
}

}  // namespace gantry::sink
