#pragma once
#include <string>

#include "protocols/harting/device_state.hpp"
#include "protocols/harting/frame.hpp"
#include "reader/device.hpp"
#include "reader/faults.hpp"

// The notification channel of a virtual reader (section 8): it dials the host of CFG49, tells what is in the
// buffer, repeats what must be acknowledged, holds the link for a while. The device lets its time pass.
namespace gantry::harting {

class Notifier final : public DialOut {
public:
    Notifier(const DeviceOptions& options, ReaderState& reader);

    // As a side link.
    void start(Now now) override;
    void received(ByteView bytes, Now now) override;
    void time_passed(Now) override {}  // the device's
    std::optional<Steady> deadline() const override { return {}; }
    bool wants_input() const override;
    bool finished() const override { return connected_ && (ended_ || faults_.dropped()); }
    void link_lost(Now now) override;
    std::string address() const override;
    std::optional<Steady> dial_at() const override;
    void dial_failed(Now now) override;

    // For the device.
    void restart(Now now);  // a reset
    void refresh(Now now);  // the mode or the configuration has changed
    void step(Now now);     // says what is due
    std::optional<Steady> due() const;
    bool is_wanted() const;     // it has somebody to notify
    void tell_all();            // [0x34]
    void event_added();         // while a trigger decides when to read: told at once
    bool acknowledge(Now now);  // [0x32]; false: nothing waits for it
    void buffer_emptied() { waiting_.reset(); }
    bool connected() const { return connected_; }
    bool waits() const { return waiting_.has_value(); }

    // Faults from outside.
    bool stuck_ack = false;
    Result<void> inject(const FaultCall& call) { return faults_.inject(call, out()); }

    struct Tally {
        std::uint64_t messages = 0, repeated = 0, acknowledged = 0, sets_acknowledged = 0, sets_sent = 0,
                      keepalives = 0, connects = 0, ignored = 0, acks_lost = 0;
    };
    const Tally& tally() const { return tally_; }
    const Framer::Tally& input() const { return framer_.tally(); }

private:
    enum class When : std::uint8_t { continuous, time, host };
    struct Waiting {
        Bytes frame;
        std::size_t sets = 0;
        Steady resend_at{};
    };

    std::size_t to_tell() const;
    void tell(Now now);
    void keep_alive(Now now);
    void say(ByteView frame, Now now);
    void on_request(const Frame& frame, Now now);

    ReaderState& reader_;
    const std::string connect_;  // instead of CFG49's destination
    const When when_;
    const std::chrono::microseconds period_, repeat_, redial_;
    const bool new_keepalive_, answer_ack_;

    Framer framer_{wire::Direction::to_reader};
    bool connected_ = false, ended_ = false, active_ = false;
    std::string dialled_;  // where the link goes
    Steady next_try_{};
    std::optional<Steady> hold_until_, keepalive_at_, tell_at_;
    std::size_t allowed_ = 0;  // sets that a trigger has let go
    std::optional<Waiting> waiting_;
    LinkFaults faults_;
    Tally tally_;
};

}  // namespace gantry::harting
