#include "protocols/caen/device_mask.hpp"

namespace gantry::caen {

static bool bit_of(ByteView bytes, std::size_t at) {
    return (bytes[at / 8] >> (7 - at % 8) & 1u) != 0;
}

static bool same_bits(ByteView memory, std::size_t first, ByteView mask, std::size_t bits) {
    if (first + bits > memory.size() * 8) return false;
    for (std::size_t i = 0; i < bits; ++i)
        if (bit_of(memory, first + i) != bit_of(mask, i)) return false;
    return true;
}

bool TagMask::matches(Air& air, const AirAccess& tag, event::Technology technology) const {
    if (bits == 0) return true;
    if (!bank) return same_bits(tag.tag.view(), first_bit, bytes, bits);
    if (technology != event::Technology::epc_gen2) return false;
    auto first_word = first_bit / 16, last_word = (first_bit + bits - 1) / 16;
    auto memory = air.read(tag, *bank, first_word, last_word - first_word + 1);
    return memory && same_bits(*memory, first_bit % 16, bytes, bits);
}

}  // namespace gantry::caen
