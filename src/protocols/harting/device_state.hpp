#pragma once
#include <array>
#include <optional>
#include <vector>

#include "protocols/harting/device_buffer.hpp"
#include "protocols/harting/device_clock.hpp"
#include "protocols/harting/device_config.hpp"
#include "protocols/harting/device_lines.hpp"
#include "protocols/harting/records.hpp"
#include "protocols/harting/tables.hpp"
#include "reader/air.hpp"
#include "reader/plugin.hpp"

// What a virtual reader knows and keeps, and how it hears tags.
namespace gantry::harting {

// A real round asks every tag in front of it. The air tells single reads, some a second: to find the tags
// that are there, a host's command also counts what was heard this long before it.
inline constexpr std::chrono::milliseconds still_there{400};

class ReaderState {
public:
    ReaderState(const DeviceOptions& options, Air& air);

    void power_on(Now now);  // the clock starts
    void restart(Now now);   // any reset: RAM from EEPROM, the rest of its memory is gone
    void changed() { setup = setup_of(config); }  // the configuration was written

    // How it works now: [0x6A] can keep a reader that reads by itself in host mode.
    Mode mode() const { return stays_host_ ? Mode::host : setup.mode; }
    bool stores() const { return mode() == Mode::buffered_read || mode() == Mode::notification; }
    bool works() const { return running && !config.eeprom_failed(); }
    bool reads_by_itself() const {
        return works() && mode() != Mode::host && trigger.reads(setup) && !rf_off_;
    }

    // --- the radio
    // [0x6A]: one antenna, or all off.
    void rf_output(std::uint8_t antenna, bool stays_host);
    std::vector<std::uint16_t> antennas() const;  // that a command of the host uses
    bool is_broken(std::uint16_t antenna) const;
    void force_broken(std::uint16_t antenna, std::optional<bool> broken) { broken_[antenna - 1u] = broken; }
    bool rf_warning() const;             // one of those in use is broken
    std::uint8_t antenna_flags() const;  // FLAGS-B of the diagnostics: a bit each
    Carrier carrier(std::uint16_t antenna) const;
    // What an antenna hears of tags that pass all filters of the configuration.
    void listen(std::uint16_t antenna, Steady from, Steady to, std::vector<AirSighting>& out) const;

    // The tag as records have it; nothing: it left before all of it was read.
    std::optional<TagRecord> identify(const AirSighting& sighting, std::uint16_t antenna) const;
    TagRecord::Antenna antenna_of(const AirSighting& sighting, std::uint16_t antenna) const;

    // --- inputs
    bool input(std::size_t index) const;  // as the world and CFG2 have it
    std::uint8_t inputs() const;          // a bit each

    Air& air;
    const std::uint64_t seed;
    const std::uint8_t sw_type;
    const std::size_t rx_buf, tx_buf;
    const std::chrono::microseconds round;
    const std::array<std::uint8_t, 6> mac;
    ConfigMemory config;
    Setup setup;
    ReaderClock clock;
    Outputs outputs;
    Trigger trigger;
    DataBuffer buffer;
    bool running = false;  // it has power and has booted
    bool logged_in = false;
    std::array<bool, input_count> levels{};  // the world's side
    std::optional<std::uint16_t> bank_next;  // where a bank that was read in part goes on
    std::size_t keys = 0;                    // written by [0xA3] and [0xAD]; nobody can read them back
    std::uint64_t tags_sent = 0;             // in replies to Inventory

private:
    const bool true_time_;
    std::array<std::optional<bool>, antenna_count> broken_{};
    std::optional<std::uint16_t> rf_antenna_;
    bool rf_off_ = false, stays_host_ = false;
};

// Do these tags answer, by the selection masks of CFG22 to CFG27?
bool is_selected(const std::vector<SelectionMask>& masks, Air& air, const AirAccess& access);

}  // namespace gantry::harting
