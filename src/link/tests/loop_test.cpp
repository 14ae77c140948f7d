#include <algorithm>
#include <atomic>

#include "net.hpp"

namespace gantry::link {
namespace {

TEST(Loop, RunsPostsInOrderAndKnowsItsThread) {
    Loop loop("order");
    std::vector<int> seen;
    for (int i = 0; i < 1000; ++i)
        loop.post([&seen, i] { seen.push_back(i); });
    loop.run_and_wait([&] { EXPECT_TRUE(loop.here()); });
    EXPECT_FALSE(loop.here());
    ASSERT_EQ(seen.size(), 1000u);
    EXPECT_TRUE(std::is_sorted(seen.begin(), seen.end()));
}

TEST(Loop, AStopSetsFreeWhoWaits) {
    auto loop = std::make_unique<Loop>("stop");
    std::atomic<bool> inside = false, waiting = false, go = false;
    loop->post([&] {
        inside = true;
        while (!go)
            std::this_thread::yield();
    });
    ASSERT_TRUE(eventually([&] { return inside.load(); }));
    std::thread waiter([&] {
        waiting = true;
        loop->run_and_wait([] {});
    });
    ASSERT_TRUE(eventually([&] { return waiting.load(); }));
    std::thread stopper([&] { loop->stop(); });
    go = true;
    waiter.join();
    stopper.join();
}

TEST(Timer, FiresOnceAtItsLastTimeAndNotWhenCancelled) {
    Loop loop("timer");
    std::optional<Timer> timer, other;
    std::atomic<int> fired = 0, wrong = 0;
    loop.run_and_wait([&] {
        auto now = read_clocks().steady;
        timer.emplace(loop);
        other.emplace(loop);
        timer->at(now + 1ms, [&] { ++wrong; });
        other->at(now + 1ms, [&] { ++wrong; });
        // Both are due and queued by now, and must still not fire.
        while (read_clocks().steady < now + 3ms) {
        }
        timer->at(now + 10ms, [&] {
            ++fired;
            timer->at(read_clocks().steady, [&] { ++fired; });
        });
        other->cancel();
    });
    EXPECT_TRUE(eventually([&] { return fired == 2; }));
    EXPECT_EQ(wrong, 0);
    loop.run_and_wait([&] {
        timer.reset();
        other.reset();
    });
}

TEST(Timer, MayOutliveItsLoop) {
    std::optional<Timer> timer;
    bool fired = false;
    {
        Loop loop("short");
        loop.run_and_wait([&] {
            timer.emplace(loop);
            timer->at(read_clocks().steady + 1h, [&] { fired = true; });
        });
    }
    timer->at(Steady{}, [&] { fired = true; });
    timer.reset();
    EXPECT_FALSE(fired);
}

}  // namespace
}  // namespace gantry::link
