#pragma once
#include <array>
#include <optional>
#include <vector>

#include "field/memory.hpp"

namespace gantry::field {

// EPC Gen2 (ISO/IEC 18000-63): four banks of 16-bit words, two passwords, ten lock bits, kill.
class Gen2Memory final : public TagMemory {
public:
    explicit Gen2Memory(const TagSpec& spec);

    AirResult<Bytes> read(Bank bank, std::uint32_t word, std::uint32_t words,
                          std::uint32_t password) const override;
    AirResult<void> write(Bank bank, std::uint32_t word, ByteView data, std::uint32_t password) override;
    AirResult<void> lock(AirLock lock, std::uint32_t password) override;
    AirResult<void> permalock(Bank bank, std::uint32_t first, ByteView mask, std::uint32_t password) override;
    AirResult<Bytes> permalocked(Bank bank, std::uint32_t first, std::uint32_t bytes,
                                 std::uint32_t password) const override;
    AirResult<void> kill(std::uint32_t kill_password) override;

private:
    enum class Access { refused, open, secured };
    Access access(std::uint32_t password) const;
    std::uint32_t password_at(std::size_t word) const;
    unsigned lock_bits(Bank bank, std::uint32_t word) const;
    bool has(Bank bank, std::size_t word) const;
    bool may_write(Bank bank, std::uint32_t word, bool secured) const;
    AirResult<void> may_permalock(Bank bank, std::uint32_t first, std::uint32_t password) const;
    void epc_written();

    std::array<Bytes, 4> banks_;     // by Bank
    std::size_t epc_end_ = 0;        // words of CRC, PC and EPC memory
    std::optional<unsigned> xpc_;    // XPC_W1
    std::uint16_t locks_ = 0;        // ten bits as in AirLock
    std::vector<bool> permalocked_;  // blocks of the user bank
};

}  // namespace gantry::field
