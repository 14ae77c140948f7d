#pragma once
#include <memory>
#include <string>
#include <vector>

#include "base/error.hpp"
#include "reader/air.hpp"
#include "reader/party.hpp"
#include "wire/message.hpp"

namespace gantry {

// A link that a virtual reader dials beside its first one: a notification channel. Whoever carries its bytes
// keeps it alive.
class DialOut : public SideParty {
public:
    virtual std::string address() const = 0;            // "192.168.0.10:3000"
    virtual std::optional<Steady> dial_at() const = 0;  // its next try; nothing: not now
    virtual void dial_failed(Now now) = 0;
};

// A virtual reader. It lives longer than any link: it has its memory, goes on reading while nobody is
// connected, and its time must pass (time_passed at deadline()) with or without a link.
class Device : public Party {
public:
    virtual void power_on(Now now) = 0;   // once, before anything else
    virtual void link_lost(Now now) = 0;  // the link that start() reported is gone
    // A device that dials: when it wants its next try, while it has no link. Nothing: it waits to be dialled.
    virtual std::optional<Steady> dial_at() const { return {}; }
    virtual void dial_failed(Now /*now*/) {}

    // Channels it wants now. One that is no longer listed sends what is left and ends.
    virtual std::vector<std::shared_ptr<DialOut>> dial_outs() const { return {}; }

    // Switches a fault on from outside, or does what a hand at the device would: "input 1=1", "error 11",
    // "restart". An unknown word is refused with the list of those known.
    virtual Result<void> inject(std::string_view command, Now now) = 0;
    // What a person would see on it now: outputs, buffer, counters.
    virtual wire::Fields state() const = 0;
};

}  // namespace gantry
