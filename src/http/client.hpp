#pragma once
#include <chrono>
#include <filesystem>
#include <functional>
#include <string>

#include "http/message.hpp"

namespace gantry::http {

// Gets a part of a body as soon as it comes; false ends the exchange.
using OnChunk = std::function<bool(std::string_view)>;

// One request to the gateway behind the Unix socket `path`; blocks. The answer has to begin within `timeout`,
// and without `on_chunk` to be whole by then. With it, the body of a good answer (2xx) goes there, however
// long that takes, and Response::body stays empty. An answer of any status is a Response, not an Error.
Result<Response> request(const std::filesystem::path& path, std::string_view method, std::string_view target,
                         std::string_view body = {},
                         std::chrono::milliseconds timeout = std::chrono::seconds(30),
                         const OnChunk& on_chunk = {});

}  // namespace gantry::http
