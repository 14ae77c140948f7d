#pragma once
#include <optional>

#include "protocols/harting/tables.hpp"

// The commands that do something to one tag: [0xB0] 0x23, 0x24 and all of [0xB3] (sections 6 and 7). One
// value for all of them; which parts are there says the sub command and MODE.
namespace gantry::harting {

struct TagCommand {
    Command command = Command::read_multiple_blocks;
    std::uint8_t mode = addressed | uid_length | extended_address;
    Bytes uid = {};                     // addressed: the EPC, or the TID where inventories carry it
    std::uint8_t bank = 0;              // with its password flag; only with the extended address or where the
                                        // command always has it
    Bytes password = {};                // access password, in Kill the kill password
    std::uint16_t address = 0;          // DB-ADR, BLOCK-PTR
    std::uint8_t count = 0;             // DB-N, BLOCK-RANGE
    std::uint8_t size = 2;              // DB-SIZE: bytes of a block
    Bytes data = {};                    // the blocks to write, the mask, LOCK-DATA
    std::uint8_t type = type_epc_gen2;  // TR-TYPE of Lock
    std::optional<std::uint8_t> recom = {};  // Kill

    bool is_addressed() const { return (mode & address_bits) == addressed; }
    friend bool operator==(const TagCommand&, const TagCommand&) = default;
};

// Reads the data of a request of one of these commands, sub command first.
wire::Result<TagCommand> parse_tag_command(std::uint8_t control, ByteView data);
// Appends the data, sub command first.
void append_tag_command(const TagCommand& command, Bytes& out);
bool is_tag_command(Command command);  // but not of Untraceable and Authenticate: nobody published their data

// The data of the reply to Read Multiple Blocks.
struct BlockData {
    std::uint8_t size = 2;        // bytes of a block
    std::uint8_t bad_status = 0;  // the first SEC-STATUS that is not 0
    std::size_t first_bad = 0;    // of which block
    Bytes data;                   // all blocks
};
wire::Result<BlockData> parse_block_data(ByteView data);
void append_block_data(ByteView blocks, std::uint8_t size, Bytes& out);

// LOCK-DATA: Gen2's ten mask and ten action bits (reader/job.hpp LockTag), left in three bytes.
Bytes lock_data(std::uint16_t mask, std::uint16_t action);
struct LockBits {
    std::uint16_t mask = 0, action = 0;
};
LockBits lock_bits(ByteView lock_data);  // three bytes

}  // namespace gantry::harting
