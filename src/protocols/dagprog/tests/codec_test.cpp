#include "protocols/dagprog/codec.hpp"

#include <map>

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "base/text.hpp"
#include "support.hpp"

namespace gantry::dagprog::test {

using testkit::Vector;
using wire::Direction;
using wire::Value;

namespace {

std::vector<Vector> vectors() {
    static const auto all =
        testkit::read_vectors(GANTRY_SOURCE_DIR "/src/protocols/dagprog/tests/vectors.tsv");
    return all;
}
Direction direction(const Vector& vector) {
    return vector.direction == "to-reader" ? Direction::to_reader : Direction::to_host;
}
struct Heard {
    std::vector<wire::Message> messages;
    std::vector<std::string> errors;
    std::string again;  // every part encoded, or as it was
};
Heard decode_all(ByteView bytes, Direction way) {
    Heard heard;
    for (auto rest = bytes; !rest.empty();) {
        auto decoded = codec().decode(rest, way, true);
        EXPECT_GT(decoded.length, 0u);
        EXPECT_LE(decoded.length, rest.size());
        if (decoded.length == 0) break;
        Bytes again;
        if (!decoded.message) {
            heard.errors.push_back(decoded.message.error().text());
            again.assign(rest.begin(), rest.begin() + static_cast<std::ptrdiff_t>(decoded.length));
        } else {
            auto done = codec().encode(*decoded.message, way, again);
            EXPECT_TRUE(done) << done.error().text() << " of " << to_hex(rest.first(decoded.length));
            heard.messages.push_back(*decoded.message);
        }
        heard.again += to_hex(again);
        rest = rest.subspan(decoded.length);
    }
    return heard;
}
Heard decode_text(std::string_view text, Direction way) {
    auto bytes = bytes_of(text);
    bytes.shrink_to_fit();
    auto heard = decode_all(bytes, way);
    EXPECT_EQ(heard.again, to_hex(bytes)) << printable(text);
    return heard;
}

}  // namespace

TEST(DagprogCodec, EveryVectorDecodesAndEncodesBackToTheSameBytes) {
    EXPECT_EQ(vectors().size(), 56u);
    for (auto& vector : vectors()) {
        SCOPED_TRACE(vector.id + " " + vector.meaning);
        auto heard = decode_all(vector.bytes, direction(vector));
        EXPECT_EQ(heard.again, to_hex(vector.bytes));
        EXPECT_EQ(heard.errors.size(), vector.id == "DAG-80" ? 1u : 0u);
        EXPECT_EQ(heard.messages.size(), vector.id == "DAG-74" || vector.id == "DAG-80" ? 2u : 1u);
    }
}

TEST(DagprogCodec, VectorsSayWhatTheirMeaningSays) {
    std::map<std::string, std::string> names;
    std::map<std::string, wire::Message> messages;
    for (auto& vector : vectors()) {
        auto heard = decode_all(vector.bytes, direction(vector));
        for (auto& message : heard.messages)
            names[vector.id] += (names[vector.id].empty() ? "" : " ") + message.name;
        messages[vector.id] = heard.messages.front();
    }
    std::map<std::string, std::string> expected = {{"DAG-01", "GetFirstBlock"},
                                                   {"DAG-02", "GetBlockCount"},
                                                   {"DAG-03", "GetVersion"},
                                                   {"DAG-04", "GetTransmitMode"},
                                                   {"DAG-05", "GetPowerUpMode"},
                                                   {"DAG-11", "FirstBlock"},
                                                   {"DAG-12", "BlockCount"},
                                                   {"DAG-13", "Version"},
                                                   {"DAG-14", "TransmitMode"},
                                                   {"DAG-20a", "SetFirstBlock"},
                                                   {"DAG-20b", "SetFirstBlock"},
                                                   {"DAG-20c", "SetFirstBlock"},
                                                   {"DAG-21c", "SetBlockCount"},
                                                   {"DAG-22b", "SetTransmitMode"},
                                                   {"DAG-23c", "SetPowerUpMode"},
                                                   {"DAG-30", "ReadForever"},
                                                   {"DAG-31r", "ReadChecked"},
                                                   {"DAG-32", "ReadOnce"},
                                                   {"DAG-33r", "ReadSerialNumber"},
                                                   {"DAG-34", "Stop"},
                                                   {"DAG-35", "FieldOff"},
                                                   {"DAG-36r", "FieldOn"},
                                                   {"DAG-37r", "SaveNext"},
                                                   {"DAG-50", "BlockData"},
                                                   {"DAG-52", "SerialNumber"},
                                                   {"DAG-60", "Error"},
                                                   {"DAG-62", "UnknownCommand"},
                                                   {"DAG-63", "PowerUp"},
                                                   {"DAG-64", "Ready"},
                                                   {"DAG-66", "Ready"},
                                                   {"DAG-70b", "WriteData"},
                                                   {"DAG-71c", "WriteDataCrc8"},
                                                   {"DAG-74", "SerialNumber BlockData"},
                                                   {"DAG-80", "ReadForever BlockData"},
                                                   {"DAG-82", "SerialNumber"},
                                                   {"DAG-84", "ReadForever"}};
    for (auto& [vector, name] : expected)
        EXPECT_EQ(names[vector], name) << vector;
    auto field = [&](const std::string& vector, std::string_view name) {
        auto* value = wire::find(messages[vector].fields, name);
        return value != nullptr ? *value : Value(std::string("missing"));
    };
    for (auto form : {"DAG-20a", "DAG-20b", "DAG-20c"})
        EXPECT_EQ(field(form, "FirstBlock"), Value(3)) << form;
    for (auto form : {"DAG-70a", "DAG-70b", "DAG-70c"}) {
        EXPECT_EQ(field(form, "Block"), Value(5)) << form;
        EXPECT_EQ(field(form, "Data"), Value(hex("11223344"))) << form;
    }
    for (auto form : {"DAG-71a", "DAG-71b", "DAG-71c"})
        EXPECT_EQ(field(form, "Data"), Value(hex("001234"))) << form;
    EXPECT_EQ(field("DAG-14", "TransmitMode"), words("SerialNumberAndData"));
    EXPECT_EQ(field("DAG-23a", "PowerUpMode"), words("ReadOnce"));
    EXPECT_EQ(field("DAG-13", "Version"), words("V1.00A"));
    EXPECT_EQ(field("DAG-50", "Count"), Value(0x1A));
    EXPECT_EQ(field("DAG-50", "Data"), Value(hex("0012341F")));
    EXPECT_EQ(field("DAG-52", "SerialNumber"), Value(hex("E004010012345678")));
    EXPECT_EQ(field("DAG-60", "Error"), words("Crc8Invalid"));
    EXPECT_EQ(field("DAG-63", "LongVersion"), words("DAGProg ICODE V1.00A"));
    EXPECT_EQ(*wire::find(messages["DAG-20b"].header, "separator"), words("none"));
    EXPECT_EQ(*wire::find(messages["DAG-54"].header, "meaning"), words("no tag in the field"));
    EXPECT_EQ(*wire::find(messages["DAG-55"].header, "meaning"), words("write error"));
    EXPECT_EQ(*wire::find(messages["DAG-82"].header, "stx"), Value(false));
}

TEST(DagprogCodec, EveryTruncationWantsMoreAndIsAnErrorAtTheEnd) {
    for (auto& vector : vectors()) {
        if (vector.id == "DAG-74" || vector.id == "DAG-80" || vector.id == "DAG-84") continue;
        SCOPED_TRACE(vector.id);
        for (std::size_t size = 1; size < vector.bytes.size(); ++size) {
            Bytes exact(vector.bytes.begin(), vector.bytes.begin() + static_cast<std::ptrdiff_t>(size));
            auto open = codec().decode(exact, direction(vector), false);
            EXPECT_TRUE(open.more) << size;
            EXPECT_EQ(open.length, 0u) << size;
            auto ended = codec().decode(exact, direction(vector), true);
            ASSERT_FALSE(ended.message) << size;
            EXPECT_EQ(ended.message.error().code, wire::Errc::truncated) << size;
            EXPECT_EQ(ended.length, size);
        }
    }
}

TEST(DagprogCodec, EverySplitGivesTheSameLines) {
    for (auto& vector : vectors()) {
        SCOPED_TRACE(vector.id);
        std::vector<std::string> whole;
        testkit::for_each_split(vector.bytes, [&](const std::vector<ByteView>& pieces) {
            Framer framer(direction(vector));
            std::vector<std::string> lines;
            for (auto piece : pieces) {
                framer.give(piece);
                while (auto line = framer.next())
                    lines.emplace_back(line->body);
                framer.settle();
            }
            if (whole.empty()) whole = lines;
            EXPECT_EQ(lines, whole);
            auto& tally = framer.tally();
            EXPECT_EQ(tally.line_bytes + tally.skipped + framer.kept(), vector.bytes.size());
        });
        EXPECT_FALSE(whole.empty());
    }
}

TEST(DagprogCodec, WhatIsWrittenInAnotherWayComesBackAsItWas) {
    struct Case {
        std::string_view text, name;
        Direction way;
    };
    for (auto& [text, name, way] : {
             Case{"\x02"
                  "BK\t3\r",
                  "FirstBlock", Direction::to_host},
             Case{"\x02"
                  "BK\t000000003\r",
                  "FirstBlock", Direction::to_host},
             Case{"\x02"
                  "SO.\r",
                  "Stop", Direction::to_host},
             Case{"SO.\r", "Stop", Direction::to_reader},
             Case{"\x02"
                  "v?\r",
                  "GetVersion", Direction::to_reader},
             Case{"\x02"
                  "BK00003\r",
                  "SetFirstBlock", Direction::to_reader},
             Case{"WD\t05\t1122\r", "WriteData", Direction::to_reader},
             Case{"WD 05 aabbccdd\r", "WriteData", Direction::to_reader},
             Case{"WD\t05\t11223344\tmore\r", "WriteData", Direction::to_reader},
             Case{"UR\t\r", "ReadForever", Direction::to_reader},
             Case{"UR\tx\ty\r\n", "ReadForever", Direction::to_reader},
             Case{"TX\t00002\r", "SetTransmitMode", Direction::to_reader},
             Case{"\x02"
                  "TX\t00003\r",
                  "TransmitMode", Direction::to_host},
             Case{"#0\tlong version\r", "PowerUp", Direction::to_host},
             Case{"\x02"
                  "0\tlong version\r",
                  "PowerUp", Direction::to_host},
             Case{"0\tlong\tversion\r", "PowerUp", Direction::to_host},
             Case{"6\r", "Ready", Direction::to_host},
             Case{"#6\r", "Ready", Direction::to_host},
             Case{"\x02??\tXY\r", "UnknownCommand", Direction::to_host},
             Case{"\x02"
                  "00\t1a\tdeadbeef\r",
                  "BlockData", Direction::to_host},
             Case{"\x02"
                  "00\t1A\tDEADBEEF\t\r",
                  "BlockData", Direction::to_host},
             Case{"\x02"
                  "ER\t7\r",
                  "Error", Direction::to_host},
             Case{"\x02"
                  "SN\te004010012345678\r",
                  "SerialNumber", Direction::to_host},
             Case{"\x02"
                  "SN\t00000000000000001\r",
                  "SerialNumber", Direction::to_host},
             Case{"\x02"
                  "SN\t000000000000000002\r",
                  "SerialNumber", Direction::to_host},
             Case{"\x02"
                  "SN\t00000000000000000000000000000000000\r",
                  "SerialNumber", Direction::to_host},
             Case{"\x02"
                  "ZZ\twhat\r",
                  "Unknown", Direction::to_host},
             Case{"hello\r", "Unknown", Direction::to_reader},
             Case{"\x02URX\r", "Unknown", Direction::to_reader},
             Case{"\r", "EmptyLine", Direction::to_reader},
             Case{"\r\n", "EmptyLine", Direction::to_host},
             Case{"\n", "LineFeed", Direction::to_host},
         }) {
        SCOPED_TRACE(printable(text));
        auto heard = decode_text(text, way);
        ASSERT_EQ(heard.messages.size(), 1u);
        EXPECT_EQ(heard.messages[0].name, name);
    }
}

TEST(DagprogCodec, ResultsInPlaceOfASerialNumberAreTold) {
    auto meaning = [](std::string_view digits) {
        auto heard = decode_text("\x02SN\t" + std::string(digits) + "\r", Direction::to_host);
        if (heard.messages.empty()) return std::string("refused");
        auto* value = wire::find(heard.messages[0].header, "meaning");
        return value != nullptr ? *value->get<std::string>() : std::string("a number");
    };
    EXPECT_EQ(meaning("0000000000000001"), "no tag in the field");
    EXPECT_EQ(meaning("00000000000000001"), "no tag in the field");
    EXPECT_EQ(meaning("000000000000000002"), "write error");
    EXPECT_EQ(meaning("0000000000000000"), "no valid number");
    EXPECT_EQ(meaning("00000000000000000000000000000000000"), "no valid number");
    EXPECT_EQ(meaning("0000000000000003"), "a number");
    EXPECT_EQ(meaning("E004010012345678"), "a number");
    EXPECT_EQ(meaning("E0040100123456789"), "refused");
    EXPECT_EQ(meaning("E00401001234567"), "refused");
    EXPECT_EQ(meaning("G004010012345678"), "refused");
    EXPECT_EQ(meaning(""), "refused");
}

TEST(DagprogCodec, WhatIsNoLineIsRefusedWithItsPlace) {
    struct Case {
        std::string_view text, error;
        Direction way = Direction::to_host;
        std::size_t messages = 0;
    };
    std::string long_line(200, 'x');
    std::string too_long = "\x02#0\t" + long_line + "\r\x02SO\r";
    for (auto& [text, error, way, messages] : {
             Case{"\x02"
                  "00\t1A\tDEADBEE\r",
                  "Data at 7"},
             Case{"\x02"
                  "00\t1A\r",
                  "Data at 6"},
             Case{"\x02"
                  "00\tG1\tDEADBEEF\r",
                  "Count at 4"},
             Case{"\x02"
                  "BK\tabc\r",
                  "FirstBlock at 4"},
             Case{"\x02"
                  "BK\t1234567890\r",
                  "FirstBlock"},
             Case{"BK\r", "FirstBlock", Direction::to_reader},
             Case{"WD05112233445\r", "Data", Direction::to_reader},
             Case{"WD\t05\t1122334455\r", "Data", Direction::to_reader},
             Case{"WC\t05\t11223344\r", "Data", Direction::to_reader},
             Case{"WD 05\t11223344\r", "Block", Direction::to_reader},
             Case{"hello\r", "line at 0"},
             Case{"\x02U\x01R\r\x02SO\r", "line at 2", Direction::to_host, 1},
             Case{"\x02U\x02SO\r", "line at 2", Direction::to_host, 1},
             Case{too_long, "line at 128", Direction::to_host, 1},
         }) {
        SCOPED_TRACE(printable(text));
        auto heard = decode_text(text, way);
        ASSERT_EQ(heard.errors.size(), 1u);
        EXPECT_NE(heard.errors[0].find(error), std::string::npos) << heard.errors[0];
        EXPECT_EQ(heard.messages.size(), messages);
    }
}

static std::string encoded(const wire::Message& message, Direction way) {
    Bytes out;
    auto done = codec().encode(message, way, out);
    return done ? std::string(as_text(out)) : "error: " + done.error().text();
}

TEST(DagprogCodec, TakesValuesAsAPersonTypesThem) {
    auto set = [](std::string name, wire::Fields fields) {
        return encoded({std::move(name), {}, std::move(fields)}, Direction::to_reader);
    };
    EXPECT_EQ(set("SetFirstBlock", {{"FirstBlock", words("3")}}), "BK\t00003\r");
    EXPECT_EQ(set("SetTransmitMode", {{"TransmitMode", words("serialnumber")}}), "TX\t00004\r");
    EXPECT_EQ(set("SetPowerUpMode", {{"PowerUpMode", words("ReadOnce")}}), "TL\t00002\r");
    EXPECT_EQ(set("WriteData", {{"Data", words("1122")}, {"Block", words("0x0e")}}), "WD\t0E\t1122\r");
    EXPECT_EQ(
        set("WriteData", {{"Data", words("11223344")}, {"Block", Value(5)}, {"separator", words("none")}}),
        "WD0511223344\r");
    EXPECT_EQ(set("Stop", {{"stx", words("true")}}), "\x02SO\r");
    EXPECT_NE(set("SetFirstBlock", {}).find("FirstBlock"), std::string::npos);
    EXPECT_NE(set("Stop", {{"Now", Value(1)}}).find("there is no field Now"), std::string::npos);
    EXPECT_NE(set("Stopp", {}).find("did you mean Stop?"), std::string::npos);
    EXPECT_NE(set("WriteData", {{"Block", Value(5)}, {"Data", words("112")}}).find("hex digits"),
              std::string::npos);
    EXPECT_NE(set("Unknown", {{"Line", words("SO")}}).find("that code has a name"), std::string::npos);
    EXPECT_NE(encoded({"Unknown", {{"stx", Value(false)}}, {{"Line", words("ZZ")}}}, Direction::to_host)
                  .find("only believed behind STX"),
              std::string::npos);
    // What the whole line says must be what the values say.
    wire::Message changed{"SetFirstBlock", {{"line", words("BK\t3")}}, {{"FirstBlock", Value(4)}}};
    EXPECT_NE(encoded(changed, Direction::to_reader).find("leave it out"), std::string::npos);
    changed.fields[0].value = Value(3);
    EXPECT_EQ(encoded(changed, Direction::to_reader), "BK\t3\r");
}

TEST(DagprogCodec, CheckRefusesWhatNoUnitTakes) {
    auto check = [](std::string name, wire::Fields fields) {
        return codec().check({std::move(name), {}, std::move(fields)}, Direction::to_reader).has_value();
    };
    EXPECT_TRUE(check("SetFirstBlock", {{"FirstBlock", Value(15)}}));
    EXPECT_FALSE(check("SetFirstBlock", {{"FirstBlock", Value(16)}}));
    EXPECT_TRUE(check("SetTransmitMode", {{"TransmitMode", Value(5)}}));
    EXPECT_FALSE(check("SetTransmitMode", {{"TransmitMode", Value(2)}}));
    EXPECT_FALSE(check("SetTransmitMode", {{"TransmitMode", Value(6)}}));
    EXPECT_FALSE(check("SetPowerUpMode", {{"PowerUpMode", Value(5)}}));
    EXPECT_FALSE(check("WriteData", {{"Block", Value(16)}, {"Data", words("11")}}));
    EXPECT_FALSE(check("Unknown", {{"Line", words("x")}}));
    for (auto way : {Direction::to_reader, Direction::to_host})
        for (auto name : codec().names(way))
            for (auto field : codec().field_names(name, way))
                EXPECT_FALSE(field.empty());
    EXPECT_EQ(codec().value_names("SetTransmitMode", "TransmitMode", Direction::to_reader).size(), 4u);
    EXPECT_TRUE(codec().field_names("Nothing", Direction::to_reader).empty());
}

RC_GTEST_PROP(DagprogCodec, AnyBytesAreCoveredAndComeBack, (const std::vector<std::uint8_t>& noise)) {
    // Half of the characters are those of lines, so that lines happen.
    static constexpr std::string_view alphabet = "\x02\r\n\t 0123456789ABCDEFSNURTXLKVWPO?=#bkv.";
    Bytes bytes;
    for (auto each : noise)
        bytes.push_back((each & 1) != 0 ? static_cast<std::uint8_t>(alphabet[each / 2 % alphabet.size()])
                                        : static_cast<std::uint8_t>(each));
    for (auto way : {Direction::to_reader, Direction::to_host}) {
        auto heard = decode_all(bytes, way);
        RC_ASSERT(heard.again == to_hex(bytes));
        Framer framer(way);
        framer.give(bytes);
        while (framer.next()) {
        }
        framer.settle();
        RC_ASSERT(framer.kept() <= max_line + 1);
    }
}

RC_GTEST_PROP(DagprogCodec, EncodeThenDecodeIsTheSameMessage, ()) {
    auto way = *rc::gen::element(Direction::to_reader, Direction::to_host);
    std::vector<const MessageRow*> rows;
    for (auto& row : messages())
        if (row.direction == way) rows.push_back(&row);
    auto& row = *rows[*rc::gen::inRange<std::size_t>(0, rows.size())];
    wire::Message message{.name = std::string(row.name), .header = {}, .fields = {}};
    for (auto& part : row.parts) {
        auto size = part.shorter ? *rc::gen::inRange(1, part.size / 2 + 1) : std::max(part.size / 2, 1);
        auto bytes =
            *rc::gen::container<Bytes>(static_cast<std::size_t>(size), rc::gen::arbitrary<std::uint8_t>());
        std::int64_t number = bytes[0] % 100;
        Value value = part.kind == Kind::bytes || part.kind == Kind::serial ? Value(bytes) : Value(number);
        if (part.kind == Kind::text) value = Value(to_hex(bytes));
        message.fields.push_back({std::string(part.name), value});
    }
    auto separator = *rc::gen::element(Separator::tab, Separator::none, Separator::space);
    bool with_stx = *rc::gen::arbitrary<bool>();
    if (way == Direction::to_reader && row.sets() && separator != Separator::tab)
        message.header.push_back({"separator", words(to_text(separator))});
    if (with_stx != (way == Direction::to_host))
        message.header.insert(message.header.begin(), {"stx", Value(with_stx)});
    Bytes bytes;
    auto done = codec().encode(message, way, bytes);
    RC_ASSERT(done.has_value());
    auto decoded = codec().decode(bytes, way, true);
    RC_ASSERT(decoded.message.has_value());
    RC_ASSERT(decoded.length == bytes.size());
    Bytes again;
    RC_ASSERT(codec().encode(*decoded.message, way, again).has_value());
    RC_ASSERT(again == bytes);
    RC_ASSERT(decoded.message->name == message.name);
}

}  // namespace gantry::dagprog::test
