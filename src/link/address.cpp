#include <arpa/inet.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>

#include "base/text.hpp"
#include "link/link.hpp"

namespace gantry::link {

namespace {

// Both families as 128 bits: IPv4 lies in ::ffff:0:0/96, so a mapped address is the same as the plain one.
using Address = std::array<std::uint8_t, 16>;
constexpr unsigned v4_offset = 96;

struct Network {
    Address address{};
    unsigned bits = 0;  // of the 128 that must match
};

std::optional<unsigned> number(std::string_view text, unsigned most) {
    unsigned value = 0;
    auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (text.empty() || error != std::errc{} || end != text.data() + text.size() || value > most) return {};
    return value;
}

struct Parsed {
    Address address{};
    bool v4 = false;
};

std::optional<Parsed> parse_address(std::string_view text) {
    if (auto scope = text.find('%'); scope != std::string_view::npos) text = text.substr(0, scope);
    std::string ended(text);  // inet_pton wants a zero at the end
    if (ended.find('\0') != std::string::npos) return {};
    Parsed parsed;
    in_addr v4{};
    if (inet_pton(AF_INET, ended.c_str(), &v4) == 1) {
        parsed.v4 = true;
        parsed.address[10] = parsed.address[11] = 0xFF;
        std::copy_n(reinterpret_cast<const std::uint8_t*>(&v4), 4, parsed.address.begin() + 12);
        return parsed;
    }
    if (inet_pton(AF_INET6, ended.c_str(), parsed.address.data()) == 1) return parsed;
    return {};
}

std::optional<Network> parse_network(std::string_view text) {
    auto slash = text.find('/');
    auto parsed = parse_address(text.substr(0, slash));
    if (!parsed) return {};
    Network network{parsed->address, 128};
    if (slash != std::string_view::npos) {
        auto bits = number(text.substr(slash + 1), parsed->v4 ? 32 : 128);
        if (!bits) return {};
        network.bits = *bits + (parsed->v4 ? v4_offset : 0);
    }
    return network;
}

bool is_host_name(std::string_view text) {
    return !text.empty() && text.size() <= 253 && std::ranges::all_of(text, [](char c) {
        return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.' ||
               c == '-' || c == '_';
    });
}

}  // namespace

Result<Endpoint> parse_endpoint(std::string_view text) {
    auto refuse = [&](std::string_view why, std::string_view hint) {
        return fail(fmt::format("\"{}\" is no address with a port: {}", printable(text), why),
                    std::string(hint));
    };
    constexpr std::string_view shape = "write it as 192.168.0.5:9055, [fe80::1]:9055, dock-1:9055 or :9055";
    auto colon = text.rfind(':');
    if (colon == std::string_view::npos || (text.ends_with(']') && text.starts_with('['))) {
        return refuse("the port is missing", shape);
    }
    auto host = text.substr(0, colon);
    auto port = number(text.substr(colon + 1), 65535);
    if (!port) return refuse("the port must be a number from 0 to 65535", shape);
    if (host.starts_with('[')) {
        if (!host.ends_with(']')) return refuse("the closing bracket is missing", shape);
        host = host.substr(1, host.size() - 2);
        auto parsed = parse_address(host);
        if (!parsed || parsed->v4) return refuse("what is in the brackets is no IPv6 address", shape);
    } else if (host.find(':') != std::string_view::npos) {
        return refuse("it has more than one colon", "put an IPv6 address in brackets: [::1]:9055");
    } else if (!host.empty() && !is_host_name(host)) {
        return refuse("the host is neither an address nor a name", shape);
    }
    return Endpoint{std::string(host), static_cast<std::uint16_t>(*port)};
}

std::string to_text(const Endpoint& endpoint) {
    if (endpoint.host.find(':') != std::string::npos) {
        return fmt::format("[{}]:{}", endpoint.host, endpoint.port);
    }
    return fmt::format("{}:{}", endpoint.host, endpoint.port);
}

bool is_network(std::string_view text) {
    return parse_network(text).has_value();
}

bool in_network(std::string_view address, std::string_view network) {
    auto parsed = parse_address(address);
    auto wanted = parse_network(network);
    if (!parsed || !wanted) return false;
    auto whole = wanted->bits / 8;
    if (!std::equal(parsed->address.begin(), parsed->address.begin() + whole, wanted->address.begin())) {
        return false;
    }
    auto rest = wanted->bits % 8;
    if (rest == 0) return true;
    auto mask = static_cast<std::uint8_t>(0xFF << (8 - rest));
    return ((parsed->address[whole] ^ wanted->address[whole]) & mask) == 0;
}

}  // namespace gantry::link
