#pragma once
#include <memory>

#include "protocols/caen/device_call.hpp"
#include "protocols/caen/device_inventory.hpp"
#include "protocols/caen/device_notify.hpp"
#include "protocols/caen/message.hpp"
#include "reader/device.hpp"
#include "reader/faults.hpp"

namespace gantry::caen {

// The virtual reader: listens, answers one request after the other, reads what the air holds. Behaves as one
// of the models of docs/protocols/caen.md.
class CaenDevice final : public Device {
public:
    CaenDevice(const DeviceOptions& options, Air& air);

    void power_on(Now now) override;
    void start(Now now) override;
    void received(ByteView bytes, Now now) override;
    void time_passed(Now now) override;
    std::optional<Steady> deadline() const override;
    bool wants_input() const override;
    bool finished() const override { return connected_ && (hang_up_ || faults_.dropped()); }
    void link_lost(Now now) override;
    std::vector<std::shared_ptr<DialOut>> dial_outs() const override { return notifier_.dial_outs(); }

    Result<void> inject(std::string_view command, Now now) override;
    static std::span<const FaultWord> faults();
    wire::Fields state() const override;

private:
    bool streaming() const { return inventory_ && inventory_->framed(); }
    void take_requests(Now now);
    void on_request(ByteView message, Now now);
    void begin_inventory(const Parsed& request, Command command, const Arguments& arguments, Now now);
    void end_inventory();
    void abort_stream(Now now);
    void drop_input();
    // What is answered before the request is looked at: the result that somebody injected, or busy.
    std::optional<ResultCode> disturbed(const CommandRow& row);
    void answer(const Parsed& request, ResultCode result, Now now, ByteView pairs = {});
    void say(ByteView bytes, Now now);
    void reboot(Now now);

    // What somebody does from outside, by its words (device_world.cpp).
    struct Rows;
    Result<void> inject_input(const FaultCall& call);
    Result<void> inject_antenna(const FaultCall& call);
    Result<void> inject_trigger(const FaultCall& call);
    Result<void> inject_result(const FaultCall& call);
    Result<void> inject_busy(const FaultCall& call);
    Result<void> inject_silent(const FaultCall& call);
    Result<void> inject_link(const FaultCall& call);
    Result<void> inject_reboot(const FaultCall& call);
    Result<void> inject_clock(const FaultCall& call);
    Result<void> inject_broken(const FaultCall& call);
    Result<void> inject_full(const FaultCall& call);

    const bool serial_;
    const std::chrono::microseconds boot_, byte_gap_;
    ReaderMemory memory_;
    Notifier notifier_;
    Framer framer_{to_reader_head};
    std::optional<Inventory> inventory_;
    Steady booted_at_{};
    bool reboot_waits_ = false;                      // for the first link
    std::optional<Steady> restart_at_, give_up_at_;  // on a request that came half

    // The link, and faults from outside.
    bool connected_ = false, hang_up_ = false;
    LinkFaults faults_;
    bool silent_ = false, busy_ = false;
    std::optional<std::uint16_t> next_result_;

    struct {
        std::uint64_t requests = 0, refused = 0, tags = 0, lost = 0, ignored_bytes = 0, restarts = 0,
                      connects = 0;
    } total_;
};

}  // namespace gantry::caen
