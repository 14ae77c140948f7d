#include "sinks/nats/subjects.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "base/text.hpp"
#include "sink/names.hpp"

namespace gantry::sinks::nats {

static constexpr std::string_view special = ".*> ";

static std::vector<std::string_view> split(std::string_view text, char separator) {
    std::vector<std::string_view> out;
    for (;;) {
        auto end = text.find(separator);
        out.push_back(text.substr(0, end));
        if (end == std::string_view::npos) return out;
        text.remove_prefix(end + 1);
    }
}

static bool is_token(std::string_view token) {
    return !token.empty() && sink::encode_name(token, special) == token;
}

Subjects::Subjects(std::string_view prefix, std::string_view gateway_id)
    : root_(fmt::format("{}.{}", prefix, sink::encode_name(gateway_id, special))) {}

Result<void> Subjects::check(std::string_view prefix) {
    if (prefix.size() <= 256 && std::ranges::all_of(split(prefix, '.'), is_token)) return {};
    return fail(fmt::format("\"{}\" is no subject to build on", printable(prefix)),
                "write words with dots between them, like \"plant.rfid\"");
}

std::string Subjects::events(std::string_view reader) const {
    if (reader.empty()) return root_ + ".bridge.events";
    auto token = sink::encode_name(reader, special);
    if (token == "bridge") token = "%62ridge";
    return fmt::format("{}.{}.events", root_, token);
}

bool covers(std::string_view pattern, std::string_view wanted) {
    auto ours = split(wanted, '.'), theirs = split(pattern, '.');
    for (std::size_t i = 0; i < theirs.size(); ++i) {
        if (i >= ours.size()) return false;
        if (theirs[i] == ">") return true;
        if (ours[i] == ">" || (theirs[i] != "*" && theirs[i] != ours[i])) return false;
    }
    return ours.size() == theirs.size();
}

Result<std::vector<std::string>> parse_subjects(std::string_view text) {
    std::vector<std::string> out;
    for (auto part : split(text, ',')) {
        auto subject = trimmed(part);
        auto tokens = split(subject, '.');
        for (std::size_t i = 0; i < tokens.size(); ++i) {
            bool wildcard = tokens[i] == "*" || (tokens[i] == ">" && i + 1 == tokens.size());
            if (!wildcard && !is_token(tokens[i]))
                return fail(fmt::format("\"{}\" is no subject", printable(subject)),
                            "write it like \"gantry.>\"");
        }
        out.emplace_back(subject);
    }
    return out;
}

}  // namespace gantry::sinks::nats
