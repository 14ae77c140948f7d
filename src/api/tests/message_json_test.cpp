#include "api/message_json.hpp"

#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <rapidcheck/gtest.h>
#include <boost/json.hpp>

namespace gantry::api {
namespace {

using wire::Direction;
using wire::Fields;
using wire::Message;
using wire::Value;

Value text(std::string_view value) {
    return std::string(value);
}

Message sample() {
    Fields tag{{"Antenna", 2}, {"Epc", Bytes{0xE2, 0x00}}};
    Value::List tags{Value(tag)};
    return {"TagUpload",
            {{"reader", text("dock-1")}, {"flags", 1}, {"ack", true}},
            {{"Tags", Value(tags)}, {"Text", text("a \"b\"\n")}}};
}

TEST(MessageJson, AMessageIsOneLineWithItsHeaderBetweenNameAndFields) {
    EXPECT_EQ(message_line({33, 26, "toy", Direction::to_host}, sample()),
              R"({"offset":33,"length":26,"protocol":"toy","direction":"to-host","message":"TagUpload",)"
              R"("reader":"dock-1","flags":1,"ack":true,)"
              R"("fields":[["Tags",[{"Antenna":2,"Epc":"E200"}]],["Text","a \"b\"\n"]]})");
}

TEST(MessageJson, AMessageWithoutFieldsHasAnEmptyList) {
    EXPECT_EQ(
        message_line({0, 4, "toy", Direction::to_reader}, {"Ping", {}, {}}),
        R"({"offset":0,"length":4,"protocol":"toy","direction":"to-reader","message":"Ping","fields":[]})");
}

TEST(MessageJson, AnErrorCarriesAllItsBytes) {
    Bytes bytes{0x80, 0x01, 0xFF};
    EXPECT_EQ(error_line({33, 3, "toy", Direction::to_reader}, "length at 2: bad", bytes),
              R"({"offset":33,"length":3,"protocol":"toy","direction":"to-reader",)"
              R"("error":"length at 2: bad","bytes":"8001FF"})");
}

TEST(MessageJson, AMessageComesBackWithBytesAsHex) {
    auto line = parse_line(message_line({0, 9, "toy", Direction::to_host}, sample()));
    ASSERT_TRUE(line) << line.error().text();
    EXPECT_EQ(line->protocol, "toy");
    EXPECT_EQ(line->direction, "to-host");
    auto expected = sample();
    Fields tag{{"Antenna", 2}, {"Epc", text("E200")}};
    expected.fields[0].value = Value::List{Value(tag)};
    EXPECT_EQ(std::get<Message>(line->content), expected);
}

TEST(MessageJson, AnErrorComesBackAsItsBytes) {
    auto line = parse_line(R"({"offset":0,"error":"x","bytes":"80 01ff"})");
    ASSERT_TRUE(line) << line.error().text();
    EXPECT_EQ(std::get<Bytes>(line->content), (Bytes{0x80, 0x01, 0xFF}));
}

TEST(MessageJson, APersonMayWriteFieldsAsAnObjectAndLeaveTheRestOut) {
    auto line = parse_line(R"({"message":"SetGpo","fields":{"Gpo":1,"State":"on"}})");
    ASSERT_TRUE(line) << line.error().text();
    EXPECT_EQ(line->protocol, "");
    Message expected{"SetGpo", {}, {{"Gpo", 1}, {"State", text("on")}}};
    EXPECT_EQ(std::get<Message>(line->content), expected);
}

TEST(MessageJson, NumbersBeyondDoublesStayExact) {
    for (auto number : {(std::int64_t{1} << 53) + 1, INT64_MAX, INT64_MIN}) {
        Message message{"M", {{"big", number}}, {{"N", number}}};
        auto line = parse_line(message_line({0, 1, "toy", Direction::to_host}, message));
        ASSERT_TRUE(line) << line.error().text();
        EXPECT_EQ(std::get<Message>(line->content), message);
    }
}

TEST(MessageJson, HostileTextStaysValidJson) {
    Message message{"M", {}, {{"T", text("\xFF\x01\xE2\x80\xAE")}}};
    auto line = message_line({0, 1, "toy", Direction::to_host}, message);
    boost::json::error_code error;
    boost::json::parse(line, error);
    EXPECT_FALSE(error) << line;
    EXPECT_EQ(line.find('\x01'), std::string::npos);
}

TEST(MessageJson, WhatIsWrongWithALineIsSaid) {
    struct Case {
        std::string_view line, error;
    };
    for (auto& [line, error] : std::vector<Case>{
             {"", "no JSON at column 1: incomplete JSON"},
             {"{\"message\":", "no JSON at column 12: incomplete JSON"},
             {"80 01", "more than one JSON value: column 4"},
             {"[1]", "the line is no JSON object"},
             {"{}",
              "the object has neither \"message\" nor \"error\" with \"bytes\"; expected a line as "
              "`gantry decode` prints it"},
             {R"({"message":5})", "\"message\" must be text"},
             {R"({"message":"M","protocol":1})", "\"protocol\" must be text"},
             {R"({"message":"M","fields":5})", "\"fields\" must be a list of [\"Name\", value] pairs"},
             {R"({"message":"M","fields":[["A",1],["B"]]})", "field 2 is no [\"Name\", value] pair"},
             {R"({"message":"M","fields":[[1,1]]})", "field 1 is no [\"Name\", value] pair"},
             {R"({"message":"M","fields":[["A",1.5]]})", "A: 1.5 is no whole number of 64 bits"},
             {R"({"message":"M","fields":[["A",18446744073709551615]]})",
              "A: 18446744073709551615 is too big"},
             {R"({"message":"M","flags":null})", "flags: null is no value"},
             {R"({"message":"M","fields":{"A":{"B":[null]}}})", "A: B: null is no value"},
             {R"({"error":"x","bytes":"8"})", "\"bytes\" is not hex"},
             {R"({"error":"x","bytes":8})", "\"bytes\" is not hex"},
         }) {
        auto result = parse_line(line);
        ASSERT_FALSE(result) << line;
        EXPECT_EQ(result.error().text(), error) << line;
    }
}

TEST(MessageJson, NestingHasALimit) {
    EXPECT_FALSE(value_from_json(std::string(100'000, '[')));
    EXPECT_FALSE(parse_line("{\"message\":\"M\",\"f\":" + std::string(100'000, '[')));
}

rc::Gen<Value> any_value(int depth) {
    auto number = rc::gen::map(rc::gen::arbitrary<std::int64_t>(), [](std::int64_t n) { return Value(n); });
    auto word = rc::gen::map(rc::gen::string<std::string>(), [](std::string s) {
        for (auto& c : s)
            c = static_cast<char>(c & 0x7F);
        return Value(std::move(s));
    });
    auto truth = rc::gen::map(rc::gen::arbitrary<bool>(), [](bool b) { return Value(b); });
    if (depth == 0) return rc::gen::oneOf(number, word, truth);
    auto list = rc::gen::map(rc::gen::container<std::vector<Value>>(any_value(depth - 1)),
                             [](std::vector<Value> v) { return Value(std::move(v)); });
    auto record = rc::gen::map(rc::gen::container<std::vector<Value>>(any_value(depth - 1)),
                               [](std::vector<Value> values) {
                                   Fields fields;
                                   for (auto& value : values)
                                       fields.push_back({"F" + std::to_string(fields.size()), value});
                                   return Value(std::move(fields));
                               });
    return rc::gen::oneOf(number, word, truth, list, record);
}

RC_GTEST_PROP(MessageJson, WhateverIsPrintedIsReadBackTheSame, ()) {
    Message message{"M", {{"head", *any_value(1)}}, {{"A", *any_value(2)}, {"A", *any_value(2)}}};
    auto line = parse_line(message_line({0, 1, "toy", Direction::to_host}, message));
    RC_ASSERT(line.has_value());
    RC_ASSERT(std::get<Message>(line->content) == message);
}

}  // namespace
}  // namespace gantry::api
