#pragma once
#include <cstdint>
#include <string>
#include <string_view>

#include "base/error.hpp"

namespace gantry::sink {

// The server of a sink, from its url: "mqtts://broker:8883".
struct ServerAddress {
    std::string scheme, host;  // an IPv6 address without its brackets
    std::uint16_t port = 0;

    // The machine itself: nobody beside it can listen to a plain connection there.
    bool is_loopback() const;
    std::string text() const;  // "host:8883", "[::1]:8883"
};

// Nothing but scheme://HOST[:PORT] is taken: credentials are settings, never part of a url that logs show.
Result<ServerAddress> parse_server_url(std::string_view url, std::uint16_t default_port);
// HOST[:PORT]
Result<ServerAddress> parse_server(std::string_view text, std::uint16_t default_port);

}  // namespace gantry::sink
