#pragma once
#include <array>
#include <vector>

#include "protocols/dagprog/crc8.hpp"
#include "protocols/dagprog/tables.hpp"
#include "reader/observation.hpp"

namespace gantry::dagprog {

enum class ByteOrder : std::uint8_t { automatic, msb, lsb };  // of the text of a serial number

// The number as it is reported: most significant byte first, where that can be told (section 5.3).
void put_in_order(std::array<std::uint8_t, 8>& serial, ByteOrder order, event::Technology technology);

// Tag lines to observations. A serial number and the blocks that follow it within 100 ms are one read; where
// the unit sends no serial numbers, the data of its blocks are what tells the tags apart.
class TagWalker {
public:
    static constexpr std::chrono::milliseconds together{100};  // section 9.1, K12
    static constexpr std::size_t max_blocks = 16;              // 64 bytes; an id holds 15 of them

    struct Setup {
        event::Technology technology = event::Technology::unknown;
        bool serials = true, data = false;  // what the transmission mode makes the unit send
        std::uint32_t blocks = 1;           // that a read brings
        ByteOrder order = ByteOrder::automatic;
        const Crc8Row* crc8 = nullptr;  // blocks whose last byte is not this are refused
        friend bool operator==(const Setup&, const Setup&) = default;
    };
    struct Tally {
        std::uint64_t reads = 0, bad_crc = 0;
        std::uint64_t stray = 0;  // blocks that belong to no read: an incomplete row, no serial number
    };

    // What is gathered of a read is forgotten.
    void set_up(const Setup& setup);
    const Setup& setup() const { return setup_; }

    // The hot path: takes whole tag lines as the manual writes them from the front, and stops at anything
    // else. Returns the bytes taken. Observations point into `data`.
    std::size_t walk(ByteView in, Steady now, std::vector<Observation>& out, Bytes& data);
    std::uint64_t lines() const { return lines_; }  // that walk() took

    // The same for one line that was taken apart already.
    void serial(const std::array<std::uint8_t, 8>& serial, Steady now, std::vector<Observation>& out,
                Bytes& data);
    void block(std::uint8_t count, const std::uint8_t* block, Steady now, std::vector<Observation>& out,
               Bytes& data);
    // A serial number whose data did not come is a read of its own.
    std::optional<Steady> deadline() const;
    void time_passed(Steady now, std::vector<Observation>& out, Bytes& data);
    const Tally& tally() const { return tally_; }

private:
    void emit(const event::TagId& tag, std::size_t blocks, std::vector<Observation>& out, Bytes& data);
    void end_serial(std::vector<Observation>& out, Bytes& data);

    Setup setup_;
    bool pending_ = false;  // a serial number that waits for its data
    event::TagId tag_;
    Steady since_{};
    std::array<std::uint8_t, max_blocks * block_size> run_{};
    std::size_t blocks_ = 0;  // in the run
    std::uint8_t count_ = 0;  // of the run
    std::uint64_t lines_ = 0;
    Tally tally_;
};

}  // namespace gantry::dagprog
