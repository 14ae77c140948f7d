#pragma once
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/error.hpp"

namespace gantry::http {

using Pairs = std::vector<std::pair<std::string, std::string>>;

// A request as a handler sees it. Everything in it comes from the peer.
struct Request {
    std::string method;  // "GET"
    std::string path;    // decoded: "/api/v1/readers/dock 1"
    Pairs query;         // decoded, in their order
    Pairs headers;       // as they were sent
    std::string body;

    std::optional<std::string_view> parameter(std::string_view name) const;  // the first of that name
    std::optional<std::string_view> header(std::string_view name) const;     // in any case
};

struct Response {
    int status = 200;
    std::string content_type = "application/json";
    std::string body;
    Pairs headers = {};
    // Instead of a body, for what is long or has no end. Called on a worker until it returns false; what it
    // put into `chunk` is sent. A chunk left empty means nothing new yet: it is asked again a moment later.
    // Never called again (and destroyed) when the client is gone.
    std::function<bool(std::string& chunk)> stream = {};
};

// An error as every program gets it, RFC 9457: {"status":404,"title":"what happened","detail":"what to do"}.
Response refusal(int status, const Error& error);

// Splits "/a%20b?x=1&y" into its decoded path and parameters.
struct Target {
    std::string path;
    Pairs query;
};
Result<Target> parse_target(std::string_view target);
// Percent-encodes everything but letters, digits and -._~
std::string encode_component(std::string_view text);

}  // namespace gantry::http
