#include "sinks/mqtt/mqtt_sink.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "base/log.hpp"
#include "base/text.hpp"

namespace gantry::sinks::mqtt {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

static constexpr milliseconds tick = 50ms;  // how often a wait looks at its patience
static constexpr milliseconds status_period = 1s, answer_wait = 50ms, goodbye = 500ms, idle_retry = 5s;
static constexpr int most_strikes = 3;

MqttSink::MqttSink(Plan plan, sink::Host& host)
    : plan_(std::move(plan)),
      host_(host),
      topics_(plan_.base),
      requests_(host_, topics_),
      board_(topics_, plan_.gateway_id, plan_.discovery_prefix) {}

MqttSink::~MqttSink() {
    if (connection_) connection_->leave(goodbye);
}

bool MqttSink::connected() const {
    return connection_ && connection_->state() == Connection::State::open;
}

std::string MqttSink::at_server(std::string_view trouble) const {
    return fmt::format("{}: {}", plan_.access.server.text(), trouble);
}

bool MqttSink::connect(const sink::Patience& patience, std::string& trouble) {
    if (connected()) return true;
    if (connection_ && connection_->state() == Connection::State::lost) connection_.reset();
    if (!connection_) {
        if (!attempt_) attempt_.emplace([access = plan_.access] { return Connection::open(access); });
        auto opened = attempt_->wait(patience);
        if (!opened) {
            trouble =
                at_server(patience.stop.stop_requested() ? "stopped while connecting" : "no answer yet");
            return false;
        }
        attempt_.reset();
        if (!*opened) {
            trouble = at_server((*opened).error().text());
            return false;
        }
        connection_ = std::move(**opened);
    }
    while (connection_->state() == Connection::State::opening) {
        if (patience.over(steady_clock::now())) {
            trouble = at_server("the port is open, but nothing there answers as an MQTT broker does");
            connection_.reset();
            return false;
        }
        connection_->turn(tick);
    }
    if (connection_->state() == Connection::State::lost) {
        trouble = at_server(connection_->trouble());
        connection_.reset();
        return false;
    }
    greet();
    return true;
}

void MqttSink::greet() {
    board_.forget();
    next_status_ = {};
    warned_ = false;
    greeting_ = 0;
    greeted_ = false;
    if (plan_.commands) connection_->subscribe(topics_.all_requests());
    if (!plan_.status || !connection_->retains()) return;
    greeting_ = connection_->publish(topics_.bridge_state(), "online", true).mid;
    show_status(steady_clock::now());  // before the broker shows what it remembers
    connection_->subscribe(topics_.all_status());
}

void MqttSink::show_status(Steady now) {
    if (!plan_.status || !connection_->retains() || now < next_status_) return;
    next_status_ = now + status_period;
    board_.update(host_.readers(), now, [&](const Retained& message) {
        if (room()) return connection_->publish(message.topic, message.payload, true).mid != 0;
        next_status_ = now + tick;  // the rest when there is room
        return false;
    });
}

void MqttSink::correct_status(const Incoming& message) {
    if (!message.retained || !plan_.status || !message.topic.ends_with("/status") || !room()) return;
    auto payload = board_.correction(message.topic, message.payload);
    if (!payload.empty()) connection_->publish(message.topic, payload, true);
}

void MqttSink::serve(Steady now) {
    for (auto& message : connection_->take_incoming()) {
        if (topics_.operation(message.topic)) {
            if (plan_.commands) requests_.take(message);
        } else {
            correct_status(message);
        }
    }
    for (auto& filter : connection_->take_denied())
        log::warn("sink", "{}: the broker lets us not subscribe to {}", plan_.access.server.text(),
                  printable(filter));
    send_answers();
    show_status(now);
}

void MqttSink::send_answers() {
    auto answers = requests_.take_answers();
    auto next = answers.begin();
    for (; next != answers.end() && room(); ++next) {
        auto handed = connection_->publish(next->topic, next->payload, false, next->correlation);
        if (handed.mid == 0 && handed.refusal.empty()) break;
        if (!handed.refusal.empty())
            log::warn("sink", "{}: an answer on {} cannot be sent: {}", plan_.access.server.text(),
                      printable(next->topic), printable(handed.refusal));
    }
    answers.erase(answers.begin(), next);
    if (!answers.empty()) requests_.put_back(std::move(answers));
}

void MqttSink::read_acks(Delivery* delivery) {
    for (auto& ack : connection_->take_acks()) {
        if (ack.mid == greeting_) greeted_ = true;
        if (delivery != nullptr && delivery->settle(ack.mid, ack.code, ack.said)) {
            if (careful_ > 0) --careful_;
            continue;
        }
        if (ack.code < 0x80 || warned_) continue;
        warned_ = true;
        log::warn("sink", "{}: the broker does not take a status or an answer: {}",
                  plan_.access.server.text(), reason_text(ack.code, ack.said));
    }
}

void MqttSink::hand_over(Delivery& delivery) {
    while (delivery.waiting() && room()) {
        bool alone = careful_ > 0;
        if (alone && (delivery.in_flight() > 0 || (greeting_ != 0 && !greeted_))) return;
        auto message = delivery.next(alone);
        auto handed = connection_->publish(topics_.events(message.reader), message.payload, false);
        if (handed.mid != 0) {
            delivery.sent(handed.mid);
        } else if (!handed.refusal.empty()) {
            delivery.refused(std::move(handed.refusal));
        } else {
            delivery.unsent();
            return;
        }
    }
}

// An event that makes the broker end the connection would block the line for ever. It is given up when it was
// alone in flight each time, and the broker had taken another message of the same connection before.
void MqttSink::blame(Delivery& delivery) {
    auto suspect = delivery.suspect();
    if (careful_ == 0 || suspect.empty() || !greeted_) {
        careful_ = std::max<std::size_t>(delivery.events_in_flight(), 1);
        return;
    }
    strikes_ = suspect == suspect_ ? strikes_ + 1 : 1;
    suspect_ = suspect;
    if (strikes_ < most_strikes) return;
    strikes_ = 0;
    suspect_.clear();
    delivery.reject_suspect(fmt::format("the broker ended the connection {} times when it got this event: {}",
                                        most_strikes, connection_->trouble()));
}

sink::Outcome MqttSink::deliver(std::span<const sink::Item> batch, const sink::Patience& patience) {
    std::string trouble;
    if (!connect(patience, trouble)) return sink::Outcome::kept(batch.size(), trouble);
    auto grouping = plan_.grouping;
    grouping.array_bytes = std::min(grouping.array_bytes, connection_->max_packet() / 2);
    Delivery delivery(batch, grouping, doubts_);
    // What is handed over late would be lost to an answer that comes after the call, and go twice.
    auto now = steady_clock::now();
    auto last_call = now + (patience.until - now) / 4 * 3;
    for (;; now = steady_clock::now()) {
        if (patience.over(now)) {
            delivery.stop(at_server("the broker did not confirm in time"));
            break;
        }
        if (now >= last_call && delivery.waiting()) delivery.stop(at_server("the broker is too slow"));
        serve(now);
        hand_over(delivery);
        if (connection_->state() == Connection::State::lost) break;
        if (!delivery.waiting() && delivery.in_flight() == 0) break;
        connection_->turn(tick);
        read_acks(&delivery);
    }
    if (connection_->state() == Connection::State::lost) {
        read_acks(&delivery);
        if (delivery.in_flight() > 0) blame(delivery);
        delivery.stop(at_server(connection_->trouble()));
        connection_.reset();
    } else if (delivery.in_flight() > 0) {
        connection_.reset();  // whatever is confirmed from now on, nobody would hear
    }
    return delivery.outcome();
}

void MqttSink::idle(const sink::Patience& patience) {
    auto now = steady_clock::now();
    if (!connected()) {
        // Nobody may deliver for hours, but people look at the status, and requests come in.
        if (now < next_try_) return;
        next_try_ = now + idle_retry;
        std::string trouble;
        if (!connect(patience, trouble)) return;
    }
    connection_->turn(0ms);
    read_acks(nullptr);
    serve(now);
    if (requests_.waiting()) {  // most are answered at once
        auto left = std::chrono::duration_cast<milliseconds>(patience.until - now);
        requests_.wait(std::clamp<milliseconds>(left, 0ms, answer_wait));
        send_answers();
    }
    if (connection_->state() == Connection::State::lost) {
        log::info("sink", "{}", at_server(connection_->trouble()));
        connection_.reset();
    }
}

}  // namespace gantry::sinks::mqtt
