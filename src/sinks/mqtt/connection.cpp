#include "sinks/mqtt/connection.hpp"

#include <mosquitto.h>
#include <mqtt_protocol.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <mutex>
#include <string>

#include <fmt/format.h>

#include "base/text.hpp"
#include "sinks/mqtt/reasons.hpp"

namespace gantry::sinks::mqtt {

namespace {
constexpr std::size_t largest_packet = 268'435'455;  // MQTT's own limit of what follows the length
constexpr std::uint32_t largest_incoming = 256 * 1024;
constexpr std::size_t most_incoming = 64;  // messages; what follows waits in the socket

// A key that needs a password is refused; without this OpenSSL would ask at the terminal.
int no_key_password(char*, int, int, void*) {
    return 0;
}

std::string text_property(const mosquitto_property* properties, int which) {
    char* text = nullptr;
    mosquitto_property_read_string(properties, which, &text, false);
    std::string out = text == nullptr ? "" : text;
    std::free(text);
    return out;
}

std::string binary_property(const mosquitto_property* properties, int which) {
    void* bytes = nullptr;
    std::uint16_t size = 0;
    mosquitto_property_read_binary(properties, which, &bytes, &size, false);
    std::string out(static_cast<const char*>(bytes), bytes == nullptr ? 0u : size);
    std::free(bytes);
    return out;
}

mosquitto_property* json_properties() {
    mosquitto_property* out = nullptr;
    mosquitto_property_add_byte(&out, MQTT_PROP_PAYLOAD_FORMAT_INDICATOR, 1);  // UTF-8
    mosquitto_property_add_string(&out, MQTT_PROP_CONTENT_TYPE, "application/json");
    return out;
}

const char* or_null(const std::string& text) {
    return text.empty() ? nullptr : text.c_str();
}
}  // namespace

// What the library calls while it is in loop_read() and its like, on our thread.
struct Connection::Callbacks {
    static Connection& of(void* self) { return *static_cast<Connection*>(self); }

    static void connected(mosquitto*, void* self, int code, int, const mosquitto_property* properties) {
        auto& to = of(self);
        if (code != 0) {
            to.lose(connack_text(static_cast<std::uint8_t>(code), to.version_5_,
                                 text_property(properties, MQTT_PROP_REASON_STRING)));
            return;
        }
        std::uint16_t window = 0xFFFF;
        std::uint32_t packet = largest_packet;
        std::uint8_t quality = 2, retain = 1;
        mosquitto_property_read_int16(properties, MQTT_PROP_RECEIVE_MAXIMUM, &window, false);
        mosquitto_property_read_int32(properties, MQTT_PROP_MAXIMUM_PACKET_SIZE, &packet, false);
        mosquitto_property_read_byte(properties, MQTT_PROP_MAXIMUM_QOS, &quality, false);
        mosquitto_property_read_byte(properties, MQTT_PROP_RETAIN_AVAILABLE, &retain, false);
        if (quality == 0) {
            to.lose("the broker confirms nothing: it takes messages with QoS 0 only; use another broker");
            return;
        }
        to.window_ = std::clamp<std::size_t>(to.window_, 1, std::max<std::size_t>(window, 1));
        to.max_packet_ = packet;
        to.retains_ = retain != 0;
        to.state_ = State::open;
    }

    static void disconnected(mosquitto*, void* self, int code, const mosquitto_property* properties) {
        auto& to = of(self);
        if (code < 0x80) {
            to.lose(to.failure(code));
            return;
        }
        to.lose(disconnect_text(static_cast<std::uint8_t>(code),
                                text_property(properties, MQTT_PROP_REASON_STRING)));
    }

    static void published(mosquitto*, void* self, int mid, int code, const mosquitto_property* properties) {
        auto& to = of(self);
        if (to.in_flight_ > 0) --to.in_flight_;
        to.acks_.push_back(
            {mid, static_cast<std::uint8_t>(code), text_property(properties, MQTT_PROP_REASON_STRING)});
    }

    static void arrived(mosquitto*, void* self, const mosquitto_message* message,
                        const mosquitto_property* properties) {
        of(self).incoming_.push_back(
            {.topic = message->topic,
             .payload = std::string(
                 static_cast<const char*>(message->payload),
                 message->payload == nullptr ? 0u : static_cast<std::size_t>(message->payloadlen)),
             .retained = message->retain,
             .response_topic = text_property(properties, MQTT_PROP_RESPONSE_TOPIC),
             .correlation = binary_property(properties, MQTT_PROP_CORRELATION_DATA)});
    }

    static void subscribed(mosquitto*, void* self, int mid, int count, const int* granted,
                           const mosquitto_property*) {
        auto& to = of(self);
        auto asked = std::ranges::find(to.subscribing_, mid, &std::pair<int, std::string>::first);
        if (asked == to.subscribing_.end()) return;
        if (count < 1 || granted[0] > 2) to.denied_.push_back(asked->second);
        to.subscribing_.erase(asked);
    }

    static void logged(mosquitto*, void* self, int level, const char* text) {
        if (level == MOSQ_LOG_ERR || level == MOSQ_LOG_WARNING) of(self).logged_ = text;
    }
};

void start_library() {
    static std::once_flag once;
    std::call_once(once, [] { mosquitto_lib_init(); });
}

Result<std::unique_ptr<Connection>> Connection::open(const Access& access) {
    std::unique_ptr<Connection> out(new Connection);
    if (auto started = out->start(access); !started) return tl::unexpected(started.error());
    return out;
}

Connection::~Connection() {
    mosquitto_destroy(client_);
    mosquitto_property_free_all(&properties_);
}

Result<void> Connection::start(const Access& access) {
    client_ = mosquitto_new(access.client_id.c_str(), true, this);
    if (client_ == nullptr) return fail("the MQTT client library does not start");
    version_5_ = access.version_5;
    will_topic_ = access.will_topic;
    window_ = access.window;
    mosquitto_int_option(client_, MOSQ_OPT_PROTOCOL_VERSION,
                         version_5_ ? MQTT_PROTOCOL_V5 : MQTT_PROTOCOL_V311);
    mosquitto_int_option(client_, MOSQ_OPT_TCP_NODELAY, 1);
    mosquitto_max_inflight_messages_set(client_, access.window);
    mosquitto_log_callback_set(client_, &Callbacks::logged);
    mosquitto_connect_v5_callback_set(client_, &Callbacks::connected);
    mosquitto_disconnect_v5_callback_set(client_, &Callbacks::disconnected);
    mosquitto_publish_v5_callback_set(client_, &Callbacks::published);
    mosquitto_message_v5_callback_set(client_, &Callbacks::arrived);
    mosquitto_subscribe_v5_callback_set(client_, &Callbacks::subscribed);
    if (!access.user.empty())
        mosquitto_username_pw_set(client_, access.user.c_str(), or_null(access.password));
    if (!will_topic_.empty())
        mosquitto_will_set(client_, will_topic_.c_str(), std::strlen("offline"), "offline", 1, true);
    if (access.tls)
        if (auto tls = use_tls(access); !tls) return tls;
    mosquitto_property* asked = nullptr;
    if (version_5_) {
        mosquitto_property_add_int32(&asked, MQTT_PROP_MAXIMUM_PACKET_SIZE, largest_incoming);
        properties_ = json_properties();
    }
    int code = mosquitto_connect_bind_v5(client_, access.server.host.c_str(), access.server.port,
                                         static_cast<int>(access.keepalive.count()), nullptr, asked);
    auto why = code == MOSQ_ERR_SUCCESS ? std::string{} : failure(code);
    mosquitto_property_free_all(&asked);
    if (code != MOSQ_ERR_SUCCESS) return fail(why);
    return {};
}

Result<void> Connection::use_tls(const Access& access) {
    // The library wants a place of its own to trust in even when it is told to trust the system's.
    auto* system = access.tls_ca.empty() ? "/etc/ssl/certs" : nullptr;
    if (system != nullptr) mosquitto_int_option(client_, MOSQ_OPT_TLS_USE_OS_CERTS, 1);
    int code = mosquitto_tls_set(client_, or_null(access.tls_ca), system, or_null(access.tls_cert),
                                 or_null(access.tls_key), &no_key_password);
    if (code == MOSQ_ERR_SUCCESS)
        code = mosquitto_tls_opts_set(client_, access.tls_insecure ? 0 : 1, nullptr, nullptr);
    if (code == MOSQ_ERR_SUCCESS) code = mosquitto_tls_insecure_set(client_, access.tls_insecure);
    if (code != MOSQ_ERR_SUCCESS) return fail(fmt::format("TLS cannot be used: {}", failure(code)));
    return {};
}

std::string Connection::failure(int code) const {
    std::string what = code == MOSQ_ERR_ERRNO ? std::strerror(errno) : mosquitto_strerror(code);
    bool tls =
        code == MOSQ_ERR_TLS || code == MOSQ_ERR_TLS_HANDSHAKE || (code == MOSQ_ERR_ERRNO && errno == EPROTO);
    if (tls && !logged_.empty()) return fmt::format("TLS failed: {}", printable(logged_));
    return printable(what);
}

void Connection::lose(std::string why) {
    if (state_ == State::lost) return;  // the first reason is the one
    state_ = State::lost;
    trouble_ = std::move(why);
}

bool Connection::still(int code) {
    if (code != MOSQ_ERR_SUCCESS) lose(failure(code));
    return state_ != State::lost;
}

// The library's own loop waits with select(), which cannot look at a descriptor beyond 1023.
void Connection::turn(std::chrono::milliseconds at_most) {
    if (state_ == State::lost) return;
    pollfd socket{mosquitto_socket(client_), POLLIN, 0};
    if (mosquitto_want_write(client_)) socket.events |= POLLOUT;
    // Brokers hold a second small answer back until the first is acknowledged, which would take 40 ms.
    int at_once = 1;
    setsockopt(socket.fd, IPPROTO_TCP, TCP_QUICKACK, &at_once, sizeof at_once);
    poll(&socket, 1, static_cast<int>(at_most.count()));
    read();
    if (state_ == State::lost) return;
    if (mosquitto_want_write(client_)) written(mosquitto_loop_write(client_, 1));
    if (state_ != State::lost) still(mosquitto_loop_misc(client_));
}

// Until there is nothing left: TLS may hold back bytes that poll() does not see.
void Connection::read() {
    do {
        errno = 0;
        if (!still(mosquitto_loop_read(client_, 1))) return;
    } while (errno != EAGAIN && incoming_.size() < most_incoming);
}

// What cannot be written any more may have been answered, with confirmations and with the reason.
void Connection::written(int code) {
    if (code == MOSQ_ERR_SUCCESS) return;
    auto why = failure(code);
    if (mosquitto_socket(client_) >= 0) read();
    lose(std::move(why));
}

Connection::Handed Connection::publish(const std::string& topic, std::string_view payload, bool retain,
                                       std::string_view correlation) {
    if (state_ != State::open) return {};
    if (payload.size() > largest_packet) return {.mid = 0, .refusal = "it is larger than MQTT allows"};
    auto* properties = payload.starts_with('{') || payload.starts_with('[') ? properties_ : nullptr;
    mosquitto_property* own = nullptr;
    if (version_5_ && !correlation.empty()) {
        own = json_properties();  // of a copy the library would send the first one only
        mosquitto_property_add_binary(&own, MQTT_PROP_CORRELATION_DATA, correlation.data(),
                                      static_cast<std::uint16_t>(correlation.size()));
    }
    int mid = 0;
    int code = mosquitto_publish_v5(client_, &mid, topic.c_str(), static_cast<int>(payload.size()),
                                    payload.data(), 1, retain, own != nullptr ? own : properties);
    mosquitto_property_free_all(&own);
    switch (code) {
        case MOSQ_ERR_SUCCESS:
            ++in_flight_;
            return {.mid = mid};
        case MOSQ_ERR_OVERSIZE_PACKET:
            return {
                .mid = 0,
                .refusal = fmt::format("its {} bytes are more than the {} that the broker takes in a message",
                                       payload.size(), max_packet_)};
        case MOSQ_ERR_INVAL:
        case MOSQ_ERR_PAYLOAD_SIZE:
        case MOSQ_ERR_MALFORMED_UTF8:
        case MOSQ_ERR_RETAIN_NOT_SUPPORTED:
            return {.mid = 0, .refusal = mosquitto_strerror(code)};
        default:
            written(code);
            return {};
    }
}

void Connection::subscribe(const std::string& filter) {
    int mid = 0;
    int code = mosquitto_subscribe_v5(client_, &mid, filter.c_str(), 1,
                                      version_5_ ? MQTT_SUB_OPT_NO_LOCAL : 0, nullptr);
    if (still(code)) subscribing_.emplace_back(mid, filter);
}

void Connection::leave(std::chrono::milliseconds at_most) {
    if (state_ != State::open) return;
    if (!will_topic_.empty())  // the same as the will, which a broker forgets when it is told goodbye
        mosquitto_publish_v5(client_, nullptr, will_topic_.c_str(), std::strlen("offline"), "offline", 0,
                             true, nullptr);
    mosquitto_disconnect(client_);
    auto end = std::chrono::steady_clock::now() + at_most;
    while (state_ == State::open && mosquitto_want_write(client_)) {
        auto left =
            std::chrono::duration_cast<std::chrono::milliseconds>(end - std::chrono::steady_clock::now());
        if (left.count() <= 0) return;
        turn(left);
    }
}

}  // namespace gantry::sinks::mqtt
