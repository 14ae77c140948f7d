#include "field/memory_plain.hpp"

#include <algorithm>

#include "field/field.hpp"

namespace gantry::field {

// ISO 15693 (ICODE SLI): 28 blocks of 4 bytes are the user's; of other tags nothing is known.
static constexpr std::size_t iso15693_size = 28 * 4, other_size = 32;

PlainMemory::PlainMemory(const TagSpec& spec) : TagMemory(spec), user_(spec.user) {
    if (spec.technology == event::Technology::iso15693)
        user_.resize(std::max(user_.size(), iso15693_size));
    else if (user_.empty())
        user_.resize(other_size);
    if (user_.size() % 2 != 0) user_.push_back(0);
}

AirResult<Bytes> PlainMemory::read(Bank bank, std::uint32_t word, std::uint32_t words,
                                   std::uint32_t /*password*/) const {
    auto size = user_.size() / 2;
    if (bank != Bank::user || !fits(size, word, words)) return tl::unexpected(AirError::bad_address);
    auto from = user_.begin() + static_cast<std::ptrdiff_t>(word) * 2;
    return Bytes(from, words == 0 ? user_.end() : from + static_cast<std::ptrdiff_t>(words) * 2);
}

AirResult<void> PlainMemory::write(Bank bank, std::uint32_t word, ByteView data, std::uint32_t /*password*/) {
    if (bank != Bank::user || data.empty() || data.size() % 2 != 0 ||
        !fits(user_.size() / 2, word, data.size() / 2))
        return tl::unexpected(AirError::bad_address);
    if (!can_store()) return tl::unexpected(AirError::insufficient_power);
    std::ranges::copy(data, user_.begin() + static_cast<std::ptrdiff_t>(word) * 2);
    return {};
}

AirResult<void> PlainMemory::lock(AirLock /*lock*/, std::uint32_t /*password*/) {
    return tl::unexpected(AirError::unsupported);
}
AirResult<void> PlainMemory::kill(std::uint32_t /*kill_password*/) {
    return tl::unexpected(AirError::unsupported);
}

}  // namespace gantry::field
