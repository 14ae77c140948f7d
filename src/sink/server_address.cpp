#include "sink/server_address.hpp"

#include <charconv>

#include <fmt/format.h>

#include "base/text.hpp"

namespace gantry::sink {

bool ServerAddress::is_loopback() const {
    return host == "localhost" || host.ends_with(".localhost") || host == "::1" ||
           (host.starts_with("127.") && host.find_first_not_of("0123456789.") == std::string::npos);
}

std::string ServerAddress::text() const {
    return host.find(':') == std::string::npos ? fmt::format("{}:{}", host, port)
                                               : fmt::format("[{}]:{}", host, port);
}

Result<ServerAddress> parse_server(std::string_view text, std::uint16_t default_port) {
    auto wrong = [&](std::string_view why) {
        return fail(fmt::format("\"{}\" is no server: {}", printable(text), why), "write HOST or HOST:PORT");
    };
    ServerAddress out{.scheme = {}, .host = {}, .port = default_port};
    auto rest = text;
    if (rest.starts_with('[')) {
        auto end = rest.find(']');
        if (end == std::string_view::npos) return wrong("the bracket is not closed");
        out.host = rest.substr(1, end - 1);
        rest.remove_prefix(end + 1);
        if (out.host.find_first_not_of("0123456789abcdefABCDEF:.") != std::string::npos)
            return wrong("only an IPv6 address stands in brackets");
    } else {
        auto end = rest.find(':');
        out.host = rest.substr(0, end);
        rest.remove_prefix(out.host.size());
        for (char c : out.host)
            if (c <= 0x20 || c >= 0x7F ||
                std::string_view("/?#@\\\"'<>,;[]").find(c) != std::string_view::npos)
                return wrong("its host has a character that no host has");
    }
    if (out.host.empty()) return wrong("it has no host");
    if (rest.empty()) return out;
    auto digits = rest.substr(1);
    auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), out.port);
    if (!rest.starts_with(':') || error != std::errc{} || end != digits.data() + digits.size() ||
        out.port == 0)
        return wrong("its port is no number from 1 to 65535");
    return out;
}

Result<ServerAddress> parse_server_url(std::string_view url, std::uint16_t default_port) {
    auto colon = url.find("://");
    if (colon == std::string_view::npos)
        return fail(fmt::format("\"{}\" is no url of a server", printable(url)),
                    "write SCHEME://HOST or SCHEME://HOST:PORT");
    auto scheme = url.substr(0, colon);
    auto server = url.substr(colon + 3);
    if (server.find('@') != std::string_view::npos)  // and the text must not show what stands before it
        return fail("a url with user or password in it is not taken",
                    "write user = \"…\" and password_file or password_env");
    if (server.ends_with('/')) server.remove_suffix(1);
    auto out = parse_server(server, default_port);
    if (out) out->scheme = scheme;
    return out;
}

}  // namespace gantry::sink
