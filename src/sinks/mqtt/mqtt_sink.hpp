#pragma once
#include <optional>
#include <string>
#include <vector>

#include "sink/attempt.hpp"
#include "sink/sink.hpp"
#include "sinks/mqtt/connection.hpp"
#include "sinks/mqtt/delivery.hpp"
#include "sinks/mqtt/requests.hpp"
#include "sinks/mqtt/status.hpp"
#include "sinks/mqtt/topics.hpp"

namespace gantry::sinks::mqtt {

struct Plan {
    Access access;
    Grouping grouping;
    std::string base, gateway_id;
    bool status = true;            // retained state of the bridge and of the readers
    bool commands = false;         // requests come in
    std::string discovery_prefix;  // of Home Assistant; empty: none
};

class MqttSink : public sink::Sink {
public:
    MqttSink(Plan plan, sink::Host& host);
    ~MqttSink() override;
    sink::Outcome deliver(std::span<const sink::Item> batch, const sink::Patience& patience) override;
    void idle(const sink::Patience& patience) override;
    bool connected() const override;

private:
    // True when the connection is open; else why not.
    bool connect(const sink::Patience& patience, std::string& trouble);
    void greet();            // what a new connection is told first
    void serve(Steady now);  // everything but events
    void send_answers();
    void show_status(Steady now);
    void correct_status(const Incoming& message);
    void read_acks(Delivery* delivery);
    void hand_over(Delivery& delivery);
    void blame(Delivery& delivery);  // the connection was lost with events in flight
    bool room() const { return connection_->in_flight() < connection_->window(); }
    std::string at_server(std::string_view trouble) const;

    Plan plan_;
    sink::Host& host_;
    Topics topics_;
    Requests requests_;
    StatusBoard board_;
    std::optional<sink::Attempt<Result<std::unique_ptr<Connection>>>> attempt_;
    std::unique_ptr<Connection> connection_;
    Steady next_status_{}, next_try_{};
    bool warned_ = false;  // of a status that was refused, on this connection

    // After a connection was lost events go one by one, until as many are through as were in flight: one of
    // them may be what the broker does not bear.
    std::size_t careful_ = 0;
    int greeting_ = 0;  // "online": once it is confirmed, the broker takes messages of ours
    bool greeted_ = false;
    std::string suspect_;  // the event that was alone in flight when the broker ended the connection
    int strikes_ = 0;      // in a row
    Doubts doubts_;
};

}  // namespace gantry::sinks::mqtt
