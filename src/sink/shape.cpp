#include "sink/shape.hpp"

#include <fmt/format.h>

#include "base/bytes.hpp"
#include "base/text.hpp"
#include "base/time.hpp"
#include "event/event_json.hpp"

namespace gantry::sink {

std::string_view to_text(Shape shape) {
    return shape == Shape::cloudevents ? "cloudevents" : "native";
}

std::optional<Shape> parse_shape(std::string_view text) {
    for (auto shape : {Shape::native, Shape::cloudevents})
        if (to_text(shape) == text) return shape;
    return {};
}

static constexpr std::string_view cloudevents_begin = R"({"specversion":)";

Shape shape_of(std::string_view payload) {
    return payload.starts_with(cloudevents_begin) ? Shape::cloudevents : Shape::native;
}

// RFC 3986: only unreserved characters stay, so a reader's name cannot add a segment or a query.
static void append_segment(std::string& out, std::string_view text) {
    for (char c : text) {
        bool plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' ||
                     c == '.' || c == '_' || c == '~';
        if (plain)
            out += c;
        else
            fmt::format_to(std::back_inserter(out), "%{:02X}", static_cast<unsigned char>(c));
    }
}

void append_payload(std::string& out, const event::Event& event, std::string_view id_prefix, Shape shape) {
    if (shape == Shape::native) return event::append_json(out, event, id_prefix);
    auto gateway = id_prefix.substr(0, id_prefix.find(':'));
    out += cloudevents_begin;
    out += R"("1.0","id":)";
    append_json_string(out, fmt::format("{}{}", id_prefix, event.seq));
    out += R"(,"source":"gantry:)";
    append_segment(out, gateway);
    if (!event.reader.empty()) {
        out += '/';
        append_segment(out, event.reader);
    }
    out += R"(","type":"gantry.)";
    out += event::to_text(event.type);
    out += R"(","time":")";
    out += to_rfc3339(event.time);
    if (event.tag.size != 0) {
        out += R"(","subject":")";
        out += to_hex(event.tag.view());
    }
    out += R"(","datacontenttype":"application/json","data":)";
    event::append_json(out, event, id_prefix);
    out += '}';
}

}  // namespace gantry::sink
