#pragma once
#include <functional>

#include "reader/party.hpp"

namespace gantry::link {

// Two parties joined in memory on virtual time: bytes arrive in pieces of a chosen size, time jumps to the
// next deadline. Hours pass in milliseconds.
class MemoryLink {
public:
    MemoryLink(Party& a, Party& b, Now start = {Steady{} + 1h, Wall{} + std::chrono::years{56}});

    void connect();  // calls start() on both
    // Runs until `duration` has passed or a party has finished and its output is delivered.
    void run_for(std::chrono::microseconds duration);
    // Carries bytes now, until neither party has more to say.
    void exchange();
    void cut() { connected_ = false; }  // bytes on the way are lost; the parties are not told

    Now now() const { return now_; }
    std::size_t piece = 1;                            // bytes per received(); 0: all at once
    std::function<void()> after_turn;                 // drain the driver here
    std::function<bool(ByteView, bool from_a)> drop;  // true: these bytes vanish

private:
    std::optional<Steady> next_deadline() const;
    void deliver(Party& from, Party& to);

    Party &a_, &b_;
    Now now_;
    bool connected_ = false;
};

}  // namespace gantry::link
