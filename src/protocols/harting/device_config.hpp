#pragma once
#include <array>
#include <chrono>
#include <string>
#include <vector>

#include "base/error.hpp"
#include "protocols/harting/config.hpp"
#include "reader/bank.hpp"

// The configuration memory of a virtual reader (section 9), and what it means.
namespace gantry::harting {

inline constexpr std::size_t antenna_count = 4, input_count = 2, output_count = 3;  // output 3: relay 1

class ConfigMemory {
public:
    ConfigMemory();  // the EEPROM has the factory values

    // A reset: checks the EEPROM block by block, mends what is broken with factory values, loads the RAM.
    void start();
    // The last reset found a broken block.
    bool eeprom_failed() const { return eeprom_failed_; }
    void spoil(std::size_t block);  // one bit of the EEPROM

    const Block& block(std::size_t number, bool eeprom) const;
    // What goes to the EEPROM lands in the RAM, too.
    void write(std::size_t number, const Block& block, bool eeprom);
    void to_factory(std::size_t number, bool eeprom);
    // "CFG1.MODE=Scan" into the EEPROM, before the first start.
    Result<void> preset(std::string_view assignment);

    // The parameters as they are at work: those that need a reset as the last one found them.
    std::int64_t number(std::string_view name) const;
    bool flag(std::string_view name) const { return number(name) != 0; }
    Bytes bytes(std::string_view name) const;

private:
    struct Stored {
        Block data{};
        std::uint16_t crc = 0;
    };
    using Store = std::array<Stored, block_count>;

    static void put(Stored& stored, const Block& block);
    Bytes bytes_of(const ConfigRow& row) const;

    Store ram_, eeprom_, at_start_;
    bool eeprom_failed_ = false;
};

// Are the bytes of a block legal values of what is known of them?
bool is_legal(std::size_t block, const Block& bytes);

struct SelectionMask {  // CFG22 to CFG27
    std::size_t bits = 0;
    Bank bank = Bank::epc;
    bool negated = false;
    std::size_t first_bit = 0;
    Bytes mask;
};

// The configuration taken apart, once after each change. Times are from units of 100 ms.
struct Setup {
    using Milliseconds = std::chrono::milliseconds;

    Mode mode = Mode::host;
    std::uint8_t address = 0;
    bool reads_gen2 = true, with_tid = false;
    std::size_t tid_size = 0;  // 0: all of it
    unsigned session = 0;
    std::array<double, antenna_count> power_dbm{};
    std::array<std::uint8_t, antenna_count> rssi_filter{};
    std::vector<std::uint16_t> antennas;  // in turn
    bool persistence_reset = false;
    std::array<Milliseconds, antenna_count> persistence{};
    std::vector<SelectionMask> masks;

    std::uint8_t tr1 = 0, tr2 = 0;
    bool prefix_address = false, pool = false, complete_bank = false;
    Bank bank = Bank::user;
    std::uint16_t first_block = 0, blocks = 0;
    std::size_t scan_first = 0, scan_size = 0;
    Milliseconds valid_time{};
    bool tell_by_data = false;
    std::uint16_t identity_block = 0, identity_blocks = 0;

    bool triggered = false, unlimited = false, input_1_inverted = false;
    Milliseconds hold{};
    std::array<bool, input_count> input_events{};
    bool trigger_event = false, timeout_event = false;

    struct Output {
        std::uint8_t idle = 0, active = 0, antennas = 0;
        Milliseconds time{};
    };
    std::array<Output, output_count> outputs{};

    struct Scan {
        bool ascii = true;
        Bytes prefix, separator, end;
    } scan;
    struct Notify {
        bool ack = false, keepalive = false;
        std::chrono::seconds interval{}, hold{};
        std::string address;  // "192.168.0.10:3000"; empty: no destination
    } notify;
};
Setup setup_of(const ConfigMemory& memory);

}  // namespace gantry::harting
