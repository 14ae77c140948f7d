#include "wire/layout.hpp"

#include <algorithm>

#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <rapidcheck/gtest.h>

#include "testkit/vectors.hpp"

namespace gantry::wire {

using testkit::hex;

static constexpr EnumRow color_rows[] = {{0, "Red"}, {1, "Green"}, {200, "Blue"}};
static constexpr Enumeration colors{"Color", color_rows};
static constexpr FieldRow pin_rows[] = {
    {.name = "Pin", .type = Type::number, .size = 1, .min = 1, .max = 4},
    {.name = "Level", .type = Type::integer, .size = 1},
};
static constexpr FieldRow rows[] = {
    {.name = "Count", .type = Type::number, .size = 2, .min = 1, .max = 1000},
    {.name = "Offset", .type = Type::integer, .size = 2},
    {.name = "Color", .type = Type::number, .size = 1, .enumeration = &colors},
    {.name = "Version", .type = Type::version, .size = 4},
    {.name = "Key", .type = Type::bytes, .size = 2},
    {.name = "Pins", .type = Type::list, .size = 1, .record = pin_rows},
    {.name = "Blob", .type = Type::sized, .size = 1},
    {.name = "Note", .type = Type::text, .size = 0},
};

static Fields record(std::int64_t pin, std::int64_t level) {
    return {{"Pin", Value(pin)}, {"Level", Value(level)}};
}

static Fields sample() {
    return {{"Count", Value(258)},
            {"Offset", Value(-2)},
            {"Color", Value(std::string("Green"))},
            {"Version", Value(std::string("1.2.3.255"))},
            {"Key", Value(hex("AABB"))},
            {"Pins", Value(Value::List{Value(record(1, 1)), Value(record(2, -1))})},
            {"Blob", Value(hex("010203"))},
            {"Note", Value(std::string("hello"))}};
}

static const std::string sample_hex =
    "0102"
    "FFFE"
    "01"
    "010203FF"
    "AABB"
    "02010102FF"
    "03010203"
    "68656C6C6F";

static Fields decoded(const Bytes& bytes) {
    Reader in(bytes);
    Fields out;
    decode(rows, in, out);
    EXPECT_FALSE(in.fault()) << in.fault()->text();
    return out;
}

static std::string encoded(const Fields& fields) {
    Bytes out;
    auto done = encode(rows, fields, out);
    return done ? to_hex(out) : done.error().text();
}

static Fields with(std::string_view name, Value value) {
    auto fields = sample();
    auto field = std::ranges::find(fields, name, &Field::name);
    EXPECT_NE(field, fields.end()) << name;
    field->value = std::move(value);
    return fields;
}

TEST(Layout, EveryTypeDecodes) {
    EXPECT_EQ(decoded(hex(sample_hex)), sample());
}

TEST(Layout, EveryTypeEncodes) {
    EXPECT_EQ(encoded(sample()), sample_hex);
}

TEST(Layout, EveryTruncationIsAFaultThatNamesAFieldAndStaysInside) {
    auto whole = hex(sample_hex);
    for (std::size_t size = 0; size < whole.size() - 5; ++size) {  // the last five belong to the open end
        Bytes part(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size));
        Reader in(part);
        Fields out;
        decode(rows, in, out);
        ASSERT_TRUE(in.fault()) << size;
        EXPECT_EQ(in.fault()->code, Errc::truncated);
        EXPECT_LE(in.fault()->offset, size);
        EXPECT_FALSE(in.fault()->field.empty());
    }
}

TEST(Layout, AListThatClaimsMoreThanIsThereCostsNoMemory) {
    static constexpr FieldRow wide[] = {{.name = "Pins", .type = Type::list, .size = 4, .record = pin_rows}};
    auto bytes = hex("FFFFFFFF 0101");
    Reader in(bytes);
    Fields out;
    decode(wide, in, out);
    ASSERT_TRUE(in.fault());
    EXPECT_EQ(in.fault()->field, "Pins");
    EXPECT_TRUE(out.empty());
}

TEST(Layout, NumbersWithoutANameInTheirEnumerationStayNumbers) {
    auto fields =
        decoded(hex("0102FFFE"
                    "07"
                    "010203FFAABB0000"));
    EXPECT_EQ(*find(fields, "Color"), Value(7));
    EXPECT_EQ(*find(fields, "Note"), Value(std::string()));
    EXPECT_EQ(encoded(fields),
              "0102FFFE"
              "07"
              "010203FFAABB0000");
}

TEST(Layout, TextThatIsNotPrintableIsShownAsHexAndGoesBack) {
    auto bytes =
        hex("0102FFFE01010203FFAABB0000"
            "00FF1B");
    auto fields = decoded(bytes);
    auto* note = find(fields, "Note")->get<Fields>();
    ASSERT_NE(note, nullptr);
    EXPECT_EQ(*find(*note, "hex"), Value(std::string("00FF1B")));
    EXPECT_EQ(encoded(fields), to_hex(bytes));
}

TEST(Layout, ValuesMayComeAsAPersonTypesThem) {
    Fields typed = sample();
    typed[0].value = Value(std::string("0x102"));
    typed[1].value = Value(std::string("-2"));
    typed[2].value = Value(std::string("gReEn"));
    typed[4].value = Value(std::string("aa bb"));
    typed[6].value = Value(std::string("010203"));
    EXPECT_EQ(encoded(typed), sample_hex);
    EXPECT_EQ(encoded(with("Note", Value(12))), encoded(with("Note", Value(std::string("12")))));
}

TEST(Layout, WhatDoesNotFitIsRefusedWithTheReason) {
    auto text = [](const char* value) { return Value(std::string(value)); };
    EXPECT_EQ(encoded(with("Count", Value(65536))), "Count at 0: 65536 is outside 0 to 65535");
    EXPECT_EQ(encoded(with("Count", Value(-1))), "Count at 0: -1 is outside 0 to 65535");
    EXPECT_EQ(encoded(with("Count", text("many"))), "Count at 0: expected a number");
    EXPECT_EQ(encoded(with("Offset", Value(32768))), "Offset at 2: 32768 is outside -32768 to 32767");
    EXPECT_EQ(encoded(with("Color", text("Mauve"))),
              "Color at 4: expected a number or one of: Red Green Blue");
    for (auto* bad : {"1.2.3", "1.2.3.256", "1.2.3.4.5", "1..2.3", "", "a.b.c.d", "1.2.3.4 "})
        EXPECT_EQ(encoded(with("Version", text(bad))), "Version at 5: expected a.b.c.d, each 0 to 255")
            << bad;
    EXPECT_EQ(encoded(with("Key", Value(hex("AA")))), "Key at 9: 1 bytes, expected 2");
    EXPECT_EQ(encoded(with("Key", text("AAB"))), "Key at 9: expected hex digits, two a byte");
    EXPECT_EQ(encoded(with("Pins", Value(1))), "Pins at 11: expected a list");
    EXPECT_EQ(encoded(with("Pins", Value(Value::List{Value(1)}))), "Pins at 12: expected a record");
    EXPECT_EQ(encoded(with("Pins", Value(Value::List(256, Value(record(1, 1)))))),
              "Pins at 11: more records than the count can hold");
    EXPECT_EQ(encoded(with("Blob", Value(Bytes(256, 0)))),
              "Blob at 16: longer than its length field can say");
}

TEST(Layout, AMissingOrUnknownFieldIsNamed) {
    auto fields = sample();
    fields.erase(fields.begin() + 3);
    EXPECT_EQ(encoded(fields), "Version at 5: field Version is missing");
    fields = sample();
    fields.push_back({"Colour", Value(1)});
    EXPECT_EQ(encoded(fields), "field at 0: there is no field Colour; did you mean Color?");
    fields.back().name = "x\x1By\x1Bz";
    EXPECT_EQ(encoded(fields), "field at 0: there is no field x\\x1By\\x1Bz");
    Bytes out;
    static constexpr std::string_view allow[] = {"Extra"};
    fields.back().name = "Extra";
    EXPECT_TRUE(encode(rows, fields, out, allow));
    EXPECT_EQ(to_hex(out), sample_hex);
}

TEST(Layout, CheckHoldsNumbersToTheLegalValuesOfTheirRows) {
    EXPECT_TRUE(check(rows, sample()));
    auto refused = check(rows, with("Count", Value(0)));
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().text(), "Count at 0: 0 is outside 1 to 1000");
    EXPECT_FALSE(check(rows, with("Count", Value(std::string("1001")))));
    EXPECT_TRUE(check(rows, with("Offset", Value(30000)))) << "a row without a range takes what fits";
    auto inside = check(rows, with("Pins", Value(Value::List{Value(record(1, 0)), Value(record(5, 0))})));
    ASSERT_FALSE(inside) << "records of lists are checked too";
    EXPECT_EQ(inside.error().field, "Pin");
}

TEST(Layout, NumbersAreReadFromText) {
    auto number = [](const char* text) { return as_number(Value(std::string(text)), &colors); };
    EXPECT_EQ(number("12"), 12);
    EXPECT_EQ(number("0x0C"), 12);
    EXPECT_EQ(number("-5"), -5);
    EXPECT_EQ(number("blue"), 200);
    EXPECT_EQ(number(""), std::nullopt);
    EXPECT_EQ(number("12a"), std::nullopt);
    EXPECT_EQ(number("0x"), std::nullopt);
    EXPECT_EQ(number("--5"), std::nullopt);
    EXPECT_EQ(as_number(Value(true)), 1);
    EXPECT_EQ(as_number(Value(Bytes{1})), std::nullopt);
}

RC_GTEST_PROP(Layout, WhateverDecodesEncodesBackToTheSameBytes, ()) {
    auto some = [](std::size_t size) {
        return *rc::gen::container<Bytes>(size, rc::gen::arbitrary<std::uint8_t>());
    };
    auto records = *rc::gen::inRange<std::size_t>(0, 20), blob = *rc::gen::inRange<std::size_t>(0, 200);
    Bytes bytes;
    Writer writer(bytes);
    writer.bytes(some(11));
    writer.u8(records);
    writer.bytes(some(2 * records));
    writer.u8(blob);
    writer.bytes(some(blob));
    writer.bytes(*rc::gen::arbitrary<Bytes>());
    Bytes out;
    RC_ASSERT(encode(rows, decoded(bytes), out).has_value());
    RC_ASSERT(out == bytes);
}

RC_GTEST_PROP(Layout, RandomMessagesSurviveTheWayThroughBytes, ()) {
    Value::List pins;
    for (auto pin : *rc::gen::resize(20, rc::gen::arbitrary<std::vector<std::int8_t>>()))
        pins.emplace_back(record(static_cast<std::uint8_t>(pin), pin));
    Fields fields = sample();
    fields[0].value = Value(*rc::gen::arbitrary<std::uint16_t>());
    fields[1].value = Value(*rc::gen::arbitrary<std::int16_t>());
    fields[4].value = Value(*rc::gen::container<Bytes>(2, rc::gen::arbitrary<std::uint8_t>()));
    fields[5].value = Value(std::move(pins));
    fields[6].value = Value(*rc::gen::resize(100, rc::gen::arbitrary<Bytes>()));
    fields[7].value = text_value(*rc::gen::arbitrary<Bytes>());
    Bytes out;
    RC_ASSERT(encode(rows, fields, out).has_value());
    Reader in(out);
    Fields back;
    decode(rows, in, back);
    RC_ASSERT(!in.fault());
    RC_ASSERT(back == fields);
}

}  // namespace gantry::wire
