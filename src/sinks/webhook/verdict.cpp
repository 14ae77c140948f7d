#include "sinks/webhook/verdict.hpp"

#include <algorithm>
#include <charconv>

#include <fmt/format.h>

#include "base/text.hpp"

namespace gantry::sinks::webhook {

std::optional<std::chrono::milliseconds> parse_retry_after(const std::string& value, const std::string& date,
                                                           Wall now) {
    constexpr std::chrono::milliseconds longest = 24h;
    if (value.empty()) return {};
    if (value.find_first_not_of("0123456789") == std::string::npos) {
        std::int64_t seconds = 0;
        auto [end, error] = std::from_chars(value.data(), value.data() + value.size(), seconds);
        if (error != std::errc{} || seconds > longest / 1s) return longest;
        return std::chrono::seconds(seconds);
    }
    auto until = parse_http_date(value);
    if (!until) return {};
    auto wait = std::chrono::ceil<std::chrono::milliseconds>(*until - parse_http_date(date).value_or(now));
    return std::clamp(wait, 0ms, longest);
}

static std::string without_secrets(std::string text, std::span<const std::string> secrets) {
    constexpr std::string_view instead = "[secret]";
    for (auto& secret : secrets)
        for (std::size_t at = 0; !secret.empty() && (at = text.find(secret, at)) != std::string::npos;
             at += instead.size())
            text.replace(at, secret.size(), instead);
    return text;
}

// The beginning of what the peer said, on one line.
static std::string excerpt(std::string text, std::span<const std::string> secrets) {
    constexpr std::size_t longest = 200;
    text = without_secrets(std::move(text), secrets);
    std::ranges::replace_if(
        text, [](char c) { return c == '\n' || c == '\r' || c == '\t'; }, ' ');
    return printable(trimmed(std::string_view(text).substr(0, longest)));
}

static std::string hint(const Answer& answer) {
    if (answer.untrusted) return "; if its CA is none that this system trusts, name the CA's file as tls_ca";
    if (answer.status == 401 || answer.status == 403)
        return "; does it want another token, user, secret or certificate?";
    if (answer.status == 404 || answer.status == 405) return "; is the path in url right?";
    if (answer.status < 300 || answer.status > 399) return {};
    auto to = parse_url(answer.redirect);
    return fmt::format("; it says to go to {}: if that is right, put it into url",
                       to ? excerpt(to->shown, {}) : std::string("nowhere"));
}

Verdict judge(const Answer& answer, std::string_view where, std::span<const std::string> secrets, Wall now) {
    switch (answer.end) {
        case Answer::End::stopped:
            return {.text = "the gateway ended while the receiver was asked"};
        case Answer::End::out_of_time:
            return {.text = fmt::format("{} did not answer in time", where)};
        case Answer::End::failed:
            return {.text = fmt::format("{}: {}{}", where, excerpt(answer.error, secrets), hint(answer))};
        case Answer::End::answered:
            break;
    }
    auto status = answer.status;
    if (status >= 200 && status <= 299) return {.fate = Verdict::Fate::accepted};
    auto said = excerpt(answer.body, secrets);
    auto text = fmt::format("{} answered {}", where, status);
    if (!answer.reason.empty()) text += ' ' + excerpt(answer.reason, secrets);
    if (!said.empty()) text += ": " + said;
    text += hint(answer);
    if (status == 400 || status == 422) return {.fate = Verdict::Fate::refused, .text = std::move(text)};
    if (status == 413) return {.fate = Verdict::Fate::too_large, .text = std::move(text)};
    return {.text = std::move(text), .retry_after = parse_retry_after(answer.retry_after, answer.date, now)};
}

}  // namespace gantry::sinks::webhook
