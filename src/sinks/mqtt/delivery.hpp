#pragma once
#include <cstdint>
#include <deque>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "sink/sink.hpp"
#include "sinks/mqtt/reasons.hpp"

namespace gantry::sinks::mqtt {

// How events become messages.
struct Grouping {
    bool array = false;            // JSON arrays, always; else one event a message
    std::size_t array_size = 100;  // events of a message
    std::size_t array_bytes = 128 * 1024;
};

// How often a broker refused an event without saying that it is the event. Goes from one delivery to the
// next.
using Doubts = std::map<std::string, int, std::less<>>;

// A batch on its way: what goes into the next message, and what the answers mean for each event. No socket.
class Delivery {
public:
    // The batch must outlive it.
    Delivery(std::span<const sink::Item> batch, const Grouping& grouping, Doubts& doubts);

    bool waiting() const { return !stopped_ && !waiting_.empty(); }  // there is a message to hand over
    std::size_t in_flight() const { return in_flight_.size(); }
    std::size_t events_in_flight() const;
    std::size_t accepted() const { return accepted_; }

    struct Message {
        std::string_view reader;   // whose events they are; empty: of the gateway
        std::string_view payload;  // until the next call
    };
    // `alone`: one event, whatever the grouping. Then exactly one of sent(), refused() and unsent() follows.
    Message next(bool alone);
    void sent(int mid);
    void refused(std::string why);  // it cannot be sent at all
    void unsent();                  // the connection is lost

    // An answer; false when no message of this batch has that number.
    bool settle(int mid, std::uint8_t code, std::string_view said);
    void stop(std::string trouble);  // hand nothing more over; the first reason stays
    // The only event in flight, by its id; empty: there are none, or more.
    std::string_view suspect() const;
    void reject_suspect(std::string why);
    sink::Outcome outcome();

private:
    struct Piece {
        std::size_t first = 0, count = 0;  // of order_
    };
    void reject(Piece piece, std::string why);
    void group(const Grouping& grouping);

    std::span<const sink::Item> batch_;
    bool array_;
    Doubts& doubts_;
    Doubts doubted_;                  // in this delivery
    std::vector<std::size_t> order_;  // items as they go; with arrays those of a reader stand together
    std::deque<Piece> waiting_;
    std::unordered_map<int, Piece> in_flight_;
    Piece next_;
    std::string payload_;
    std::size_t accepted_ = 0;
    bool stopped_ = false;
    std::string trouble_;
    std::vector<sink::Fate> fates_;
    std::map<std::size_t, std::string> rejected_;
};

}  // namespace gantry::sinks::mqtt
