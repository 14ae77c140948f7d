#pragma once
#include <chrono>
#include <optional>
#include <vector>

#include "base/time.hpp"
#include "event/event.hpp"
#include "reader/bank.hpp"
#include "wire/error.hpp"

namespace gantry {

// What a virtual reader needs of the field around it; `field` implements it. All times are steady time.

// What the reader sends out through an antenna. Antennas count from 1.
struct Carrier {
    std::uint16_t antenna = 1;
    double power_dbm = 27;  // radiated

    // How the reader inventories through it. A field without air time and collisions passes over these.
    std::optional<std::uint8_t> session = {};  // Gen2, 0 to 3; nothing: as the field has this reader set up
    std::optional<std::uint8_t> q = {};        // Gen2, where the Q algorithm starts; nothing: likewise
    // A reader that asks about more time than it sent for: only the last so much of it counts. Zero: all.
    std::chrono::microseconds dwell{};
    bool anticollision = true;  // HF: false where two tags at once mean that neither is heard
};

struct AirSighting {
    event::TagId tag;
    event::Technology technology = event::Technology::epc_gen2;
    std::int16_t rssi = 0;  // tenths of a dBm
    Steady at{};            // when within the round
    // Of the backscattered carrier: 0 to 4095, where 4096 is the full circle. Nothing: the field knows none.
    std::optional<std::uint16_t> phase = {};
};

enum class AirError : std::uint8_t {
    no_tag,              // nobody answered
    locked,              // memory locked or wrong password
    bad_address,         // no such memory
    insufficient_power,  // the tag heard but could not do it
    unsupported,         // the tag has no such command
};
template <class T>
using AirResult = tl::expected<T, AirError>;

struct AirLock {
    // Gen2 lock payload: 10 mask bits, 10 action bits (kill, access, EPC, TID, user; two bits each, as in the
    // standard, most significant first).
    std::uint16_t mask = 0;
    std::uint16_t action = 0;
};

// One tag, by its id (Gen2: EPC), and how it is reached. Writing takes more power than reading.
struct AirAccess {
    Carrier carrier;
    event::TagId tag;
    std::uint32_t password = 0;  // access password
    Steady now{};
};

class Air {
public:
    virtual ~Air() = default;
    // Appends what an inventory with this carrier hears in [from, to), in order of time: tags of all
    // technologies; a device passes over those that it does not speak.
    virtual void inventory(const Carrier& carrier, Steady from, Steady to, std::vector<AirSighting>& out) = 0;
    // The antennas that are connected to this reader.
    virtual std::vector<std::uint16_t> antennas() const = 0;
    // Whether this reader can tell several HF tags at one antenna apart. A device whose make cannot says so
    // in its Carrier in any case.
    virtual bool anticollision() const { return true; }

    // Access to one tag. An air whose tags only say who they are has nothing to add: nobody answers.

    // Gen2. Addresses and sizes are in 16-bit words. `words` 0: up to the end of the bank.
    virtual AirResult<Bytes> read(const AirAccess& /*access*/, Bank /*bank*/, std::uint32_t /*word*/,
                                  std::uint32_t /*words*/) {
        return tl::unexpected(AirError::no_tag);
    }
    virtual AirResult<void> write(const AirAccess& /*access*/, Bank /*bank*/, std::uint32_t /*word*/,
                                  ByteView /*data*/) {
        return tl::unexpected(AirError::no_tag);
    }
    virtual AirResult<void> lock(const AirAccess& /*access*/, AirLock /*lock*/) {
        return tl::unexpected(AirError::no_tag);
    }
    // Gen2 BlockPermalock: makes blocks of a bank read-only for ever. The tag says how many words a block
    // has; the highest bit of the mask's first byte is block `first`. Bits past the end of the bank must be
    // zero.
    virtual AirResult<void> permalock(const AirAccess& /*access*/, Bank /*bank*/, std::uint32_t /*first*/,
                                      ByteView /*mask*/) {
        return tl::unexpected(AirError::no_tag);
    }
    // The same mask of the blocks that are permalocked; zeros past the end of the bank.
    virtual AirResult<Bytes> permalocked(const AirAccess& /*access*/, Bank /*bank*/, std::uint32_t /*first*/,
                                         std::uint32_t /*bytes*/) {
        return tl::unexpected(AirError::no_tag);
    }
    // Gen2 and EPC Gen1 (whose kill code has 16 bits).
    virtual AirResult<void> kill(const AirAccess& /*access*/, std::uint32_t /*kill_password*/) {
        return tl::unexpected(AirError::no_tag);
    }

    // ISO 18000-6B: one memory of bytes (the first eight are the id), a lock bit for each.
    virtual AirResult<Bytes> read_bytes(const AirAccess& /*access*/, std::uint32_t /*address*/,
                                        std::uint32_t /*size*/) {
        return tl::unexpected(AirError::no_tag);
    }
    virtual AirResult<void> write_bytes(const AirAccess& /*access*/, std::uint32_t /*address*/,
                                        ByteView /*data*/) {
        return tl::unexpected(AirError::no_tag);
    }
    virtual AirResult<void> lock_byte(const AirAccess& /*access*/, std::uint32_t /*address*/) {
        return tl::unexpected(AirError::no_tag);
    }

    // EPC Gen1 and EPC 1.19: gives the tag another id; `lock` (Gen1) makes it its last.
    virtual AirResult<void> program(const AirAccess& /*access*/, const event::TagId& /*new_id*/,
                                    std::uint32_t /*kill_password*/, bool /*lock*/) {
        return tl::unexpected(AirError::no_tag);
    }
};

}  // namespace gantry
