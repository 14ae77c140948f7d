#pragma once
#include "field/memory.hpp"

namespace gantry::field {

// The other technologies (ISO 15693 above all): an id for ever, and user memory that is open to all.
class PlainMemory final : public TagMemory {
public:
    explicit PlainMemory(const TagSpec& spec);

    AirResult<Bytes> read(Bank bank, std::uint32_t word, std::uint32_t words,
                          std::uint32_t password) const override;
    AirResult<void> write(Bank bank, std::uint32_t word, ByteView data, std::uint32_t password) override;
    AirResult<void> lock(AirLock lock, std::uint32_t password) override;
    AirResult<void> kill(std::uint32_t kill_password) override;

private:
    Bytes user_;
};

}  // namespace gantry::field
