#include "base/text.hpp"

#include <array>

#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <rapidcheck/gtest.h>

namespace gantry {

struct Hostile {
    std::string_view raw, printable, json;
};

static const Hostile hostile[] = {
    {"", "", "\"\""},
    {"plain text 123", "plain text 123", "\"plain text 123\""},
    {"\"quoted\"", "\"quoted\"", "\"\\\"quoted\\\"\""},
    {"back\\slash", "back\\\\slash", "\"back\\\\slash\""},
    {"a\nb\rc\td", "a\\x0Ab\\x0Dc\\x09d", "\"a\\nb\\rc\\td\""},
    {"\x1B[31mred", "\\x1B[31mred", "\"\\u001B[31mred\""},
    {"\x7F", "\\x7F", "\"\\u007F\""},
    {std::string_view("a\0b", 3), "a\\x00b", "\"a\\u0000b\""},
    // Valid UTF-8 passes.
    {"gr\xC3\xBC\xC3\x9F", "gr\xC3\xBC\xC3\x9F", "\"gr\xC3\xBC\xC3\x9F\""},
    {"\xE2\x82\xAC", "\xE2\x82\xAC", "\"\xE2\x82\xAC\""},
    {"\xF0\x9F\x90\x99", "\xF0\x9F\x90\x99", "\"\xF0\x9F\x90\x99\""},
    // C1 controls, marks that turn the reading direction, zero width space, line separator, byte order mark.
    {"\xC2\x9B", "\\u{009B}", "\"\xC2\x9B\""},
    {"\xE2\x80\xAE", "\\u{202E}", "\"\xE2\x80\xAE\""},
    {"\xE2\x80\x8B", "\\u{200B}", "\"\xE2\x80\x8B\""},
    {"\xE2\x80\xA8", "\\u{2028}", "\"\\u2028\""},
    {"\xEF\xBB\xBF", "\\u{FEFF}", "\"\xEF\xBB\xBF\""},
    {"\xF3\xA0\x81\x81", "\\u{E0041}", "\"\xF3\xA0\x81\x81\""},
    // Bytes that are no UTF-8: a stray continuation, an overlong slash, half a surrogate pair, above
    // U+10FFFF, a sequence cut short.
    {"\x80", "\\x80", "\"\xEF\xBF\xBD\""},
    {"\xC0\xAF", "\\xC0\\xAF", "\"\xEF\xBF\xBD\xEF\xBF\xBD\""},
    {"\xE0\x80\xAF", "\\xE0\\x80\\xAF", "\"\xEF\xBF\xBD\xEF\xBF\xBD\xEF\xBF\xBD\""},
    {"\xED\xA0\x80", "\\xED\\xA0\\x80", "\"\xEF\xBF\xBD\xEF\xBF\xBD\xEF\xBF\xBD\""},
    {"\xF4\x90\x80\x80", "\\xF4\\x90\\x80\\x80", "\"\xEF\xBF\xBD\xEF\xBF\xBD\xEF\xBF\xBD\xEF\xBF\xBD\""},
    {"\xE2\x82", "\\xE2\\x82", "\"\xEF\xBF\xBD\xEF\xBF\xBD\""},
    {"\xFF"
     "a",
     "\\xFFa",
     "\"\xEF\xBF\xBD"
     "a\""},
};

TEST(Text, HostileBytesComeOutPrintable) {
    for (auto& each : hostile)
        EXPECT_EQ(printable(each.raw), each.printable);
}

TEST(Text, HostileBytesComeOutAsAJsonString) {
    for (auto& each : hostile) {
        std::string out = "[";
        append_json_string(out, each.raw);
        EXPECT_EQ(out, "[" + std::string(each.json));
    }
}

static std::string some_bytes() {
    return *rc::gen::container<std::string>(rc::gen::arbitrary<char>());
}

RC_GTEST_PROP(Text, WhatIsPrintableIsAlwaysUtf8WithoutControls, ()) {
    auto out = printable(some_bytes());
    RC_ASSERT(is_utf8(out));
    for (char c : out)
        RC_ASSERT(static_cast<unsigned char>(c) >= 0x20 && c != 0x7F);
}

RC_GTEST_PROP(Text, DifferentBytesStayDifferentWhenPrinted, ()) {
    auto a = some_bytes(), b = some_bytes();
    RC_ASSERT((a == b) == (printable(a) == printable(b)));
}

RC_GTEST_PROP(Text, AJsonStringIsUtf8OnOneLineWhateverWentIn, ()) {
    std::string out;
    append_json_string(out, some_bytes());
    RC_ASSERT(is_utf8(out));
    RC_ASSERT(out.find('\n') == std::string::npos);
    RC_ASSERT(out.size() >= 2 && out.front() == '"' && out.back() == '"');
}

TEST(Text, AsciiAndUtf8AreToldFromTheRest) {
    EXPECT_TRUE(is_printable_ascii(""));
    EXPECT_TRUE(is_printable_ascii(" ~"));
    EXPECT_FALSE(is_printable_ascii("\x7F"));
    EXPECT_FALSE(is_printable_ascii("\n"));
    EXPECT_FALSE(is_printable_ascii("\xC3\xBC"));
    EXPECT_TRUE(is_utf8("\xC3\xBC"));
    EXPECT_FALSE(is_utf8("\xC3"));
}

TEST(Matches, AStarStandsForAnyRunOfCharacters) {
    EXPECT_TRUE(matches("gate-*", "gate-"));
    EXPECT_TRUE(matches("gate-*", "gate-12"));
    EXPECT_FALSE(matches("gate-*", "gate"));
    EXPECT_TRUE(matches("*", ""));
    EXPECT_TRUE(matches("**", "x"));
    EXPECT_TRUE(matches("a*b*c", "a-b-b-c"));
    EXPECT_FALSE(matches("a*b*c", "a-b-b-d"));
    EXPECT_TRUE(matches("*.local", "x.local.local"));
    EXPECT_TRUE(matches("", ""));
    EXPECT_FALSE(matches("", "x"));
    EXPECT_FALSE(matches("Gate", "gate"));
    EXPECT_FALSE(matches("gate?", "gate1")) << "only the star is special";
}

TEST(Matches, ManyStarsAgainstALongNameEndInTime) {
    std::string pattern, name(5000, 'a');
    for (int i = 0; i < 200; ++i)
        pattern += "a*";
    EXPECT_FALSE(matches(pattern + "b", name));
    EXPECT_TRUE(matches(pattern, name));
}

RC_GTEST_PROP(Matches, ANameMatchesItselfAndItsEveryBeginningWithAStar, (std::string name)) {
    std::erase(name, '*');
    auto cut = *rc::gen::inRange<std::size_t>(0, name.size() + 1);
    RC_ASSERT(matches(name, name));
    RC_ASSERT(matches(name.substr(0, cut) + "*", name));
    RC_ASSERT(matches("*" + name.substr(cut), name));
    RC_ASSERT(!matches(name, name + "x"));
}

TEST(Nearest, FindsASlipAndNothingForAnotherWord) {
    static constexpr std::array<std::string_view, 4> words = {"data_dir", "address", "zone", "id"};
    EXPECT_EQ(nearest("adress", words), "address");
    EXPECT_EQ(nearest("datadir", words), "data_dir");
    EXPECT_EQ(nearest("zoen", words), "zone");
    EXPECT_EQ(nearest("zone", words), "zone");
    EXPECT_EQ(nearest("temperature", words), "");
    EXPECT_EQ(nearest("xy", words), "") << "a word as short as the slip is no suggestion";
    EXPECT_EQ(nearest("", words), "");
    EXPECT_EQ(nearest("zone", {}), "");
    EXPECT_EQ(nearest("getpower", std::array<std::string_view, 2>{"SetPower", "GetPower"}), "GetPower");
}

TEST(Text, CaseOfLettersAloneDoesNotTellNamesApart) {
    EXPECT_TRUE(alike("G2Kill", "g2KILL"));
    EXPECT_TRUE(alike("", ""));
    EXPECT_FALSE(alike("G2Kill", "G2Kil"));
    EXPECT_FALSE(alike("a[", "A{"));
    EXPECT_FALSE(alike("\xC4", "\xE4")) << "only ASCII letters have a case here";
}

}  // namespace gantry
