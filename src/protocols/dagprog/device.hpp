#pragma once
#include <array>
#include <optional>
#include <string>

#include "protocols/dagprog/crc8.hpp"
#include "protocols/dagprog/framer.hpp"
#include "reader/device.hpp"
#include "reader/faults.hpp"
#include "reader/plugin.hpp"

namespace gantry::dagprog {

// The virtual unit on its serial line: one antenna, one tag at a time.
class DagprogDevice final : public Device {
public:
    DagprogDevice(const DeviceOptions& options, Air& air);

    void power_on(Now now) override;
    void start(Now now) override;
    void received(ByteView bytes, Now now) override;
    void time_passed(Now now) override;
    std::optional<Steady> deadline() const override;
    bool finished() const override { return faults_.dropped(); }
    void link_lost(Now now) override;

    Result<void> inject(std::string_view command, Now now) override;
    static std::span<const FaultWord> faults();
    wire::Fields state() const override;

private:
    enum class Mode : std::uint8_t { stopped, forever, checked, once };
    struct Memory {  // what SV keeps
        std::uint32_t first_block = 0, block_count = 0, power_up = 0;
    };
    using Serial = std::array<std::uint8_t, 8>;

    // Commands (device_commands.cpp).
    void command(const Line& line, Now now);
    bool understands(const Line& line) const;
    bool legal(const Line& line) const;
    void set(Code code, std::uint32_t value);
    void enter(Mode mode, Code code);
    void read_serial(Now now);
    void write(const Line& line, Now now);

    // What somebody does from outside, by its words (device_world.cpp).
    struct Rows;
    Result<void> inject_link(const FaultCall& call);
    Result<void> inject_bad_crc(const FaultCall& call);
    Result<void> inject_stuck_ack(const FaultCall& call);
    Result<void> inject_reboot(const FaultCall& call);
    Result<void> inject_broken(const FaultCall& call);
    Result<void> inject_antenna(const FaultCall& call);
    Result<void> inject_silent(const FaultCall& call);
    Result<void> inject_write_error(const FaultCall& call);
    Result<void> inject_error(const FaultCall& call);

    // Reading.
    bool reading() const { return mode_ != Mode::stopped && field_on_ && !booting_; }
    void scan(Now now);
    void hear(const AirSighting& sighting);
    void detect(const event::TagId& tag, Steady at);
    std::vector<event::TagId> in_the_field(Steady at);
    bool is_there(const event::TagId& tag, Steady at);
    AirAccess access(const event::TagId& tag, Steady at) const;
    std::optional<Bytes> read_block(const event::TagId& tag, std::uint32_t block, Steady at);

    // Saying.
    void say(const MessageRow& row, std::span<const std::string> values = {});
    void say(Code code, std::initializer_list<std::string> values = {});
    void say_number(Code code, std::uint32_t value);
    void say_serial(const Serial& serial);
    void say_result(std::uint8_t result);
    void send(ByteView line);
    void boot(Now now);
    void reboot(Now now);

    // Settings.
    Air& air_;
    const Family family_;
    const std::optional<bool> wants_stx_;
    const std::optional<Separator> wants_separator_;
    const bool reversed_;  // serial numbers
    const Crc8Row& crc8_;
    const bool banner_stx_;
    const std::string version_;
    const std::chrono::microseconds boot_time_;
    std::string name_;

    Memory saved_, now_;
    std::uint32_t transmit_ = 0;
    bool save_next_ = false;
    Mode mode_ = Mode::stopped;
    bool field_on_ = true;
    std::uint8_t count_ = 0;            // of detections
    std::vector<event::TagId> asleep_;  // tags that were read in mode `once`
    bool booting_ = true;
    std::optional<Steady> boots_at_;
    bool reboot_waits_ = false;         // for the first link
    std::optional<Steady> reboots_at_;  // soon after that
    Steady scanned_to_{}, next_scan_{}, clock_{};
    Steady told_collision_{};

    Framer framer_{wire::Direction::to_reader};
    bool connected_ = false;

    // Faults from outside.
    LinkFaults faults_;
    bool silent_ = false, stuck_ack_ = false, antenna_broken_ = false;
    bool spoil_crc_ = false, write_error_ = false;

    struct {
        std::uint64_t commands = 0, refused = 0, detections = 0, collisions = 0, writes = 0, restarts = 0,
                      connects = 0;
    } total_;
};

}  // namespace gantry::dagprog
