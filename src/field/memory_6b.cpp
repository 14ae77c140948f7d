#include "field/memory_6b.hpp"

#include <algorithm>

#include "field/field.hpp"

namespace gantry::field {

// An id of another size is cut or filled up, more user data than there is room for is left out.
Iso6bMemory::Iso6bMemory(const TagSpec& spec) : TagMemory(spec) {
    auto id = spec.id.view();
    memory_.assign(id.begin(), id.begin() + static_cast<std::ptrdiff_t>(std::min(id.size(), id_size)));
    memory_.resize(id_size);
    answer_as(event::TagId(memory_));
    memory_.insert(memory_.end(), spec.user.begin(), spec.user.end());
    memory_.resize(spec.user.empty() ? default_size : std::min(memory_.size(), max_size));
    locked_.resize(memory_.size());
    std::fill_n(locked_.begin(), id_size, true);
}

AirResult<Bytes> Iso6bMemory::read_bytes(std::uint32_t address, std::uint32_t size) const {
    if (!fits(memory_.size(), address, size)) return tl::unexpected(AirError::bad_address);
    auto from = memory_.begin() + static_cast<std::ptrdiff_t>(address);
    return Bytes(from, from + static_cast<std::ptrdiff_t>(size));
}

AirResult<void> Iso6bMemory::write_bytes(std::uint32_t address, ByteView data) {
    if (data.empty() || !fits(memory_.size(), address, data.size()))
        return tl::unexpected(AirError::bad_address);
    for (std::size_t i = 0; i < data.size(); ++i)
        if (locked_[address + i]) return tl::unexpected(AirError::locked);
    if (!can_store()) return tl::unexpected(AirError::insufficient_power);
    std::ranges::copy(data, memory_.begin() + static_cast<std::ptrdiff_t>(address));
    return {};
}

// A reader asks first whether the byte can be locked; of one that is, the tag says no.
AirResult<void> Iso6bMemory::lock_byte(std::uint32_t address) {
    if (!fits(memory_.size(), address, 1)) return tl::unexpected(AirError::bad_address);
    if (locked_[address]) return tl::unexpected(AirError::locked);
    if (!can_store()) return tl::unexpected(AirError::insufficient_power);
    locked_[address] = true;
    return {};
}

}  // namespace gantry::field
