#pragma once
#include <array>
#include <cstdint>

#include "base/bytes.hpp"

namespace gantry::wire {

// CRC-16 with a reflected polynomial (least significant bit first), sixteen bytes a step.
class Crc16 {
public:
    explicit constexpr Crc16(std::uint16_t reflected_polynomial, std::uint16_t initial) : initial_(initial) {
        for (std::uint32_t i = 0; i < 256; ++i) {
            std::uint16_t crc = static_cast<std::uint16_t>(i);
            for (int bit = 0; bit < 8; ++bit)
                crc =
                    static_cast<std::uint16_t>((crc & 1) != 0 ? (crc >> 1) ^ reflected_polynomial : crc >> 1);
            table_[0][i] = crc;
        }
        for (std::size_t slice = 1; slice < slices; ++slice)
            for (std::size_t i = 0; i < 256; ++i) {
                auto before = table_[slice - 1][i];
                table_[slice][i] = static_cast<std::uint16_t>((before >> 8) ^ table_[0][before & 0xFF]);
            }
    }

    std::uint16_t operator()(ByteView bytes) const { return update(initial_, bytes); }
    std::uint16_t update(std::uint16_t crc, ByteView bytes) const;

private:
    std::uint16_t initial_;
    static constexpr std::size_t slices = 16;
    std::array<std::array<std::uint16_t, 256>, slices> table_{};
};

// CRC-16/MODBUS: polynomial 0x8005 reflected, starts at 0xFFFF, no final XOR; "123456789" gives 0x4B37.
extern const Crc16 crc16_modbus;

// Polynomial 0x1021 fed most significant bit first into a register that starts at `initial`, with no trailing
// zeros: the register after the message bits themselves.
std::uint16_t crc16_ccitt_register(ByteView bytes, std::uint16_t initial = 0xFFFF);

}  // namespace gantry::wire
