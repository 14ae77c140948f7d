#pragma once
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <thread>

#include "mosquitto_server.hpp"

namespace gantry::sinks::mqtt::tests {

// A broker of MQTT 5 that answers as it is told: real ones refuse messages for reasons that a test cannot
// bring about.
class ScriptedBroker {
public:
    // The code for a message; nothing: the connection is closed; 0x8E: it is ended with that.
    using Script = std::function<std::optional<std::uint8_t>(std::string_view payload)>;

    explicit ScriptedBroker(Script script, std::uint16_t receive_maximum = 20)
        : script_(std::move(script)), receive_maximum_(receive_maximum) {
        listener_ = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
        auto address = loopback(0);
        socklen_t size = sizeof address;
        bind(listener_, reinterpret_cast<sockaddr*>(&address), size);
        listen(listener_, 5);
        getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &size);
        port_ = ntohs(address.sin_port);
        thread_ = std::thread([this] {
            while (!ending_)
                if (readable(listener_)) serve(accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC));
        });
    }
    ~ScriptedBroker() {
        ending_ = true;
        thread_.join();
        close(listener_);
    }
    std::uint16_t port() const { return port_; }
    std::size_t most_in_flight() const { return most_; }
    int connections() const { return connections_; }

private:
    static bool readable(int fd) {
        pollfd waiting{fd, POLLIN, 0};
        return poll(&waiting, 1, 10) > 0;
    }
    static std::size_t number(std::string_view at) {
        return static_cast<std::size_t>(static_cast<std::uint8_t>(at[0]) << 8 |
                                        static_cast<std::uint8_t>(at[1]));
    }
    static void say(int fd, std::string_view bytes) {
        (void)!send(fd, bytes.data(), bytes.size(), MSG_NOSIGNAL);
    }

    void serve(int fd) {
        ++connections_;
        std::string buffer, held;  // held: answers that wait until the sink waits for them
        std::size_t unanswered = 0;
        auto answer = [&] {
            say(fd, held);
            held.clear();
            unanswered = 0;
        };
        while (!ending_) {
            if (!readable(fd)) {
                answer();
                continue;
            }
            char chunk[4096];
            auto size = recv(fd, chunk, sizeof chunk, 0);
            if (size <= 0) break;
            buffer.append(chunk, static_cast<std::size_t>(size));
            bool open = true;
            while (open && handle(fd, buffer, held, unanswered, open))
                most_ = std::max<std::size_t>(most_, unanswered);
            if (!open) break;
            if (unanswered >= receive_maximum_) answer();
        }
        shutdown(fd, SHUT_WR);  // what was said must not be lost to a reset
        char rest[4096];
        while (!ending_ && (!readable(fd) || recv(fd, rest, sizeof rest, 0) > 0)) {
        }
        close(fd);
    }

    // One packet; false when the buffer holds none.
    bool handle(int fd, std::string& buffer, std::string& held, std::size_t& unanswered, bool& open) {
        std::size_t length = 0, at = 1;
        for (int shift = 0;; shift += 7, ++at) {
            if (at >= buffer.size()) return false;
            length |= static_cast<std::size_t>(buffer[at] & 0x7F) << shift;
            if ((buffer[at] & 0x80) == 0) break;
        }
        ++at;
        if (buffer.size() < at + length) return false;
        auto type = static_cast<std::uint8_t>(buffer[0]);
        auto body = buffer.substr(at, length);
        buffer.erase(0, at + length);
        if (type >> 4 == 1) {
            std::string hello = {0x20,
                                 6,
                                 0,
                                 0,
                                 3,
                                 0x21,
                                 static_cast<char>(receive_maximum_ >> 8),
                                 static_cast<char>(receive_maximum_ & 0xFF)};
            say(fd, hello);
        } else if (type >> 4 == 3 && (type & 0x06) != 0) {
            auto topic = number(body);
            auto mid = body.substr(2 + topic, 2);
            auto properties = static_cast<std::size_t>(body[4 + topic]);
            auto code = script_(std::string_view(body).substr(5 + topic + properties));
            if (!code || *code == 0x8E) {
                say(fd, held);
                if (code) say(fd, {"\xE0\1\x8E", 3});
                open = false;
                return false;
            }
            held += std::string{0x40, 3} + mid + static_cast<char>(*code);
            ++unanswered;
        } else if (type >> 4 == 8) {
            say(fd, std::string{static_cast<char>(0x90), 4} + body.substr(0, 2) + std::string(2, '\0'));
        } else if (type >> 4 == 12) {
            say(fd, {"\xD0\0", 2});
        }
        return true;
    }

    Script script_;
    std::uint16_t receive_maximum_;
    int listener_ = -1;
    std::uint16_t port_ = 0;
    std::atomic<bool> ending_ = false;
    std::atomic<std::size_t> most_ = 0;
    std::atomic<int> connections_ = 0;
    std::thread thread_;
};

}  // namespace gantry::sinks::mqtt::tests
