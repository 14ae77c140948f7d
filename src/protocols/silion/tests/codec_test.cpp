#include "protocols/silion/codec.hpp"

#include <gtest/gtest.h>

#include <rapidcheck/gtest.h>

#include "protocols/silion/frame.hpp"
#include "protocols/silion/walker.hpp"
#include "support.hpp"

namespace gantry::silion::test {

using wire::Direction;
using wire::Fields;
using wire::Message;
using wire::Value;

static std::string encoded(const Message& message, Direction direction) {
    Bytes out;
    auto done = codec().encode(message, direction, out);
    return done ? to_hex(out) : done.error().text();
}

static Value output(std::int64_t number, std::int64_t state, std::int64_t seconds) {
    Fields record;
    record.push_back({"Output", Value(number)});
    record.push_back({"State", Value(state)});
    record.push_back({"Seconds", Value(seconds)});
    return Value(std::move(record));
}
static Message set_outputs(Value::List outputs) {
    Message message{.name = "SetGpo", .header = {}, .fields = {}};
    message.fields.push_back({"Outputs", Value(std::move(outputs))});
    return message;
}

TEST(SilionCodec, WhatAPersonLeavesOutTakesItsUsualValue) {
    EXPECT_EQ(encoded({"TagAck", {}, {}}, Direction::to_reader), "EE0000000100");
    EXPECT_EQ(encoded({"Restart", {}, {}}, Direction::to_reader), "EE0000001801");
    EXPECT_EQ(encoded({"GetGpi", {{"flags", Value(std::string("0x02"))}}, {}}, Direction::to_reader),
              "EE000000160298F4");
    EXPECT_EQ(encoded(set_outputs({output(1, 1, 7)}), Direction::to_reader), "EE000004170101010107");
    Message reply{"SetGpo", {}, {}};
    reply.fields.push_back({"reader", Value(std::string("silion"))});
    EXPECT_EQ(encoded(reply, Direction::to_host), "FF06000017000000000073696C696F6E");
}

TEST(SilionCodec, ErrorsSayWhatAndWhere) {
    EXPECT_EQ(encoded({"GetGpo", {}, {}}, Direction::to_reader),
              "message at 0: there is no message GetGpo; did you mean GetGpi?");
    EXPECT_EQ(encoded({"SetGpo", {}, {}}, Direction::to_reader), "Outputs at 0: field Outputs is missing");
    EXPECT_EQ(encoded({"Restart", {{"flags", Value(256)}}, {}}, Direction::to_reader),
              "flags at 0: expected a number from 0 to 255");
    EXPECT_EQ(encoded({"Restart", {{"crc", Value(std::string("123"))}}, {}}, Direction::to_reader),
              "crc at 0: expected two bytes as hex digits");
    Message wrong{"Restart", {}, {}};
    wrong.header.push_back({"flags", Value(0)});
    wrong.header.push_back({"crc", Value(std::string("1234"))});
    EXPECT_EQ(encoded(wrong, Direction::to_reader), "crc at 5: a CRC needs bit 1 of the flags");
    EXPECT_EQ(encoded({"Unknown", {{"code", Value(1)}}, {{"Data", Value(Bytes{})}}}, Direction::to_reader),
              "code at 4: that code has another name");
    EXPECT_EQ(encoded({"Unknown", {}, {{"Data", Value(Bytes{})}}}, Direction::to_reader),
              "code at 4: a message without a name needs its code");
    Bytes out = {1, 2, 3};
    EXPECT_FALSE(codec().encode({"SetGpo", {}, {}}, Direction::to_reader, out));
    EXPECT_EQ(out, (Bytes{1, 2, 3})) << "a refused message leaves nothing behind";
}

TEST(SilionCodec, ChecksWhatAPersonWants) {
    auto checked = [](const Message& message) {
        auto fine = codec().check(message, Direction::to_reader);
        return fine ? std::string("fine") : fine.error().text();
    };
    EXPECT_EQ(checked(set_outputs({output(1, 1, 7), output(5, 0, 0)})), "fine");
    EXPECT_EQ(checked(set_outputs({output(6, 1, 7)})), "Output at 0: 6 is outside 1 to 5");
    EXPECT_EQ(checked(set_outputs({output(1, 2, 7)})), "State at 0: 2 is outside 0 to 1");
    EXPECT_EQ(checked(set_outputs({output(2, 1, 7), output(2, 0, 7)})),
              "Output at 10: output 2 is named twice");
    EXPECT_EQ(checked(set_outputs({})), "Outputs at 6: name at least one output");
    EXPECT_EQ(checked({"Restart", {{"flags", Value(4)}}, {}}),
              "flags at 5: bits 2 to 7 are not defined: leave 0");
    EXPECT_NE(checked({"Restrat", {}, {}}).find("did you mean Restart?"), std::string::npos);
}

TEST(SilionCodec, CarriesWhatItDoesNotKnow) {
    for (auto* text : {
             "FF06000342FC1234567873696C696F6EAABBCC",                  // code, flags and status of no table
             "FF06000B02000000000073696C696F6E0401010200030104010506",  // bytes after the inputs
             "FF02000017000000000000FF",                                // a name that is no text
             "EE00000377F1010203",                                      // a command of no table
             "EE0000021800ABCD",                                        // data where there are none
             "FF06000C04020000000073696C696F6E010A0A0000000102000000005DFA",  // the CRC the other way round
         }) {
        SCOPED_TRACE(text);
        auto bytes = hex(text);
        auto direction = bytes[0] == 0xFF ? Direction::to_host : Direction::to_reader;
        auto decoded = codec().decode(bytes, direction, true);
        ASSERT_TRUE(decoded.message) << decoded.message.error().text();
        EXPECT_EQ(encoded(*decoded.message, direction), text);
    }
}

TEST(SilionCodec, ABadChecksumIsAnErrorUpToTheNextPossibleStart) {
    auto bytes = hex("FF06000C04020000000073696C696F6E010A0A0000000102000000001234");
    auto next = hex(heartbeat_0);
    bytes.insert(bytes.end(), next.begin(), next.end());
    auto decoded = codec().decode(bytes, Direction::to_host, true);
    ASSERT_FALSE(decoded.message);
    EXPECT_EQ(decoded.message.error().code, wire::Errc::bad_checksum);
    EXPECT_EQ(decoded.message.error().text(), "crc at 28: bad checksum");
    EXPECT_EQ(decoded.length, 30u);
}

TEST(SilionCodec, DataThatEndInsideAFieldAreAnErrorOfTheWholeFrame) {
    auto decoded =
        codec().decode(hex("FF06000802000000000073696C696F6E0401010200030104"), Direction::to_host, true);
    ASSERT_FALSE(decoded.message);
    EXPECT_EQ(decoded.length, 24u);
    EXPECT_EQ(decoded.message.error().text(), "State at 24: truncated");
}

TEST(SilionCodec, NamesItsFieldsForCompletion) {
    EXPECT_EQ(codec().field_names("SetGpo", Direction::to_reader),
              (std::vector<std::string_view>{"Outputs"}));
    EXPECT_TRUE(codec().field_names("SetGpo", Direction::to_host).empty());
    EXPECT_EQ(codec().names(Direction::to_reader).size(), 5u);
    EXPECT_EQ(codec().names(Direction::to_host).size(), 9u);
}

TEST(SilionTables, HaveOneRowAMessage) {
    std::set<std::pair<int, Code>> seen;
    for (auto& row : messages()) {
        EXPECT_TRUE(seen.insert({static_cast<int>(row.direction), row.code}).second) << row.name;
        EXPECT_EQ(find_message(static_cast<std::uint8_t>(row.code), row.direction), &row);
        EXPECT_EQ(find_message(row.name, row.direction), &row);
        EXPECT_FALSE(row.source.empty());
    }
    for (auto* enumeration : {&main_boards, &modules, &tag_protocols, &errors}) {
        std::set<std::int64_t> values;
        std::set<std::string_view> names;
        for (auto& row : enumeration->rows) {
            EXPECT_TRUE(values.insert(row.value).second) << enumeration->name << " " << row.value;
            EXPECT_TRUE(names.insert(row.name).second) << enumeration->name << " " << row.name;
        }
    }
}

TEST(SilionTables, ReadBothCodingsOfAStatus) {
    EXPECT_EQ(describe_status(0).text, "normal");
    EXPECT_EQ(describe_status(100007).code, 7);
    EXPECT_EQ(describe_status(7).code, 7);
    EXPECT_EQ(describe_status(7).text, describe_status(100007).text);
    EXPECT_EQ(describe_status(0x186).code, 0x186);
    EXPECT_EQ(describe_status(100000).code, 100000) << "not zero, so never taken for normal";
    EXPECT_EQ(describe_status(100000).text, "unknown status 0x000186A0");
}

TEST(SilionCrc, FollowsTheDocumentedVariants) {
    auto check = as_bytes("123456789");
    EXPECT_EQ(crc_bytes(CrcKind::modbus, check), (CrcBytes{0x37, 0x4B}));
    EXPECT_EQ(crc_bytes(CrcKind::modbus_swapped, check), (CrcBytes{0x4B, 0x37}));
    EXPECT_EQ(crc_bytes(CrcKind::ccitt, hex("FF0003")), (CrcBytes{0x1D, 0x0C}));
    EXPECT_EQ(crc_bytes(CrcKind::ccitt, hex("FF016103")), (CrcBytes{0xBD, 0xBE}));
}

// --- properties --------------------------------------------------------------------------------------------

namespace {

Bytes arbitrary_bytes(std::size_t most) {
    auto size = *rc::gen::inRange<std::size_t>(0, most + 1);
    return *rc::gen::container<Bytes>(size, rc::gen::arbitrary<std::uint8_t>());
}
std::uint8_t one_of(std::initializer_list<int> values) {
    return static_cast<std::uint8_t>(*rc::gen::elementOf(std::vector<int>(values)));
}

// A frame as a reader might send it, with data that fit its code or that do not.
Bytes arbitrary_frame(Direction direction) {
    auto flags = one_of({0, 1, 2, 3, 0xF0, 0xFF});
    Bytes out;
    if (direction == Direction::to_reader) {
        append_to_reader(out, one_of({1, 2, 0x16, 0x17, 0x18, 0x55}), flags, arbitrary_bytes(40),
                         CrcKind::modbus);
        return out;
    }
    auto code = one_of({1, 1, 1, 2, 3, 4, 5, 6, 0x16, 0x17, 0x18, 0x55});
    Bytes data;
    if (code == 1 || code == 3) {
        wire::Writer writer(data);
        auto count = *rc::gen::inRange<std::size_t>(0, 6);
        auto wide = *rc::gen::inRange(0, 4) == 0;
        writer.u16(count);
        for (std::size_t i = 0; i < count; ++i) {
            writer.bytes(*rc::gen::container<Bytes>(4, rc::gen::arbitrary<std::uint8_t>()));
            auto epc = arbitrary_bytes(70);
            writer.u8(epc.size());
            writer.bytes(epc);
            auto bank = arbitrary_bytes(8);
            writer.big_endian(bank.size(), wide ? 2 : 1);
            writer.bytes(bank);
        }
        if (*rc::gen::inRange(0, 4) == 0) writer.bytes(arbitrary_bytes(5));
        if (*rc::gen::inRange(0, 4) == 0 && !data.empty())
            data.resize(data.size() - *rc::gen::inRange<std::size_t>(0, data.size()));
    } else {
        data = arbitrary_bytes(40);
    }
    Bytes name = code == 0x55 ? Bytes{'a', 'b'} : arbitrary_bytes(12);
    append_to_host(out, code, flags, *rc::gen::arbitrary<std::uint32_t>(), name, data, CrcKind::modbus);
    return out;
}

Direction arbitrary_direction() {
    return *rc::gen::element(Direction::to_host, Direction::to_reader);
}

}  // namespace

RC_GTEST_PROP(SilionCodecProperty, WhatDecodesEncodesToTheSameBytes, ()) {
    auto direction = arbitrary_direction();
    auto frame = arbitrary_frame(direction);
    auto decoded = codec().decode(frame, direction, true);
    if (!decoded.message) RC_DISCARD("data that do not fit");
    RC_ASSERT(decoded.length == frame.size());
    Bytes again;
    RC_ASSERT(codec().encode(*decoded.message, direction, again).has_value());
    RC_ASSERT(again == frame);
    auto twice = codec().decode(again, direction, true);
    RC_ASSERT(twice.message.has_value());
    RC_ASSERT(*twice.message == *decoded.message);
}

RC_GTEST_PROP(SilionCodecProperty, AnyBytesDoNoHarm, ()) {
    auto direction = arbitrary_direction();
    Bytes bytes;
    while (bytes.size() < 200 && *rc::gen::inRange(0, 6) != 0) {
        auto more = *rc::gen::inRange(0, 2) == 0 ? arbitrary_frame(direction) : arbitrary_bytes(30);
        bytes.insert(bytes.end(), more.begin(), more.end());
    }
    std::size_t covered = 0;
    for (ByteView rest = bytes; !rest.empty();) {
        auto decoded = codec().decode(rest, direction, true);
        RC_ASSERT(decoded.length > 0u);
        RC_ASSERT(decoded.length <= rest.size());
        covered += decoded.length;
        rest = rest.subspan(decoded.length);
    }
    RC_ASSERT(covered == bytes.size());
}

RC_GTEST_PROP(SilionCodecProperty, TheWalkerAgreesWithTheGenericCodec, ()) {
    auto frame = arbitrary_frame(Direction::to_host);
    auto look = look_at(frame, Direction::to_host, CrcRule::any());
    if (look.what != Look::What::frame || look.frame.row == nullptr || !carries_tags(*look.frame.row))
        RC_DISCARD("no tag frame");
    std::vector<Observation> seen;
    Bytes bank;
    auto walked = walk_tags(look.frame.data, look.frame.data_offset(), seen, bank);
    RC_ASSERT(seen.size() + walked.unusable == walked.records);
    auto decoded = codec().decode(frame, Direction::to_host, true);
    bool exact = decoded.message && wire::find(decoded.message->fields, "Trailing") == nullptr;
    RC_ASSERT(exact == !walked.fault.has_value());
    if (!decoded.message) return;
    RC_ASSERT(walked.wide == (wire::find(decoded.message->header, "bank_length_bytes") != nullptr));
    auto& list = *wire::find(decoded.message->fields, "Tags")->get<Value::List>();
    RC_ASSERT(list.size() == walked.records);
    std::size_t next = 0;
    for (auto& item : list) {
        auto& record = *item.get<Fields>();
        auto id = *wire::as_raw(*wire::find(record, "Epc"));
        if (id.empty() || id.size() > event::TagId::max_size) continue;
        auto& o = seen.at(next++);
        RC_ASSERT(std::ranges::equal(o.tag.view(), id));
        RC_ASSERT(wire::as_number(*wire::find(record, "Antenna")) == o.antenna);
        RC_ASSERT(*wire::as_number(*wire::find(record, "Rssi")) * 10 == o.rssi);
        RC_ASSERT(std::max<std::int64_t>(1, *wire::as_number(*wire::find(record, "ReadCount"))) == o.reads);
        auto data = *wire::as_raw(*wire::find(record, "BankData"));
        RC_ASSERT(std::ranges::equal(ByteView(bank).subspan(o.data_offset, o.data_size), data));
    }
}

}  // namespace gantry::silion::test
