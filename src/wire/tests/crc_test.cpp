#include "wire/crc.hpp"

#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <rapidcheck/gtest.h>

#include "testkit/vectors.hpp"

namespace gantry::wire {

using testkit::hex;

// Bit by bit, straight from the definition: the check of the sliced tables.
static std::uint16_t bitwise(std::uint16_t polynomial, std::uint16_t crc, ByteView bytes) {
    for (auto byte : bytes) {
        crc = static_cast<std::uint16_t>(crc ^ byte);
        for (int bit = 0; bit < 8; ++bit)
            crc = static_cast<std::uint16_t>((crc & 1) != 0 ? crc >> 1 ^ polynomial : crc >> 1);
    }
    return crc;
}

TEST(Crc, ModbusGivesTheCheckValueOfTheCatalogue) {
    EXPECT_EQ(crc16_modbus(as_bytes("123456789")), 0x4B37);
    EXPECT_EQ(crc16_modbus({}), 0xFFFF);
}

TEST(Crc, OtherReflectedPolynomialsGiveTheirCheckValues) {
    Crc16 kermit(0x8408, 0x0000), mcrf4xx(0x8408, 0xFFFF), arc(0xA001, 0x0000);
    EXPECT_EQ(kermit(as_bytes("123456789")), 0x2189);
    EXPECT_EQ(mcrf4xx(as_bytes("123456789")), 0x6F91);
    EXPECT_EQ(arc(as_bytes("123456789")), 0xBB3D);
}

TEST(Crc, EightBytesAStepGiveTheSameAsOneBitAStepAtEveryLengthAndOffset) {
    Bytes bytes;
    for (unsigned i = 0; i < 96; ++i)
        bytes.push_back(static_cast<std::uint8_t>(i * 89 + 7));
    for (std::size_t offset = 0; offset < 16; ++offset)
        for (std::size_t size = 0; offset + size <= bytes.size(); ++size) {
            auto part = ByteView(bytes).subspan(offset, size);
            ASSERT_EQ(crc16_modbus(part), bitwise(0xA001, 0xFFFF, part)) << offset << " " << size;
        }
}

RC_GTEST_PROP(Crc, PiecesGiveTheSameAsTheWhole, (const Bytes& bytes)) {
    auto cut = *rc::gen::inRange<std::size_t>(0, bytes.size() + 1);
    auto all = ByteView(bytes);
    auto crc = crc16_modbus.update(0xFFFF, all.first(cut));
    RC_ASSERT(crc16_modbus.update(crc, all.subspan(cut)) == crc16_modbus(bytes));
    RC_ASSERT(crc16_modbus(bytes) == bitwise(0xA001, 0xFFFF, bytes));
}

// Silion guide, section on frames of the module: polynomial 0x1021 in a register that message bits are
// shifted into; 03 "get version" carries 1D0C.
TEST(Crc, TheRegisterFormGivesTheValuesOfKnownFrames) {
    EXPECT_EQ(crc16_ccitt_register(hex("0003")), 0x1D0C);
    EXPECT_EQ(crc16_ccitt_register(hex("016103")), 0xBDBE);
    EXPECT_EQ(crc16_ccitt_register({}), 0xFFFF);
}

TEST(Crc, TheRegisterFormWithItsSixteenZerosIsTheCatalogueForm) {
    // CRC-16/SPI-FUJITSU starts the plain form at 0x1D0F; the register form reaches that after 16 zero bits.
    auto message = hex("313233343536373839");
    auto with_zeros = message;
    with_zeros.insert(with_zeros.end(), 2, 0);
    EXPECT_EQ(crc16_ccitt_register(with_zeros), 0xE5CC);
}

}  // namespace gantry::wire
