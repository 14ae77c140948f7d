// When a reader's clock was set.
#include "reader/clock_watch.hpp"

#include <gtest/gtest.h>

#include <vector>

namespace gantry {
namespace {

struct Watched : ::testing::Test {
    ClockWatch watch;
    Now now{Steady{} + 1h, Wall{} + std::chrono::years{56}};
    std::chrono::microseconds clock = 42h;  // the reader's
    using Set = std::optional<std::chrono::microseconds>;

    // Both clocks go on.
    void waits(std::chrono::microseconds time) {
        now = now + time;
        clock += time;
    }
    Set reads(std::vector<std::chrono::microseconds> times) {
        std::vector<Observation> all;
        for (auto time : times)
            all.emplace_back().reader_time_us = time.count();
        return watch.look(all, now);
    }
    Set read() { return reads({clock}); }
    void settle() {
        for (int i = 0; i < 20; ++i) {
            EXPECT_EQ(read(), Set{});
            waits(100ms);
        }
    }
};

TEST_F(Watched, AClockThatIsSetIsNoticedOnce) {
    settle();
    for (auto by : {3600s, -3600s, 6s, -7s, 90'000s, 26 * 31'556'952s}) {
        waits(1s);
        clock += by;
        EXPECT_EQ(read(), Set(by));
        settle();
    }
}

TEST_F(Watched, AStepTooSmallIsNone) {
    settle();
    for (auto by : {4s, -4s, 4s}) {
        clock += by;
        settle();
    }
}

TEST_F(Watched, AnotherDayIsOnlyAnotherGuess) {
    settle();
    for (auto by : {24h, -24h, 240h, -24h}) {
        clock += by;
        settle();
    }
    clock += 1h;
    EXPECT_EQ(read(), Set(1h));
}

TEST_F(Watched, ReadsWithoutATimeSayNothing) {
    settle();
    EXPECT_EQ(reads({0us, 0us}), Set{});
    settle();
}

TEST_F(Watched, ReadsThatLayInItsMemoryAreNoSetting) {
    EXPECT_EQ(reads({clock - 5h, clock - 4h, clock - 1h, clock}), Set{});
    waits(10s);
    EXPECT_EQ(reads({clock}), Set{});
    waits(3min);  // nothing is read, then something old and something new
    EXPECT_EQ(reads({clock - 2min, clock}), Set{});
    settle();
    waits(1h);  // our own disk was slow
    EXPECT_EQ(reads({clock - 59min, clock - 30min}), Set{});
    EXPECT_EQ(read(), Set{});
    settle();
    clock += 1h;
    EXPECT_EQ(read(), Set(1h));
}

TEST_F(Watched, AFallIsNoticedAlsoAmongReadsThatLayInItsMemory) {
    EXPECT_EQ(reads({clock - 5min, clock - 4min, clock - 34min, clock - 33min}), Set(-30min));
    waits(1s);
    clock -= 30min;
    settle();
}

TEST_F(Watched, ClocksMayDrift) {
    settle();
    for (int i = 0; i < 10'000; ++i) {
        waits(10s);
        clock += i < 5'000 ? 1ms : -1ms;
        EXPECT_EQ(read(), Set{});
    }
}

}  // namespace
}  // namespace gantry
