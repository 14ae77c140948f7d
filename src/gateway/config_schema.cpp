#include <algorithm>

#include <fmt/format.h>
#include <boost/json.hpp>

#include "gateway/config_makes.hpp"
#include "protocols/registry.hpp"
#include "sinks/registry.hpp"

namespace gantry::gateway {

namespace json = boost::json;

namespace {
json::string_view view(std::string_view text) {
    return {text.data(), text.size()};
}

// As parse_duration() and parse_size() read them.
constexpr std::string_view duration_pattern = R"(^[0-9]+(\.[0-9]+)?(us|ms|s|m|min|h|d)$)";
constexpr std::string_view duration_or_never_pattern = R"(^([0-9]+(\.[0-9]+)?(us|ms|s|m|min|h|d)|never)$)";
constexpr std::string_view hex_pattern = R"(^([0-9A-Fa-f]{2} ?)*$)";
constexpr std::string_view size_pattern = R"(^[0-9]+(\.[0-9]+)?([kKMGT]?B|[KMGT]iB)$)";

json::object text_with(std::string_view pattern) {
    return {{"type", "string"}, {"pattern", view(pattern)}};
}

json::array words(std::span<const std::string_view> choices) {
    json::array out;
    for (auto choice : choices)
        out.emplace_back(view(choice));
    return out;
}

json::object schema_of(const ConfigRow& row) {
    using Kind = ConfigRow::Kind;
    json::object out;
    switch (row.kind) {
        case Kind::name:
            out = {{"type", "string"}, {"minLength", 1}, {"maxLength", row.max}};
            break;
        case Kind::texts:
            out = {{"type", "array"}, {"items", {{"type", "string"}}}};
            break;
        case Kind::boolean:
            out = {{"type", "boolean"}};
            break;
        case Kind::count:
            out = {{"type", "integer"}, {"minimum", row.min}, {"maximum", row.max}};
            break;
        case Kind::number:
        case Kind::point:
        case Kind::points:
            break;  // only scenarios have these, and they have no schema
        case Kind::duration:
            out = text_with(duration_pattern);
            break;
        case Kind::duration_or_never:
            out = text_with(duration_or_never_pattern);
            break;
        case Kind::size:
            out = text_with(size_pattern);
            break;
        case Kind::choice:
            out = {{"enum", words(row.choices)}};
            break;
    }
    out["description"] = view(row.help);
    if (row.fallback.empty()) return out;
    if (row.kind == Kind::boolean)
        out["default"] = row.fallback == "true";
    else if (row.kind == Kind::count)
        out["default"] = json::parse(view(row.fallback));
    else
        out["default"] = view(row.fallback);
    return out;
}

json::object schema_of(const SettingRow& row, std::string_view make) {
    using Kind = SettingRow::Kind;
    json::object out;
    switch (row.kind) {
        case Kind::text:
            out = {{"type", "string"}};
            break;
        case Kind::number:
            out = {{"type", "number"}};
            if (row.min <= row.max) {
                out["minimum"] = row.min;
                out["maximum"] = row.max;
            }
            break;
        case Kind::boolean:
            out = {{"type", "boolean"}};
            break;
        case Kind::duration:
            out = text_with(duration_pattern);
            break;
        case Kind::choice:
            out = {{"enum", words(row.choices)}};
            break;
        case Kind::hex:
            out = text_with(hex_pattern);
            break;
    }
    out["description"] = fmt::format("({}) {}", make, row.help);
    return out;
}

json::object table_schema(const ConfigSection& section) {
    json::object properties;
    json::array required;
    for (auto& row : section.rows) {
        properties[view(row.key)] = schema_of(row);
        if (row.required) required.emplace_back(view(row.key));
    }
    json::object out{
        {"type", "object"}, {"properties", std::move(properties)}, {"additionalProperties", false}};
    if (!required.empty()) out["required"] = std::move(required);
    return out;
}

json::object section_schema(const ConfigSection& section, json::object table) {
    if (!section.repeated) {
        table["description"] = view(section.help);
        return table;
    }
    return {{"type", "array"}, {"items", std::move(table)}, {"description", view(section.help)}};
}

// What makes and kinds add. Two of them may use one name in two ways.
void add_settings(json::object& properties, std::span<const SettingRow> rows, std::string_view owner) {
    for (auto& row : rows) {
        if (row.secret) {
            for (auto& [suffix, from] : {std::pair{"_file", "the file that holds it"},
                                         std::pair{"_env", "the variable of the environment that holds it"}})
                properties[std::string(row.name) + suffix] = {
                    {"type", "string"}, {"description", fmt::format("({}) {}: {}", owner, row.help, from)}};
            continue;
        }
        auto schema = schema_of(row, owner);
        auto* there = properties.if_contains(view(row.name));
        if (there == nullptr) {
            properties[view(row.name)] = std::move(schema);
        } else if (auto* several = there->as_object().if_contains("anyOf")) {
            several->as_array().emplace_back(std::move(schema));
        } else {
            json::array both{std::move(*there), std::move(schema)};
            *there = json::object{{"anyOf", std::move(both)}};
        }
    }
}

json::object reader_schema(Makes makes) {
    auto table = table_schema(config_section("reader"));
    auto& properties = table["properties"].as_object();
    std::vector<std::string_view> schemes;
    for (auto* make : makes)
        for (auto& scheme : make->schemes)
            schemes.push_back(scheme.name);
    auto& address = properties["address"].as_object();
    std::string alternatives = fmt::format("{}", fmt::join(schemes, "|"));
    for (std::size_t at = 0; (at = alternatives.find('+', at)) != std::string::npos; at += 2)
        alternatives.insert(at, 1, '\\');
    address["pattern"] = fmt::format("^({})://", alternatives);
    for (auto* make : makes)
        add_settings(properties, make->driver_settings, make->name);
    auto& antenna = config_section("reader.antenna");
    properties["antenna"] = section_schema(antenna, table_schema(antenna));
    return table;
}

json::object sink_schema(Kinds kinds) {
    auto table = table_schema(config_section("sink"));
    auto& properties = table["properties"].as_object();
    json::array names;
    for (auto* kind : kinds) {
        names.emplace_back(view(kind->name));
        add_settings(properties, kind->settings, kind->name);
    }
    auto& type = properties["type"].as_object();
    type.erase("minLength");
    type.erase("maxLength");
    type.erase("type");
    type["enum"] = std::move(names);
    return table;
}
}  // namespace

std::string config_schema(Makes makes, Kinds kinds) {
    json::object properties;
    for (auto& section : config_sections()) {
        if (section.path.find('.') != std::string_view::npos) continue;
        auto table = section.path == "reader" ? reader_schema(makes)
                     : section.path == "sink" ? sink_schema(kinds)
                                              : table_schema(section);
        properties[view(section.path)] = section_schema(section, std::move(table));
    }
    json::object schema{{"$schema", "https://json-schema.org/draft/2020-12/schema"},
                        {"title", "gantry.toml"},
                        {"type", "object"},
                        {"properties", std::move(properties)},
                        {"additionalProperties", false}};
    return json::serialize(schema);
}

std::string config_schema() {
    return config_schema(plugins(), sink_kinds());
}

}  // namespace gantry::gateway
