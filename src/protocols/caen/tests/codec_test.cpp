#include "protocols/caen/codec.hpp"

#include <algorithm>

#include <gtest/gtest.h>

#include <rapidcheck/gtest.h>

#include "protocols/caen/message.hpp"
#include "protocols/caen/walker.hpp"
#include "testkit/vectors.hpp"

namespace gantry::caen::test {

using testkit::hex;
using wire::Direction;
using wire::Field;
using wire::Fields;
using wire::Message;
using wire::Value;

namespace {

// A message as a command line gives it: every value is text.
Message typed(std::string name, std::initializer_list<std::pair<const char*, const char*>> fields) {
    Message message{.name = std::move(name), .header = {}, .fields = {}};
    for (auto& [field, value] : fields)
        message.fields.push_back({field, Value(std::string(value))});
    return message;
}
std::string encoded(const Message& message, Direction direction = Direction::to_reader) {
    Bytes out;
    auto done = codec().encode(message, direction, out);
    return done ? to_hex(out) : done.error().text();
}
std::string checked(const Message& message, Direction direction = Direction::to_reader) {
    auto fine = codec().check(message, direction);
    return fine ? "fine" : fine.error().text();
}
Message decoded(std::string_view digits, Direction direction = Direction::to_host) {
    auto bytes = hex(digits);
    auto result = codec().decode(bytes, direction, true);
    EXPECT_EQ(result.length, bytes.size());
    EXPECT_TRUE(result.message) << result.message.error().text();
    return result.message ? *result.message : Message{};
}
std::string refused(std::string_view digits, std::size_t length, Direction direction = Direction::to_host) {
    auto result = codec().decode(hex(digits), direction, true);
    EXPECT_EQ(result.length, length);
    EXPECT_FALSE(result.message);
    return result.message ? "" : result.message.error().text();
}

}  // namespace

// --- what a person types -----------------------------------------------------------------------------------

TEST(CaenCodec, EncodesWhatAPersonTypes) {
    EXPECT_EQ(encoded(typed("RawReadIDs", {{"SourceName", "Source_0"}})),
              "8001000000005358002100000008000100120000000F00FB536F757263655F3000");
    EXPECT_EQ(encoded(typed("setprotocol", {{"protocol", "epcc1g2"}})),
              "8001000000005358001C00000008000100740000000A005400000003");
    EXPECT_EQ(encoded(typed("SetPower", {{"PowerSet", "0x3E8"}})),
              "8001000000005358001C00000008000100640000000A0096000003E8");
    EXPECT_EQ(encoded(typed("GetPower", {{"id", "7"}})), "800100070000535800120000000800010073");
    EXPECT_EQ(
        encoded(typed("SetSourceConfig",
                      {{"SourceName", "Source_0"}, {"ConfigParameter", "G2Session"}, {"ConfigValue", "1"}})),
        "80010000000053580035000000080001008A0000000F00FB536F757263655F30000000000A006A000000040000000A006B0"
        "0000001");
    EXPECT_EQ(encoded(typed("NewRawReadIDs", {{"Bitmask", "0x0001"}})),
              encoded(typed("InventoryTag", {{"Bitmask", "1"}})));
    EXPECT_EQ(encoded(typed("Abort", {})), "AB");
    EXPECT_EQ(encoded(typed("UpgradeRequest", {})), to_hex(as_bytes(upgrade_text)));
}

TEST(CaenCodec, ParametersHaveTheirOtherNames) {
    EXPECT_EQ(encoded(typed("G2Lock", {{"BankMask", "TID"}, {"PositionMask", "8"}})),
              encoded(typed("G2Lock", {{"MemoryBank", "2"}, {"TagAddress", "8"}})));
    EXPECT_EQ(encoded(typed("ProgramID", {{"Lock", "1"}})), encoded(typed("ProgramID", {{"Boolean", "1"}})));
    EXPECT_NE(encoded(typed("GetPower", {{"BankMask", "1"}})).find("no attribute BankMask"),
              std::string::npos);
}

TEST(CaenCodec, TakesAttributesByTheirNumber) {
    auto text = "80010000000053580019000000080001 00C000000007123401";
    EXPECT_EQ(encoded(typed("G2BlockProgramID", {{"0x1234", "01"}})), to_hex(hex(text)));
    auto message = decoded(text, Direction::to_reader);
    EXPECT_EQ(message.name, "G2BlockProgramID");
    ASSERT_EQ(message.fields.size(), 1u);
    EXPECT_EQ(message.fields[0].name, "Attribute");
    auto& record = *message.fields[0].value.get<Fields>();
    EXPECT_EQ(*wire::find(record, "type"), Value(std::string("0x1234")));
    EXPECT_EQ(*wire::find(record, "value"), Value(Bytes{1}));
    EXPECT_EQ(encoded(typed("Unknown", {{"code", "0xC8"}})), "8001000000005358001200000008000100C8");
}

TEST(CaenCodec, TakesTimesAsSecondsOrAsADate) {
    auto time = [](const char* text) {
        auto out = encoded(typed("ReportBuffer", {{"TimeStamp", text}}), Direction::to_host);
        return out.size() == 64 ? out.substr(48) : out;
    };
    EXPECT_EQ(time("1400"), "0000057800000000");
    EXPECT_EQ(time("1400.5"), "000005780007A120");
    EXPECT_EQ(time("1400.000001"), "0000057800000001");
    EXPECT_EQ(time("1400.4294967295"), "00000578FFFFFFFF");
    EXPECT_EQ(time("1970-01-01T00:23:20Z"), "0000057800000000");
    EXPECT_EQ(time("1400."), "0000057800000000");
    for (auto* bad : {"", ".", "1.x", "-1", "noon", "4294967296"})
        EXPECT_NE(time(bad).find("expected seconds since 1970"), std::string::npos) << bad;
}

TEST(CaenCodec, TextGetsItsNulAndShowsWhenItIsMissing) {
    auto with_nul = "00010000000053580020000000080001007C0000000E005C342E312E30303000";
    EXPECT_EQ(decoded(with_nul).fields[0].value, Value(std::string("4.1.000")));
    auto without = decoded("0001000000005358001D000000080001007C0000000B005C342E312E30");
    auto* record = without.fields[0].value.get<Fields>();
    ASSERT_NE(record, nullptr);
    EXPECT_EQ(*wire::find(*record, "unterminated"), Value(std::string("4.1.0")));
}

TEST(CaenCodec, ErrorsSayWhatAndWhere) {
    EXPECT_EQ(encoded(typed("GetPowr", {})),
              "message at 0: there is no message GetPowr; did you mean GetPower?");
    EXPECT_EQ(encoded(typed("SetPower", {{"PowrSet", "1"}})),
              "field at 18: there is no attribute PowrSet; did you mean PowerSet?");
    EXPECT_EQ(encoded(typed("SetPower", {{"PowerSet", "lots"}})), "PowerSet at 18: expected a number");
    EXPECT_EQ(encoded(typed("SetPower", {{"PowerSet", "4294967296"}})),
              "PowerSet at 18: 4294967296 is outside 0 to 4294967295");
    EXPECT_EQ(encoded(typed("SetEventMode", {{"EventMode", "often"}})),
              "EventMode at 18: expected a number or one of: ReadCycle, Time, NoEvent");
    EXPECT_EQ(encoded(typed("G2Read", {{"SourceName", "S"}, {"TagID", "ABC"}})),
              "TagID at 26: expected hex digits, two a byte");
    EXPECT_EQ(encoded(typed("GetPower", {{"id", "65536"}})), "id at 0: expected a number from 0 to 65535");
    EXPECT_EQ(encoded(typed("GetPower", {{"code", "0x12"}})), "code at 16: 0x12 is RawReadIDs");
    EXPECT_EQ(encoded(typed("Abort", {{"SourceName", "Source_0"}})), "field at 0: Abort has no fields");
    Bytes out = {1, 2, 3};
    EXPECT_FALSE(codec().encode(typed("SetPower", {{"PowerSet", "lots"}}), Direction::to_reader, out));
    EXPECT_EQ(out, (Bytes{1, 2, 3})) << "a refused message leaves nothing behind";
    Message big = typed("G2Write", {});
    big.fields.push_back({"TagValue", Value(Bytes(65512))});
    EXPECT_EQ(encoded(big), "TagValue at 18: with it the message is longer than 65535 bytes");
}

// --- checks ------------------------------------------------------------------------------------------------

TEST(CaenCodec, ChecksTheParametersOfACommand) {
    auto read = {std::pair{"SourceName", "Source_0"},
                 {"TagIDLen", "2"},
                 {"TagID", "AABB"},
                 {"MemoryBank", "User"},
                 {"TagAddress", "0"},
                 {"Length", "4"}};
    EXPECT_EQ(checked(typed("G2Read", read)), "fine");
    EXPECT_EQ(checked(typed("G2Read", {{"TagIDLen", "2"},
                                       {"TagID", "AABB"},
                                       {"MemoryBank", "User"},
                                       {"TagAddress", "0"},
                                       {"Length", "4"},
                                       {"G2Password", "0x1234"}})),
              "fine")
        << "the source may be left out";
    EXPECT_EQ(checked(typed("G2Read", {{"SourceName", "Source_0"},
                                       {"BankMask", "EPC"},
                                       {"PositionMask", "4"},
                                       {"TagIDLen", "2"},
                                       {"TagID", "AABB"},
                                       {"MemoryBank", "User"},
                                       {"TagAddress", "0"},
                                       {"Length", "4"}})),
              "fine")
        << "the id as a mask";
    EXPECT_EQ(checked(typed("GetPower", {})), "fine");
    EXPECT_EQ(checked(typed("GetPower", {{"PowerGet", "1"}})),
              "PowerGet at 18: no parameter of GetPower; GetPower takes, in this order: none");
    EXPECT_EQ(checked(typed("SetPower", {})),
              "PowerSet at 0: missing; SetPower takes, in this order: PowerSet");
    EXPECT_EQ(checked(typed("SetPower", {{"PowerSet", "1"}, {"PowerSet", "2"}})),
              "PowerSet at 18: given 2 times, once too often; SetPower takes, in this order: PowerSet");
    EXPECT_EQ(checked(typed("AddReadPointToSource", {{"ReadPointName", "Ant1"}, {"SourceName", "Source_0"}})),
              "ReadPointName at 18: not in its place; AddReadPointToSource takes, in this order: SourceName, "
              "ReadPointName");
    EXPECT_EQ(checked(typed("G2CustomCommand", {{"SubCmd", "1"}, {"Length", "2"}})), "fine");
    EXPECT_EQ(checked(typed("G2CustomCommand",
                            {{"SubCmd", "1"}, {"Length", "2"}, {"TagValue", "AABB"}, {"Length", "4"}})),
              "fine");
    EXPECT_NE(
        checked(typed("GroupSelectUnselect", {{"SourceName", "Source_0"}, {"Operation", "SelectEqual"}})),
        "fine");
}

TEST(CaenCodec, ChecksValues) {
    EXPECT_EQ(checked(typed("SetRFChannel", {{"RFChannel", "10"}})), "RFChannel at 18: 10 is outside 0 to 9");
    EXPECT_EQ(checked(typed("SetEventMode", {{"EventMode", "3"}})),
              "EventMode at 18: 3 is none of: ReadCycle, Time, NoEvent");
    EXPECT_EQ(checked(typed("CheckReadPointStatus", {{"ReadPointName", "Ant10"}})),
              "ReadPointName at 18: 6 bytes with the closing NUL, at most 5 fit");
    EXPECT_EQ(
        checked(typed("G2ProgramID",
                      {{"SourceName", "Source_0"}, {"TagIDLen", "4"}, {"TagID", "AABB"}, {"G2NSI", "0"}})),
        "TagIDLen at 33: 4, but the TagID has 2 bytes");
    EXPECT_EQ(checked(typed("InventoryTag", {{"TagID", std::string(130, 'A').c_str()}})),
              "TagID at 18: 65 bytes, at most 64 fit");
    EXPECT_EQ(checked(typed("Reserved0x71", {})),
              "code at 16: the manual reserves it: there is no such command");
    EXPECT_EQ(checked(typed("ReportBuffer", {})), "code at 16: only a reader sends it");
    EXPECT_EQ(checked(typed("GetPower", {{"framed", "1"}})),
              "framed at 8: only a reader sends a framed stream");
    EXPECT_EQ(checked(typed("G2BlockWrite", {{"0x4E", "0000"}, {"TagValue", "AABB"}})), "fine")
        << "its parameters are not published";
    EXPECT_EQ(checked(typed("Unknown", {{"code", "0xC8"}})), "fine");
    EXPECT_EQ(checked(typed("Unknown", {})), "code at 10: a message without a name needs its code");
    EXPECT_EQ(checked(typed("Abort", {})), "fine");
}

TEST(CaenCodec, ChecksAnswers) {
    auto to_host = Direction::to_host;
    EXPECT_EQ(checked(typed("GetPower", {{"PowerGet", "446"}, {"ResultCode", "success"}}), to_host), "fine");
    EXPECT_EQ(checked(typed("GetPower", {{"ResultCode", "invalid function"}}), to_host), "fine");
    EXPECT_EQ(checked(typed("GetPower", {{"PowerGet", "446"}}), to_host),
              "ResultCode at 28: missing: every answer ends with it");
    EXPECT_NE(checked(typed("GetPower", {{"ResultCode", "0"}}), to_host), "fine");
    EXPECT_EQ(
        checked(typed("InventoryTag", {{"TagID", "AABB"}, {"TagID", "CCDD"}, {"ResultCode", "0"}}), to_host),
        "fine");
    EXPECT_EQ(checked(typed("InventoryTag", {{"ResultCode", "0"}}), to_host), "fine");
    EXPECT_EQ(checked(typed("KillMessage", {}), to_host), "fine");
    EXPECT_EQ(
        checked(
            typed("GetTriggers",
                  {{"NoOfTriggers", "2"}, {"TriggerName", "a"}, {"TriggerName", "b"}, {"ResultCode", "0"}}),
            to_host),
        "fine");
}

TEST(CaenCodec, EveryCommandCanBeSentWithTheParametersOfItsRow) {
    for (auto& row : commands()) {
        if (row.reserved || row.notification) continue;
        SCOPED_TRACE(row.name);
        for (bool all : {false, true}) {
            Message message{.name = std::string(row.name), .header = {}, .fields = {}};
            for (auto& param : row.in) {
                if (param.optional && !all) continue;
                auto& attribute = row_of(param.attribute);
                auto value = Value(std::max<std::int64_t>(attribute.min, 1));
                if (attribute.kind == Kind::text) value = Value(std::string("x"));
                if (attribute.kind == Kind::bytes) value = Value(std::string("AA"));
                message.fields.push_back({std::string(attribute.name), value});
            }
            EXPECT_EQ(checked(message), "fine");
            Bytes bytes;
            ASSERT_TRUE(codec().encode(message, Direction::to_reader, bytes));
            auto back = codec().decode(bytes, Direction::to_reader, true);
            ASSERT_TRUE(back.message);
            EXPECT_EQ(back.message->name, row.name);
            EXPECT_EQ(back.message->fields.size(), message.fields.size());
        }
    }
}

TEST(CaenCodec, NamesItselfForCompletion) {
    auto names = codec().names(Direction::to_reader);
    auto has = [&](std::string_view name) { return std::ranges::find(names, name) != names.end(); };
    EXPECT_TRUE(has("RawReadIDs"));
    EXPECT_TRUE(has("Abort"));
    EXPECT_FALSE(has("ReportBuffer"));
    EXPECT_FALSE(has("Reserved0x71"));
    EXPECT_EQ(codec().field_names("G2Read", Direction::to_reader),
              (std::vector<std::string_view>{"SourceName", "MemoryBank", "TagAddress", "TagIDLen", "TagID",
                                             "Length", "G2Password"}));
    EXPECT_EQ(codec().field_names("GetPower", Direction::to_host),
              (std::vector<std::string_view>{"PowerGet", "ResultCode"}));
    EXPECT_TRUE(codec().field_names("Abort", Direction::to_reader).empty());
    EXPECT_EQ(codec().value_names("SetEventMode", "EventMode", Direction::to_reader),
              (std::vector<std::string_view>{"ReadCycle", "Time", "NoEvent"}));
    EXPECT_TRUE(codec().value_names("SetPower", "PowerSet", Direction::to_reader).empty());
}

// --- what is on the wire -----------------------------------------------------------------------------------

TEST(CaenCodec, CarriesWhatItDoesNotKnow) {
    for (auto* text : {
             "000100000000535800120000000800010201",  // a code of no table
             "0001000000005358000A",                  // no pair at all
             "0001000000005358001000000006000 1",     // a CommandName without a value
             "00010000000053580020 0000000800010073 00000007005201 0000000800020000",  // a size of no row
             "0001000000005358001A12340008000100730001000800020000",      // reserved bytes that are set
             "0001000000005358001C000000080001007C0000000A005C342E3130",  // text without its NUL
             "0001000000005358001B000000080001007C00000009005C340100",    // text that is none
             "0001000000005358001C00000008000100B40000000A00537FC00001",  // no number
             "0001000000005358001C00000008000100B40000000A00533FA00000",  // 1.25
             "00010000000053580020000000080001FFFE0000000E001000000578FFFFFFFF",
             "0001000000005358001C00000008000100730000000800020999000000060011",
             "000100000000535800220000000800010013000000080012000900000008007AFDF0",
         }) {
        auto bytes = hex(text);
        // The lengths above are the writer's business, not the reader's of this test.
        bytes[8] = static_cast<std::uint8_t>(bytes.size() >> 8);
        bytes[9] = static_cast<std::uint8_t>(bytes.size());
        SCOPED_TRACE(to_hex(bytes));
        auto message = decoded(to_hex(bytes));
        EXPECT_EQ(encoded(message, Direction::to_host), to_hex(bytes));
    }
    EXPECT_EQ(decoded("000100000000535800120000000800010201").name, "Unknown");
    EXPECT_EQ(*wire::find(decoded("000100000000535800120000000800010201").header, "code"), Value(0x201));
    EXPECT_EQ(decoded("0001000000005358001C00000008000100B40000000A00533FA00000").fields[0].value,
              Value(std::string("1.25")));
    EXPECT_EQ(decoded("0001000000005358001A0000000800010013000000080 07AFDF0").fields[0].value, Value(-528));
}

TEST(CaenCodec, RefusesWhatIsNoMessage) {
    EXPECT_EQ(refused("FF06000C", 4), "header at 0: starts with 0xFF06, expected 0x0001");
    EXPECT_EQ(refused("8001000000005358001200000008000100 73", 18),
              "header at 0: starts with 0x8001, expected 0x0001");
    EXPECT_EQ(refused("00010000000053590012", 10), "vendor at 4: 0x00005359, expected 0x00005358");
    EXPECT_EQ(refused("00010000000053580009", 10), "length at 8: length 9 is below the header (10)");
    EXPECT_EQ(refused("0001000000005358001200", 11), "message at 11: 11 bytes of 18");
    EXPECT_EQ(refused("00010000", 4), "message at 4: 4 bytes of at least 10");
    EXPECT_EQ(refused("0001000000005358001A000000080001007300000003005200010001", 26),
              "AVP at 18: length 3 is below its header (6)")
        << "its length could be trusted: decoding goes on behind it";
    EXPECT_EQ(refused("FFFF0001000000005358001200000008000100 73", 2),
              "header at 0: starts with 0xFFFF, expected 0x0001");
    EXPECT_EQ(refused("4023557047", 5, Direction::to_reader),
              "text at 5: ends inside one of the ten-byte texts");
}

TEST(CaenCodec, AStreamGoesToTheNextHeaderOrTheEnd) {
    auto stream = hex("00010006000053580000000000080001001300000008001100AA");
    auto next = hex("00010007000053580012000000080001 0073");
    auto both = stream;
    both.insert(both.end(), next.begin(), next.end());
    for (bool end : {false, true}) {
        auto first = codec().decode(both, Direction::to_host, end);
        ASSERT_TRUE(first.message);
        EXPECT_EQ(first.length, stream.size());
        EXPECT_EQ(first.message->fields.size(), 1u);
    }
    EXPECT_TRUE(codec().decode(stream, Direction::to_host, false).more);
    EXPECT_TRUE(codec().decode(ByteView(both).first(stream.size() + 9), Direction::to_host, false).more)
        << "these nine bytes may become a header";
    auto broken = stream;
    auto lie = hex("000000050011");
    broken.insert(broken.end(), lie.begin(), lie.end());
    EXPECT_EQ(codec().decode(broken, Direction::to_host, false).length, stream.size());
}

// --- properties --------------------------------------------------------------------------------------------

namespace {

Bytes arbitrary_bytes(std::size_t most) {
    auto size = *rc::gen::inRange<std::size_t>(0, most + 1);
    return *rc::gen::container<Bytes>(size, rc::gen::arbitrary<std::uint8_t>());
}

void append_arbitrary_pair(Bytes& out) {
    auto rows = attributes();
    auto& row = rows[*rc::gen::inRange<std::size_t>(0, rows.size())];
    auto type = *rc::gen::inRange(0, 8) == 0 ? *rc::gen::arbitrary<std::uint16_t>() : row.code;
    Bytes value = arbitrary_bytes(20);
    if (*rc::gen::inRange(0, 8) != 0 && (row.kind != Kind::text && row.kind != Kind::bytes))
        value = *rc::gen::container<Bytes>(row.size, rc::gen::arbitrary<std::uint8_t>());
    if (row.kind == Kind::text && *rc::gen::inRange(0, 3) != 0) {
        value = *rc::gen::container<Bytes>(rc::gen::inRange<std::uint8_t>(0x20, 0x7F));
        if (*rc::gen::inRange(0, 4) != 0) value.push_back(0);
    }
    wire::Writer writer(out);
    writer.u16(*rc::gen::inRange(0, 8) == 0 ? *rc::gen::arbitrary<std::uint16_t>() : 0);
    writer.u16(avp_header_size + value.size());
    writer.u16(type);
    writer.bytes(value);
}

Bytes arbitrary_message(Direction direction) {
    Bytes out;
    wire::Writer writer(out);
    writer.u16(direction == Direction::to_reader ? to_reader_head : to_host_head);
    writer.u16(*rc::gen::arbitrary<std::uint16_t>());
    writer.u32(vendor);
    writer.u16(0);
    if (*rc::gen::inRange(0, 8) != 0) {
        auto rows = commands();
        append_number(out, Attribute::command_name,
                      rows[*rc::gen::inRange<std::size_t>(0, rows.size())].code);
    }
    auto pairs = *rc::gen::inRange(0, 8);
    for (int i = 0; i < pairs; ++i)
        append_arbitrary_pair(out);
    if (*rc::gen::inRange(0, 6) != 0) writer.patch_big_endian(8, out.size(), 2);
    return out;
}

Direction arbitrary_direction() {
    return *rc::gen::element(Direction::to_host, Direction::to_reader);
}

}  // namespace

RC_GTEST_PROP(CaenCodecProperty, WhatDecodesEncodesToTheSameBytes, ()) {
    auto direction = arbitrary_direction();
    auto bytes = arbitrary_message(direction);
    auto decoded = codec().decode(bytes, direction, true);
    RC_ASSERT(decoded.message.has_value());
    Bytes again;
    RC_ASSERT(codec().encode(*decoded.message, direction, again).has_value());
    RC_ASSERT(again == Bytes(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(decoded.length)));
    if (decoded.length == bytes.size()) {
        auto twice = codec().decode(again, direction, true);
        RC_ASSERT(twice.message.has_value());
        RC_ASSERT(*twice.message == *decoded.message);
    }
}

RC_GTEST_PROP(CaenCodecProperty, AnyBytesDoNoHarm, ()) {
    auto direction = arbitrary_direction();
    Bytes bytes;
    while (bytes.size() < 300 && *rc::gen::inRange(0, 6) != 0) {
        auto more = *rc::gen::inRange(0, 2) == 0 ? arbitrary_message(direction) : arbitrary_bytes(30);
        if (!more.empty() && *rc::gen::inRange(0, 3) == 0)
            more[*rc::gen::inRange<std::size_t>(0, more.size())] = *rc::gen::arbitrary<std::uint8_t>();
        bytes.insert(bytes.end(), more.begin(), more.end());
    }
    std::size_t covered = 0;
    for (ByteView rest = bytes; !rest.empty();) {
        auto decoded = codec().decode(rest, direction, true);
        RC_ASSERT(decoded.length > 0u);
        RC_ASSERT(decoded.length <= rest.size());
        covered += decoded.length;
        rest = rest.subspan(decoded.length);
        if (decoded.message) (void)codec().check(*decoded.message, direction);
    }
    RC_ASSERT(covered == bytes.size());
}

RC_GTEST_PROP(CaenCodecProperty, TheWalkerAgreesWithTheGenericCodec, ()) {
    auto bytes = arbitrary_message(Direction::to_host);
    auto decoded = codec().decode(bytes, Direction::to_host, true);
    RC_ASSERT(decoded.message.has_value());
    std::vector<Observation> seen;
    Bytes data;
    auto walked = TagWalker().walk(ByteView(bytes).subspan(header_size), header_size, seen, data);
    std::size_t next = 0, unusable = 0;
    std::optional<std::size_t> said_size;  // TagIDLen holds for the ids after it
    for (auto& field : decoded.message->fields) {
        if (field.name == "TagIDLen") {
            if (const auto* number = std::get_if<std::int64_t>(&field.value.of))
                said_size = static_cast<std::size_t>(*number);
        }
        if (field.name != "TagID") continue;
        auto id = *wire::as_raw(field.value);
        if (auto size = said_size.value_or(id.size());
            size == 0 || size > event::TagId::max_size || size > id.size())
            ++unusable;
        else
            RC_ASSERT(std::ranges::equal(seen.at(next++).tag.view(), ByteView(id).first(size)));
    }
    if (decoded.length == bytes.size()) {
        RC_ASSERT(!walked.fault.has_value());
        RC_ASSERT(next == seen.size());
        RC_ASSERT(walked.tags == next);
        RC_ASSERT(walked.unusable == unusable);
    }
}

}  // namespace gantry::caen::test
