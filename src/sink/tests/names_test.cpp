#include "sink/names.hpp"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "base/text.hpp"

namespace gantry::sink {

TEST(EncodeName, PlainNamesStayAsTheyAre) {
    EXPECT_EQ(encode_name("dock-1_A.b c", "/+#$"), "dock-1_A.b c");
    EXPECT_EQ(encode_name("Größe 北", "/+#$"), "Größe 北");
    EXPECT_EQ(encode_name("", "/+#$"), "");
}

TEST(EncodeName, WhatWouldBeAnotherPlaceIsEncoded) {
    EXPECT_EQ(encode_name("a/b/#/+/$SYS", "/+#$"), "a%2Fb%2F%23%2F%2B%2F%24SYS");
    EXPECT_EQ(encode_name("x.*.> y", ".*> "), "x%2E%2A%2E%3E%20y");
    EXPECT_EQ(encode_name("100%2F", "/"), "100%252F");
}

TEST(EncodeName, ControlsAndWhatHidesTextAreEncoded) {
    EXPECT_EQ(encode_name(std::string_view("a\0b\r\n\x7F", 6), ""), "a%00b%0D%0A%7F");
    EXPECT_EQ(encode_name("\xC2\x85", ""), "%C2%85") << "a control beyond ASCII";
    EXPECT_EQ(encode_name("\xE2\x80\xAEx", ""), "%E2%80%AEx") << "right to left";
    EXPECT_EQ(encode_name("\xEF\xBF\xBE", ""), "%EF%BF%BE") << "no character";
    EXPECT_EQ(encode_name("\xF0\x9F\xBF\xBF", ""), "%F0%9F%BF%BF");
    EXPECT_EQ(encode_name("\xEF\xB7\x90", ""), "%EF%B7%90");
    EXPECT_EQ(encode_name("\xF0\x9F\x98\x80", ""), "\xF0\x9F\x98\x80");
    EXPECT_EQ(encode_name("\xE2\x80", ""), "%E2%80") << "cut short";
    EXPECT_EQ(encode_name("\xFF\x80z", ""), "%FF%80z");
}

RC_GTEST_PROP(EncodeName, CanBeUndoneSoDifferentNamesStayDifferent, (const std::string& name)) {
    auto encoded = encode_name(name, "/+#$");
    RC_ASSERT(is_utf8(encoded));
    std::string back;
    for (std::size_t i = 0; i < encoded.size(); ++i) {
        if (encoded[i] != '%') {
            back += encoded[i];
            continue;
        }
        back += static_cast<char>(std::stoi(encoded.substr(i + 1, 2), nullptr, 16));
        i += 2;
    }
    RC_ASSERT(back == name);
}

}  // namespace gantry::sink
