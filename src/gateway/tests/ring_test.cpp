#include "gateway/ring.hpp"

#include <string>
#include <thread>

#include <gtest/gtest.h>

namespace gantry::gateway {
namespace {

TEST(Ring, KeepsOrderAndRefusesWhenFull) {
    Ring<int> ring(4, 1000);
    for (int i = 0; i < 4; ++i) {
        int item = i;
        EXPECT_TRUE(ring.push(item, 1));
    }
    int more = 4;
    EXPECT_FALSE(ring.push(more, 1));
    EXPECT_EQ(more, 4);
    for (int i = 0; i < 4; ++i) {
        int item = -1;
        ASSERT_TRUE(ring.pop(item));
        EXPECT_EQ(item, i);
    }
    EXPECT_TRUE(ring.empty());
}

TEST(Ring, IsBoundedByWeightButLetsOneHeavyItemThrough) {
    Ring<std::string> ring(16, 100);
    std::string heavy = "heavy", light = "light";
    EXPECT_TRUE(ring.push(heavy, 500));
    EXPECT_FALSE(ring.push(light, 1));
    EXPECT_EQ(light, "light");
    std::string out;
    ASSERT_TRUE(ring.pop(out));
    EXPECT_TRUE(ring.push(light, 1));
}

TEST(Ring, CarriesEverythingFromOneThreadToAnotherInOrder) {
    Ring<std::uint64_t> ring(64, 1'000'000);
    constexpr std::uint64_t many = 200'000;
    std::thread producer([&] {
        for (std::uint64_t i = 1; i <= many; ++i)
            for (auto item = i; !ring.push(item, 8);)
                std::this_thread::yield();
    });
    std::uint64_t expected = 1;
    while (expected <= many) {
        std::uint64_t item = 0;
        if (!ring.pop(item)) {
            std::this_thread::yield();
            continue;
        }
        ASSERT_EQ(item, expected);
        ++expected;
    }
    producer.join();
    EXPECT_TRUE(ring.empty());
}

}  // namespace
}  // namespace gantry::gateway
