#include "http/message.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "base/bytes.hpp"
#include "base/text.hpp"

namespace gantry::http {

namespace {

bool same(std::string_view a, std::string_view b) {
    auto lower = [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c + 32) : c; };
    return std::ranges::equal(a, b, {}, lower, lower);
}

// Nothing: a broken escape, or a zero byte, which no name of ours has and many programs stumble over.
std::optional<std::string> decode(std::string_view text, bool plus_is_blank) {
    std::string out;
    out.reserve(text.size());
    for (std::size_t i = 0; i < text.size(); ++i) {
        char c = text[i];
        if (c == '+' && plus_is_blank) c = ' ';
        if (c == '%') {
            auto digits = text.substr(i + 1, 2);
            if (digits.size() < 2 || digits.find(' ') != std::string_view::npos) return {};
            auto byte = from_hex(digits);
            if (!byte || byte->size() != 1) return {};
            c = static_cast<char>(byte->front());
            i += 2;
        }
        if (c == '\0') return {};
        out += c;
    }
    return out;
}

}  // namespace

std::optional<std::string_view> Request::parameter(std::string_view name) const {
    for (auto& [key, value] : query)
        if (key == name) return value;
    return {};
}

std::optional<std::string_view> Request::header(std::string_view name) const {
    for (auto& [key, value] : headers)
        if (same(key, name)) return value;
    return {};
}

Response refusal(int status, const Error& error) {
    Response response;
    response.status = status;
    response.content_type = "application/problem+json";
    response.body = fmt::format("{{\"status\":{},\"title\":", status);
    append_json_string(response.body, error.what);
    if (!error.hint.empty()) {
        response.body += ",\"detail\":";
        append_json_string(response.body, error.hint);
    }
    response.body += "}\n";
    return response;
}

Result<Target> parse_target(std::string_view target) {
    if (!target.starts_with('/')) return fail("the target of a request must begin with /");
    Target out;
    auto mark = target.find('?');
    auto path = decode(target.substr(0, mark), false);
    if (!path) return fail("the path has a broken % escape");
    out.path = std::move(*path);
    if (mark == std::string_view::npos) return out;
    for (auto rest = target.substr(mark + 1); !rest.empty();) {
        auto part = rest.substr(0, rest.find('&'));
        rest.remove_prefix(std::min(rest.size(), part.size() + 1));
        if (part.empty()) continue;
        auto equals = part.find('=');
        auto key = decode(part.substr(0, equals), true);
        auto value = equals == std::string_view::npos ? std::string() : decode(part.substr(equals + 1), true);
        if (!key || !value) return fail("the query has a broken % escape");
        out.query.emplace_back(std::move(*key), std::move(*value));
    }
    return out;
}

std::string encode_component(std::string_view text) {
    std::string out;
    for (char c : text) {
        bool plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' ||
                     c == '.' || c == '_' || c == '~';
        if (plain) {
            out += c;
        } else {
            out += '%';
            out += to_hex(as_bytes(std::string_view(&c, 1)));
        }
    }
    return out;
}

}  // namespace gantry::http
