#include "event/event_json.hpp"

#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <rapidcheck/gtest.h>
#include <boost/json.hpp>

#include "base/text.hpp"
#include "testkit/vectors.hpp"

namespace gantry::event {

using testkit::hex;

static Wall at(std::string_view text) {
    return parse_rfc3339(text).value();
}

static std::string json(const Event& event, std::string_view id_prefix = "site-7:") {
    std::string out;
    append_json(out, event, id_prefix);
    return out;
}

static Event observed() {
    Event event;
    event.seq = 184467;
    event.type = Type::tag_observed;
    event.technology = Technology::epc_gen2;
    event.time = at("2026-11-21T23:04:00.123456Z");
    event.reader = "dock-1";
    event.antenna = "Ant0";
    event.zone = "dock";
    event.tag = TagId(hex("3074257BF7194E4000001A85"));
    event.epc = "urn:epc:id:sgtin:0614141.812345.6789";
    event.gs1 = "(01)80614141123458(21)6789";
    event.link = "https://id.gs1.org/01/80614141123458/21/6789";
    event.rssi = -528;
    event.reads = 17;
    event.first_seen = at("2026-11-21T23:03:59Z");
    event.last_seen = at("2026-11-21T23:04:00.1Z");
    event.reader_time = at("2026-11-21T23:04:01.000001Z");
    event.user = hex("E28011052000");
    return event;
}

TEST(EventJson, AnObservedTagLooksAsTheInterfacesSay) {
    EXPECT_EQ(
        json(observed()),
        R"({"schema":1,"id":"site-7:184467","seq":184467,"type":"tag.observed","time":"2026-11-21T23:04:00.123456Z",)"
        R"("reader":"dock-1","antenna":"Ant0","zone":"dock","technology":"epc-gen2","tag":"3074257BF7194E4000001A85",)"
        R"("epc":"urn:epc:id:sgtin:0614141.812345.6789","gs1":"(01)80614141123458(21)6789",)"
        R"("link":"https://id.gs1.org/01/80614141123458/21/6789","rssi_dbm":-52.8,"reads":17,)"
        R"("first_seen":"2026-11-21T23:03:59.000000Z","last_seen":"2026-11-21T23:04:00.100000Z",)"
        R"("reader_time":"2026-11-21T23:04:01.000001Z","data":{"user":"E28011052000"}})");
}

TEST(EventJson, FieldsThatWereNotGivenAreAbsent) {
    Event event;
    event.seq = 1;
    event.type = Type::tag_read;
    EXPECT_EQ(
        json(event, "g:2:"),
        R"({"schema":1,"id":"g:2:1","seq":1,"type":"tag.read","time":"1970-01-01T00:00:00.000000Z","technology":"unknown"})");
    event.type = Type::reader_connected;
    EXPECT_EQ(
        json(event),
        R"({"schema":1,"id":"site-7:1","seq":1,"type":"reader.connected","time":"1970-01-01T00:00:00.000000Z"})");
}

TEST(EventJson, ItIsAppendedToWhatIsThere) {
    std::string out = "first\n";
    Event event;
    event.type = Type::reader_connected;
    append_json(out, event, "g:");
    append_json(out, event, "g:");
    EXPECT_EQ(out, "first\n" + json(event, "g:") + json(event, "g:"));
}

// What follows the time, for events that are short.
static std::string tail(const Event& event) {
    auto text = json(event);
    return text.substr(text.find("000000Z\"") + 8);
}

TEST(EventJson, EachKindOfEventCarriesItsOwnFields) {
    Event moved;
    moved.type = Type::tag_moved;
    moved.technology = Technology::iso15693;
    moved.tag = TagId(hex("E004"));
    moved.from = "dock";
    moved.to = "hall";
    EXPECT_EQ(tail(moved), R"(,"technology":"iso15693","tag":"E004","from":"dock","to":"hall"})");

    Event lost;
    lost.type = Type::tag_lost;
    lost.reason = "reader_offline";
    EXPECT_EQ(tail(lost), R"(,"technology":"unknown","reason":"reader_offline"})");

    Event fault;
    fault.type = Type::reader_fault;
    fault.reader = "gate-2";
    fault.code = -11;
    fault.text = "no antennas";
    fault.bytes = hex("FF0600");
    EXPECT_EQ(tail(fault), R"(,"reader":"gate-2","code":-11,"text":"no antennas","bytes":"FF0600"})");

    Event gpi;
    gpi.type = Type::gpi_changed;
    gpi.input = 2;
    gpi.state = false;
    EXPECT_EQ(tail(gpi), R"(,"input":2,"state":false})");
    gpi.state = true;
    EXPECT_EQ(tail(gpi), R"(,"input":2,"state":true})");

    Event overflow;
    overflow.type = Type::overflow;
    overflow.scope = "store";
    overflow.count = 18'446'744'073'709'551'615u;
    overflow.since = at("2026-11-21T00:00:00Z");
    EXPECT_EQ(tail(overflow),
              R"(,"scope":"store","count":18446744073709551615,"since":"2026-11-21T00:00:00.000000Z"})");

    Event jumped;
    jumped.type = Type::clock_jumped;
    jumped.by = "+1h";
    EXPECT_EQ(tail(jumped), R"(,"by":"+1h"})");

    Event read;
    read.type = Type::tag_read;
    read.possible_repeat = true;
    EXPECT_EQ(tail(read), R"(,"technology":"unknown","possible_repeat":true})");
}

TEST(EventJson, PcAndXpcHaveFourDigitsAWordAndAreAbsentWhereTheyAreNotKnown) {
    Event read;
    read.type = Type::tag_read;
    read.technology = Technology::epc_gen2;
    read.tag = TagId(hex("3074"));
    read.reads = 1;
    const std::string before = R"(,"technology":"epc-gen2","tag":"3074",)";
    read.pc = 0x0800;
    EXPECT_EQ(tail(read), before + R"("pc":"0800","reads":1})");
    read.xpc = 0x00010000;
    EXPECT_EQ(tail(read), before + R"("pc":"0800","xpc":"0001","reads":1})");
    read.pc = 0;
    read.xpc = 0x80000002;
    EXPECT_EQ(tail(read), before + R"("xpc":"80000002","reads":1})") << "with XPC_W2";
}

TEST(EventJson, SignalStrengthHasOneDecimal) {
    auto rssi = [](std::int16_t tenths) {
        Event event;
        event.type = Type::tag_read;
        event.rssi = tenths;
        auto value = boost::json::parse(json(event));
        auto text = json(event);
        auto start = text.find("rssi_dbm\":") + 10;
        EXPECT_DOUBLE_EQ(value.at("rssi_dbm").to_number<double>(), tenths / 10.0);
        return text.substr(start, text.size() - 1 - start);
    };
    EXPECT_EQ(rssi(-528), "-52.8");
    EXPECT_EQ(rssi(-520), "-52.0");
    EXPECT_EQ(rssi(-5), "-0.5");
    EXPECT_EQ(rssi(0), "0.0");
    EXPECT_EQ(rssi(7), "0.7");
    EXPECT_EQ(rssi(INT16_MIN), "-3276.8");
    EXPECT_EQ(rssi(INT16_MAX), "3276.7");
}

TEST(EventJson, TimesAreRightWhicheverWasWrittenBefore) {
    auto time_of = [](Wall time) {
        Event event;
        event.type = Type::reader_connected;
        event.time = time;
        return std::string(boost::json::parse(json(event)).at("time").as_string());
    };
    for (auto us : {std::int64_t{0}, std::int64_t{-1}, std::int64_t{-1'000'000}, std::int64_t{999'999},
                    std::int64_t{1'000'000}, std::int64_t{1'795'302'240'123'456}, INT64_MAX, INT64_MIN,
                    std::int64_t{253'402'300'799'999'999}, std::int64_t{253'402'300'800'000'000}}) {
        EXPECT_EQ(time_of(from_us(us)), to_rfc3339(from_us(us)));
        EXPECT_EQ(time_of(from_us(us)), to_rfc3339(from_us(us))) << "again";
    }
}

static const std::string_view hostile_texts[] = {
    "\"}\n{\"",
    "\\",
    "\x1B[2J\x07",
    "\xFF\xC0\x80",
    "1234567\"",
    "12345678\\",
    "\x7F",
    "\xE2\x80\xA8",
    "gr\xC3\xBC\xC3\x9F dich, Tor",
    "\xF0\x9F\x90\x99",
    "\xED\xA0\x80",
    std::string_view("nul\0nul", 7),
};

TEST(EventJson, HostileTextStaysInsideItsString) {
    for (auto text : hostile_texts) {
        SCOPED_TRACE(printable(text));
        Event event;
        event.type = Type::reader_fault;
        event.reader = event.antenna = event.zone = event.text = event.scope = event.by = text;
        event.epc = event.gs1 = event.link = event.from = event.to = event.reason = text;
        auto out = json(event, text);
        EXPECT_EQ(out.find('\n'), std::string::npos);
        EXPECT_TRUE(is_utf8(out));
        auto value = boost::json::parse(out);
        std::string expected(text);
        if (!is_utf8(text)) {
            std::string escaped;
            append_json_string(escaped, text);
            expected = std::string(boost::json::parse(escaped).as_string());
        }
        for (auto* key : {"reader", "antenna", "zone", "text", "scope", "by", "epc", "gs1", "link", "from",
                          "to", "reason"})
            EXPECT_EQ(value.at(key).as_string(), expected) << key;
        EXPECT_EQ(value.at("id").as_string(), expected + "0");
    }
}

TEST(EventJson, LongTextThatGrowsSixfoldHasRoom) {
    Event event;
    event.type = Type::reader_fault;
    event.text = std::string(100'000, '\x01');
    event.bytes = Bytes(70'000, 0xAB);
    auto value = boost::json::parse(json(event));
    EXPECT_EQ(value.at("text").as_string(), event.text);
    EXPECT_EQ(value.at("bytes").as_string(), to_hex(event.bytes));
}

TEST(EventJson, TheLargestEventOfFixedFieldsFitsItsRoom) {
    Event event;
    event.seq = UINT64_MAX;
    event.type = Type::reader_disconnected;
    event.reads = UINT64_MAX;
    event.rssi = INT16_MIN;
    event.pc = UINT16_MAX;
    event.xpc = UINT32_MAX;
    event.tag = TagId(Bytes(TagId::max_size, 0xFF));
    event.code = event.input = INT64_MIN;
    event.count = UINT64_MAX;
    event.state = false;
    event.possible_repeat = true;
    event.first_seen = event.last_seen = event.reader_time = event.since = event.time;
    event.user = event.tid = event.bytes = Bytes(1, 0);
    event.reader = event.antenna = event.zone = event.epc = event.gs1 = event.link = event.from = event.to =
        event.reason = event.text = event.scope = event.by = "\x01";
    EXPECT_LT(json(event).size(), 1024u);
    EXPECT_EQ(boost::json::parse(json(event)).at("seq").to_number<std::uint64_t>(), UINT64_MAX);
}

RC_GTEST_PROP(EventJson, WhatAParserReadsBackIsWhatTheEventSaid, ()) {
    Event event;
    event.seq = *rc::gen::arbitrary<std::uint64_t>();
    event.type = all_types()[*rc::gen::inRange<std::size_t>(0, all_types().size())].type;
    event.time = from_us(*rc::gen::inRange<std::int64_t>(0, 4'000'000'000'000'000));
    event.reader = *rc::gen::arbitrary<std::string>();
    event.zone = *rc::gen::string<std::string>();
    event.tag = TagId(*rc::gen::resize(static_cast<int>(TagId::max_size), rc::gen::arbitrary<Bytes>()));
    event.rssi = *rc::gen::arbitrary<std::int16_t>();
    event.reads = *rc::gen::arbitrary<std::uint64_t>();
    event.pc = *rc::gen::arbitrary<std::uint16_t>();
    event.xpc = *rc::gen::arbitrary<std::uint32_t>();
    event.user = *rc::gen::arbitrary<Bytes>();
    event.tid = *rc::gen::arbitrary<Bytes>();

    auto text = json(event, "x:");
    auto value = boost::json::parse(text).as_object();
    RC_ASSERT(value.at("schema").to_number<int>() == 1);
    RC_ASSERT(value.at("id").as_string() == "x:" + std::to_string(event.seq));
    RC_ASSERT(value.at("seq").to_number<std::uint64_t>() == event.seq);
    RC_ASSERT(parse_type(std::string_view(value.at("type").as_string())) == event.type);
    RC_ASSERT(parse_rfc3339(std::string_view(value.at("time").as_string())) == event.time);
    RC_ASSERT(value.contains("reader") != event.reader.empty());
    if (is_utf8(event.reader) && !event.reader.empty())
        RC_ASSERT(value.at("reader").as_string() == event.reader);
    RC_ASSERT(value.contains("technology") == is_tag(event.type));
    RC_ASSERT(value.contains("tag") == (event.tag.size != 0));
    if (event.tag.size != 0) RC_ASSERT(value.at("tag").as_string() == to_hex(event.tag.view()));
    RC_ASSERT(value.contains("reads") == (event.reads != 0));
    auto number_of = [&](const char* key, std::size_t digits) {
        if (!value.contains(key)) return 0ul;
        std::string said(value.at(key).as_string());
        RC_ASSERT(said.size() == 4 || said.size() == digits);
        return std::stoul(said, nullptr, 16) << 4 * (digits - said.size());
    };
    RC_ASSERT(number_of("pc", 4) == event.pc);
    RC_ASSERT(number_of("xpc", 8) == event.xpc);
    if (!event.user.empty()) RC_ASSERT(value.at("data").at("user").as_string() == to_hex(event.user));
    if (!event.tid.empty()) RC_ASSERT(value.at("data").at("tid").as_string() == to_hex(event.tid));
    RC_ASSERT(!value.contains("text"));
}

}  // namespace gantry::event
