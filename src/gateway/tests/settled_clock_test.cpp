#include "gateway/settled_clock.hpp"

#include <gtest/gtest.h>

namespace gantry::gateway {
namespace {

constexpr auto year = std::chrono::hours(24 * 365);
const Now start{Steady{} + 5h, Wall{} + 56 * year};

TEST(SettledClock, GoesWithAWallClockThatGoesAsItShould) {
    SettledClock clock(Wall{}, start);
    EXPECT_EQ(clock.look(start), start.wall);
    auto now = start;
    for (int hours = 0; hours < 100; ++hours) {
        now = now + 1h;
        now.wall += hours % 2 == 0 ? 20s : -20s;
        EXPECT_EQ(clock.look(now), now.wall);
    }
}

TEST(SettledClock, BelievesAJumpAheadAfterADay) {
    SettledClock clock(start.wall, start);
    auto jumped = start;
    jumped.wall += 10 * year;
    EXPECT_EQ(clock.look(jumped), start.wall);
    EXPECT_EQ(clock.look(jumped + 23h), start.wall + 23h);
    EXPECT_EQ(clock.look(jumped + 24h), jumped.wall + 24h);
}

TEST(SettledClock, ForgetsAJumpThatWasTakenBack) {
    SettledClock clock(start.wall, start);
    auto jumped = start;
    jumped.wall += 10 * year;
    clock.look(jumped);
    EXPECT_EQ(clock.look(start + 1h), start.wall + 1h);
    EXPECT_EQ(clock.look(jumped + 2h), start.wall + 2h);
    EXPECT_EQ(clock.look(jumped + 25h), start.wall + 25h) << "the day begins anew";
}

TEST(SettledClock, BelievesOneThatGoesBackAtOnce) {
    SettledClock clock(start.wall, start);
    auto back = start;
    back.wall -= year;
    EXPECT_EQ(clock.look(back), back.wall);
    EXPECT_EQ(clock.look(start + 1h), back.wall + 1h) << "and what is ahead of that is doubted";
}

TEST(SettledClock, DoubtsOneThatIsAheadOfTheStoreWhenItStarts) {
    SettledClock clock(start.wall - year, start);
    EXPECT_EQ(clock.look(start), start.wall - year);
    EXPECT_EQ(clock.look(start + 24h), start.wall + 24h);
    SettledClock behind(start.wall + year, start);
    EXPECT_EQ(behind.look(start), start.wall);
}

}  // namespace
}  // namespace gantry::gateway
