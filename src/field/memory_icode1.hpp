#pragma once
#include "field/memory.hpp"

namespace gantry::field {

// ICODE1: 16 blocks of 4 bytes. Blocks 0 and 1 hold the serial number, low byte first, and cannot be written;
// block 2 has two write-access bits a block, which can only be cleared: a block without both is locked for
// ever. Here the lowest pair of its first byte stands for block 0. Counted in words of two bytes.
class Icode1Memory final : public TagMemory {
public:
    static constexpr std::size_t blocks = 16, block_size = 4;

    explicit Icode1Memory(const TagSpec& spec);

    AirResult<Bytes> read(Bank bank, std::uint32_t word, std::uint32_t words,
                          std::uint32_t password) const override;
    AirResult<void> write(Bank bank, std::uint32_t word, ByteView data, std::uint32_t password) override;
    AirResult<void> lock(AirLock lock, std::uint32_t password) override;
    AirResult<void> kill(std::uint32_t kill_password) override;

private:
    bool locked(std::size_t block) const;

    Bytes memory_;
};

}  // namespace gantry::field
