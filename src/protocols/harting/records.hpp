#pragma once
#include <cstdint>
#include <optional>
#include <vector>

#include "base/bytes.hpp"
#include "base/time.hpp"
#include "reader/observation.hpp"
#include "wire/error.hpp"

// What tags look like in replies: the records of the data buffer and of notifications (section 8), and those
// of Inventory (section 6).
namespace gantry::harting {

// TR-DATA1, TR-DATA2: which parts a record has.
inline constexpr std::uint8_t tr1_idd = 0x01, tr1_blocks = 0x02, tr1_lsb_first = 0x08, tr1_antenna = 0x10,
                              tr1_timer = 0x20, tr1_date = 0x40, tr1_extension = 0x80;
inline constexpr std::uint8_t tr2_input = 0x01, tr2_mac = 0x02, tr2_afi = 0x04, tr2_statistics = 0x08,
                              tr2_antennas = 0x10, tr2_direction = 0x20, tr2_extension = 0x80;

// The identifier data of a tag, taken apart. Views into it.
struct TagIdentity {
    std::uint16_t pc = 0;
    std::optional<std::uint16_t> xpc;
    ByteView epc;  // of other tags than Gen2: all of the identifier
    ByteView tid;  // empty: not there
};
// `iddt`: 0x00 the id alone, 0x02 with TID. nullopt: it does not hold what its PC says.
std::optional<TagIdentity> take_apart(std::uint8_t transponder_type, std::uint8_t iddt, ByteView idd);

// An input or trigger event of a record.
struct InputEvent {
    std::uint8_t inputs = 0;  // bit 0: input 1
    std::uint8_t status = 0;  // bit 0: the trigger is on, bit 1: its hold time is over
    std::int64_t reader_time_us = 0;
};

struct Walked {
    std::uint32_t records = 0;         // whole ones
    std::uint32_t unusable = 0;        // without an id that can be used, where one was to be; not appended
    std::optional<wire::Fault> fault;  // what came before it is delivered all the same
};

struct WalkOptions {
    Bank block_bank = Bank::user;  // where the data blocks are from (CFG11)
    // Of a record with a time and no date (or neither): the day is that of `now`, corrected over midnight.
    Wall now{};
    std::chrono::minutes utc_offset{};  // the reader's clock minus UTC
};

// The hot path: one pass over the data of a [0x22] reply (TR-DATA1 first), no allocation but the growth of
// what the caller owns. A record that several antennas have read becomes an observation each. Steps by
// RecLen.
Walked walk_buffer(ByteView data, std::size_t base, const WalkOptions& options, std::vector<Observation>& out,
                   Bytes& bank, std::vector<InputEvent>& inputs);

// The data of an Inventory reply (DATA-SETS first). `antennas`: it was asked for with the ANT flag.
Walked walk_inventory(ByteView data, std::size_t base, bool antennas, std::vector<Observation>& out,
                      Bytes& bank);

// A tag as a reader has read it, for the virtual reader to send.
struct TagRecord {
    std::uint8_t transponder_type = 0x84;
    std::uint8_t iddt = 0;
    Bytes idd;
    Bytes blocks;  // data blocks
    std::uint8_t block_size = 2;
    struct Antenna {
        std::uint8_t number = 1;  // from 1
        std::uint8_t rssi = 0;    // -dBm
        std::uint16_t phase = 0;  // 1/4096 of a turn
        std::uint8_t status = 0;
        std::uint16_t count = 1;
    };
    std::vector<Antenna> antennas;
    Wall time{};
    std::optional<InputEvent> input;  // instead of a tag, or beside it
};
// The head of a [0x22] reply: TR-DATA1, TR-DATA2 if there is one, DATA-SETS.
void append_buffer_head(std::uint8_t tr1, std::uint8_t tr2, std::uint16_t data_sets, Bytes& out);
// Appends RecLen and the parts that `tr1` and `tr2` ask for.
void append_record(const TagRecord& record, std::uint8_t tr1, std::uint8_t tr2, ByteView mac, Bytes& out);
// Appends one tag of an Inventory reply.
void append_inventory_tag(const TagRecord& record, bool antennas, Bytes& out);

// The IDD of a Gen2 tag: PC, XPC if there is one, EPC, TID if it is wanted.
Bytes gen2_idd(ByteView epc, std::optional<std::uint16_t> xpc, ByteView tid);

}  // namespace gantry::harting
