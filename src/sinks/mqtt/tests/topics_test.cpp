#include "sinks/mqtt/topics.hpp"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <mosquitto.h>

#include <algorithm>

namespace gantry::sinks::mqtt {

TEST(MqttTopics, OfReadersAndOfTheGateway) {
    Topics topics(Topics::default_base("site-7"));
    EXPECT_EQ(topics.events("dock-1"), "gantry/site-7/dock-1/events");
    EXPECT_EQ(topics.events(""), "gantry/site-7/bridge/events");
    EXPECT_EQ(topics.status("dock-1"), "gantry/site-7/dock-1/status");
    EXPECT_EQ(topics.bridge_state(), "gantry/site-7/bridge/state");
    EXPECT_EQ(topics.response("tag.read"), "gantry/site-7/response/tag.read");
    EXPECT_EQ(Topics::default_base("a/b"), "gantry/a%2Fb");
}

TEST(MqttTopics, NoNameOfAReaderTakesAnotherPlace) {
    Topics topics("b");
    EXPECT_EQ(topics.events("bridge"), "b/%62ridge/events");
    EXPECT_EQ(topics.events("request"), "b/%72equest/events");
    EXPECT_EQ(topics.events("response"), "b/%72esponse/events");
    EXPECT_EQ(topics.events("../#/+/$SYS"), "b/..%2F%23%2F%2B%2F%24SYS/events");
    EXPECT_EQ(topics.events(std::string_view("a\0b", 3)), "b/a%00b/events");
}

RC_GTEST_PROP(MqttTopics, EveryNameIsOneLevelOfAValidTopic, (const std::string& name)) {
    RC_PRE(!name.empty());
    auto topic = Topics("base").events(name);
    RC_ASSERT(mosquitto_pub_topic_check2(topic.data(), topic.size()) == MOSQ_ERR_SUCCESS);
    RC_ASSERT(mosquitto_validate_utf8(topic.data(), static_cast<int>(topic.size())) == MOSQ_ERR_SUCCESS);
    RC_ASSERT(std::ranges::count(topic, '/') == 2);
}

TEST(MqttTopics, EveryCharacterGivesATopicThatTheLibraryTakes) {
    auto utf8 = [](std::uint32_t c) {
        auto byte = [](std::uint32_t value) { return static_cast<char>(value); };
        std::string out;
        if (c < 0x80) return out + byte(c);
        if (c < 0x800) return out + byte(0xC0 | c >> 6) + byte(0x80 | (c & 0x3F));
        if (c < 0x10000)
            return out + byte(0xE0 | c >> 12) + byte(0x80 | (c >> 6 & 0x3F)) + byte(0x80 | (c & 0x3F));
        return out + byte(0xF0 | c >> 18) + byte(0x80 | (c >> 12 & 0x3F)) + byte(0x80 | (c >> 6 & 0x3F)) +
               byte(0x80 | (c & 0x3F));
    };
    Topics topics("base");
    for (std::uint32_t c = 0; c <= 0x10FFFF; ++c) {
        auto topic = topics.events(utf8(c));
        ASSERT_EQ(mosquitto_validate_utf8(topic.data(), static_cast<int>(topic.size())), MOSQ_ERR_SUCCESS)
            << std::hex << c;
    }
}

TEST(MqttTopics, BasesThatCannotBeBuiltOn) {
    for (auto* good : {"gantry/site-7", "/FX7500/ctrl", "a", "Größe/x y"})
        EXPECT_TRUE(Topics::check(good)) << good;
    for (auto* bad : {"", "a/", "a/+", "#", "$SYS/x", "a\nb", "a%2F", "\xFF"})
        EXPECT_FALSE(Topics::check(bad)) << bad;
    EXPECT_FALSE(Topics::check(std::string(600, 'a')));
}

TEST(MqttTopics, OperationsOfRequests) {
    Topics topics("gantry/site-7");
    EXPECT_EQ(topics.operation("gantry/site-7/request/tag.read"), "tag.read");
    for (auto* none : {"gantry/site-7/request/", "gantry/site-7/request/a/b", "gantry/site-70/request/x",
                       "gantry/site-7/requestx/y", "gantry/site-7/request/a b", "other/request/x",
                       "gantry/site-7/response/x", ""})
        EXPECT_EQ(topics.operation(none), std::nullopt) << none;
    EXPECT_EQ(topics.operation("gantry/site-7/request/" + std::string(65, 'a')), std::nullopt);
}

TEST(MqttTopics, AnswersGoNowhereWhereTheGatewayItselfSpeaks) {
    Topics topics("gantry/site-7");
    for (auto* ours : {"gantry/site-7", "gantry/site-7/dock-1/status", "gantry/site-7/bridge/state",
                       "gantry/site-7/request/x", "$SYS/x", ""})
        EXPECT_TRUE(topics.is_reserved(ours)) << ours;
    for (auto* free : {"gantry/site-7/response/me", "gantry/site-70/x", "client/answers"})
        EXPECT_FALSE(topics.is_reserved(free)) << free;
}

}  // namespace gantry::sinks::mqtt
