#include "base/bytes.hpp"

#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <rapidcheck/gtest.h>

namespace gantry {

TEST(Hex, BlanksAreAllowedBetweenDigitsAndCaseDoesNotMatter) {
    EXPECT_EQ(from_hex("80 01\t7f\r\nFF"), (Bytes{0x80, 0x01, 0x7F, 0xFF}));
    EXPECT_EQ(from_hex("8 0 0 1"), (Bytes{0x80, 0x01}));
    EXPECT_EQ(from_hex(""), Bytes{});
    EXPECT_EQ(from_hex(" \n"), Bytes{});
}

TEST(Hex, ALoneDigitOrAnotherCharacterIsRefused) {
    for (auto text : {"8", "80 0", "0x80", "8G", "80-01", "\xB2\xB2", "80\v01"})
        EXPECT_EQ(from_hex(text), std::nullopt) << text;
    EXPECT_EQ(from_hex(std::string_view("80\0", 3)), std::nullopt);
}

TEST(Hex, IsWrittenInUpperCaseIntoExactlyTwoCharactersAByte) {
    Bytes bytes{0x00, 0x0A, 0xF0, 0xFF};
    EXPECT_EQ(to_hex(bytes), "000AF0FF");
    char room[10] = "#########";
    EXPECT_EQ(write_hex(bytes, room), room + 8);
    EXPECT_EQ(std::string_view(room, 9), "000AF0FF#");
}

RC_GTEST_PROP(Hex, BytesSurviveTheWayThroughText, (const Bytes& bytes)) {
    RC_ASSERT(from_hex(to_hex(bytes)) == bytes);
}

RC_GTEST_PROP(Bytes, TextAndBytesAreTwoViewsOfTheSame, (const std::string& text)) {
    RC_ASSERT(as_text(as_bytes(text)) == text);
}

}  // namespace gantry
