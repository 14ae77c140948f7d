#include "protocols/harting/codec.hpp"

#include <algorithm>

#include <gtest/gtest.h>

#include "protocols/harting/frame.hpp"
#include "protocols/harting/tag_command.hpp"
#include "testkit/vectors.hpp"

namespace gantry::harting::test {

using testkit::hex;
using wire::Direction;
using wire::Errc;
using wire::Fields;
using wire::Message;
using wire::Value;

namespace {

constexpr auto to_reader = Direction::to_reader, to_host = Direction::to_host;

Value text(std::string_view value) {
    return Value(std::string(value));
}
Message typed(std::string_view name, Fields fields = {}) {
    return {.name = std::string(name), .header = {}, .fields = std::move(fields)};
}
// The data of a typed request, or what is wrong with it.
std::string data_of(const Message& message) {
    Bytes out;
    auto done = codec().encode(message, to_reader, out);
    if (!done) return done.error().text();
    return to_hex(look_at(out, to_reader).frame.data);
}
std::string refusal(const Message& message, Direction direction = to_reader) {
    auto fine = codec().check(message, direction);
    return fine ? "" : fine.error().text();
}
Message reply(std::uint8_t control, std::string_view data, std::uint8_t status = 0) {
    Bytes out;
    append_reply(out, 0, control, status, hex(data));
    auto decoded = codec().decode(out, to_host, true);
    Bytes again;
    EXPECT_TRUE(codec().encode(*decoded.message, to_host, again));
    EXPECT_EQ(to_hex(again), to_hex(out));
    return *decoded.message;
}

}  // namespace

// --- as people type it -------------------------------------------------------------------------------------

TEST(HartingCodec, TakesWhatAPersonTypes) {
    EXPECT_EQ(data_of(typed("getreaderinfo", {{"MODE", text("hardware")}})), "10");
    EXPECT_EQ(data_of(typed("GetReaderInfo", {{"MODE", text("0x50")}})), "50");
    EXPECT_EQ(data_of(typed("ReadConfiguration", {{"CFG-ADR", text("0x81")}})), "81");
    EXPECT_EQ(data_of(typed("ReaderLogin", {{"READER-ID", text("0102 0304")}})), "01020304");
    EXPECT_EQ(
        data_of(typed(
            "WriteAesReaderKeys",
            {{"MODE", Value(1)}, {"KEY-INDEX", Value(0)}, {"AUTH-MODE", Value(2)}, {"KEY", text("AABB")}})),
        "01000202AABB");
    EXPECT_EQ(data_of(typed("LockRegion", {{"Data", text("0102")}})), "0102");
    EXPECT_EQ(data_of(typed("LockRegion")), "");
    EXPECT_EQ(data_of(typed("Untraceable", {{"Data", text("31AA")}})), "3031AA");
    EXPECT_EQ(data_of(typed("HostCommand", {{"SUB-COMMAND", text("0x2B")}, {"Data", text("00")}})), "2B00");
}

TEST(HartingCodec, FillsInWhatAPersonLeavesOut) {
    EXPECT_EQ(data_of(typed("Inventory")), "0100");
    EXPECT_EQ(data_of(typed("Inventory", {{"ANT-SEL", Value(3)}})), "011003");
    EXPECT_EQ(data_of(typed("ReadMultipleBlocks",
                            {{"BANK", text("tid")}, {"DB-ADR", Value(0)}, {"DB-N", Value(6)}})),
              "232002000006");
    EXPECT_EQ(data_of(typed("ReadMultipleBlocks", {{"UID", text("3074")},
                                                   {"BANK", text("user")},
                                                   {"A-PW", text("01020304")},
                                                   {"DB-ADR", Value(2)},
                                                   {"DB-N", Value(1)}})),
              "2331023074830401020304000201");
    EXPECT_EQ(data_of(typed("WriteMultipleBlocks",
                            {{"BANK", Value(1)}, {"DB-ADR", Value(2)}, {"DB", text("AABBCCDD")}})),
              "24200100020202AABBCCDD");
    EXPECT_EQ(
        data_of(typed("Lock",
                      {{"UID", text("3074")}, {"LOCK-DATA", text("080200")}, {"A-PW", text("00000000")}})),
        "22310230748403080200"
        "0400000000");
    EXPECT_EQ(data_of(typed("Kill", {{"UID", text("3074")}, {"KILL-PW", text("11223344")}})),
              "183102307404"
              "11223344");
    auto sent = typed("GetInput");
    Bytes out;
    ASSERT_TRUE(codec().encode(sent, to_reader, out));
    EXPECT_EQ(to_hex(out), "020007FF746660");  // any reader
    sent.fields = {{"address", Value(7)}};
    out.clear();
    ASSERT_TRUE(codec().encode(sent, to_reader, out));
    EXPECT_EQ(look_at(out, to_reader).frame.address, 7);
}

TEST(HartingCodec, SaysWhatIsWrongWithWhatIsTyped) {
    auto contains = [](const std::string& said, std::string_view words) {
        EXPECT_NE(said.find(words), std::string::npos) << said << " does not say " << words;
    };
    contains(data_of(typed("Inventry")), "did you mean Inventory?");
    contains(data_of(typed("ReadBuffer")), "DATA-SETS is missing");
    contains(data_of(typed("GetInput", {{"MODE", Value(1)}})), "there is no field MODE");
    contains(data_of(typed("ReadMultipleBlocks", {{"BANKS", Value(1)}})), "did you mean BANK?");
    contains(data_of(typed("GetReaderInfo", {{"MODE", text("hardwear")}})), "expected a number or one of:");
    contains(data_of(typed("Unknown")), "needs its code");
    contains(data_of(typed("Unknown", {{"code", Value(0x66)}})), "0x66 is GetReaderInfo");
    contains(data_of(typed("Unknown", {{"code", Value(0xB0)}})), "0xB0 is HostCommand");
    contains(data_of(typed("GetInput", {{"status", Value(0)}})), "only replies have one");
    contains(data_of(typed("GetInput", {{"frame", text("long")}})), "\"short\"");
    contains(data_of(typed("GetInput", {{"address", Value(256)}})), "0 to 255");
    contains(data_of(typed("Inventory", {{"MODE", Value(0)}, {"ANT-SEL", Value(1)}})), "needs MODE with ANT");
    contains(data_of(typed("Kill", {{"MODE", Value(1)}, {"KILL-PW", text("00")}})), "MODE says addressed");
    contains(data_of(typed("HostCommand", {{"Data", text("00")}})), "missing: it stands before the data");
    contains(data_of(typed("ReadMultipleBlocks",
                           {{"MODE", Value(0)}, {"DB-ADR", Value(256)}, {"DB-N", Value(1)}})),
             "over 255 needs MODE 0x20");
}

TEST(HartingCodec, ChecksWhatAReaderWouldRefuse) {
    auto contains = [](const Message& message, std::string_view words) {
        auto said = refusal(message);
        EXPECT_NE(said.find(words), std::string::npos) << message.name << ": " << said;
    };
    auto date = [](int month, int day) {
        return typed("SetSystemTimeAndDate", {{"CENTURY", Value(20)},
                                              {"YEAR", Value(26)},
                                              {"MONTH", Value(month)},
                                              {"DAY", Value(day)},
                                              {"TIMEZONE", Value(0)},
                                              {"HOUR", Value(12)},
                                              {"MINUTE", Value(0)},
                                              {"MILLISECONDS", Value(0)}});
    };
    EXPECT_EQ(refusal(date(2, 28)), "");
    contains(date(2, 29), "there is no such day");
    contains(date(13, 1), "outside 1 to 12");
    contains(typed("SetSystemTimer", {{"HOUR", Value(24)}, {"MINUTE", Value(0)}, {"MILLISECONDS", Value(0)}}),
             "24 is outside 0 to 23");
    contains(typed("Inventory", {{"MODE", Value(1)}}), "only 0x80 and 0x10");
    auto read = [](Fields more) {
        Fields fields = {{"BANK", text("user")}, {"DB-ADR", Value(0)}};
        fields.insert(fields.end(), more.begin(), more.end());
        return typed("ReadMultipleBlocks", fields);
    };
    EXPECT_EQ(refusal(read({{"DB-N", Value(1)}})), "");
    contains(read({{"DB-N", Value(0)}}), "at least 1");
    contains(read({{"DB-N", Value(1)}, {"A-PW", text("0102")}}), "four bytes");
    contains(read({{"DB-N", Value(1)}, {"UID", text("")}}), "must not be empty");
    contains(read({{"DB-N", Value(1)}, {"MODE", Value(0x27)}}), "bits 2 to 0");
    contains(typed("Lock", {{"LOCK-DATA", text("080201")}, {"A-PW", text("00000000")}}), "last four bits");
    contains(typed("ReadPermalockStatus",
                   {{"BANK", text("tid")}, {"BLOCK-PTR", Value(0)}, {"BLOCK-RANGE", Value(1)}}),
             "only user memory");
    contains(typed("SetOutput", {{"MODE", Value(1)}, {"OUT-N", Value(Value::List{})}}),
             "at least one output");
    contains(typed("WriteConfiguration", {{"CFG-ADR", Value(0x40)}, {"CFG-DATA", Value(Bytes(14, 0))}}),
             "one block at a time");
    contains(typed("ReadBuffer", {{"Data", text("00")}}), "not the data of ReadBuffer");
    EXPECT_EQ(refusal(typed("ReadBuffer", {{"Data", text("0001")}})), "");
    contains(typed("GetInput", {{"frame", text("short")}}), "does not take short frames");
    EXPECT_EQ(refusal(typed("Authenticate", {{"Data", text("00")}})), "");
    EXPECT_EQ(refusal(typed("Unknown", {{"code", Value(0x2B)}, {"Data", text("00")}})), "");
}

TEST(HartingCodec, GivesNamesForCompletion) {
    auto names = codec().names(to_reader);
    for (const auto* name : {"ReadBuffer", "Inventory", "Authenticate", "HostCommand", "EpcCommand"})
        EXPECT_NE(std::ranges::find(names, name), names.end()) << name;
    using Names = std::vector<std::string_view>;
    EXPECT_EQ(codec().field_names("ReadBuffer", to_reader), (Names{"DATA-SETS"}));
    EXPECT_EQ(codec().field_names("Inventory", to_host), (Names{"DATA-SETS", "TAG-ERROR"}));
    EXPECT_EQ(codec().field_names("HostCommand", to_reader), (Names{"SUB-COMMAND", "Data"}));
    EXPECT_EQ(codec().value_names("ReadMultipleBlocks", "BANK", to_reader),
              (Names{"reserved", "epc", "tid", "user"}));
    EXPECT_EQ(codec().value_names("GetInput", "status", to_host).front(), "ok");
    EXPECT_EQ(codec().unit("ReadBuffer", "RSSI", to_host), "-dBm");
    EXPECT_EQ(codec().unit("SetOutput", "OUT-TIME", to_reader), "100 ms");
    EXPECT_TRUE(codec().field_names("Nothing", to_reader).empty());
}

// --- replies -----------------------------------------------------------------------------------------------

TEST(HartingCodec, RepliesThatDoNotSayWhatTheyAnswerAreNamedByTheirData) {
    EXPECT_EQ(reply(0xB0, "").name, "HostCommand");
    EXPECT_EQ(reply(0xB0, "", 0x01).name, "HostCommand");
    auto tags = reply(0xB0, "01 84 00 04 0800 1234", 0x94);
    EXPECT_EQ(tags.name, "Inventory");
    EXPECT_EQ(tags.fields,
              (Fields{{"DATA-SETS", Value(Value::List{Value(Fields{{"TR-TYPE", text("EPC-Class1-Gen2")},
                                                                   {"IDDT", Value(0)},
                                                                   {"IDD", Value(hex("08001234"))}})})}}));
    EXPECT_EQ(reply(0xB0, "01 11 84 00 04 0800 1234 01 01 00 37 0000 0000").name, "Inventory");
    auto blocks = reply(0xB0, "02 02 00 AABB 00 CCDD");
    EXPECT_EQ(blocks.name, "ReadMultipleBlocks");
    EXPECT_EQ(*wire::find(blocks.fields, "DB-SIZE"), Value(2));
    EXPECT_EQ(reply(0xB0, "01 05 71 00").name, "HostCommand");
    EXPECT_EQ(reply(0xB0, "04", 0x95).fields, (Fields{{"TAG-ERROR", text("memory-locked")}}));
    EXPECT_EQ(reply(0xB3, "000A", 0x00).name, "EpcCommand");
    EXPECT_EQ(reply(0xB3, "0F0002", 0x95).fields,
              (Fields{{"TAG-ERROR", text("non-specific")}, {"Data", Value(hex("0002"))}}));
}

TEST(HartingCodec, KeepalivesComeInBothForms) {
    auto old_form = reply(0x6E, "0102");
    EXPECT_EQ(old_form.fields, (Fields{{"FLAGS-A", Value(1)}, {"FLAGS-B", Value(2)}}));
    auto new_form = reply(0x6E, "0000005B 01 01 0304" + std::string(2 * 28, '0'));
    auto records = *wire::find(new_form.fields, "REC-CNT")->get<Value::List>();
    ASSERT_EQ(records.size(), 1u);
    EXPECT_EQ(records[0],
              Value(Fields{{"MODE", text("RfStatus")}, {"FLAGS-A", Value(3)}, {"FLAGS-B", Value(4)}}));
    auto all = reply(0x6E, "02 01 0304" + std::string(2 * 28, '0') + "77" + std::string(2 * 29, '0') + "05");
    records = *wire::find(all.fields, "DATASETS")->get<Value::List>();
    ASSERT_EQ(records.size(), 2u);
    EXPECT_EQ(records[1],
              Value(Fields{{"MODE", Value(0x77)}, {"Rest", Value(hex(std::string(58, '0') + "05"))}}));
    EXPECT_EQ(reply(0x6E, "010203").fields, (Fields{{"Data", Value(hex("010203"))}}));
}

TEST(HartingCodec, RecordsOfNewerAndOlderFirmwareAreReadAsFarAsTheyGo) {
    auto& row = row_of(Command::get_reader_info);
    struct Case {
        std::string_view mode, data;
        std::vector<std::string_view> fields;
    };
    for (auto& each : std::initializer_list<Case>{
             {"00",
              "0201 00 10 5B 0010 0200 0400",
              {"SW-REV", "D-REV", "HW-TYPE", "SW-TYPE", "TR-TYPE", "RX-BUF", "TX-BUF"}},
             {"00", "0201 00 10 5B 0010 02", {"SW-REV", "D-REV", "HW-TYPE", "SW-TYPE", "TR-TYPE", "Rest"}},
             {"60", "02 02 01 AABB", {"INPUTS", "OUTPUTS", "RELAYS", "Rest"}},
             {"51", "02 C0A80001 00000000000000000000000000000000", {"FLAGS", "IPv4", "IPv6"}},
             {"40", "0040 FF80", {"NR-OF-PAGES", "PERMISSION"}},
         }) {
        Fields fields;
        EXPECT_TRUE(decode_reply(row, hex(each.mode), 0, hex(each.data), fields));
        std::vector<std::string_view> names;
        for (auto& field : fields)
            names.push_back(field.name);
        EXPECT_EQ(names, each.fields);
        Bytes again;
        ASSERT_TRUE(encode_reply(row, 0, fields, again));
        EXPECT_EQ(again, hex(each.data));
    }
    Fields fields;
    EXPECT_FALSE(decode_reply(row, hex("77"), 0, hex("0102"), fields)) << "a record that nobody knows";
    EXPECT_EQ(fields, (Fields{{"Data", Value(hex("0102"))}}));
    fields.clear();
    EXPECT_FALSE(decode_reply(row, hex("00"), 0, {}, fields)) << "a record that is not there";
    EXPECT_EQ(fields, (Fields{{"Data", Value(Bytes{})}}));
    Bytes text = hex("4F4B");
    text.resize(padded_record);
    fields.clear();
    EXPECT_TRUE(decode_reply(row_of(Command::reader_diagnostic), hex("20"), 0, text, fields));
    EXPECT_EQ(fields, (Fields{{"TEXT", Value(std::string("OK"))}}));
}

TEST(HartingCodec, TheRequestSaysWhetherAnInventoryHasAntennas) {
    auto& row = row_of(Command::inventory);
    Fields fields;
    // Both forms fit these bytes.
    auto data = hex("01 11 84 01 00");
    EXPECT_TRUE(decode_reply(row, hex("0100"), 0, data, fields));
    EXPECT_EQ(fields[0].value.get<Value::List>()->front().get<Fields>()->front().name, "TR-TYPE");
    fields.clear();
    EXPECT_FALSE(decode_reply(row, hex("011001"), 0, data, fields));
    EXPECT_EQ(fields, (Fields{{"Data", Value(data)}}));
}

TEST(HartingCodec, AFailedWriteSaysWhere) {
    auto& row = row_of(Command::write_multiple_blocks);
    struct Case {
        std::uint8_t status;
        std::string_view data;
        Fields fields;
    };
    for (auto& each : std::initializer_list<Case>{
             {0x00, "", {}},
             {0x03, "", {}},
             {0x03, "0004", {{"DB-ADR-E", Value(hex("0004"))}}},
             {0x95, "04", {{"TAG-ERROR", text("memory-locked")}}},
             {0x95, "0405", {{"TAG-ERROR", text("memory-locked")}, {"DB-ADR-E", Value(hex("05"))}}},
             {0x95, "99", {{"TAG-ERROR", Value(0x99)}}},
         }) {
        Fields fields;
        EXPECT_TRUE(decode_reply(row, {}, each.status, hex(each.data), fields));
        EXPECT_EQ(fields, each.fields);
        Bytes again;
        ASSERT_TRUE(encode_reply(row, each.status, fields, again));
        EXPECT_EQ(again, hex(each.data));
    }
}

// What chance finds only now and then: replies of no byte, or few, to whatever was asked.
TEST(HartingCodec, EveryShortReplyComesBackAsItWas) {
    for (auto& row : commands())
        for (int asked = 0; asked <= 0xFF; ++asked)
            for (auto status : std::initializer_list<std::uint8_t>{0x00, 0x03, 0x95})
                for (auto* reply : {"", "00", "01", "95", "0000", "0102", "000000", "01020304"}) {
                    auto mode = static_cast<std::uint8_t>(asked);
                    Bytes request = {has_sub(row.control) ? row.sub : mode, mode}, again;
                    Fields fields;
                    decode_reply(row, request, status, hex(reply), fields);
                    auto written = encode_reply(row, status, fields, again);
                    ASSERT_TRUE(written) << row.name << " " << asked << " " << reply;
                    ASSERT_EQ(again, hex(reply)) << row.name << " " << asked;
                }
}

// --- where decoding goes on after an error -----------------------------------------------------------------

TEST(HartingCodec, AfterAnErrorDecodingGoesOnAtTheNextPlaceThatCanStartAFrame) {
    auto good = hex("020007FF33DD56");
    auto bad = hex("020007FF33DD57");
    auto after = [](std::initializer_list<Bytes> parts) {
        Bytes bytes;
        for (auto& part : parts)
            bytes.insert(bytes.end(), part.begin(), part.end());
        auto decoded = codec().decode(bytes, to_reader, true);
        EXPECT_FALSE(decoded.message);
        return decoded.length;
    };
    EXPECT_EQ(after({bad}), 7u);
    EXPECT_EQ(after({bad, good}), 7u);
    // The length is not to be trusted: what follows starts no frame.
    auto swollen = hex("02000AFF33DD56");
    EXPECT_EQ(after({swollen, good}), 7u);
    EXPECT_EQ(after({hex("4711"), good}), 2u);
    EXPECT_EQ(after({hex("4711"), hex("07FFB001001C56")}), 2u) << "a short frame";
    EXPECT_EQ(after({hex("4711 0200")}), 4u);
    EXPECT_EQ(after({hex("020003"), good}), 3u);
    EXPECT_EQ(after({hex("02FFFF"), good}), 3u) << "the end came before the frame's";
}

// --- commands for one tag
// -----------------------------------------------------------------------------------

TEST(HartingTagCommand, LockBitsStandAtTheTopOfThreeBytes) {
    EXPECT_EQ(to_hex(lock_data(0b0000100000, 0b0000100000)), "080200");  // EPC locked
    EXPECT_EQ(to_hex(lock_data(0b0000110000, 0b0000110000)), "0C0300");  // and for ever
    for (unsigned bits = 0; bits < 0x400; ++bits) {
        auto mask = static_cast<std::uint16_t>(bits), action = static_cast<std::uint16_t>(~bits & 0x3FF);
        auto found = lock_bits(lock_data(mask, action));
        ASSERT_EQ(found.mask, mask);
        ASSERT_EQ(found.action, action);
    }
}

TEST(HartingTagCommand, BlockDataSayWhichBlockIsBad) {
    auto blocks = parse_block_data(hex("02 02 00 AABB 00 CCDD"));
    ASSERT_TRUE(blocks);
    EXPECT_EQ(to_hex(blocks->data), "AABBCCDD");
    EXPECT_EQ(blocks->bad_status, 0);
    blocks = parse_block_data(hex("02 02 00 AABB 05 0000"));
    EXPECT_EQ(blocks->bad_status, 5);
    EXPECT_EQ(blocks->first_bad, 1u);
    for (const auto* bad : {"", "01", "01 02 00 AA", "01 02 00 AABB 00"})
        EXPECT_FALSE(parse_block_data(hex(bad))) << bad;
    Bytes out;
    append_block_data(hex("AABBCCDD"), 2, out);
    EXPECT_EQ(to_hex(out), "020200AABB00CCDD");
}

}  // namespace gantry::harting::test
