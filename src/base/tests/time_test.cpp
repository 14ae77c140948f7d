#include "base/time.hpp"

#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <rapidcheck/gtest.h>

namespace gantry {

using std::chrono::microseconds;

TEST(Time, IsWrittenInUtcWithMicroseconds) {
    EXPECT_EQ(to_rfc3339(from_us(0)), "1970-01-01T00:00:00.000000Z");
    EXPECT_EQ(to_rfc3339(from_us(1'795'302'240'123'456)), "2026-11-21T23:04:00.123456Z");
    EXPECT_EQ(to_rfc3339(from_us(-1)), "1969-12-31T23:59:59.999999Z");
    EXPECT_EQ(to_rfc3339(from_us(951'782'400'000'000)), "2000-02-29T00:00:00.000000Z");
}

TEST(Time, YearsThatHaveNotFourDigitsAreClamped) {
    EXPECT_EQ(to_rfc3339(from_us(INT64_MAX)), "9999-12-31T23:59:59.999999Z");
    EXPECT_EQ(to_rfc3339(from_us(INT64_MIN)), "0000-01-01T00:00:00.000000Z");
}

TEST(Time, IsWrittenIntoExactlyItsRoom) {
    char room[rfc3339_size + 1];
    room[rfc3339_size] = '#';
    EXPECT_EQ(write_rfc3339(from_us(0), room), room + rfc3339_size);
    EXPECT_EQ(room[rfc3339_size], '#');
}

TEST(Time, AllFormsOfTheStandardAreRead) {
    auto expected = from_us(1'795'302'240'123'456);
    for (auto text : {"2026-11-21T23:04:00.123456Z", "2026-11-21t23:04:00.123456z",
                      "2026-11-21 23:04:00.123456789Z", "2026-11-22T00:04:00.123456+01:00",
                      "2026-11-21T17:34:00.123456-05:30", "2026-11-21T23:04:00.123456+00:00"})
        EXPECT_EQ(parse_rfc3339(text), expected) << text;
    EXPECT_EQ(parse_rfc3339("1970-01-01T00:00:00Z"), from_us(0));
    EXPECT_EQ(parse_rfc3339("1970-01-01T00:00:00.5Z"), from_us(500'000));
    EXPECT_EQ(parse_rfc3339("2016-12-31T23:59:60Z"), parse_rfc3339("2017-01-01T00:00:00Z")) << "leap second";
}

TEST(Time, WhatIsNoTimeIsRefused) {
    for (auto text : {"",
                      "2026",
                      "2026-11-21",
                      "2026-11-21T23:04Z",
                      "2026-11-21T23:04:00",
                      "2026-11-21T23:04:00.Z",
                      "2026-13-01T00:00:00Z",
                      "2026-02-29T00:00:00Z",
                      "2026-00-10T00:00:00Z",
                      "2026-01-00T00:00:00Z",
                      "2026-11-21T24:00:00Z",
                      "2026-11-21T23:60:00Z",
                      "2026-11-21T23:04:61Z",
                      "2026-11-21T23:04:00+1:00",
                      "2026-11-21T23:04:00+24:00",
                      "2026-11-21T23:04:00+01:60",
                      "2026-11-21T23:04:00Zx",
                      " 2026-11-21T23:04:00Z",
                      "+026-11-21T23:04:00Z",
                      "2026-11-21T23:04:0 Z",
                      "2026/11/21T23:04:00Z"})
        EXPECT_EQ(parse_rfc3339(text), std::nullopt) << text;
}

RC_GTEST_PROP(Time, EveryTimeOfFourDigitYearsGoesBothWays, ()) {
    // -62,167,219,200 s is the first of January of year 0, 253,402,300,800 s the end of year 9999.
    auto time = from_us(*rc::gen::inRange<std::int64_t>(-62'167'219'200'000'000, 253'402'300'800'000'000));
    RC_ASSERT(parse_rfc3339(to_rfc3339(time)) == time);
    RC_ASSERT(to_us(from_us(to_us(time))) == to_us(time));
}

RC_GTEST_PROP(Time, TextOrderIsTimeOrder, ()) {
    auto gen = rc::gen::inRange<std::int64_t>(0, 253'402'300'800'000'000);
    auto a = *gen, b = *gen;
    RC_ASSERT((a < b) == (to_rfc3339(from_us(a)) < to_rfc3339(from_us(b))));
}

TEST(Time, BothClocksMoveTogether) {
    Now now{Steady{} + 1h, from_us(5)};
    auto later = now + 1500us;
    EXPECT_EQ(later.steady - now.steady, 1500us);
    EXPECT_EQ(later.wall, from_us(1505));
}

TEST(Duration, AllUnitsAreRead) {
    EXPECT_EQ(parse_duration("250us"), 250us);
    EXPECT_EQ(parse_duration("500ms"), 500ms);
    EXPECT_EQ(parse_duration("2s"), 2s);
    EXPECT_EQ(parse_duration("5min"), 5min);
    EXPECT_EQ(parse_duration("5m"), 5min);
    EXPECT_EQ(parse_duration("1h"), 1h);
    EXPECT_EQ(parse_duration("30d"), 720h);
    EXPECT_EQ(parse_duration("1.5s"), 1500ms);
    EXPECT_EQ(parse_duration("0s"), 0s);
    EXPECT_EQ(parse_duration("0.1us"), 0us);
}

TEST(Duration, WhatIsNoDurationIsRefused) {
    for (auto text : {"", "5", "s", "-1s", "5 s", "5sec", "1e3s", "nans", "infs", "1h30m", "5s ", "0x5s",
                      "40000d", "99999999999999999999s"})
        EXPECT_EQ(parse_duration(text), std::nullopt) << text;
}

TEST(Duration, IsWrittenInItsShortestExactForm) {
    EXPECT_EQ(to_text(microseconds{0}), "0s");
    EXPECT_EQ(to_text(2s), "2s");
    EXPECT_EQ(to_text(1500ms), "1500ms");
    EXPECT_EQ(to_text(1h), "1h");
    EXPECT_EQ(to_text(90min), "90min");
    EXPECT_EQ(to_text(48h), "2d");
    EXPECT_EQ(to_text(1001us), "1001us");
}

RC_GTEST_PROP(Duration, WhatIsWrittenReadsBackTheSame, ()) {
    // Up to a hundred years, which a double holds exactly in microseconds.
    microseconds duration{*rc::gen::inRange<std::int64_t>(0, 3'000'000'000'000'000)};
    RC_ASSERT(parse_duration(to_text(duration)) == duration);
}

TEST(Duration, PeopleGetOneOrTwoUnits) {
    EXPECT_EQ(approximate(300ms), "0.3 s");
    EXPECT_EQ(approximate(-5s), "0.0 s");
    EXPECT_EQ(approximate(45s), "45 s");
    EXPECT_EQ(approximate(4min + 10s), "4 min");
    EXPECT_EQ(approximate(130min), "2 h 10 min");
    EXPECT_EQ(approximate(72h), "3 d");
}

}  // namespace gantry
