#pragma once
#include <vector>

#include "field/memory.hpp"

namespace gantry::field {

// ISO 18000-6B: one memory of up to 2048 bits, counted in bytes, of which the first eight are the id. Each
// byte can be locked, for ever; the maker has locked the id. No passwords.
class Iso6bMemory final : public TagMemory {
public:
    static constexpr std::size_t id_size = 8, default_size = 224, max_size = 256;  // bytes

    explicit Iso6bMemory(const TagSpec& spec);

    AirResult<Bytes> read_bytes(std::uint32_t address, std::uint32_t size) const override;
    AirResult<void> write_bytes(std::uint32_t address, ByteView data) override;
    AirResult<void> lock_byte(std::uint32_t address) override;

private:
    Bytes memory_;
    std::vector<bool> locked_;  // by byte
};

}  // namespace gantry::field
