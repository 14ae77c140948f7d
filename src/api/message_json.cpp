#include "api/message_json.hpp"

#include <fmt/format.h>
#include <boost/json.hpp>

#include "api/json_text.hpp"
#include "base/text.hpp"

namespace gantry::api {

namespace json = boost::json;

static json::string_view view(std::string_view text) {
    return {text.data(), text.size()};
}

static std::string_view view(const json::string& text) {
    return {text.data(), text.size()};
}

// JSON must be valid UTF-8 whatever a codec made of a peer's bytes.
static json::string json_text(std::string_view text) {
    return is_utf8(text) ? json::string(view(text)) : json::string(view(printable(text)));
}

json::value to_json(const wire::Value& value) {
    if (auto* number = value.get<std::int64_t>()) return *number;
    if (auto* text = value.get<std::string>()) return json_text(*text);
    if (auto* bytes = value.get<Bytes>()) return json_text(to_hex(*bytes));
    if (auto* record = value.get<wire::Fields>()) return to_json(*record);
    if (auto* yes = value.get<bool>()) return *yes;
    json::array array;
    for (auto& item : *value.get<wire::Value::List>())
        array.push_back(to_json(item));
    return array;
}

json::object to_json(const wire::Fields& fields) {
    json::object object;
    for (auto& field : fields)
        object[json_text(field.name)] = to_json(field.value);
    return object;
}

json::array pairs_to_json(const wire::Fields& fields) {
    json::array pairs;
    for (auto& field : fields) {
        json::array pair;
        pair.emplace_back(json_text(field.name));
        pair.push_back(to_json(field.value));
        pairs.emplace_back(std::move(pair));
    }
    return pairs;
}

static Result<wire::Fields> record_from_json(const json::object& object) {
    wire::Fields record;
    for (auto& member : object) {
        auto value = from_json(member.value());
        if (!value)
            return fail(fmt::format("{}: {}", printable({member.key().data(), member.key().size()}),
                                    value.error().what));
        record.push_back({std::string(member.key()), std::move(*value)});
    }
    return record;
}

Result<wire::Value> from_json(const json::value& value) {
    switch (value.kind()) {
        case json::kind::int64:
            return wire::Value(value.get_int64());
        case json::kind::uint64:  // only what is above the largest int64
            return fail(fmt::format("{} is too big", value.get_uint64()));
        case json::kind::double_:
            return fail(fmt::format("{} is no whole number of 64 bits", value.get_double()));
        case json::kind::bool_:
            return wire::Value(value.get_bool());
        case json::kind::string:
            return wire::Value(std::string(value.get_string()));
        case json::kind::null:
            return fail("null is no value");
        case json::kind::array: {
            wire::Value::List list;
            for (auto& item : value.get_array()) {
                auto each = from_json(item);
                if (!each) return each;
                list.push_back(std::move(*each));
            }
            return wire::Value(std::move(list));
        }
        case json::kind::object: {
            auto record = record_from_json(value.get_object());
            if (!record) return tl::unexpected(record.error());
            return wire::Value(std::move(*record));
        }
    }
    return fail("unknown kind of JSON value");
}

static Result<json::value> parse(std::string_view text) {
    json::stream_parser parser;
    json::error_code error;
    auto used = parser.write_some(text.data(), text.size(), error);
    if (!error && !parser.done()) parser.finish(error);
    if (error) return fail(fmt::format("no JSON at column {}: {}", used + 1, error.message()));
    if (auto rest = text.substr(used); rest.find_first_not_of(" \t\r\n") != std::string_view::npos)
        return fail(fmt::format("more than one JSON value: column {}", used + 1));
    return parser.release();
}

Result<wire::Value> value_from_json(std::string_view text) {
    auto value = parse(text);
    if (!value) return tl::unexpected(value.error());
    return from_json(*value);
}

std::string_view to_text(wire::Direction direction) {
    return direction == wire::Direction::to_reader ? "to-reader" : "to-host";
}

static json::object begin(const Place& place) {
    json::object line;
    line["offset"] = place.offset;
    line["length"] = place.length;
    line["protocol"] = view(place.protocol);
    line["direction"] = view(to_text(place.direction));
    return line;
}

std::string message_line(const Place& place, const wire::Message& message) {
    auto line = begin(place);
    line["message"] = json_text(message.name);
    for (auto& field : message.header)
        line[json_text(field.name)] = to_json(field.value);
    line["fields"] = pairs_to_json(message.fields);
    return json_text(line);
}

std::string error_line(const Place& place, std::string_view error, ByteView bytes) {
    auto line = begin(place);
    line["error"] = json_text(error);
    line["bytes"] = json_text(to_hex(bytes));
    return json_text(line);
}

Result<wire::Fields> fields_from_json(const json::value& value) {
    if (auto* object = value.if_object()) return record_from_json(*object);
    auto* array = value.if_array();
    if (array == nullptr) return fail(R"("fields" must be a list of ["Name", value] pairs)");
    wire::Fields fields;
    for (auto& item : *array) {
        auto* pair = item.if_array();
        if (pair == nullptr || pair->size() != 2 || !(*pair)[0].is_string())
            return fail(fmt::format(R"(field {} is no ["Name", value] pair)", fields.size() + 1));
        auto name = std::string((*pair)[0].get_string());
        auto field = from_json((*pair)[1]);
        if (!field) return fail(fmt::format("{}: {}", printable(name), field.error().what));
        fields.push_back({std::move(name), std::move(*field)});
    }
    return fields;
}

static Result<Bytes> raw_bytes(const json::object& object) {
    auto* bytes = object.if_contains("bytes");
    if (!object.contains("error") || bytes == nullptr)
        return fail(R"(the object has neither "message" nor "error" with "bytes")",
                    "expected a line as `gantry decode` prints it");
    auto* text = bytes->if_string();
    auto raw = text != nullptr ? from_hex(view(*text)) : std::nullopt;
    if (!raw) return fail(R"("bytes" is not hex)");
    return std::move(*raw);
}

Result<Line> parse_line(std::string_view text) {
    auto value = parse(text);
    if (!value) return tl::unexpected(value.error());
    auto* object = value->if_object();
    if (object == nullptr) return fail("the line is no JSON object");
    Line line;
    auto take_text = [&](std::string_view name, std::string& into) {
        auto* member = object->if_contains(view(name));
        if (member == nullptr) return true;
        if (!member->is_string()) return false;
        into = std::string(member->get_string());
        return true;
    };
    wire::Message message;
    for (auto [name, into] :
         {std::pair{"protocol", &line.protocol}, {"direction", &line.direction}, {"message", &message.name}})
        if (!take_text(name, *into)) return fail(fmt::format("\"{}\" must be text", name));
    if (!object->contains("message")) {
        auto raw = raw_bytes(*object);
        if (!raw) return tl::unexpected(raw.error());
        line.content = std::move(*raw);
        return line;
    }
    for (auto& member : *object) {
        auto name = std::string(member.key());
        if (name == "offset" || name == "length" || name == "protocol" || name == "direction" ||
            name == "message" || name == "fields")
            continue;
        auto field = from_json(member.value());
        if (!field) return fail(fmt::format("{}: {}", printable(name), field.error().what));
        message.header.push_back({std::move(name), std::move(*field)});
    }
    if (auto* fields = object->if_contains("fields")) {
        auto read = fields_from_json(*fields);
        if (!read) return tl::unexpected(read.error());
        message.fields = std::move(*read);
    }
    line.content = std::move(message);
    return line;
}

}  // namespace gantry::api
