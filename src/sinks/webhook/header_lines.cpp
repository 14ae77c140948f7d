#include "sinks/webhook/header_lines.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "base/text.hpp"

namespace gantry::sinks::webhook {

static constexpr std::string_view ours[] = {
    "Connection",        "Content-Encoding", "Content-Length", "Content-Type", "Expect",
    "Gantry-Signature",  "Idempotency-Key",  "Host",           "Keep-Alive",   "TE",
    "Transfer-Encoding", "Upgrade",          "User-Agent"};

bool is_header_text(std::string_view text) {
    return std::ranges::none_of(text, [](char c) {
        auto byte = static_cast<unsigned char>(c);
        return (byte < 0x20 && c != '\t') || byte == 0x7F;
    });
}

// RFC 9110, 5.6.2: a token.
static bool is_header_name(std::string_view name) {
    constexpr std::string_view others = "!#$%&'*+-.^_`|~";
    return !name.empty() && std::ranges::all_of(name, [&](char c) {
        return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
               others.find(c) != std::string_view::npos;
    });
}

Result<std::vector<std::string>> parse_headers(std::string_view setting, std::string_view text) {
    std::vector<std::string> out;
    for (std::size_t number = 1; !text.empty(); ++number) {
        auto end = text.find('\n');
        auto line = trimmed(text.substr(0, end));
        text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
        if (line.empty()) continue;
        auto colon = line.find(':');
        auto name = line.substr(0, colon), value = line.substr(std::min(line.size(), name.size() + 1));
        if (colon == std::string_view::npos || !is_header_name(name) || !is_header_text(value) ||
            trimmed(value).empty())
            return fail(fmt::format("{}: line {} is no header", setting, number),
                        "write one a line, like \"X-Site: 7\"");
        if (std::ranges::any_of(ours, [&](auto each) { return alike(each, name); }))
            return fail(fmt::format("{}: {} is written by Gantry itself", setting, name), "leave it out");
        out.push_back(fmt::format("{}: {}", name, trimmed(value)));
    }
    return out;
}

}  // namespace gantry::sinks::webhook
