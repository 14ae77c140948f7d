#include "sinks/mqtt/status.hpp"

#include <gtest/gtest.h>

#include <boost/json.hpp>

namespace gantry::sinks::mqtt {

namespace {
struct Board {
    Topics topics{"gantry/site-7"};
    StatusBoard board;
    Steady now{};
    std::vector<Retained> told;
    std::size_t room = 1000;

    explicit Board(std::string prefix = {}) : board(topics, "site-7", std::move(prefix)) {}
    std::vector<Retained> update(const std::vector<sink::ReaderState>& readers) {
        told.clear();
        board.update(readers, now, [&](const Retained& message) {
            if (told.size() >= room) return false;
            told.push_back(message);
            return true;
        });
        return told;
    }
};
std::string text(const boost::json::value& value) {
    return std::string(value.as_string());
}
const sink::ReaderState dock{.name = "dock-1", .make = "caen", .connected = true, .text = "connected"};
}  // namespace

TEST(MqttStatus, IsOneJsonObject) {
    auto payload = status_payload({.name = "a\"b", .make = "m", .connected = false, .text = "away\n"});
    auto parsed = boost::json::parse(payload).as_object();
    EXPECT_EQ(parsed.at("availability"), "offline");
    EXPECT_EQ(parsed.at("reader"), "a\"b");
    EXPECT_EQ(parsed.at("text"), "away\n");
}

TEST(MqttStatus, IsToldWhenItChanges) {
    Board board;
    ASSERT_EQ(board.update({dock}).size(), 1u);
    EXPECT_EQ(board.told[0].topic, "gantry/site-7/dock-1/status");
    EXPECT_TRUE(board.update({dock}).empty());
    auto gone = dock;
    gone.connected = false;
    EXPECT_EQ(board.update({gone}).size(), 1u);
    board.board.forget();
    EXPECT_EQ(board.update({gone}).size(), 1u) << "a new connection is told all";
}

TEST(MqttStatus, ATextAloneIsToldTwiceAMinute) {
    Board board;
    board.update({dock});
    auto later = dock;
    later.text = "connected, last read 1 s ago";
    board.now += 29s;
    EXPECT_TRUE(board.update({later}).empty());
    board.now += 1s;
    EXPECT_EQ(board.update({later}).size(), 1u);
}

TEST(MqttStatus, AReaderThatIsNoMoreIsDeleted) {
    Board board("homeassistant");
    EXPECT_EQ(board.update({dock}).size(), 3u);
    auto deleted = board.update({});
    ASSERT_EQ(deleted.size(), 3u);
    for (auto& each : deleted)
        EXPECT_EQ(each.payload, "") << each.topic;
    EXPECT_TRUE(board.update({}).empty());
}

TEST(MqttStatus, WhatDoesNotFitIsToldNextTime) {
    Board board;
    auto second = dock;
    second.name = "dock-2";
    board.room = 1;
    EXPECT_EQ(board.update({dock, second}).size(), 1u);
    EXPECT_EQ(board.board.correction("gantry/site-7/dock-2/status", status_payload(second)), "")
        << "it is there";
    EXPECT_EQ(board.update({dock, second}).size(), 1u);
    EXPECT_EQ(board.told[0].topic, "gantry/site-7/dock-2/status");
    EXPECT_TRUE(board.update({dock, second}).empty());
}

TEST(MqttStatus, WhatAnEarlierGatewayLeftOnlineIsCorrected) {
    Board board;
    board.update({dock});
    EXPECT_EQ(board.board.correction("gantry/site-7/dock-1/status", status_payload(dock)), "");
    auto corrected = board.board.correction("gantry/site-7/gate-3/status", status_payload(dock));
    EXPECT_EQ(boost::json::parse(corrected).at("availability"), "offline");
    EXPECT_EQ(board.board.correction("gantry/site-7/gate-3/status", corrected), "");
    EXPECT_EQ(board.board.correction("gantry/site-7/gate-3/status", ""), "");
}

TEST(MqttStatus, DiscoveryNamesASensorAndAScanner) {
    Topics topics("gantry/site-7");
    auto reader = dock;
    reader.name = "dock 1/\"x\"";
    auto found = discovery(topics, "homeassistant", "site-7", reader);
    ASSERT_EQ(found.size(), 2u);
    EXPECT_EQ(found[0].topic,
              "homeassistant/binary_sensor/gantry_site-7__dock_201_2F_22x_22/connection/config");
    EXPECT_EQ(found[1].topic, "homeassistant/tag/gantry_site-7__dock_201_2F_22x_22/config");
    auto sensor = boost::json::parse(found[0].payload).as_object();
    EXPECT_EQ(text(sensor.at("state_topic")), topics.status(reader.name));
    EXPECT_EQ(sensor.at("availability_topic"), "gantry/site-7/bridge/state");
    EXPECT_EQ(sensor.at("device_class"), "connectivity");
    EXPECT_EQ(sensor.at("value_template"), "{{ value_json.availability }}");
    EXPECT_EQ(sensor.at("unique_id"), "gantry_site-7__dock_201_2F_22x_22_connection");
    EXPECT_EQ(text(sensor.at("device").at("name")), reader.name);
    auto scanner = boost::json::parse(found[1].payload).as_object();
    EXPECT_EQ(text(scanner.at("topic")), topics.events(reader.name));
    EXPECT_EQ(scanner.at("value_template"),
              "{% set e = value_json.data if value_json.specversion is defined else value_json %}"
              "{{ e.tag if e.type == 'tag.new' else '' }}");
    EXPECT_EQ(scanner.at("device").at("identifiers"), sensor.at("device").at("identifiers"));
}

}  // namespace gantry::sinks::mqtt
