#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <system_error>

#include <fmt/format.h>

#include "base/log.hpp"
#include "base/text.hpp"
#include "document/check.hpp"
#include "sinks/webhook/header_lines.hpp"
#include "sinks/webhook/sample.hpp"  // made by CMake from sample.toml
#include "sinks/webhook/signature.hpp"
#include "sinks/webhook/webhook.hpp"

namespace gantry::sinks::webhook {

namespace {

constexpr std::string_view schemes[] = {"https", "http"};
constexpr double longest_text = 4096;
constexpr std::size_t shortest_secret = 16;
constexpr std::int64_t largest_body = 1024 * 1024 * 1024;

constexpr SettingRow rows[] = {
    {.name = "secret",
     .kind = SettingRow::Kind::text,
     .fallback = "",
     .help = "Signs each request (Gantry-Signature, HMAC-SHA256); 16 characters or more.",
     .min = 0,
     .max = longest_text,
     .secret = true},
    {.name = "token",
     .kind = SettingRow::Kind::text,
     .fallback = "",
     .help = "Sent as Authorization: Bearer.",
     .min = 0,
     .max = longest_text,
     .secret = true},
    {.name = "user",
     .kind = SettingRow::Kind::text,
     .fallback = "",
     .help = "User name, for receivers that want one and a password.",
     .min = 0,
     .max = 255},
    {.name = "password",
     .kind = SettingRow::Kind::text,
     .fallback = "",
     .help = "Password of the user.",
     .min = 0,
     .max = longest_text,
     .secret = true},
    {.name = "headers",
     .kind = SettingRow::Kind::text,
     .fallback = "",
     .help = "More headers, \"Name: value\", one a line.",
     .min = 0,
     .max = longest_text},
    {.name = "secret_headers",
     .kind = SettingRow::Kind::text,
     .fallback = "",
     .help = "Such as hold a secret, like an API key.",
     .min = 0,
     .max = longest_text,
     .secret = true},
    {.name = "gzip",
     .kind = SettingRow::Kind::boolean,
     .fallback = "false",
     .help = "Compress what is sent (Content-Encoding: gzip)."},
    {.name = "max_body",
     .kind = SettingRow::Kind::text,
     .fallback = "1MiB",
     .help = "The most that is sent at once, before compressing."},
    {.name = "connect_timeout",
     .kind = SettingRow::Kind::duration,
     .fallback = "10s",
     .help = "How long connecting may take.",
     .min = 0.1,
     .max = 300},
    {.name = "follow_redirects",
     .kind = SettingRow::Kind::boolean,
     .fallback = "false",
     .help = "Follow 307 and 308 to the same host."},
    {.name = "tls_ca",
     .kind = SettingRow::Kind::text,
     .fallback = "",
     .help = "File of the CAs that are trusted; else those of this system."},
    {.name = "tls_cert",
     .kind = SettingRow::Kind::text,
     .fallback = "",
     .help = "File of our certificate, for a server that asks."},
    {.name = "tls_key",
     .kind = SettingRow::Kind::text,
     .fallback = "",
     .help = "File of its key, where tls_cert does not hold it."},
    {.name = "tls_insecure",
     .kind = SettingRow::Kind::boolean,
     .fallback = "false",
     .help = "Believe whoever answers. Not for production."},
    {.name = "proxy",
     .kind = SettingRow::Kind::text,
     .fallback = "",
     .help = "URL of a proxy; else none, whatever the environment says."},
};

bool is_loopback(std::string_view host) {
    return host == "localhost" || host.ends_with(".localhost") || host == "[::1]" ||
           (host.starts_with("127.") && host.find_first_not_of("0123456789.") == std::string_view::npos);
}

Result<void> check_url(const std::string& text, const Settings& settings) {
    auto url = parse_url(text);
    if (!url || url->host.empty())
        return fail("url is no address of a web server",
                    "write it like \"https://erp.example.com/hooks/rfid\"");
    if (std::ranges::find(schemes, url->scheme) == std::end(schemes))
        return fail(fmt::format("url: {}:// is neither https:// nor http://", printable(url->scheme)));
    if (url->has_password)
        return fail("url holds a user name or a password, which others could read",
                    "give them as user and password_file");
    if (!settings.text("proxy").empty()) {
        auto proxy = parse_url(std::string(settings.text("proxy")));
        if (!proxy || proxy->has_password)
            return fail("proxy is no address, or holds a user name or a password",
                        "write it like \"http://proxy.example.com:3128\"");
    }
    if (url->scheme == "https") return {};
    for (auto* name : {"tls_ca", "tls_cert", "tls_key"})
        if (!settings.text(name).empty())
            return fail(fmt::format("{} says nothing for http://", name), "write https://, or leave it out");
    return {};
}

Result<void> check_files(const Settings& settings) {
    for (auto* name : {"tls_ca", "tls_cert", "tls_key"}) {
        std::string path(settings.text(name));
        if (!path.empty() && ::access(path.c_str(), R_OK) != 0)
            return fail(fmt::format("{}: cannot read {}: {}", name, printable(path),
                                    std::generic_category().message(errno)),
                        "is it there, and may this user read it?");
    }
    if (!settings.text("tls_key").empty() && settings.text("tls_cert").empty())
        return fail("tls_key without tls_cert", "name the certificate's file, too");
    return {};
}

Result<void> check_credentials(const Settings& settings) {
    for (auto* name : {"token", "user", "password"})
        if (!is_header_text(settings.text(name)))
            return fail(fmt::format("{} holds a control character", name));
    if (!settings.text("token").empty() && !settings.text("user").empty())
        return fail("token and user are both given", "a receiver wants one of them");
    if (settings.text("user").empty() != settings.text("password").empty())
        return fail("user and password belong together", "give both, or none");
    if (settings.text("user").find(':') != std::string_view::npos) return fail("user holds a colon");
    auto secret = settings.text("secret").size();
    if (secret != 0 && secret < shortest_secret)
        return fail(fmt::format("secret has {} characters, which can be guessed", secret),
                    "take 32 random bytes: openssl rand -hex 32");
    return {};
}

std::string basic_credentials(const Settings& settings) {
    return base64(fmt::format("{}:{}", settings.text("user"), settings.text("password")));
}

Result<std::vector<std::string>> all_headers(const Settings& settings) {
    auto out = parse_headers("headers", settings.text("headers"));
    if (!out) return out;
    auto more = parse_headers("secret_headers", settings.text("secret_headers"));
    if (!more) return more;
    out->insert(out->end(), more->begin(), more->end());
    bool has_own =
        std::ranges::any_of(*out, [](auto& line) { return alike(line.substr(0, 14), "Authorization:"); });
    if (has_own && !(settings.text("token").empty() && settings.text("user").empty()))
        return fail("an Authorization header is given beside token or user", "leave one of them out");
    if (!settings.text("token").empty())
        out->push_back(fmt::format("Authorization: Bearer {}", settings.text("token")));
    if (!settings.text("user").empty())
        out->push_back(fmt::format("Authorization: Basic {}", basic_credentials(settings)));
    return out;
}

// Whatever a receiver might repeat in an error.
std::vector<std::string> all_secrets(const Settings& settings) {
    std::vector<std::string> out;
    for (auto* name : {"secret", "token", "password"})
        out.emplace_back(settings.text(name));
    auto headers = parse_headers("secret_headers", settings.text("secret_headers"));
    for (auto& line : headers.value())
        out.push_back(line.substr(line.find(':') + 2));
    if (!settings.text("user").empty()) out.push_back(basic_credentials(settings));
    return out;
}

Result<std::unique_ptr<sink::Sink>> make(const sink::Options& options, sink::Host& /*host*/) {
    auto& settings = options.settings;
    if (auto fine = check_url(options.url, settings); !fine) return tl::unexpected(fine.error());
    if (auto fine = check_files(settings); !fine) return tl::unexpected(fine.error());
    if (auto fine = check_credentials(settings); !fine) return tl::unexpected(fine.error());
    auto headers = all_headers(settings);
    if (!headers) return tl::unexpected(headers.error());
    auto max_body = document::parse_size(settings.text("max_body"));
    if (!max_body || *max_body == 0 || *max_body > largest_body)
        return fail(
            fmt::format("max_body = \"{}\" is no size up to 1GiB", printable(settings.text("max_body"))),
            "write it like \"512KiB\" or \"1MiB\"");
    auto text = [&](std::string_view name) { return std::string(settings.text(name)); };
    WebhookOptions made{
        .connection = {.url = options.url,
                       .ca = text("tls_ca"),
                       .certificate = text("tls_cert"),
                       .key = text("tls_key"),
                       .insecure = settings.boolean("tls_insecure"),
                       .proxy = text("proxy"),
                       .connect_timeout = std::chrono::ceil<std::chrono::milliseconds>(
                           settings.duration("connect_timeout"))},
        .headers = std::move(*headers),
        .secret = text("secret"),
        .secrets = all_secrets(settings),
        .max_body = static_cast<std::size_t>(*max_body),
        .gzip = settings.boolean("gzip"),
        .follow_redirects = settings.boolean("follow_redirects"),
    };
    auto url = parse_url(options.url);
    if (url->scheme == "http" && !is_loopback(url->host))
        log::warn("sink", "{}: {} is not encrypted: who is on the way can read and change it; write https://",
                  printable(options.name), url->shown);
    if (made.connection.insecure)
        log::warn("sink", "{}: tls_insecure: anybody can pass for {}", printable(options.name), url->shown);
    return std::make_unique<Webhook>(std::move(made));
}

}  // namespace

const sink::Kind kind{
    .name = "webhook",
    .title = "Webhook (HTTP POST)",
    .summary =
        "batches as JSON arrays; confirmed by a 2xx answer, which is worth what the receiver makes of it",
    .schemes = schemes,
    .settings = rows,
    .batch = 1000,
    .idempotent = false,
    .sample_toml = sample_toml,
    .make = &make,
};

}  // namespace gantry::sinks::webhook
