#include "sinks/mqtt/topics.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "base/text.hpp"
#include "sink/names.hpp"

namespace gantry::sinks::mqtt {

static constexpr std::string_view special = "/+#$";

static std::string reader_level(std::string_view reader) {
    auto level = sink::encode_name(reader, special);
    for (std::string_view ours : {"bridge", "request", "response"})
        if (level == ours) return fmt::format("%{:02X}{}", level.front(), ours.substr(1));
    return level;
}

Result<void> Topics::check(std::string_view base) {
    auto wrong = [&](std::string_view why) {
        return fail(fmt::format("\"{}\" is no topic to build on: {}", printable(base), why),
                    "write it like \"gantry/site-7\"");
    };
    if (base.empty()) return wrong("it is empty");
    if (base.size() > 512) return wrong("it is too long");
    if (base.front() == '$') return wrong("topics with $ at their front belong to the broker");
    if (base.ends_with('/')) return wrong("it ends with /");
    if (sink::encode_name(base, "+#") != base)
        return wrong("it has +, #, % or a character that topics cannot have");
    return {};
}

std::string Topics::default_base(std::string_view gateway_id) {
    return "gantry/" + sink::encode_name(gateway_id, special);
}

std::string Topics::events(std::string_view reader) const {
    return reader.empty() ? base_ + "/bridge/events"
                          : fmt::format("{}/{}/events", base_, reader_level(reader));
}

std::string Topics::status(std::string_view reader) const {
    return fmt::format("{}/{}/status", base_, reader_level(reader));
}

std::optional<std::string_view> Topics::operation(std::string_view topic) const {
    if (!topic.starts_with(base_)) return {};
    topic.remove_prefix(base_.size());
    constexpr std::string_view level = "/request/";
    if (!topic.starts_with(level)) return {};
    topic.remove_prefix(level.size());
    auto fits = [](char c) {
        return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.' ||
               c == '_' || c == '-';
    };
    if (topic.empty() || topic.size() > 64 || !std::ranges::all_of(topic, fits)) return {};
    return topic;
}

bool Topics::is_reserved(std::string_view topic) const {
    if (topic.empty() || topic.front() == '$') return true;
    if (!topic.starts_with(base_)) return false;
    topic.remove_prefix(base_.size());
    return topic.empty() || (topic.starts_with('/') && !topic.starts_with("/response/"));
}

}  // namespace gantry::sinks::mqtt
