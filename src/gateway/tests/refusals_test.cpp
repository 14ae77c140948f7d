#include "gateway/refusals.hpp"

#include <gtest/gtest.h>

namespace gantry::gateway {
namespace {

constexpr std::string_view here = "127.0.0.1:9000", there = "127.0.0.1:9001";

TEST(Refusals, AReaderThatDialsForEverIsNamedOnceAMinuteWithTheNumberOfTimes) {
    Refusals refusals;
    int said = 0;
    std::uint64_t told = 0;
    for (int i = 0; i < 3 * 30 + 1; ++i)  // every two seconds for three minutes
        if (auto unsaid = refusals.count(here, "gate-9", Steady{i * 2s})) {
            ++said;
            told += *unsaid;
            EXPECT_EQ(*unsaid, i == 0 ? 0u : 29u);
        }
    EXPECT_EQ(said, 4);
    EXPECT_EQ(told + 4, 91u) << "none is forgotten";
}

TEST(Refusals, EachListenerAndNameHasItsOwnMinute) {
    Refusals refusals;
    EXPECT_EQ(refusals.count(here, "a", Steady{0s}), 0u);
    EXPECT_EQ(refusals.count(there, "a", Steady{0s}), 0u);
    EXPECT_EQ(refusals.count(here, "b", Steady{1s}), 0u);
    EXPECT_EQ(refusals.count(here, "", Steady{1s}), 0u);
    EXPECT_EQ(refusals.count(here, "a", Steady{59s}), std::nullopt);
    EXPECT_EQ(refusals.count(here, "a", Steady{60s}), 1u);
    EXPECT_EQ(refusals.count(here, "b", Steady{60s}), std::nullopt);
    EXPECT_EQ(refusals.count(here, "b", Steady{61s}), 1u);
}

TEST(Refusals, AnyNumberOfInventedNamesCostsLittleMemoryAndFewLines) {
    Refusals refusals;
    std::size_t said = 0;
    for (int i = 0; i < 100'000; ++i)
        if (refusals.count(here, std::to_string(i), Steady{i * 100us})) ++said;
    EXPECT_EQ(said, Refusals::max_names + 1);
    // When they are gone there is room again.
    EXPECT_EQ(refusals.count(here, "honest", Steady{5min}), 0u);
    EXPECT_EQ(refusals.count(here, "honest", Steady{5min + 1s}), std::nullopt);
}

}  // namespace
}  // namespace gantry::gateway
