#pragma once
#include <array>
#include <optional>
#include <string>
#include <unordered_map>

#include "protocols/silion/framer.hpp"
#include "protocols/silion/tag_buffer.hpp"
#include "reader/device.hpp"
#include "reader/faults.hpp"
#include "reader/plugin.hpp"

namespace gantry::silion {

// The virtual reader: dials out or has a serial line, reads what the air holds, keeps it until it is
// acknowledged. Behaves as one of the two firmware generations of docs/protocols/silion.md.
class SilionDevice final : public Device {
public:
    SilionDevice(const DeviceOptions& options, Air& air);

    void power_on(Now now) override;
    void start(Now now) override;
    void received(ByteView bytes, Now now) override;
    void time_passed(Now now) override;
    std::optional<Steady> deadline() const override;
    bool finished() const override { return connected_ && (hang_up_ || faults_.dropped()); }
    void link_lost(Now now) override;
    std::optional<Steady> dial_at() const override;
    void dial_failed(Now now) override;

    Result<void> inject(std::string_view command, Now now) override;
    static std::span<const FaultWord> faults();
    wire::Fields state() const override;

private:
    struct Output {
        bool on = false;
        std::optional<Steady> reverts;
    };
    struct Unacknowledged {
        Bytes frame;
        std::uint32_t tags = 0;
        std::uint64_t reads = 0;
        Steady resend_at;
    };
    struct PendingAnswer {  // gen 1 answers when the timed outputs are over
        std::uint8_t flags;
        Steady at;
    };

    bool gen2() const { return generation_ == 2; }
    // May it send uploads now? While it waits for an acknowledgement it does not, nor does a gen 1 whose
    // outputs are timed.
    bool may_upload() const;
    std::uint8_t own_flags() const { return crc_ ? flag_crc : 0; }
    CrcKind crc_kind() const { return crc_.value_or(CrcKind::modbus); }
    CrcRule crc_rule() const;  // of what it gets
    std::uint32_t coded(std::uint32_t error) const { return gen2() ? error : status_base + error; }

    void inventory(Now now);
    void hear(std::uint16_t antenna, const AirSighting& sighting, Now now);
    void send_waiting(Now now);
    void send_tags(Now now);
    void send_again(Now now);
    void send_heartbeat(Now now);
    void upload(Code code, std::uint8_t flags, std::uint32_t status, ByteView data, Now now);
    void say(ByteView frame, Now now);

    void take_commands(Now now);
    void on_command(const Frame& frame, Now now);
    void on_acknowledged(Now now);
    void on_set_outputs(const Frame& frame, Now now);
    bool legal_outputs(ByteView data) const;
    void answer(Code code, std::uint8_t command_flags, std::uint32_t status, ByteView data, Now now);
    Bytes inputs_data() const;
    void reboot(Now now);
    std::uint64_t random();
    std::vector<std::uint16_t> working_antennas();

    // What somebody does from outside, by its words (device_world.cpp).
    struct Rows;
    Result<void> inject_error(const FaultCall& call);
    Result<void> inject_clear(const FaultCall& call);
    Result<void> inject_input(const FaultCall& call);
    Result<void> inject_link(const FaultCall& call);
    Result<void> inject_duplicate(const FaultCall& call);
    Result<void> inject_stuck_ack(const FaultCall& call);
    Result<void> inject_reboot(const FaultCall& call);
    Result<void> inject_antenna(const FaultCall& call);
    Result<void> inject_full(const FaultCall& call);

    // Settings.
    Air& air_;
    const unsigned generation_;
    const bool serial_, acknowledge_, first_seen_;
    const std::optional<CrcKind> crc_;  // nothing: its frames have none
    const std::chrono::microseconds ack_wait_, batch_, heartbeat_, redial_;
    const std::uint16_t antennas_;
    const std::uint32_t bank_words_;
    std::string name_;
    std::uint64_t random_;

    // Memory that a restart loses.
    TagBuffer buffer_;
    std::optional<Unacknowledged> waiting_;
    std::array<Output, 5> outputs_;
    std::uint32_t status_ = 0;
    std::uint32_t heartbeat_count_ = 0;
    bool fault_due_ = false, inputs_due_ = false;
    std::unordered_map<event::TagId, Steady, event::TagIdHash> seen_;
    std::optional<PendingAnswer> pending_;
    Bytes last_tags_;  // the frame sent last, for "duplicate"

    // Its times.
    bool reboot_waits_ = false;  // for the first link
    std::optional<Steady> dial_at_, booted_at_, restart_at_, hello_at_, heartbeat_at_;
    Steady scanned_to_{}, next_scan_{}, batch_at_{};

    // The link.
    Framer framer_;
    bool connected_ = false, hang_up_ = false;
    bool greeted_ = false;  // the first frame of this connection went out

    // The world, and faults from outside.
    std::array<bool, 4> inputs_{};
    LinkFaults faults_;
    bool stuck_ack_ = false, repeat_tags_ = false;
    std::uint32_t broken_ = 0;  // antennas, a bit each from 1

    struct {
        std::uint64_t frames = 0, tags = 0, reads = 0, tags_acknowledged = 0, reads_acknowledged = 0,
                      resent = 0, heartbeats = 0, lost = 0, restarts = 0, connects = 0, acknowledgements = 0;
    } total_;
};

}  // namespace gantry::silion
