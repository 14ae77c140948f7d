#pragma once
#include <chrono>
#include <filesystem>
#include <functional>
#include <memory>

#include "http/message.hpp"

namespace gantry::http {

// Runs on a worker; several may run at once. What it throws becomes a 500.
using Handler = std::function<Response(const Request&)>;

struct Limits {
    std::size_t header = 16 * 1024;
    std::size_t body = 1024 * 1024;
    std::size_t connections = 64;  // one more is told 503
    std::size_t workers = 2;       // so that one slow query does not hold up the others
    std::chrono::milliseconds wait{
        30'000};                          // for a whole request, between requests, and for a client to read
    std::chrono::milliseconds poll{100};  // between two looks at a stream that had nothing new
};

// HTTP/1.1 over a Unix socket that only this user and root may use. It has threads of its own.
class Server {
public:
    // Takes the place of a socket file that nobody answers on; refuses when somebody does.
    static Result<std::unique_ptr<Server>> open(const std::filesystem::path& path, Handler handler,
                                                Limits limits = {});
    // Ends every connection and waits for the handlers under way. Removes the socket file.
    virtual ~Server() = default;
    virtual std::size_t connections() const = 0;
};

}  // namespace gantry::http
