#include "sinks/mqtt/delivery.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "testkit/sink_suite.hpp"

namespace gantry::sinks::mqtt {

using sink::Fate;

namespace {
// Small events of some readers: "r0" "r1" "r0" …
struct Batch {
    Batch(std::size_t count, std::size_t readers = 1, std::size_t bytes = 3) : events(count) {
        for (std::size_t i = 0; i < count; ++i) {
            events[i].reader = "r" + std::to_string(i % readers);
            ids.push_back("e:" + std::to_string(i));
            payloads.push_back(std::string(bytes, static_cast<char>('a' + i % 26)));
        }
        for (std::size_t i = 0; i < count; ++i)
            items.push_back({&events[i], ids[i], payloads[i]});
    }
    std::vector<event::Event> events;
    std::vector<std::string> ids, payloads;
    std::vector<sink::Item> items;
};

// A broker that refuses messages with certain text in them.
sink::Outcome run(Delivery& delivery, const std::string& poison, std::uint8_t code,
                  std::vector<std::string>* taken = nullptr) {
    int mid = 0;
    while (delivery.waiting()) {
        auto message = delivery.next(false);
        bool bad = !poison.empty() && message.payload.find(poison) != std::string_view::npos;
        if (!bad && taken != nullptr) taken->emplace_back(message.payload);
        delivery.sent(++mid);
        EXPECT_TRUE(delivery.settle(mid, bad ? code : 0, ""));
        EXPECT_FALSE(delivery.settle(mid, 0, "")) << "an answer counts once";
    }
    return delivery.outcome();
}
}  // namespace

TEST(MqttDelivery, OneEventAMessageInOrder) {
    Batch batch(3, 2);
    Doubts doubts;
    Delivery delivery(batch.items, {}, doubts);
    std::vector<std::string> taken;
    auto outcome = run(delivery, "", 0, &taken);
    EXPECT_EQ(taken, (std::vector<std::string>{"aaa", "bbb", "ccc"}));
    EXPECT_EQ(outcome.fates, std::vector(3, Fate::accepted));
    EXPECT_EQ(outcome.trouble, "");
}

TEST(MqttDelivery, ArraysHoldTheEventsOfOneReaderInOrder) {
    Batch batch(7, 2);
    Doubts doubts;
    Delivery delivery(batch.items, {.array = true, .array_size = 3}, doubts);
    std::vector<std::string> taken;
    auto outcome = run(delivery, "", 0, &taken);
    EXPECT_EQ(taken, (std::vector<std::string>{"[aaa,ccc,eee]", "[ggg]", "[bbb,ddd,fff]"}));
    EXPECT_EQ(outcome.fates, std::vector(7, Fate::accepted));
}

TEST(MqttDelivery, ArraysKeepTheirSizeInBytes) {
    Batch batch(10, 1, 10);
    Doubts doubts;
    Delivery delivery(batch.items, {.array = true, .array_size = 100, .array_bytes = 40}, doubts);
    std::vector<std::string> taken;
    run(delivery, "", 0, &taken);
    EXPECT_EQ(taken.size(), 4u);
    for (auto& each : taken)
        EXPECT_LE(each.size(), 40u);
}

TEST(MqttDelivery, AnEventThatIsRefusedIsFoundInItsArray) {
    Batch batch(20);
    Doubts doubts;
    Delivery delivery(batch.items, {.array = true}, doubts);
    auto outcome = run(delivery, "hhh", 0x99);
    ASSERT_EQ(outcome.reasons.size(), 1u);
    EXPECT_EQ(outcome.reasons[0].item, 7u);
    EXPECT_EQ(outcome.reasons[0].text, "the broker refused it: payload format invalid (0x99)");
    EXPECT_EQ(std::ranges::count(outcome.fates, Fate::accepted), 19);
    EXPECT_EQ(outcome.trouble, "");
}

TEST(MqttDelivery, RightsAndQuotasKeepTheEventAndStopTheRest) {
    for (auto code : std::initializer_list<std::uint8_t>{0x87, 0x97, 0x91}) {
        Batch batch(5);
        Doubts doubts;
        Delivery delivery(batch.items, {}, doubts);
        auto outcome = run(delivery, "ccc", code);
        EXPECT_EQ(outcome.fates,
                  (std::vector{Fate::accepted, Fate::accepted, Fate::kept, Fate::kept, Fate::kept}));
        EXPECT_NE(outcome.trouble.find("e:2"), std::string::npos) << outcome.trouble;
    }
}

TEST(MqttDelivery, ARefusalWithoutAReasonIsBelievedTheThirdTimeIfTheBrokerTakesOthers) {
    Batch batch(4);
    Doubts doubts;
    for (int time = 1; time <= 3; ++time) {
        Delivery delivery(batch.items, {}, doubts);
        auto outcome = run(delivery, "bbb", 0x80);
        EXPECT_EQ(outcome.fates[1], time < 3 ? Fate::kept : Fate::rejected) << time;
        EXPECT_EQ(outcome.trouble.empty(), time == 3);
    }
    EXPECT_TRUE(doubts.empty());
}

TEST(MqttDelivery, ABrokerThatTakesNothingCondemnsNoEvent) {
    Batch batch(3);
    Doubts doubts;
    for (int time = 1; time <= 5; ++time) {
        Delivery delivery(batch.items, {.array = time % 2 == 0}, doubts);
        int mid = 0;
        while (delivery.waiting()) {
            delivery.next(false);
            delivery.sent(++mid);
            delivery.settle(mid, 0x83, "");
        }
        EXPECT_EQ(delivery.outcome().fates, std::vector(3, Fate::kept)) << time;
    }
    EXPECT_LE(doubts.size(), 3u);
}

TEST(MqttDelivery, WhatCannotBeSentAtAllIsRejected) {
    Batch batch(3);
    Doubts doubts;
    Delivery delivery(batch.items, {}, doubts);
    delivery.next(false);
    delivery.refused("too large");
    run(delivery, "", 0);
    Delivery again(batch.items, {}, doubts);
    again.next(false);
    again.refused("too large");
    auto outcome = run(again, "", 0);
    EXPECT_EQ(outcome.fates, (std::vector{Fate::rejected, Fate::accepted, Fate::accepted}));
    EXPECT_EQ(outcome.reasons[0].text, "too large");
}

TEST(MqttDelivery, WhatWasNotAnsweredIsKept) {
    Batch batch(4);
    Doubts doubts;
    Delivery delivery(batch.items, {}, doubts);
    delivery.next(false);
    delivery.sent(1);
    delivery.next(false);
    delivery.sent(2);
    EXPECT_EQ(delivery.suspect(), "") << "two are in flight";
    delivery.settle(1, 0, "");
    EXPECT_EQ(delivery.suspect(), "e:1");
    delivery.next(false);
    delivery.unsent();
    delivery.stop("gone");
    delivery.stop("another");
    EXPECT_FALSE(delivery.waiting());
    auto outcome = delivery.outcome();
    EXPECT_EQ(outcome.fates, (std::vector{Fate::accepted, Fate::kept, Fate::kept, Fate::kept}));
    EXPECT_EQ(outcome.trouble, "gone");
}

TEST(MqttDelivery, AloneTakesOneEventOfAnArray) {
    Batch batch(3);
    Doubts doubts;
    Delivery delivery(batch.items, {.array = true}, doubts);
    EXPECT_EQ(delivery.next(true).payload, "[aaa]");
    delivery.sent(1);
    delivery.reject_suspect("it kills");
    EXPECT_EQ(delivery.next(false).payload, "[bbb,ccc]");
    delivery.sent(2);
    delivery.settle(2, 0x10, "");
    auto outcome = delivery.outcome();
    EXPECT_EQ(outcome.fates, (std::vector{Fate::rejected, Fate::accepted, Fate::accepted}));
}

TEST(MqttReasons, AreInWords) {
    EXPECT_EQ(reason_text(0x87), "not authorized (0x87)");
    EXPECT_EQ(reason_text(0xEE, "no\x1b"), "a code of its own (0xEE): no\\x1B");
    EXPECT_EQ(puback_verdict(0xEE), Verdict::doubtful);
    EXPECT_EQ(puback_verdict(0x01), Verdict::accepted);
    EXPECT_NE(connack_text(1, false, "").find("unsupported protocol version"), std::string::npos);
    EXPECT_NE(connack_text(4, false, "").find("password_file"), std::string::npos);
    EXPECT_NE(connack_text(0x86, true, "").find("bad user name or password"), std::string::npos);
}

}  // namespace gantry::sinks::mqtt
