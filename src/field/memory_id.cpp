#include "field/memory_id.hpp"

#include "field/field.hpp"

namespace gantry::field {

static constexpr std::uint32_t code_bits = 0xFFFF;

EpcGen1Memory::EpcGen1Memory(const TagSpec& spec)
    : TagMemory(spec), kill_code_(spec.kill_password & code_bits) {}

// These chips are made for ids of one length.
AirResult<void> EpcGen1Memory::program(const event::TagId& new_id, std::uint32_t kill_password, bool lock) {
    if (locked_) return tl::unexpected(AirError::locked);
    if (new_id.size != id().size) return tl::unexpected(AirError::bad_address);
    if (!can_store()) return tl::unexpected(AirError::insufficient_power);
    answer_as(new_id);
    kill_code_ = kill_password & code_bits;
    locked_ = lock;
    return {};
}

AirResult<void> EpcGen1Memory::kill(std::uint32_t kill_password) {
    return kill_if(kill_code_, kill_password);
}

Epc119Memory::Epc119Memory(const TagSpec& spec) : TagMemory(spec) {}

AirResult<void> Epc119Memory::program(const event::TagId& new_id, std::uint32_t /*kill_password*/,
                                      bool /*lock*/) {
    if (new_id.size != id().size) return tl::unexpected(AirError::bad_address);
    if (!can_store()) return tl::unexpected(AirError::insufficient_power);
    answer_as(new_id);
    return {};
}

}  // namespace gantry::field
