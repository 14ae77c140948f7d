#pragma once
#include <chrono>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/error.hpp"
#include "sink/server_address.hpp"

struct mosquitto;
struct mqtt5__property;

namespace gantry::sinks::mqtt {

struct Access {
    sink::ServerAddress server;
    bool tls = false, tls_insecure = false;
    std::string tls_ca, tls_cert, tls_key;  // files; no tls_ca: what the system trusts
    std::string user, password, client_id;
    bool version_5 = true;
    std::chrono::seconds keepalive{30};
    std::uint16_t window = 100;  // unacknowledged messages
    std::string will_topic;      // "offline" is put there when we go; empty: nowhere
};

// A message with QoS 1 was answered. MQTT 3.1.1 has no code but 0.
struct Ack {
    int mid = 0;
    std::uint8_t code = 0;
    std::string said;
};

struct Incoming {
    std::string topic, payload;
    bool retained = false;
    std::string response_topic, correlation;  // MQTT 5
};

void start_library();  // before the first connection

// One connection to a broker, from its beginning to its end: what the library would send again by itself on
// the next one goes with it. Driven by turn() on the caller's thread.
class Connection {
public:
    // Blocks until the broker's port is open or is not, which may take minutes.
    static Result<std::unique_ptr<Connection>> open(const Access& access);
    ~Connection();
    Connection(const Connection&) = delete;
    Connection& operator=(const Connection&) = delete;

    enum class State : std::uint8_t { opening, open, lost };
    State state() const { return state_; }
    const std::string& trouble() const { return trouble_; }  // why it is lost
    // Of the broker, once it is open.
    std::size_t window() const { return window_; }
    std::size_t max_packet() const { return max_packet_; }
    bool retains() const { return retains_; }

    // Waits so long at most for something to happen, and handles all that has.
    void turn(std::chrono::milliseconds at_most);
    std::vector<Ack> take_acks() { return std::exchange(acks_, {}); }
    std::vector<Incoming> take_incoming() { return std::exchange(incoming_, {}); }
    std::vector<std::string> take_denied() {
        return std::exchange(denied_, {});
    }  // filters not subscribed to

    struct Handed {
        int mid = 0;  // 0: not handed over
        std::string refusal =
            {};  // the message cannot be sent at all; empty and no mid: the connection is lost
    };
    // QoS 1. `correlation` goes along in MQTT 5.
    Handed publish(const std::string& topic, std::string_view payload, bool retain,
                   std::string_view correlation = {});
    std::size_t in_flight() const { return in_flight_; }
    void subscribe(const std::string& filter);
    // Says "offline" and goodbye, and waits for no answer.
    void leave(std::chrono::milliseconds at_most);

private:
    struct Callbacks;
    Connection() = default;
    Result<void> start(const Access& access);
    Result<void> use_tls(const Access& access);
    void read();
    void written(int code);
    bool still(int code);  // false: the library says that the connection is over
    void lose(std::string why);
    std::string failure(int code) const;

    mosquitto* client_ = nullptr;
    mqtt5__property* properties_ = nullptr;  // of each message that is JSON
    bool version_5_ = true;
    std::string will_topic_;
    State state_ = State::opening;
    std::string trouble_, logged_;  // logged_: the library's last complaint
    std::size_t window_ = 0, max_packet_ = 0, in_flight_ = 0;
    bool retains_ = true;
    std::vector<Ack> acks_;
    std::vector<Incoming> incoming_;
    std::vector<std::pair<int, std::string>> subscribing_;
    std::vector<std::string> denied_;
};

}  // namespace gantry::sinks::mqtt
