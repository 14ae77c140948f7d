#pragma once
#include <deque>
#include <string>

#include "protocols/caen/device_events.hpp"
#include "reader/device.hpp"
#include "reader/faults.hpp"

namespace gantry::caen {

// A notification channel of a virtual reader: dials the host, keeps events until a notify trigger sends them,
// dials again when the link is lost (section 9).
class NotifyChannel final : public DialOut {
public:
    struct Event {
        std::int64_t time_us = 0;
        event::TagId tag;
        std::size_t source = 0;
        TagEvent event{};
    };

    NotifyChannel(std::string name, std::string address, std::chrono::microseconds redial,
                  std::size_t capacity, std::uint64_t seed, Now now);

    void start(Now now) override;
    void received(ByteView bytes, Now now) override;
    void time_passed(Now now) override { faults_.time_passed(now, out()); }
    std::optional<Steady> deadline() const override { return faults_.deadline(); }
    bool finished() const override { return ended_ || faults_.dropped(); }
    void link_lost(Now now) override;
    std::string address() const override { return address_; }
    std::optional<Steady> dial_at() const override;
    void dial_failed(Now now) override;

    const std::string& name() const { return name_; }
    void add(const Event& event);  // the oldest goes when it is full
    // Newer ones have pushed them all out; where there are none, the next one finds no place.
    void overflow();
    void report(Now now);  // what there is, if the host takes it
    void kill(Now now);    // the kill message, then the end
    void end();            // at once
    Result<void> inject(const FaultCall& call) { return faults_.inject(call, out()); }
    bool connected() const { return connected_; }
    std::size_t buffered() const { return events_.size(); }
    std::uint64_t dropped() const { return dropped_; }

    std::uint32_t sources = 0;          // a bit each
    std::vector<std::string> triggers;  // that make it report

private:
    void report_some(Now now);

    std::string name_, address_;
    std::chrono::microseconds redial_;
    std::size_t capacity_;
    std::deque<Event> events_;
    std::uint64_t dropped_ = 0;
    std::uint16_t id_ = 0;
    std::optional<Steady> dial_at_;
    bool connected_ = false, ended_ = false, no_place_ = false;
    LinkFaults faults_;
};

}  // namespace gantry::caen
