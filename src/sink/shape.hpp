#pragma once
#include <optional>
#include <string>
#include <string_view>

#include "event/event.hpp"

namespace gantry::sink {

// How an event is written for a destination.
enum class Shape : std::uint8_t {
    native,       // as everywhere in Gantry
    cloudevents,  // CloudEvents 1.0, JSON, structured: the native object under `data`
};
std::string_view to_text(Shape shape);
std::optional<Shape> parse_shape(std::string_view text);

// Appends one JSON object. `id_prefix` as for event::append_json.
// CloudEvents: `source` is "gantry:<gateway id>" with "/<reader>" behind it where the event has a reader,
// `type` "gantry.<type>", `subject` the tag, if any. Characters that a URI must not have are percent-encoded.
void append_payload(std::string& out, const event::Event& event, std::string_view id_prefix, Shape shape);
// Which one a payload is in, for what has to say so beside it (a content type).
Shape shape_of(std::string_view payload);

}  // namespace gantry::sink
