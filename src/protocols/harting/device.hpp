#pragma once
#include <memory>

#include "protocols/harting/device_call.hpp"
#include "protocols/harting/device_inventory.hpp"
#include "reader/device.hpp"
#include "reader/faults.hpp"

namespace gantry::harting {

// The virtual RF-R400: answers hosts that dial it, over TCP or a serial line; reads by itself; dials a host
// with what it has read, beside that link or, if told so, as its only one.
class HartingDevice final : public Device {
public:
    HartingDevice(const DeviceOptions& options, Air& air);

    void power_on(Now now) override;
    void start(Now now) override;
    void received(ByteView bytes, Now now) override;
    void time_passed(Now now) override;
    std::optional<Steady> deadline() const override;
    bool wants_input() const override;
    bool finished() const override;
    void link_lost(Now now) override;
    std::optional<Steady> dial_at() const override;
    void dial_failed(Now now) override;
    std::vector<std::shared_ptr<DialOut>> dial_outs() const override;

    Result<void> inject(std::string_view command, Now now) override;
    static std::span<const FaultWord> faults();
    wire::Fields state() const override;

private:
    struct Pending {  // an inventory under way
        std::uint8_t control = 0;
        Steady due{};
    };

    bool is_up(Now now) const { return powered_ && now.steady >= booted_at_; }
    void take_requests(Now now);
    void on_request(const Frame& frame, Now now);
    // What is answered before the request is looked at.
    std::optional<Status> disturbed(const Frame& frame);
    void run(const CommandRow& row, const Frame& frame, Now now);
    void answer(std::uint8_t control, Status status, ByteView data, Now now);
    void say(ByteView bytes, Now now);
    void read(Now now);
    void store(std::vector<TagRecord>& cycle, Now now);
    void store_event(bool reported, Now now);
    void refresh(Now now);
    void pump();  // one link: what the notifier says
    void reset(Now now, std::chrono::microseconds boot);
    void drop_input();
    void preset(const Settings& settings);

    // What somebody does from outside, by its words (device_world.cpp).
    struct Rows;
    Result<void> inject_input(const FaultCall& call);
    Result<void> inject_antenna(const FaultCall& call);
    Result<void> inject_eeprom(const FaultCall& call);
    Result<void> inject_config(const FaultCall& call);
    Result<void> inject_power(const FaultCall& call);
    Result<void> inject_status(const FaultCall& call);
    Result<void> inject_busy(const FaultCall& call);
    Result<void> inject_silent(const FaultCall& call);
    Result<void> inject_link(const FaultCall& call);
    Result<void> inject_stuck_ack(const FaultCall& call);
    Result<void> inject_reboot(const FaultCall& call);
    Result<void> inject_clock(const FaultCall& call);
    Result<void> inject_broken(const FaultCall& call);
    Result<void> inject_full(const FaultCall& call);
    // Does it speak by itself now, on the notifier's link?
    bool notifies() const { return dials_ || notifier_->connected(); }

    const bool dials_, serial_;
    const std::chrono::microseconds boot_, byte_gap_;
    ReaderState reader_;
    Reading reading_;
    std::shared_ptr<Notifier> notifier_;
    HostInventory inventory_;
    Framer framer_{wire::Direction::to_reader};
    std::size_t buffer_read_ = 0;
    std::optional<Pending> pending_;
    bool powered_ = false;
    Steady booted_at_{};
    bool reboot_waits_ = false;         // for the first link
    std::optional<Steady> reboots_at_;  // soon after that
    std::optional<Steady> start_at_;    // when the boot is over
    std::optional<Steady> give_up_at_;  // on a request that came half
    Now last_seen_{};                   // for state(), which is told no time

    // The link, and faults from outside.
    bool connected_ = false, hang_up_ = false;
    LinkFaults faults_;
    bool silent_ = false, busy_ = false, stuck_ack_ = false;
    std::optional<std::uint8_t> next_status_;

    struct {
        std::uint64_t requests = 0, refused = 0, foreign = 0, resets = 0, connects = 0, scans = 0,
                      scans_lost = 0, acks_lost = 0;
    } total_;
};

}  // namespace gantry::harting
