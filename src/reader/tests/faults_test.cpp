// What goes wrong between what a virtual reader says and its output.
#include "reader/faults.hpp"

#include <gtest/gtest.h>

namespace gantry {
namespace {

struct FaultyLink : ::testing::Test {
    LinkFaults link{1};
    Bytes out;
    Now now;

    void SetUp() override { link.link_up(); }
    void say(std::string_view text) { link.say(as_bytes(text), now, out); }
    Result<void> inject(std::string_view word, std::string_view value = {}) {
        return link.inject({word, value, now}, out);
    }
    void waits(std::chrono::milliseconds time) {
        now = now + time;
        link.time_passed(now, out);
    }
    std::string taken() { return std::string(as_text(std::exchange(out, {}))); }
};

TEST_F(FaultyLink, WithoutAFaultAllGoesOut) {
    say("one");
    say("two");
    EXPECT_EQ(taken(), "onetwo");
    EXPECT_FALSE(link.deadline());
}

TEST_F(FaultyLink, HalfOpenEndsWithItsLink) {
    ASSERT_TRUE(inject("half-open"));
    say("lost");
    ASSERT_TRUE(inject("garbage"));
    ASSERT_TRUE(inject("duplicate"));
    EXPECT_EQ(taken(), "");
    EXPECT_TRUE(link.deaf());
    link.link_lost();
    link.link_up();
    EXPECT_FALSE(link.deaf());
    say("heard");
    EXPECT_EQ(taken(), "heard");
}

TEST_F(FaultyLink, OneInjectedBeforeTheLinkIsOfTheFirstLink) {
    LinkFaults early(1);
    ASSERT_TRUE(early.inject({"half-open", "on", now}, out));
    early.link_up();
    early.say(as_bytes("lost"), now, out);
    EXPECT_EQ(taken(), "");
}

TEST_F(FaultyLink, SlowKeepsTheOrderAlsoWhenItEnds) {
    ASSERT_TRUE(inject("slow", "500ms"));
    say("a");
    waits(200ms);
    say("b");
    ASSERT_TRUE(inject("slow", "off"));
    say("c");
    EXPECT_EQ(taken(), "");
    EXPECT_EQ(link.late(), 3u);
    waits(300ms);
    EXPECT_EQ(taken(), "a");
    waits(200ms);
    EXPECT_EQ(taken(), "bc");
    say("d");
    EXPECT_EQ(taken(), "d");
}

TEST_F(FaultyLink, WhatIsLateIsBoundedAndNothingOfItIsLost) {
    ASSERT_TRUE(inject("slow", "1h"));
    std::string much(100'000, 'x');
    for (int i = 0; i < 10; ++i)
        say(much);
    EXPECT_LE(link.late(), 256u * 1024);
    waits(2h);
    EXPECT_EQ(taken().size(), 1'000'000u);
}

TEST_F(FaultyLink, TheNextMessageIsSpoiledOrCutAndNoOther) {
    ASSERT_TRUE(inject("truncated"));
    say("1234");
    say("1234");
    EXPECT_EQ(taken(), "121234");
    ASSERT_TRUE(inject("bad-crc"));
    say("1234");
    auto spoiled = taken();
    EXPECT_EQ(spoiled.substr(0, 3), "123");
    EXPECT_NE(spoiled[3], '4');
    ASSERT_TRUE(inject("duplicate"));
    EXPECT_EQ(taken(), "1234");
    ASSERT_TRUE(inject("garbage", "7"));
    EXPECT_EQ(taken().size(), 7u);
}

TEST_F(FaultyLink, DropEndsOneLink) {
    ASSERT_TRUE(inject("drop"));
    EXPECT_TRUE(link.dropped());
    EXPECT_TRUE(link.deaf());
    say("too late");
    EXPECT_EQ(taken(), "");
    link.link_lost();
    EXPECT_FALSE(link.dropped());
    link.link_up();
    EXPECT_FALSE(link.dropped());
    say("heard");
    EXPECT_EQ(taken(), "heard");
}

TEST(FaultyLinks, WhatHappensOnceWaitsForALinkWhereThereIsNone) {
    for (std::string_view word : {"drop", "garbage", "bad-crc", "truncated", "duplicate"}) {
        SCOPED_TRACE(word);
        LinkFaults link{1};
        Bytes out;
        Now now;
        ASSERT_TRUE(link.inject({word, word == "garbage" ? "3" : "", now}, out));
        link.say(as_bytes("1234"), now, out);
        EXPECT_TRUE(out.empty());
        EXPECT_FALSE(link.dropped());
        link.link_lost();  // a try that failed
        link.link_up();
        EXPECT_EQ(link.dropped(), word == "drop");
        link.say(as_bytes("1234"), now, out);
        std::string first(as_text(out));
        std::size_t size = word == "drop" ? 0 : word == "garbage" ? 7 : word == "truncated" ? 2 : 4;
        EXPECT_EQ(first.size(), word == "duplicate" ? 8 : size);
        EXPECT_EQ(first.ends_with("1234"), word == "garbage" || word == "duplicate");
        link.link_lost();
        link.link_up();
        out.clear();
        link.say(as_bytes("1234"), now, out);
        EXPECT_EQ(as_text(out), "1234");
    }
}

TEST(FaultWords, WhatAMakeCannotHaveIsRefusedWithTheReasonAndWhatItCan) {
    constexpr std::array known = {faults::drop, faults::half_open};
    constexpr std::array impossible = {NoFault{faults::clock_jump, "it has no clock"}};
    for (auto* word : {"clock-jump", "clock_jump +1h", "clock"})
        EXPECT_EQ(no_such_fault(word, known, impossible).value().text(),
                  "a reader of this make cannot have the fault \"clock-jump\": it has no clock; "
                  "known: drop, half-open on|off");
    EXPECT_EQ(no_such_fault("explode", known, impossible).value().text(),
              "there is no fault \"explode\"; known: drop, half-open on|off");
}

TEST(FaultWords, OlderOnesMeanTheSame) {
    EXPECT_TRUE(means(faults::half_open, "half-open"));
    EXPECT_TRUE(means(faults::half_open, "half_open"));
    EXPECT_TRUE(means(faults::truncated, "truncate"));
    EXPECT_TRUE(means(faults::reboot, "restart"));
    EXPECT_FALSE(means(faults::reboot, ""));
    EXPECT_FALSE(means(faults::drop, "dro"));
}

TEST(FaultWords, ValuesHaveTheirUsualOnes) {
    EXPECT_EQ(*fault_jump(""), 1h);
    EXPECT_EQ(*fault_jump("-5min"), -5min);
    EXPECT_FALSE(fault_jump("later"));
    EXPECT_EQ(*fault_antenna("", 4), std::optional<std::uint16_t>{1});
    EXPECT_EQ(*fault_antenna("off", 4), std::nullopt);
    EXPECT_FALSE(fault_antenna("5", 4));
    bool on = false;
    EXPECT_TRUE(fault_switch(on, faults::stuck_ack, ""));
    EXPECT_FALSE(fault_switch(on, faults::stuck_ack, "perhaps"));
    EXPECT_TRUE(on);
    EXPECT_TRUE(fault_switch(on, faults::stuck_ack, "off"));
    EXPECT_FALSE(on);
}

}  // namespace
}  // namespace gantry
