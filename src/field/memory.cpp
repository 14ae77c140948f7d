#include "field/memory.hpp"

#include "field/field.hpp"
#include "field/memory_6b.hpp"
#include "field/memory_gen2.hpp"
#include "field/memory_icode1.hpp"
#include "field/memory_id.hpp"
#include "field/memory_plain.hpp"

namespace gantry::field {

TagMemory::TagMemory(const TagSpec& spec) : technology_(spec.technology), id_(spec.id) {}

static auto silence() {
    return tl::unexpected(AirError::no_tag);
}

AirResult<Bytes> TagMemory::read(Bank /*bank*/, std::uint32_t /*word*/, std::uint32_t /*words*/,
                                 std::uint32_t /*password*/) const {
    return silence();
}
AirResult<void> TagMemory::write(Bank /*bank*/, std::uint32_t /*word*/, ByteView /*data*/,
                                 std::uint32_t /*password*/) {
    return silence();
}
AirResult<void> TagMemory::lock(AirLock /*lock*/, std::uint32_t /*password*/) {
    return silence();
}
AirResult<void> TagMemory::permalock(Bank /*bank*/, std::uint32_t /*first*/, ByteView /*mask*/,
                                     std::uint32_t /*password*/) {
    return silence();
}
AirResult<Bytes> TagMemory::permalocked(Bank /*bank*/, std::uint32_t /*first*/, std::uint32_t /*bytes*/,
                                        std::uint32_t /*password*/) const {
    return silence();
}
AirResult<void> TagMemory::kill(std::uint32_t /*kill_password*/) {
    return silence();
}
AirResult<Bytes> TagMemory::read_bytes(std::uint32_t /*address*/, std::uint32_t /*size*/) const {
    return silence();
}
AirResult<void> TagMemory::write_bytes(std::uint32_t /*address*/, ByteView /*data*/) {
    return silence();
}
AirResult<void> TagMemory::lock_byte(std::uint32_t /*address*/) {
    return silence();
}
AirResult<void> TagMemory::program(const event::TagId& /*new_id*/, std::uint32_t /*kill_password*/,
                                   bool /*lock*/) {
    return silence();
}

AirResult<void> TagMemory::kill_if(std::uint32_t own_password, std::uint32_t password) {
    if (own_password == 0 || own_password != password) return tl::unexpected(AirError::locked);
    if (!can_store()) return tl::unexpected(AirError::insufficient_power);
    killed_ = true;
    return {};
}

std::unique_ptr<TagMemory> make_memory(const TagSpec& spec) {
    using event::Technology;
    switch (spec.technology) {
        case Technology::epc_gen2:
            return std::make_unique<Gen2Memory>(spec);
        case Technology::iso18000_6b:
            return std::make_unique<Iso6bMemory>(spec);
        case Technology::epc_gen1:
            return std::make_unique<EpcGen1Memory>(spec);
        case Technology::epc_1_19:
            return std::make_unique<Epc119Memory>(spec);
        case Technology::icode1:
            return std::make_unique<Icode1Memory>(spec);
        case Technology::unknown:
        case Technology::iso18000_6a:
        case Technology::iso15693:
            break;
    }
    return std::make_unique<PlainMemory>(spec);
}

}  // namespace gantry::field
