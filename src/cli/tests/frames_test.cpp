#include "cli/frames.hpp"

#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <rapidcheck/gtest.h>

#include "api/message_json.hpp"
#include "base/text.hpp"
#include "cli/tests/toy_codec.hpp"
#include "cli/typed_message.hpp"
#include "testkit/vectors.hpp"

namespace gantry::cli {
namespace {

using testkit::hex;
using wire::Direction;

const test::ToyCodec toy;

std::string lines_of(const std::vector<ByteView>& pieces) {
    Frames frames(toy, "toy", Direction::to_host);
    std::string out;
    for (auto piece : pieces)
        frames.add(piece, false, out);
    frames.add({}, true, out);
    return out;
}

TEST(Frames, MessagesStandOneALineWithTheirOffsets) {
    EXPECT_EQ(
        lines_of({hex("5501AA5500")}),
        R"({"offset":0,"length":3,"protocol":"toy","direction":"to-host","message":"Data","fields":[["Data","AA"]]})"
        "\n"
        R"({"offset":3,"length":2,"protocol":"toy","direction":"to-host","message":"Data","fields":[["Data",""]]})"
        "\n");
}

TEST(Frames, WhatIsNoFrameIsAnErrorWithItsBytesAndTheRestGoesOn) {
    Frames frames(toy, "toy", Direction::to_reader);
    std::string out;
    frames.add(hex("0102 5500 5503AA"), true, out);
    EXPECT_EQ(
        out,
        R"({"offset":0,"length":2,"protocol":"toy","direction":"to-reader","error":"start at 0: bad value","bytes":"0102"})"
        "\n"
        R"({"offset":2,"length":2,"protocol":"toy","direction":"to-reader","message":"Data","fields":[["Data",""]]})"
        "\n"
        R"({"offset":4,"length":3,"protocol":"toy","direction":"to-reader","error":"frame at 3: truncated","bytes":"5503AA"})"
        "\n");
    EXPECT_EQ(frames.bad_bytes(), 5u);
    EXPECT_EQ(frames.bad_places(), 2u);
}

TEST(Frames, ADecoderThatClaimsNothingEndsInAnError) {
    test::StuckCodec stuck;
    Frames frames(stuck, "toy", Direction::to_host);
    std::string out;
    frames.add(hex("0102"), true, out);
    EXPECT_EQ(
        out,
        R"({"offset":0,"length":2,"protocol":"toy","direction":"to-host","error":"incomplete","bytes":"0102"})"
        "\n");
}

TEST(Frames, PiecesOfAGoodStreamChangeNothing) {
    auto stream = hex("5501AA 5500 5504 01020304 5502 5555");
    auto whole = lines_of({stream});
    testkit::for_each_split(stream, [&](auto& pieces) { EXPECT_EQ(lines_of(pieces), whole); });
}

RC_GTEST_PROP(Frames, TheLinesEncodeToTheBytesTheyCameFrom, (const std::vector<std::uint8_t>& stream)) {
    Frames frames(toy, "toy", Direction::to_host);
    std::string out;
    auto cut = *rc::gen::inRange<std::size_t>(0, stream.size() + 1);
    frames.add(ByteView(stream).first(cut), false, out);
    frames.add(ByteView(stream).subspan(cut), true, out);
    Bytes back;
    for (std::string_view rest = out; !rest.empty();) {
        auto line = api::parse_line(rest.substr(0, rest.find('\n')));
        RC_ASSERT(line.has_value());
        rest.remove_prefix(rest.find('\n') + 1);
        if (auto* raw = std::get_if<Bytes>(&line->content))
            back.insert(back.end(), raw->begin(), raw->end());
        else
            RC_ASSERT(
                toy.encode(std::get<wire::Message>(line->content), Direction::to_host, back).has_value());
    }
    RC_ASSERT(back == stream);
}

TEST(TypedMessage, TakesTextAsItStandsAndJsonWhereItLooksLikeIt) {
    std::vector<std::string> arguments = {"Name=a=b", "Empty=", "Number=12",
                                          R"(List=[{"Output":1,"On":true}])", R"(Text="[x]")"};
    auto message = typed_message("SetGpo", arguments);
    ASSERT_TRUE(message) << message.error().text();
    wire::Fields output{{"Output", 1}, {"On", true}};
    wire::Message expected{"SetGpo",
                           {},
                           {{"Name", std::string("a=b")},
                            {"Empty", std::string()},
                            {"Number", std::string("12")},
                            {"List", wire::Value::List{wire::Value(output)}},
                            {"Text", std::string("[x]")}}};
    EXPECT_EQ(*message, expected);
}

TEST(TypedMessage, SaysWhatIsWrongWithAnArgument) {
    std::vector<std::string> bare = {"Output"}, unnamed = {"=1"}, broken = {"Outputs=[1,"};
    EXPECT_EQ(typed_message("M", bare).error().text(),
              "\"Output\" is no Field=value; write fields like Name=text, and lists like "
              "Name='[{\"Field\":1}]'");
    EXPECT_FALSE(typed_message("M", unnamed));
    EXPECT_EQ(
        typed_message("M", broken).error().text(),
        "Outputs: no JSON at column 4: incomplete JSON; a value that starts with [, { or \" must be JSON");
}

TEST(TypedMessage, ARefusalNamesTheFieldsOrTheNearestMessage) {
    wire::Fault fault{wire::Errc::bad_value, 6, "Data", "expected hex digits"};
    EXPECT_EQ(explain(fault, "Data", toy, Direction::to_host).text(),
              "Data: Data: expected hex digits; fields of Data: Data");
    EXPECT_EQ(explain(fault, "Date", toy, Direction::to_host).text(),
              "Date: Data: expected hex digits; Date has no fields of its own");
    EXPECT_EQ(explain(fault, "Daat", toy, Direction::to_host).text(),
              "there is no message Daat; did you mean Data?");
    EXPECT_EQ(explain(fault, "xyzzy", toy, Direction::to_host).text(),
              "there is no message xyzzy; messages: Data, Date");
}

}  // namespace
}  // namespace gantry::cli
