#include "wire/cursor.hpp"

#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <rapidcheck/gtest.h>

#include "testkit/vectors.hpp"

namespace gantry::wire {

using testkit::hex;

TEST(Reader, ReadsStraightDownALayout) {
    auto bytes = hex("01 FE 0203 04050607 0A0B AABBCC");
    Reader in(bytes);
    EXPECT_EQ(in.u8("a"), 1);
    EXPECT_EQ(in.s8("b"), -2);
    EXPECT_EQ(in.u16("c"), 0x0203);
    EXPECT_EQ(in.u32("d"), 0x04050607u);
    EXPECT_EQ(in.little_endian(2, "e"), 0x0B0Au);
    EXPECT_EQ(in.left(), 3u);
    EXPECT_EQ(to_hex(in.rest()), "AABBCC");
    EXPECT_EQ(in.left(), 0u);
    EXPECT_FALSE(in.fault());
}

TEST(Reader, TheFirstFaultSticksAndLaterReadsYieldZeros) {
    auto bytes = hex("0102 03");
    Reader in(bytes, 100);
    EXPECT_EQ(in.u16("first"), 0x0102);
    EXPECT_EQ(in.u16("second"), 0);
    EXPECT_EQ(in.u8("third"), 0) << "a byte is there, but after a fault nothing is read";
    EXPECT_TRUE(in.rest().empty());
    in.fail(Errc::bad_value, "fourth");
    ASSERT_TRUE(in.fault());
    EXPECT_EQ(*in.fault(), (Fault{Errc::truncated, 102, "second"}));
    EXPECT_EQ(in.fault()->text(), "second at 102: truncated");
}

TEST(Reader, AHugeLengthIsAFaultAndNoOverflow) {
    auto bytes = hex("0102");
    Reader in(bytes);
    in.u8("a");
    EXPECT_TRUE(in.bytes(SIZE_MAX, "b").empty());
    EXPECT_EQ(in.fault()->code, Errc::truncated);
}

TEST(Fault, ADetailTakesThePlaceOfTheGeneralWord) {
    EXPECT_EQ((Fault{Errc::bad_length, 18, "AVP", "length 3 is below its header (6)"}.text()),
              "AVP at 18: length 3 is below its header (6)");
    for (auto code : {Errc::truncated, Errc::trailing_bytes, Errc::bad_length, Errc::bad_value,
                      Errc::bad_checksum, Errc::unknown_code, Errc::too_big})
        EXPECT_FALSE(to_text(code).empty());
    EXPECT_EQ(to_text(Errc::bad_checksum), "bad checksum");
}

TEST(Writer, AppendsBehindWhatIsThereAndFillsHolesLater) {
    auto out = hex("EE");
    Writer writer(out);
    auto length = writer.hole(2);
    writer.u8(0xAB);
    writer.u16(0x0102);
    writer.u32(0x03040506);
    writer.little_endian(0x0708, 2);
    writer.bytes(hex("FF"));
    writer.patch_big_endian(length, writer.written(), 2);
    EXPECT_EQ(to_hex(out), "EE000CAB0102030405060807FF");
    EXPECT_EQ(to_hex(writer.since_start()), "000CAB0102030405060807FF");
}

RC_GTEST_PROP(Cursor, EveryNumberGoesBothWaysInEverySizeItFits, ()) {
    auto size = *rc::gen::inRange<std::size_t>(1, 9);
    auto value = *rc::gen::arbitrary<std::uint64_t>() >> (8 * (8 - size));
    Bytes out;
    Writer writer(out);
    writer.big_endian(value, size);
    writer.little_endian(value, size);
    RC_ASSERT(out.size() == 2 * size);
    Reader in(out);
    RC_ASSERT(in.big_endian(size, "big") == value);
    RC_ASSERT(in.little_endian(size, "little") == value);
    RC_ASSERT(!in.fault() && in.left() == 0);
}

}  // namespace gantry::wire
