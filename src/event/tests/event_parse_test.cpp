#include "event/event_parse.hpp"

#include <gtest/gtest.h>

#include "event/event_json.hpp"
#include "testkit/vectors.hpp"

namespace gantry::event {

using testkit::hex;

namespace {

std::string written(const Event& event) {
    std::string out;
    append_json(out, event, "site-7:");
    return out;
}

// Every member has a value.
Event full(Type type) {
    Event event;
    event.seq = 184467;
    event.type = type;
    event.technology = Technology::iso15693;
    event.possible_repeat = true;
    event.time = from_us(1'795'000'000'123'456);
    event.reader = "dock-1 \"<b>\"\n";
    event.antenna = "Ant0";
    event.zone = "dock/left";
    event.tag = TagId(hex("3074257BF7194E4000001A85"));
    event.epc = "urn:epc:id:sgtin:0614141.812345.6789";
    event.gs1 = "(01)80614141123458(21)6789";
    event.link = "https://id.gs1.org/01/80614141123458/21/6789";
    event.pc = 0x3400;
    event.xpc = type == Type::tag_new ? 0x82000000 : 0x82000001;
    event.rssi = -528;
    event.reads = 17;
    event.first_seen = event.last_seen = event.reader_time = event.since = from_us(1'795'000'000'000'001);
    event.from = "yard";
    event.to = "dock/left";
    event.reason = "reader_offline";
    event.text = "antenna 3";
    event.code = -7;
    event.bytes = hex("0102FF");
    event.input = 2;
    event.state = false;
    event.scope = "store";
    event.count = 12;
    event.by = "+1h";
    event.tid = hex("E280");
    event.user = hex("CAFE");
    return event;
}

TEST(EventParse, IsTheInverseOfTheWriter) {
    for (auto& [type, name] : all_types()) {
        Event bare;
        bare.seq = 1;
        bare.type = type;
        for (auto& event : {full(type), bare}) {
            auto parsed = parse_event(written(event));
            ASSERT_TRUE(parsed) << name << ": " << parsed.error().text();
            EXPECT_EQ(written(*parsed), written(event));
            EXPECT_EQ(parsed->seq, event.seq);
            EXPECT_EQ(parsed->tag, event.tag);
        }
    }
    auto moved = parse_event(written(full(Type::tag_moved)));
    EXPECT_EQ(moved->rssi, Rssi(-528));
    EXPECT_EQ(moved->reader, "dock-1 \"<b>\"\n");
}

TEST(EventParse, WhatIsNoEventIsRefused) {
    for (auto* text :
         {"", "[]", "{", "{}", R"({"seq":1,"type":"tag.new"})", R"({"seq":1,"time":"2026-11-21T23:04:00Z"})",
          R"({"type":"tag.new","time":"2026-11-21T23:04:00Z"})"})
        EXPECT_FALSE(parse_event(text)) << text;
    for (auto* member :
         {R"("seq":"1")", R"("seq":-1)", R"("type":"tag.eaten")", R"("tag":"0")", R"("tag":1)",
          R"("rssi_dbm":"x")", R"("rssi_dbm":1e9)", R"("pc":"34")", R"("xpc":"820000")", R"("state":"on")",
          R"("data":7)", R"("data":{"tid":"zz"})", R"("technology":"tin")", R"("first_seen":"today")"}) {
        auto text = std::string(R"({"seq":1,"type":"tag.new","time":"2026-11-21T23:04:00Z",)") + member + "}";
        EXPECT_FALSE(parse_event(text)) << text;
    }
    EXPECT_TRUE(parse_event(R"({"seq":1,"type":"tag.new","time":"2026-11-21T23:04:00Z","later":[1]})"));
}

}  // namespace
}  // namespace gantry::event
