#pragma once
#include <gtest/gtest.h>

#include <atomic>
#include <condition_variable>
#include <filesystem>
#include <memory>
#include <mutex>
#include <thread>

#include "http/client.hpp"
#include "http/server.hpp"
#include "testkit/eventually.hpp"
#include "testkit/peer.hpp"
#include "testkit/temp_dir.hpp"

// What the tests of this module share.
namespace gantry::http {

using namespace std::chrono_literals;
using testkit::eventually;
using testkit::Peer;

// Handlers wait here until a test opens it.
class Gate {
public:
    void open() {
        std::lock_guard lock(mutex_);
        open_ = true;
        changed_.notify_all();
    }
    bool pass() {
        std::unique_lock lock(mutex_);
        return changed_.wait_for(lock, 60s, [&] { return open_; });
    }

private:
    std::mutex mutex_;
    std::condition_variable changed_;
    bool open_ = false;
};

// A server on a Unix socket of its own, and its client.
struct Http : ::testing::Test {
    testkit::TempDir dir{"/tmp"};  // the path of a Unix socket must be short
    const std::filesystem::path folder = dir.path(), path = folder / "gantry.sock";
    Limits limits;
    std::unique_ptr<Server> server;

    void serve(Handler handler) {
        auto opened = Server::open(path, std::move(handler), limits);
        ASSERT_TRUE(opened) << opened.error().text();
        server = std::move(*opened);
    }
    void serve_echo() {
        serve([](const Request& request) {
            Response response;
            response.content_type = "text/plain";
            response.body = request.method + " " + request.path;
            for (auto& [key, value] : request.query)
                response.body.append(" ").append(key).append("=").append(value);
            if (!request.body.empty()) response.body += " " + request.body;
            return response;
        });
    }
    Result<Response> get(std::string_view target, std::chrono::milliseconds timeout = 60s) {
        return request(path, "GET", target, {}, timeout);
    }
};

}  // namespace gantry::http
