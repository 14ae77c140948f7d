#pragma once
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <csignal>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include <boost/json.hpp>

#include "sinks/webhook/webhook.hpp"
#include "testkit/process.hpp"
#include "testkit/sink_suite.hpp"
#include "testkit/temp_dir.hpp"

// What the tests of this sink share.
namespace gantry::sinks::webhook {

namespace json = boost::json;
using Given = std::map<std::string, std::string>;

// A port that nobody else gets, also while our server is dead: bound here all the time and never listened on.
class OwnPort {
public:
    OwnPort() {
        int on = 1;
        ::setsockopt(fd_, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
        sockaddr_in address{};
        address.sin_family = AF_INET;
        address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        socklen_t size = sizeof address;
        EXPECT_EQ(::bind(fd_, reinterpret_cast<sockaddr*>(&address), size), 0);
        ::getsockname(fd_, reinterpret_cast<sockaddr*>(&address), &size);
        number_ = ntohs(address.sin_port);
    }
    OwnPort(const OwnPort&) = delete;
    OwnPort& operator=(const OwnPort&) = delete;
    ~OwnPort() { ::close(fd_); }
    std::uint16_t number() const { return number_; }

private:
    int fd_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    std::uint16_t number_ = 0;
};

// tests/webhook_server.py as a process of its own.
class WebServer {
public:
    explicit WebServer(std::vector<std::string> tls = {}) : tls_(std::move(tls)) {}

    void start() {
        std::vector<std::string> words = {
            GANTRY_PYTHON, "-S",
            std::string(GANTRY_SOURCE_DIR) + "/src/sinks/webhook/tests/webhook_server.py",
            std::to_string(port_.number()), dir_.path()};
        if (!tls_.empty()) words.emplace_back("--tls");
        words.insert(words.end(), tls_.begin(), tls_.end());
        process_ =
            std::make_unique<testkit::Process>(words, std::vector<std::string>{}, dir_.path() + "/log");
        EXPECT_EQ(process_->wait_for_line("ready"), "ready");
    }
    void kill() {
        process_->signal(SIGKILL);
        process_->wait();
    }

    // What it does from the next request on; `words` is JSON.
    void behave(const json::object& words) const {
        testkit::write_file(dir_.path() + "/behaviour.new", json::serialize(words));
        std::filesystem::rename(dir_.path() + "/behaviour.new", dir_.path() + "/behaviour");
    }
    std::vector<std::string> ids() const { return lines("ids"); }
    std::vector<json::object> requests() const {
        std::vector<json::object> out;
        for (auto& line : lines("requests"))
            out.push_back(json::parse(line).as_object());
        return out;
    }
    std::uint16_t port() const { return port_.number(); }
    std::string url() const {
        return (tls_.empty() ? "http://127.0.0.1:" : "https://127.0.0.1:") + std::to_string(port()) +
               "/hooks/rfid";
    }
    const std::string& dir() const { return dir_.path(); }

private:
    std::vector<std::string> lines(const char* name) const {
        std::ifstream file(dir_.path() + '/' + name);
        std::vector<std::string> out;
        for (std::string line; std::getline(file, line);)
            out.push_back(line);
        return out;
    }

    testkit::TempDir dir_;
    OwnPort port_;
    std::vector<std::string> tls_;
    std::unique_ptr<testkit::Process> process_;
};

inline std::string header(const json::object& request, std::string_view name) {
    auto* value = request.at("headers").as_object().if_contains(name);
    return value == nullptr ? std::string() : std::string(value->as_string());
}

inline Result<std::unique_ptr<sink::Sink>> try_make(const std::string& url, const Given& given) {
    static testkit::QuietHost host;
    std::vector<std::pair<std::string, std::string>> pairs(given.begin(), given.end());
    auto settings = Settings::make(kind.settings, pairs);
    if (!settings) return tl::unexpected(settings.error());
    return kind.make({.name = "erp", .gateway_id = "suite", .url = url, .settings = *settings, .batch = 1000},
                     host);
}

inline std::unique_ptr<sink::Sink> make_webhook(const std::string& url, const Given& given = {}) {
    auto made = try_make(url, given);
    EXPECT_TRUE(made) << made.error().text();
    return made ? std::move(*made) : nullptr;
}

inline void expect_accepted(const sink::Outcome& outcome, std::size_t items) {
    EXPECT_EQ(outcome.trouble, "");
    EXPECT_EQ(outcome.fates, std::vector(items, sink::Fate::accepted));
}

inline void expect_kept(const sink::Outcome& outcome, std::size_t items, const std::string& why) {
    EXPECT_EQ(outcome.fates, std::vector(items, sink::Fate::kept));
    EXPECT_NE(outcome.trouble.find(why), std::string::npos) << outcome.trouble;
}

}  // namespace gantry::sinks::webhook
