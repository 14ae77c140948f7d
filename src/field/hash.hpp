#pragma once
#include <cstdint>
#include <initializer_list>

#include "base/bytes.hpp"

namespace gantry::field {

// The field's only source of chance: what happens is computed from who, where and how often, never drawn from
// a generator that runs. So it does not matter in what order, or in what slices, anybody asks.
inline std::uint64_t mix(std::uint64_t value) {
    value = (value ^ value >> 32) * 0xD6E8'FEB8'6659'FD93u;
    value = (value ^ value >> 32) * 0xD6E8'FEB8'6659'FD93u;
    return value ^ value >> 32;
}
inline std::uint64_t hash_of(std::initializer_list<std::uint64_t> values) {
    std::uint64_t hash = 0x9E37'79B9'7F4A'7C15u;
    for (auto value : values)
        hash = mix(hash ^ value) + 0x9E37'79B9'7F4A'7C15u;
    return mix(hash);
}
inline std::uint64_t hash_of(ByteView bytes) {
    std::uint64_t hash = bytes.size();
    for (auto byte : bytes)
        hash = mix(hash << 8 ^ byte ^ hash >> 56);
    return hash;
}

// From 0 up to and without 1.
inline double fraction(std::uint64_t hash) {
    return static_cast<double>(hash >> 11) * 0x1p-53;
}

}  // namespace gantry::field
