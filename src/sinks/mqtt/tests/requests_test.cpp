#include "sinks/mqtt/requests.hpp"

#include <gtest/gtest.h>

#include <boost/json.hpp>

#include "base/log.hpp"

namespace gantry::sinks::mqtt {

struct AskedHost : sink::Host {
    struct Asked {
        std::string operation, body;
        std::function<void(std::string)> answer;
    };
    std::vector<Asked> asked;
    std::vector<sink::ReaderState> readers() override { return {}; }
    void request(std::string_view operation, std::string body,
                 std::function<void(std::string)> answer) override {
        asked.push_back({std::string(operation), std::move(body), std::move(answer)});
    }
};

class MqttRequests : public testing::Test {
protected:
    AskedHost host;
    Topics topics{"gantry/site-7"};
    Requests requests{host, topics};

    static Incoming incoming(std::string body, std::string response_topic = {},
                             std::string correlation = {}) {
        return {.topic = "gantry/site-7/request/tag.read",
                .payload = std::move(body),
                .retained = false,
                .response_topic = std::move(response_topic),
                .correlation = std::move(correlation)};
    }
    Requests::Answer only_answer() {
        auto answers = requests.take_answers();
        EXPECT_EQ(answers.size(), 1u);
        return answers.empty() ? Requests::Answer{} : answers.front();
    }
};

TEST_F(MqttRequests, AreGivenToTheGatewayAndAnsweredWithTheirIds) {
    requests.take(incoming(R"({"id":7,"transaction":"a\"b","reader":"dock-1"})"));
    ASSERT_EQ(host.asked.size(), 1u);
    EXPECT_EQ(host.asked[0].operation, "tag.read");
    EXPECT_EQ(host.asked[0].body, R"({"id":7,"transaction":"a\"b","reader":"dock-1"})");
    EXPECT_TRUE(requests.waiting());
    host.asked[0].answer(R"({"status":"ok","data":{}})");
    EXPECT_FALSE(requests.waiting());
    auto answer = only_answer();
    EXPECT_EQ(answer.topic, "gantry/site-7/response/tag.read");
    auto parsed = boost::json::parse(answer.payload).as_object();
    EXPECT_EQ(parsed.at("id"), 7);
    EXPECT_EQ(parsed.at("transaction"), "a\"b");
    EXPECT_EQ(parsed.at("status"), "ok");
}

TEST_F(MqttRequests, AnswersGoWhereTheRequestSays) {
    requests.take(incoming("", "client/answers", std::string("\0\1x", 3)));
    EXPECT_EQ(host.asked.at(0).body, "{}") << "an empty request is an empty object";
    host.asked[0].answer("{}");
    auto answer = only_answer();
    EXPECT_EQ(answer.topic, "client/answers");
    EXPECT_EQ(answer.correlation, std::string("\0\1x", 3));
    requests.take(incoming("{}", "gantry/site-7/dock-1/status"));
    host.asked.at(1).answer("{}");
    EXPECT_EQ(only_answer().topic, "gantry/site-7/response/tag.read")
        << "but never as the gateway's own word";
}

TEST_F(MqttRequests, WhatIsNoJsonObjectIsAnsweredWithAnError) {
    for (auto* body : {"{", "[]", "7", "\xFF", "{\"id\":1}x"}) {
        requests.take(incoming(body));
        auto parsed = boost::json::parse(only_answer().payload).as_object();
        EXPECT_EQ(parsed.at("status"), "error") << body;
    }
    requests.take(incoming("{\"a\":\"" + std::string(70'000, 'x') + "\"}"));
    EXPECT_NE(only_answer().payload.find("65536 bytes"), std::string::npos);
    EXPECT_TRUE(host.asked.empty());
}

TEST_F(MqttRequests, LongOrNestedIdsAreNotRepeated) {
    requests.take(incoming(R"({"id":{"a":1},"transaction":")" + std::string(300, 't') + "\"}"));
    host.asked.at(0).answer(R"({"status":"ok"})");
    EXPECT_EQ(only_answer().payload, R"({"status":"ok"})");
}

TEST_F(MqttRequests, RetainedOnesAreIgnoredAndSaidSo) {
    log::Capture capture;
    auto old = incoming("{}");
    old.retained = true;
    requests.take(old);
    EXPECT_TRUE(host.asked.empty());
    EXPECT_TRUE(requests.take_answers().empty());
    EXPECT_NE(capture.take().find("retained request"), std::string::npos);
}

TEST_F(MqttRequests, NoMoreThanSixteenAreUnderWay) {
    for (int i = 0; i < 100; ++i)
        requests.take(incoming("{\"id\":" + std::to_string(i) + "}"));
    EXPECT_EQ(host.asked.size(), 16u);
    auto refused = requests.take_answers();
    EXPECT_EQ(refused.size(), 64u) << "nor does an endless heap of refusals wait to be sent";
    EXPECT_NE(refused.front().payload.find("too many requests"), std::string::npos);
    EXPECT_NE(refused.front().payload.find("\"id\":16"), std::string::npos);
    for (auto& each : host.asked)
        each.answer("{}");
    EXPECT_EQ(requests.take_answers().size(), 16u);
    requests.take(incoming("{}"));
    EXPECT_EQ(host.asked.size(), 17u);
}

TEST_F(MqttRequests, AnAnswerMayComeAfterTheSinkIsGone) {
    auto sink = std::make_unique<Requests>(host, topics);
    sink->take(incoming("{}"));
    sink.reset();
    host.asked.at(0).answer("{}");
    EXPECT_FALSE(requests.waiting());
}

}  // namespace gantry::sinks::mqtt
