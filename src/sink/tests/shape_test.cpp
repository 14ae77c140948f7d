#include "sink/shape.hpp"

#include <gtest/gtest.h>

#include <boost/json.hpp>

#include "base/bytes.hpp"
#include "event/event_json.hpp"

namespace gantry::sink {
namespace {

event::Event observed() {
    event::Event event;
    event.seq = 184467;
    event.type = event::Type::tag_observed;
    event.time = from_us(1'795'000'000'123'456);
    event.reader = "dock 1/../<b>\"";
    event.tag = event::TagId(from_hex("3074257BF7194E4000001A85").value());
    return event;
}

TEST(Shape, NativeIsTheOneShape) {
    std::string ours, everywhere;
    append_payload(ours, observed(), "site-7:", Shape::native);
    event::append_json(everywhere, observed(), "site-7:");
    EXPECT_EQ(ours, everywhere);
}

TEST(Shape, CloudEventsWrapIt) {
    std::string text, inner;
    append_payload(text, observed(), "site-7:2:", Shape::cloudevents);
    event::append_json(inner, observed(), "site-7:2:");
    auto value = boost::json::parse(text).as_object();
    EXPECT_EQ(value.at("specversion").as_string(), "1.0");
    EXPECT_EQ(value.at("id").as_string(), "site-7:2:184467");
    EXPECT_EQ(value.at("source").as_string(), "gantry:site-7/dock%201%2F..%2F%3Cb%3E%22");
    EXPECT_EQ(value.at("type").as_string(), "gantry.tag.observed");
    EXPECT_EQ(value.at("subject").as_string(), "3074257BF7194E4000001A85");
    EXPECT_EQ(value.at("time").as_string(), to_rfc3339(observed().time));
    EXPECT_EQ(value.at("datacontenttype").as_string(), "application/json");
    EXPECT_EQ(value.at("data"), boost::json::parse(inner));
}

TEST(Shape, WhatIsNotThereIsLeftOut) {
    event::Event overflow;
    overflow.seq = 1;
    overflow.type = event::Type::overflow;
    std::string text;
    append_payload(text, overflow, "a\"b:", Shape::cloudevents);
    auto value = boost::json::parse(text).as_object();
    EXPECT_EQ(value.at("id").as_string(), "a\"b:1");
    EXPECT_EQ(value.at("source").as_string(), "gantry:a%22b");
    EXPECT_FALSE(value.contains("subject"));
}

TEST(Shape, APayloadTellsItsOwn) {
    for (auto shape : {Shape::native, Shape::cloudevents}) {
        std::string text;
        append_payload(text, observed(), "site-7:", shape);
        EXPECT_EQ(shape_of(text), shape);
    }
    EXPECT_EQ(shape_of(""), Shape::native);
}

TEST(Shape, Names) {
    for (auto shape : {Shape::native, Shape::cloudevents})
        EXPECT_EQ(parse_shape(to_text(shape)), shape);
    EXPECT_FALSE(parse_shape("avro"));
}

}  // namespace
}  // namespace gantry::sink
