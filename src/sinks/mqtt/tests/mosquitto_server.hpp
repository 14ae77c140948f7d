#pragma once
#include <arpa/inet.h>
#include <mosquitto.h>
#include <mqtt_protocol.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <memory>
#include <mutex>
#include <optional>
#include <random>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "sinks/mqtt/mqtt_sink.hpp"
#include "testkit/eventually.hpp"
#include "testkit/peer.hpp"
#include "testkit/process.hpp"
#include "testkit/sink_suite.hpp"
#include "testkit/temp_dir.hpp"

namespace gantry::sinks::mqtt {
extern const sink::Kind kind;
}

namespace gantry::sinks::mqtt::tests {

using namespace std::chrono_literals;
using testkit::eventually;

inline sockaddr_in loopback(std::uint16_t port) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    return address;
}

// Below the range from which the system takes ports for connections: nobody takes it while the server is
// down.
inline std::uint16_t free_port() {
    static std::minstd_rand random{std::random_device{}()};
    for (int tries = 0; tries < 1000; ++tries) {
        auto port = static_cast<std::uint16_t>(10'000 + random() % 20'000);
        auto address = loopback(port);
        int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
        bool free = bind(fd, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0;
        close(fd);
        if (free) return port;
    }
    ADD_FAILURE() << "no free port";
    return 0;
}

inline bool answers(std::uint16_t port) {
    auto address = loopback(port);
    int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    bool open = connect(fd, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0;
    close(fd);
    return open;
}

// A broker of the test's own.
class MosquittoServer {
public:
    // `extra`: more lines of its configuration; "DIR" in them is its directory.
    explicit MosquittoServer(std::string extra = "allow_anonymous true\n")
        : port_(free_port()), extra_(std::move(extra)) {
        for (auto at = extra_.find("DIR"); at != std::string::npos; at = extra_.find("DIR"))
            extra_.replace(at, 3, dir_.path());
    }
    void start() {
        testkit::write_file(
            dir_.path() + "/mosquitto.conf",
            fmt::format("user root\npersistence false\nlog_dest stderr\nlistener {} 127.0.0.1\n{}", port_,
                        extra_));
        process_.emplace(
            std::vector<std::string>{"/usr/sbin/mosquitto", "-c", dir_.path() + "/mosquitto.conf"},
            std::vector<std::string>{}, dir_.path() + "/stderr");
        ASSERT_TRUE(eventually([&] { return answers(port_); })) << "mosquitto does not start";
    }
    void kill() { process_.reset(); }
    void pause() { process_->signal(SIGSTOP); }
    void resume() { process_->signal(SIGCONT); }
    std::uint16_t port() const { return port_; }
    const std::string& dir() const { return dir_.path(); }

private:
    testkit::TempDir dir_;
    std::uint16_t port_;
    std::string extra_;
    std::optional<testkit::Process> process_;
};

struct Heard {
    std::string topic, payload;
    bool retained = false;
    std::string content_type, correlation;
};

// A second client that hears what the broker passes on. QoS 0: what a killed broker has confirmed to the sink
// is on its way then, and not in a queue that dies with it.
class Listener {
public:
    explicit Listener(std::uint16_t port, std::string filter = "#", std::string user = {},
                      std::string password = {})
        : port_(port), filter_(std::move(filter)), user_(std::move(user)), password_(std::move(password)) {
        mosquitto_lib_init();
    }
    ~Listener() { stop(); }
    Listener(const Listener&) = delete;
    Listener& operator=(const Listener&) = delete;

    void start() {
        stop();
        ready_ = false;
        client_ = mosquitto_new(nullptr, true, this);
        mosquitto_int_option(client_, MOSQ_OPT_PROTOCOL_VERSION, MQTT_PROTOCOL_V5);
        if (!user_.empty()) mosquitto_username_pw_set(client_, user_.c_str(), password_.c_str());
        mosquitto_subscribe_v5_callback_set(
            client_, [](mosquitto*, void* self, int, int, const int*, const mosquitto_property*) {
                static_cast<Listener*>(self)->ready_ = true;
            });
        mosquitto_message_v5_callback_set(client_,
                                          [](mosquitto*, void* self, const mosquitto_message* message,
                                             const mosquitto_property* properties) {
                                              static_cast<Listener*>(self)->hear(*message, properties);
                                          });
        ASSERT_EQ(mosquitto_connect_bind_v5(client_, "127.0.0.1", port_, 60, nullptr, nullptr),
                  MOSQ_ERR_SUCCESS);
        mosquitto_subscribe(client_, nullptr, filter_.c_str(), 0);
        going_ = true;
        thread_ = std::thread([this] {
            while (going_ && mosquitto_loop(client_, 20, 1) == MOSQ_ERR_SUCCESS) {
                std::lock_guard lock(mutex_);
                for (auto& [topic, payload, properties, retain] : outgoing_) {
                    mosquitto_publish_v5(client_, nullptr, topic.c_str(), static_cast<int>(payload.size()),
                                         payload.data(), 1, retain, properties);
                    mosquitto_property_free_all(&properties);
                }
                outgoing_.clear();
            }
            ended_ = true;
        });
        ASSERT_TRUE(eventually([&] { return ready_.load(); }));
    }
    void stop() {
        going_ = false;
        if (thread_.joinable()) thread_.join();
        if (client_ != nullptr) mosquitto_destroy(client_);
        client_ = nullptr;
    }
    // The broker is gone and all that came from it is heard.
    void drain() {
        if (thread_.joinable()) thread_.join();
    }
    void publish(std::string topic, std::string payload, bool retain = false, std::string response_topic = {},
                 std::string correlation = {}) {
        mosquitto_property* properties = nullptr;
        if (!response_topic.empty())
            mosquitto_property_add_string(&properties, MQTT_PROP_RESPONSE_TOPIC, response_topic.c_str());
        if (!correlation.empty())
            mosquitto_property_add_binary(&properties, MQTT_PROP_CORRELATION_DATA, correlation.data(),
                                          static_cast<std::uint16_t>(correlation.size()));
        std::lock_guard lock(mutex_);
        outgoing_.emplace_back(std::move(topic), std::move(payload), properties, retain);
    }
    std::vector<Heard> all() {
        std::lock_guard lock(mutex_);
        return heard_;
    }
    // The last message on a topic, once there is one that `fits`.
    template <class Fits>
    Heard wait_for(const std::string& topic, Fits fits) {
        Heard found;
        EXPECT_TRUE(eventually([&] {
            auto now = all();
            auto it = std::find_if(now.rbegin(), now.rend(), [&](auto& each) { return each.topic == topic; });
            if (it == now.rend() || !fits(*it)) return false;
            found = *it;
            return true;
        })) << topic;
        return found;
    }
    Heard wait_for(const std::string& topic) {
        return wait_for(topic, [](const Heard&) { return true; });
    }

private:
    void hear(const mosquitto_message& message, const mosquitto_property* properties) {
        Heard heard{.topic = message.topic,
                    .payload = std::string(
                        static_cast<const char*>(message.payload),
                        message.payload == nullptr ? 0u : static_cast<std::size_t>(message.payloadlen)),
                    .retained = message.retain,
                    .content_type = {},
                    .correlation = {}};
        char* text = nullptr;
        if (mosquitto_property_read_string(properties, MQTT_PROP_CONTENT_TYPE, &text, false) != nullptr)
            heard.content_type = text;
        std::free(text);
        void* bytes = nullptr;
        std::uint16_t size = 0;
        if (mosquitto_property_read_binary(properties, MQTT_PROP_CORRELATION_DATA, &bytes, &size, false) !=
            nullptr)
            heard.correlation = std::string(static_cast<const char*>(bytes), size);
        std::free(bytes);
        std::lock_guard lock(mutex_);
        heard_.push_back(std::move(heard));
    }

    std::uint16_t port_;
    std::string filter_, user_, password_;
    mosquitto* client_ = nullptr;
    std::thread thread_;
    std::atomic<bool> going_ = false, ready_ = false, ended_ = false;
    std::mutex mutex_;
    std::vector<Heard> heard_;
    std::vector<std::tuple<std::string, std::string, mosquitto_property*, bool>> outgoing_;
};

using Given = std::vector<std::pair<std::string, std::string>>;

inline Result<std::unique_ptr<sink::Sink>> try_make(const std::string& url, const Given& given,
                                                    sink::Host& host, bool commands = false) {
    auto settings = Settings::make(kind.settings, given);
    if (!settings) return tl::unexpected(settings.error());
    return kind.make({.name = "broker",
                      .gateway_id = "site-7",
                      .url = url,
                      .settings = *settings,
                      .batch = 1000,
                      .commands = commands},
                     host);
}

inline std::unique_ptr<sink::Sink> make(const std::string& url, const Given& given, sink::Host& host,
                                        bool commands = false) {
    auto made = try_make(url, given, host, commands);
    EXPECT_TRUE(made) << (made ? "" : made.error().text());
    return made ? *std::move(made) : nullptr;
}

inline std::string url_of(std::uint16_t port) {
    return fmt::format("mqtt://127.0.0.1:{}", port);
}

inline std::size_t count(const sink::Outcome& outcome, sink::Fate fate) {
    return static_cast<std::size_t>(std::ranges::count(outcome.fates, fate));
}

// The ids in an event or an array of events, as they stand there.
inline std::vector<std::string> ids_in(const std::string& payload) {
    std::vector<std::string> out;
    constexpr std::string_view mark = R"("id":")";
    for (auto at = payload.find(mark); at != std::string::npos; at = payload.find(mark, at + 1)) {
        auto begin = at + mark.size();
        out.push_back(payload.substr(begin, payload.find('"', begin) - begin));
    }
    return out;
}

// What the suite needs; `given` are the settings of its sinks.
class MosquittoDestination : public testkit::Destination {
public:
    explicit MosquittoDestination(Given given = {}, std::string extra = "allow_anonymous true\n")
        : server_(std::move(extra)),
          listener_(server_.port(), "gantry/+/+/events"),
          given_(std::move(given)) {}

    void start() override {
        server_.start();
        listener_.start();
    }
    void kill() override {
        server_.kill();
        listener_.drain();
    }
    std::unique_ptr<sink::Sink> make_sink() override;
    std::vector<std::string> ids() override {
        std::vector<std::string> out;
        for (auto& each : listener_.all())
            std::ranges::move(ids_in(each.payload), std::back_inserter(out));
        return out;
    }
    bool refuse(const std::string& id) override {
        if (!refuses_) return false;
        too_large_.insert(id);
        return true;
    }

protected:
    bool refuses_ = false;  // its broker has a limit of size
    std::set<std::string> too_large_;
    testkit::QuietHost host_;
    MosquittoServer server_;
    Listener listener_;
    Given given_;
};

// Makes some events larger than the broker takes: a real server refuses nothing else by its content.
class Padding : public sink::Sink {
public:
    Padding(std::unique_ptr<sink::Sink> sink, const std::set<std::string>& ids)
        : sink_(std::move(sink)), ids_(ids) {}
    sink::Outcome deliver(std::span<const sink::Item> batch, const sink::Patience& patience) override {
        std::vector<sink::Item> items(batch.begin(), batch.end());
        for (auto& item : items) {
            if (!ids_.contains(std::string(item.id))) continue;
            auto padded =
                std::string(item.payload.substr(0, item.payload.size() - 1)) + std::string(8000, ' ') + '}';
            item.payload = kept_.emplace_back(std::make_unique<std::string>(std::move(padded)))->c_str();
        }
        return sink_->deliver(items, patience);
    }
    void idle(const sink::Patience& patience) override { sink_->idle(patience); }
    bool connected() const override { return sink_->connected(); }

private:
    std::unique_ptr<sink::Sink> sink_;
    const std::set<std::string>& ids_;
    std::vector<std::unique_ptr<std::string>> kept_;
};

inline std::unique_ptr<sink::Sink> MosquittoDestination::make_sink() {
    return std::make_unique<Padding>(make(url_of(server_.port()), given_, host_), too_large_);
}

}  // namespace gantry::sinks::mqtt::tests
