#include <algorithm>

#include <fmt/format.h>

#include "base/text.hpp"
#include "gateway/config_makes.hpp"
#include "link/serial.hpp"
#include "protocols/registry.hpp"

namespace gantry::gateway {

namespace {
std::vector<std::string_view> scheme_names(Makes makes) {
    std::vector<std::string_view> names;
    for (auto* make : makes)
        for (auto& scheme : make->schemes)
            names.push_back(scheme.name);
    return names;
}

Result<void> find_scheme(Address& address, std::string_view name, Makes makes) {
    for (auto* make : makes)
        for (auto& scheme : make->schemes)
            if (scheme.name == name) {
                address.plugin = make;
                address.scheme = &scheme;
                return {};
            }
    auto names = scheme_names(makes);
    auto near = nearest(name, names);
    return fail(fmt::format("there is no scheme \"{}\"", printable(name)),
                near.empty() ? fmt::format("schemes: {}", fmt::join(names, ", "))
                             : fmt::format("did you mean \"{}://\"?", near));
}

// Does "HOST" lack its ":PORT"? "[::1]" has colons of its own.
bool lacks_port(std::string_view authority) {
    auto colon = authority.rfind(':');
    auto bracket = authority.rfind(']');
    return colon == std::string_view::npos || (bracket != std::string_view::npos && colon < bracket);
}

Result<void> parse_authority(Address& address, std::string_view authority) {
    auto& scheme = *address.scheme;
    auto shown = printable(address.text);
    std::string with_port(authority);
    if (lacks_port(authority)) {
        if (scheme.port == 0)
            return fail(fmt::format("\"{}\" has no port", shown),
                        fmt::format("write {}://{}:PORT", scheme.name,
                                    authority.empty() ? "HOST" : printable(authority)));
        with_port += fmt::format(":{}", scheme.port);
    }
    auto endpoint = link::parse_endpoint(with_port);
    if (!endpoint) return tl::unexpected(endpoint.error());
    address.host = endpoint->host;
    address.port = endpoint->port;
    if (scheme.kind != LinkKind::dial) return {};
    if (address.host.empty())
        return fail(fmt::format("\"{}\" does not say which host to dial", shown),
                    fmt::format("write {}://HOST:{}", scheme.name, address.port));
    if (address.port == 0)
        return fail(fmt::format("\"{}\": port 0 cannot be dialled", shown), "write the reader's port");
    return {};
}

// "baud=38400&parity=even". `fallback`: what is there already stays as it is.
Result<void> parse_options(Address& address, std::string_view query, bool fallback = false) {
    while (!query.empty()) {
        auto pair = query.substr(0, query.find('&'));
        query.remove_prefix(std::min(query.size(), pair.size() + 1));
        auto equals = pair.find('=');
        if (equals == std::string_view::npos || equals == 0)
            return fail(fmt::format("\"{}\" in the address is no name=value", printable(pair)),
                        "write options like ?baud=38400");
        std::string name(pair.substr(0, equals));
        bool given = std::ranges::find(address.options, name, &std::pair<std::string, std::string>::first) !=
                     address.options.end();
        if (given && fallback) continue;
        if (given) return fail(fmt::format("option {} stands twice in the address", printable(name)));
        address.options.emplace_back(std::move(name), pair.substr(equals + 1));
    }
    return {};
}
}  // namespace

std::string scheme_list(Makes makes) {
    return fmt::format("{}", fmt::join(scheme_names(makes), ", "));
}

Result<Address> parse_address(std::string_view url, Makes makes) {
    Address address;
    address.text = url;
    auto colon = url.find("://");
    if (colon == std::string_view::npos)
        return fail(fmt::format("\"{}\" is no address", printable(url)),
                    fmt::format("write SCHEME://HOST:PORT; schemes: {}", scheme_list(makes)));
    if (auto known = find_scheme(address, url.substr(0, colon), makes); !known)
        return tl::unexpected(known.error());
    auto rest = url.substr(colon + 3);
    auto question = rest.find('?');
    auto place = rest.substr(0, question);
    auto query = question == std::string_view::npos ? std::string_view{} : rest.substr(question + 1);
    if (address.scheme->kind == LinkKind::serial) {
        if (!place.starts_with('/'))
            return fail(fmt::format("\"{}\" names no device file", printable(url)),
                        fmt::format("write {}:///dev/ttyUSB0", address.scheme->name));
        address.path = place;
        if (auto fine = parse_options(address, query); !fine) return tl::unexpected(fine.error());
        if (auto fine = parse_options(address, address.scheme->line, true); !fine)
            return tl::unexpected(fine.error());
        if (auto fine = link::parse_serial(address.path, address.options); !fine)
            return tl::unexpected(fine.error());
        return address;
    }
    if (place.ends_with('/')) place.remove_suffix(1);
    if (question != std::string_view::npos || place.find('/') != std::string_view::npos)
        return fail(fmt::format("\"{}\" has something after the port", printable(url)),
                    fmt::format("write {}://HOST:PORT", address.scheme->name));
    if (auto fine = parse_authority(address, place); !fine) return tl::unexpected(fine.error());
    return address;
}

Result<Address> parse_address(std::string_view url) {
    return parse_address(url, plugins());
}

}  // namespace gantry::gateway
