#include "cli/typed_message.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "api/message_json.hpp"
#include "base/text.hpp"

namespace gantry::cli {

Result<wire::Message> typed_message(const std::string& name, std::span<const std::string> arguments) {
    wire::Message message;
    message.name = name;
    for (auto& argument : arguments) {
        auto equals = argument.find('=');
        if (equals == std::string::npos || equals == 0)
            return fail(fmt::format("\"{}\" is no Field=value", printable(argument)),
                        R"(write fields like Name=text, and lists like Name='[{"Field":1}]')");
        auto field = argument.substr(0, equals);
        auto text = argument.substr(equals + 1);
        wire::Value value(text);
        if (!text.empty() && std::string_view("[{\"").find(text.front()) != std::string_view::npos) {
            auto json = api::value_from_json(text);
            if (!json)
                return fail(fmt::format("{}: {}", printable(field), json.error().what),
                            "a value that starts with [, { or \" must be JSON");
            value = std::move(*json);
        }
        message.fields.push_back({std::move(field), std::move(value)});
    }
    return message;
}

// A place among bytes says nothing to who typed fields.
static std::string without_place(const wire::Fault& fault) {
    auto why = fault.detail.empty() ? std::string(to_text(fault.code)) : fault.detail;
    return fault.field == "field" ? why : fmt::format("{}: {}", fault.field, why);
}

Error explain(const wire::Fault& fault, const std::string& message, const wire::Codec& codec,
              wire::Direction direction) {
    auto names = codec.names(direction);
    Error error{fault.text(), ""};
    if (std::ranges::find(names, message) == names.end()) {
        // Names people nearly got right are worth more than the list, which is what the codec may say.
        auto near = nearest(message, names);
        error.what = fmt::format("there is no message {}", printable(message));
        auto few = std::span(names).first(std::min<std::size_t>(names.size(), 12));
        error.hint = near.empty() ? fmt::format("messages: {}{}", fmt::join(few, ", "),
                                                few.size() < names.size() ? ", …" : "")
                                  : fmt::format("did you mean {}?", near);
        return error;
    }
    error.what = fmt::format("{}: {}", message, without_place(fault));
    auto fields = codec.field_names(message, direction);
    error.hint = fields.empty() ? fmt::format("{} has no fields of its own", message)
                                : fmt::format("fields of {}: {}", message, fmt::join(fields, ", "));
    return error;
}

}  // namespace gantry::cli
