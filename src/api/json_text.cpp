#include "api/json_text.hpp"

#include <cmath>

#include <fmt/format.h>
#include <boost/json.hpp>

namespace gantry::api {

namespace json = boost::json;

static void append(std::string& out, const json::value& value) {
    bool first = true;
    auto between = [&] {
        if (!first) out += ',';
        first = false;
    };
    if (const auto* object = value.if_object()) {
        out += '{';
        for (const auto& [key, member] : *object) {
            between();
            out += json::serialize(key);
            out += ':';
            append(out, member);
        }
        out += '}';
    } else if (const auto* array = value.if_array()) {
        out += '[';
        for (const auto& each : *array) {
            between();
            append(out, each);
        }
        out += ']';
    } else if (const auto* number = value.if_double(); number != nullptr && std::isfinite(*number)) {
        auto text = fmt::format("{}", *number);
        out += text;
        if (text.find_first_of(".e") == std::string::npos) out += ".0";  // it comes back as what it was
    } else {
        out += json::serialize(value);
    }
}

std::string json_text(const json::value& value) {
    std::string out;
    append(out, value);
    return out;
}

}  // namespace gantry::api
