#include "field/memory_icode1.hpp"

#include <algorithm>

#include "field/field.hpp"

namespace gantry::field {

static constexpr std::size_t access_block = 2;

// The blocks as they are given, but what every tag of the kind holds stands in the first three.
Icode1Memory::Icode1Memory(const TagSpec& spec) : TagMemory(spec), memory_(spec.user) {
    memory_.resize(blocks * block_size);
    auto id = spec.id.view();
    for (std::size_t i = 0; i < 2 * block_size; ++i)
        memory_[i] = i < id.size() ? id[id.size() - 1 - i] : 0;
    bool given = spec.user.size() >= (access_block + 1) * block_size;
    for (std::size_t i = 0; i < block_size; ++i) {
        auto& byte = memory_[access_block * block_size + i];
        if (!given) byte = 0xFF;
        if (i == 0) byte &= 0xF0;
    }
}

bool Icode1Memory::locked(std::size_t block) const {
    auto bits = memory_[access_block * block_size + block / 4] >> (block % 4 * 2) & 3;
    return bits != 3;
}

AirResult<Bytes> Icode1Memory::read(Bank bank, std::uint32_t word, std::uint32_t words,
                                    std::uint32_t /*password*/) const {
    if (bank != Bank::user || !fits(memory_.size() / 2, word, words))
        return tl::unexpected(AirError::bad_address);
    auto from = memory_.begin() + static_cast<std::ptrdiff_t>(word) * 2;
    return Bytes(from, words == 0 ? memory_.end() : from + static_cast<std::ptrdiff_t>(words) * 2);
}

AirResult<void> Icode1Memory::write(Bank bank, std::uint32_t word, ByteView data,
                                    std::uint32_t /*password*/) {
    if (bank != Bank::user || data.empty() || data.size() % 2 != 0 ||
        !fits(memory_.size() / 2, word, data.size() / 2))
        return tl::unexpected(AirError::bad_address);
    std::size_t first = std::size_t{word} * 2;
    for (auto block = first / block_size; block <= (first + data.size() - 1) / block_size; ++block)
        if (locked(block)) return tl::unexpected(AirError::locked);
    if (!can_store()) return tl::unexpected(AirError::insufficient_power);
    for (std::size_t i = 0; i < data.size(); ++i) {
        auto& byte = memory_[first + i];
        bool once = (first + i) / block_size == access_block;
        byte = once ? byte & data[i] : data[i];
    }
    return {};
}

AirResult<void> Icode1Memory::lock(AirLock /*lock*/, std::uint32_t /*password*/) {
    return tl::unexpected(AirError::unsupported);
}
AirResult<void> Icode1Memory::kill(std::uint32_t /*kill_password*/) {
    return tl::unexpected(AirError::unsupported);
}

}  // namespace gantry::field
