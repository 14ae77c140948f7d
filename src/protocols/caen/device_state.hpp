#pragma once
#include <array>
#include <chrono>
#include <optional>
#include <string>
#include <vector>

#include "protocols/caen/tables.hpp"
#include "reader/air.hpp"
#include "reader/plugin.hpp"

// What a virtual reader knows and keeps: its model, its settings, its memory, its clock.
namespace gantry::caen {

// Source parameters that code needs by name (section 4.2).
enum class Config : std::uint32_t {
    read_cycle = 0,
    observed_threshold = 1,
    lost_threshold = 2,
    starting_q = 3,
    session = 4,
    target = 5,
    selected = 6,
    desb = 7,
    dwell_time = 8,
    inventory_type = 9,
    inventory_count = 10,
    min_q = 11,
    max_q = 12,
    tid_length = 13,
    matching = 14,  // only inside MatchRFImpedance
    quiet_time = 15,
};
inline constexpr std::size_t config_size = 16;

// A real round asks every tag in front of it. The air tells single reads, some a second: to find the tags
// that are there, a round also counts what was heard this long before it.
inline constexpr std::chrono::milliseconds still_there{400};

struct SourceMemory {
    std::uint32_t read_points = 0;  // a bit each
    std::array<std::uint32_t, config_size> config{};

    std::uint32_t operator[](Config which) const { return config[static_cast<std::size_t>(which)]; }
    std::uint32_t& operator[](Config which) { return config[static_cast<std::size_t>(which)]; }
};

// No source says what survives a restart beside the network and serial settings; 0xB3 (SaveSettings) of later
// readers shows that most does not. So the rest is RAM, and a host must set it again.
struct Eeprom {
    std::string address = "192.168.0.125", net_mask = "255.255.255.0",
                gateway = "192.168.0.1";  // table 4.1
    std::uint32_t baud_rate = 115200, data_bits = 8, stop_bits = 1, parity = 0,
                  flow_ctrl = 0;  // tables 4.1, 4.3
    std::uint32_t regulation = 0;
};
struct Ram {
    std::uint32_t power = 0, protocol = 3, bit_rate = 3, lbt = 0, channel = 0, rf_on = 0, event_mode = 0;
    std::uint32_t outputs = 0, directions = 0;
    std::vector<SourceMemory> sources;
};

class ReaderMemory {
public:
    ReaderMemory(const DeviceOptions& options, Air& air);

    void restart(Now now);  // RAM has its defaults, the clock runs from zero

    // Its own time, as it stamps tags; microseconds since 1970.
    std::int64_t time_at(Steady at) const;
    void set_time(Steady at, std::int64_t micros);
    void jump(std::chrono::microseconds by) { base_us_ += by.count(); }

    std::optional<std::size_t> source(std::string_view name) const;    // "Source_2" is 2
    std::optional<unsigned> read_point(std::string_view name) const;   // "Ant1" is 1
    std::vector<unsigned> points_of(std::size_t source) const;         // in order
    std::chrono::microseconds slot(const SourceMemory& source) const;  // one stay on a read point
    Carrier carrier(unsigned read_point) const;

    enum class Antenna : std::uint8_t { good, poor, bad };
    Antenna antenna(unsigned read_point) const;
    void force_antenna(unsigned read_point, std::optional<Antenna> state);
    // Appends what the read point hears of the protocol in use.
    // With the source's own way to inventory. `sent`: for how long up to `to` the reader really sends through
    // this read point; zero: all the time.
    void listen(unsigned read_point, std::size_t source, Steady::duration sent, Steady from, Steady to,
                std::vector<AirSighting>& out) const;
    // The tags of one kind that are in front of a source now, the strongest first, with the read point that
    // hears each.
    struct Present {
        unsigned read_point = 0;
        AirSighting sighting;
    };
    std::vector<Present> present(std::size_t source, event::Technology technology, Steady now) const;

    unsigned lines() const { return unsigned{model.inputs} + model.outputs; }
    std::uint32_t line_mask() const { return lines() >= 32 ? ~0u : (1u << lines()) - 1; }
    std::uint32_t io_register() const;

    const ModelRow& model;
    const std::string serial, firmware;
    const std::chrono::microseconds round;
    const bool stream_starts_with_result, stream_ends_with_result, good_is_zero, associated_is_one, any_order;
    const std::size_t pc_size;
    Eeprom eeprom;
    Ram ram;
    std::uint32_t inputs = 0;  // the world's side
    Air& air;

private:
    const std::string clock_;
    std::vector<std::optional<Antenna>> forced_;
    std::int64_t base_us_ = 0;
    Steady base_{};
    bool clock_set_ = false;
};

bool is_dotted_decimal(std::string_view text);  // an IPv4 address

}  // namespace gantry::caen
