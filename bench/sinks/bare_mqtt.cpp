#include <mosquitto.h>
#include <mqtt_protocol.h>
#include <poll.h>

#include <algorithm>
#include <cerrno>

#include <fmt/format.h>

#include "bench/load/outcome.hpp"
#include "bench/sinks/bare_client.hpp"
#include "sink/server_address.hpp"

namespace gantry::bench {

namespace {
constexpr int window = 100;  // as the sink's default
constexpr int wait_ms = 50;

void check_mqtt(int code, const char* doing) {
    if (code != MOSQ_ERR_SUCCESS)
        throw Failure(fmt::format("bare mqtt, {}: {}", doing, mosquitto_strerror(code)));
}

// MQTT 5, a message an event, QoS 1, driven by hand on one thread.
class BareMqtt final : public BareClient {
public:
    BareMqtt(const std::string& host, int port) {
        mosquitto_lib_init();
        client_ = mosquitto_new("bare", true, this);
        if (client_ == nullptr) throw Failure("bare mqtt: no client");
        mosquitto_int_option(client_, MOSQ_OPT_PROTOCOL_VERSION, MQTT_PROTOCOL_V5);
        mosquitto_int_option(client_, MOSQ_OPT_TCP_NODELAY, 1);
        mosquitto_max_inflight_messages_set(client_, window);
        mosquitto_connect_v5_callback_set(client_, [](mosquitto*, void* self, int, int,
                                                      const mosquitto_property* properties) {
            auto& to = *static_cast<BareMqtt*>(self);
            std::uint16_t most = window;  // what is beyond would wait in the library, which is slow at that
            mosquitto_property_read_int16(properties, MQTT_PROP_RECEIVE_MAXIMUM, &most, false);
            to.window_ = std::min<std::size_t>(window, most);
            to.open_ = true;
        });
        mosquitto_publish_v5_callback_set(
            client_, [](mosquitto*, void* self, int, int code, const mosquitto_property*) {
                auto& to = *static_cast<BareMqtt*>(self);
                --to.in_flight_;
                to.refused_ = to.refused_ || code >= 0x80;
            });
        check_mqtt(mosquitto_connect(client_, host.c_str(), port, 60), "connecting");
        while (!open_)
            turn();
    }
    ~BareMqtt() override { mosquitto_destroy(client_); }

    void deliver(std::span<const sink::Item> batch) override {
        for (std::size_t next = 0; next < batch.size() || in_flight_ > 0;) {
            for (; next < batch.size() && in_flight_ < window_; ++next) {
                auto& payload = batch[next].payload;
                ++in_flight_;
                check_mqtt(
                    mosquitto_publish_v5(client_, nullptr, "bare/dock-1/events",
                                         static_cast<int>(payload.size()), payload.data(), 1, false, nullptr),
                    "publishing");
            }
            turn();
        }
        if (refused_) throw Failure("bare mqtt: the broker refused a message");
    }

private:
    void turn() {
        pollfd ready{mosquitto_socket(client_),
                     static_cast<short>(mosquitto_want_write(client_) ? POLLIN | POLLOUT : POLLIN), 0};
        ::poll(&ready, 1, wait_ms);
        do {  // a call reads a packet or two
            errno = 0;
            check_mqtt(mosquitto_loop_read(client_, 1), "reading");
        } while (errno != EAGAIN);
        if ((ready.revents & POLLOUT) != 0) check_mqtt(mosquitto_loop_write(client_, 1), "writing");
        check_mqtt(mosquitto_loop_misc(client_), "waiting");
    }

    mosquitto* client_ = nullptr;
    bool open_ = false, refused_ = false;
    std::size_t in_flight_ = 0, window_ = window;
};
}  // namespace

std::unique_ptr<BareClient> bare_mqtt(const std::string& place) {
    auto server = sink::parse_server_url(place, 1883);
    if (!server) throw Failure(server.error().text());
    return std::make_unique<BareMqtt>(server->host, server->port);
}

}  // namespace gantry::bench
