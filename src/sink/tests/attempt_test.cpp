#include "sink/attempt.hpp"

#include <gtest/gtest.h>

#include <future>

namespace gantry::sink {

static Patience for_ms(int ms) {
    return {.until = std::chrono::steady_clock::now() + std::chrono::milliseconds{ms}, .stop = {}};
}

TEST(Attempt, BringsItsResultOnce) {
    Attempt<int> attempt([] { return 7; });
    EXPECT_EQ(attempt.wait(for_ms(10'000)), 7);
    EXPECT_EQ(attempt.wait(for_ms(1)), std::nullopt);
}

TEST(Attempt, CanBeWaitedForAgain) {
    std::promise<int> later;
    Attempt<int> attempt([future = later.get_future().share()] { return future.get(); });
    EXPECT_EQ(attempt.wait(for_ms(1)), std::nullopt);
    std::stop_source stopped;
    stopped.request_stop();
    auto patience = for_ms(60'000);
    patience.stop = stopped.get_token();
    EXPECT_EQ(attempt.wait(patience), std::nullopt) << "a stop ends the wait";
    later.set_value(8);
    EXPECT_EQ(attempt.wait(for_ms(10'000)), 8);
}

TEST(Attempt, LeftBehindItEndsByItself) {
    auto alive = std::make_shared<int>(9);
    std::weak_ptr<int> watched = alive;
    std::promise<void> later;
    {
        Attempt<std::shared_ptr<int>> attempt([alive, future = later.get_future().share()] {
            future.wait();
            return alive;
        });
        alive.reset();
        EXPECT_EQ(attempt.wait(for_ms(1)), std::nullopt);
    }
    EXPECT_FALSE(watched.expired());
    later.set_value();
    auto end = std::chrono::steady_clock::now() + std::chrono::seconds{20};
    while (!watched.expired() && std::chrono::steady_clock::now() < end)
        std::this_thread::yield();
    EXPECT_TRUE(watched.expired());
}

}  // namespace gantry::sink
