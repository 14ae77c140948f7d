#include "wire/crc.hpp"

#include <bit>
#include <cstring>

namespace gantry::wire {

constinit const Crc16 crc16_modbus{0xA001, 0xFFFF};

std::uint16_t Crc16::update(std::uint16_t crc, ByteView bytes) const {
    static_assert(std::endian::native == std::endian::little);
    const auto* at = bytes.data();
    auto left = bytes.size();
    // What the eight bytes of a chunk leave behind when `after` more bytes follow it.
    auto eight = [this](std::uint64_t chunk, std::size_t after) {
        const auto* table = &table_[after];
        return table[7][chunk & 0xFF] ^ table[6][chunk >> 8 & 0xFF] ^ table[5][chunk >> 16 & 0xFF] ^
               table[4][chunk >> 24 & 0xFF] ^ table[3][chunk >> 32 & 0xFF] ^ table[2][chunk >> 40 & 0xFF] ^
               table[1][chunk >> 48 & 0xFF] ^ table[0][chunk >> 56];
    };
    auto chunk_at = [](const std::uint8_t* from) {
        std::uint64_t chunk;
        std::memcpy(&chunk, from, 8);
        return chunk;
    };
    for (; left >= 16; left -= 16, at += 16)
        crc = static_cast<std::uint16_t>(eight(chunk_at(at) ^ crc, 8) ^ eight(chunk_at(at + 8), 0));
    if (left >= 8) {
        crc = static_cast<std::uint16_t>(eight(chunk_at(at) ^ crc, 0));
        at += 8;
        left -= 8;
    }
    for (; left > 0; --left, ++at)
        crc = static_cast<std::uint16_t>((crc >> 8) ^ table_[0][(crc ^ *at) & 0xFF]);
    return crc;
}

// The register form of the bit-by-bit rule: each message bit is shifted in from the right and the
// polynomial is applied when a one falls out on the left.
std::uint16_t crc16_ccitt_register(ByteView bytes, std::uint16_t initial) {
    std::uint32_t crc = initial;
    for (auto byte : bytes)
        for (int bit = 7; bit >= 0; --bit) {
            bool out = (crc & 0x8000) != 0;
            crc = (crc << 1 | (byte >> bit & 1u)) & 0xFFFF;
            if (out) crc ^= 0x1021;
        }
    return static_cast<std::uint16_t>(crc);
}

}  // namespace gantry::wire
