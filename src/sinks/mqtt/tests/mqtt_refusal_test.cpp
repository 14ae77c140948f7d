// What brokers refuse, and how: answers that only a scripted broker gives, and real limits.
#include "base/log.hpp"
#include "scripted_broker.hpp"

namespace gantry::sinks::mqtt::tests {

using sink::Fate;
using testkit::LentEvents;
using testkit::patience;
using testkit::QuietHost;

namespace {
bool has_id(std::string_view payload, std::string_view id) {
    return payload.find(std::string("\"id\":\"") + std::string(id) + "\"") != std::string_view::npos;
}
ScriptedBroker::Script refusing(std::string id, std::optional<std::uint8_t> code) {
    return [id = std::move(id), code](std::string_view payload) -> std::optional<std::uint8_t> {
        if (!has_id(payload, id)) return std::uint8_t{0};
        return code;
    };
}
}  // namespace

TEST(MqttRefusal, WhatIsWrongWithTheMessageRejectsItAlone) {
    for (auto code : std::initializer_list<std::uint8_t>{0x90, 0x99}) {
        QuietHost host;
        ScriptedBroker broker(refusing("suite:4", code));
        auto sink = make(url_of(broker.port()), {}, host);
        LentEvents events(10);
        auto outcome = sink->deliver(events.items(), patience(20s));
        EXPECT_EQ(count(outcome, Fate::accepted), 9u);
        ASSERT_EQ(outcome.reasons.size(), 1u);
        EXPECT_EQ(outcome.reasons[0].item, 3u);
        EXPECT_NE(outcome.reasons[0].text.find(reason_name(code)), std::string::npos)
            << outcome.reasons[0].text;
        EXPECT_EQ(broker.connections(), 1);
    }
}

TEST(MqttRefusal, WhatTheBrokerIsNotReadyForIsKept) {
    for (auto code : std::initializer_list<std::uint8_t>{0x87, 0x97}) {
        QuietHost host;
        ScriptedBroker broker(refusing("suite:4", code));
        auto sink = make(url_of(broker.port()), {}, host);
        LentEvents events(10);
        for (int i = 0; i < 5; ++i) {
            auto outcome = sink->deliver(events.items(), patience(20s));
            EXPECT_EQ(count(outcome, Fate::rejected), 0u);
            EXPECT_EQ(outcome.fates[3], Fate::kept);
            EXPECT_NE(outcome.trouble.find(reason_name(code)), std::string::npos) << outcome.trouble;
        }
    }
}

TEST(MqttRefusal, WithoutAReasonTheThirdOneCounts) {
    QuietHost host;
    ScriptedBroker broker(refusing("suite:4", 0x83));
    auto sink = make(url_of(broker.port()), {}, host);
    LentEvents events(10);
    std::vector<Fate> fates;
    for (int i = 0; i < 3; ++i)
        fates.push_back(sink->deliver(events.items(), patience(20s)).fates[3]);
    EXPECT_EQ(fates, (std::vector{Fate::kept, Fate::kept, Fate::rejected}));
}

// The library takes "packet too large" in a confirmation for a fault of the broker and ends the connection.
TEST(MqttRefusal, AnEventThatEndsTheConnectionIsFoundAndGivenUp) {
    for (std::optional<std::uint8_t> code :
         {std::optional<std::uint8_t>{}, std::optional<std::uint8_t>{0x95}}) {
        QuietHost host;
        ScriptedBroker broker(refusing("suite:6", code));
        auto sink = make(url_of(broker.port()), {}, host);
        LentEvents events(10);
        std::vector<sink::Item> left(events.items().begin(), events.items().end());
        std::vector<std::string> rejected;
        int calls = 0;
        for (; !left.empty() && calls < 10; ++calls) {
            auto outcome = sink->deliver(left, patience(20s));
            std::vector<sink::Item> kept;
            for (std::size_t i = 0; i < left.size(); ++i) {
                if (outcome.fates[i] == Fate::rejected) rejected.emplace_back(left[i].id);
                if (outcome.fates[i] == Fate::kept) kept.push_back(left[i]);
            }
            left = std::move(kept);
        }
        EXPECT_TRUE(left.empty());
        EXPECT_EQ(rejected, std::vector<std::string>{"suite:6"});
        EXPECT_LE(calls, 5);
    }
}

TEST(MqttRefusal, ABrokerThatEndsEveryConnectionCondemnsNothing) {
    QuietHost host;
    ScriptedBroker broker([](std::string_view) { return std::nullopt; });
    auto sink = make(url_of(broker.port()), {}, host);
    LentEvents events(10);
    for (int i = 0; i < 8; ++i) {
        auto outcome = sink->deliver(events.items(), patience(20s));
        EXPECT_EQ(count(outcome, Fate::kept), 10u);
        EXPECT_FALSE(outcome.trouble.empty());
    }
}

TEST(MqttRefusal, NoMoreIsInFlightThanTheBrokerAllows) {
    for (auto [receive_maximum, window, most] :
         {std::tuple{7, "100", 7u}, std::tuple{500, "30", 30u}, std::tuple{1, "100", 1u}}) {
        QuietHost host;
        ScriptedBroker broker([](std::string_view) { return std::uint8_t{0}; },
                              static_cast<std::uint16_t>(receive_maximum));
        auto sink = make(url_of(broker.port()), {{"window", window}}, host);
        LentEvents events(100);
        EXPECT_EQ(count(sink->deliver(events.items(), patience(20s)), Fate::accepted), 100u);
        EXPECT_EQ(broker.most_in_flight(), most);
    }
}

TEST(MqttRefusal, AWrongPasswordIsSaidAndNotShown) {
    MosquittoServer server("allow_anonymous false\npassword_file DIR/passwords\n");
    testkit::write_file(server.dir() + "/passwords", "");
    server.start();
    for (auto* version : {"5", "3.1.1"}) {
        QuietHost host;
        log::Capture capture;
        auto sink = make(url_of(server.port()),
                         {{"version", version}, {"user", "joe"}, {"password", "s3cret"}}, host);
        LentEvents events(3);
        auto outcome = sink->deliver(events.items(), patience(20s));
        EXPECT_EQ(count(outcome, Fate::kept), 3u);
        EXPECT_NE(outcome.trouble.find("not authorized"), std::string::npos) << outcome.trouble;
        EXPECT_NE(outcome.trouble.find("password_file"), std::string::npos) << outcome.trouble;
        EXPECT_EQ((outcome.trouble + capture.take()).find("s3cret"), std::string::npos);
        EXPECT_FALSE(sink->connected());
    }
}

TEST(MqttRefusal, TopicsThatWeMayNotPublishToKeepTheEvents) {
    MosquittoServer server("allow_anonymous true\nacl_file DIR/acl\n");
    testkit::write_file(server.dir() + "/acl", "topic readwrite gantry/site-7/bridge/state\n");
    server.start();
    QuietHost host;
    log::Capture capture;
    auto sink = make(url_of(server.port()), {}, host, true);
    LentEvents events(3);
    auto outcome = sink->deliver(events.items(), patience(20s));
    EXPECT_EQ(count(outcome, Fate::kept), 3u);
    EXPECT_NE(outcome.trouble.find("not authorized"), std::string::npos) << outcome.trouble;
    EXPECT_TRUE(sink->connected()) << "which is no reason to go";
}

TEST(MqttRefusal, AnotherClientWithOurNameIsNamedAsTheReason) {
    QuietHost host;
    ScriptedBroker broker(refusing("suite:4", 0x8E));
    auto sink = make(url_of(broker.port()), {}, host);
    LentEvents events(10);
    auto outcome = sink->deliver(events.items(), patience(20s));
    EXPECT_NE(outcome.trouble.find("session taken over"), std::string::npos) << outcome.trouble;
    EXPECT_NE(outcome.trouble.find("client_id"), std::string::npos) << outcome.trouble;
}

}  // namespace gantry::sinks::mqtt::tests
