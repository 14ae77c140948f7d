#include "sinks/nats/subjects.hpp"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>

namespace gantry::sinks::nats {

TEST(NatsSubjects, OfReadersAndOfTheGateway) {
    Subjects subjects("plant.rfid", "site-7");
    EXPECT_EQ(subjects.events("dock-1"), "plant.rfid.site-7.dock-1.events");
    EXPECT_EQ(subjects.events(""), "plant.rfid.site-7.bridge.events");
    EXPECT_EQ(subjects.events("bridge"), "plant.rfid.site-7.%62ridge.events");
    EXPECT_EQ(subjects.all_events(), "plant.rfid.site-7.*.events");
    EXPECT_EQ(Subjects("g", "a.b").events("x.*.> y"), "g.a%2Eb.x%2E%2A%2E%3E%20y.events");
}

RC_GTEST_PROP(NatsSubjects, EveryNameIsOneToken, (const std::string& name)) {
    RC_PRE(!name.empty());
    auto subject = Subjects("g", "s").events(name);
    RC_ASSERT(std::ranges::count(subject, '.') == 3);
    RC_ASSERT(std::ranges::none_of(subject, [](char c) {
        return (static_cast<unsigned char>(c) <= 0x20) || c == '*' || c == '>' || c == 0x7F;
    }));
    RC_ASSERT(covers(Subjects("g", "s").all_events(), subject));
}

TEST(NatsSubjects, WhatAPatternCovers) {
    for (auto [pattern, wanted] : {std::pair{"a.>", "a.b"},
                                   {"a.>", "a.b.*.d"},
                                   {">", "a"},
                                   {"a.*.c", "a.b.c"},
                                   {"a.*.c", "a.*.c"},
                                   {"a.b", "a.b"},
                                   {"a.>", "a.>"}})
        EXPECT_TRUE(covers(pattern, wanted)) << pattern << " " << wanted;
    for (auto [pattern, wanted] : {std::pair{"a.>", "a"},
                                   {"a.b", "a.*"},
                                   {"a.*", "a.b.c"},
                                   {"a.*", "a.>"},
                                   {"a.b.c", "a.b"},
                                   {"b.>", "a.b"},
                                   {"a.b.>", "a.*.c"}})
        EXPECT_FALSE(covers(pattern, wanted)) << pattern << " " << wanted;
}

TEST(NatsSubjects, PrefixesAndLists) {
    for (auto* good : {"gantry", "a.b-c_d", "größe"})
        EXPECT_TRUE(Subjects::check(good)) << good;
    for (auto* bad : {"", ".", "a.", "a..b", "a.*", ">", "a b", "a\nb", "a%"})
        EXPECT_FALSE(Subjects::check(bad)) << bad;
    EXPECT_EQ(parse_subjects("a.>, b.*.c").value(), (std::vector<std::string>{"a.>", "b.*.c"}));
    for (auto* bad : {"", "a,", "a.>.b", "a b", "a..b"})
        EXPECT_FALSE(parse_subjects(bad)) << bad;
}

}  // namespace gantry::sinks::nats
