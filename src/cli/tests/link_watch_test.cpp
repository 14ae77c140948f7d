#include "cli/link_watch.hpp"

#include <gtest/gtest.h>

#include "base/log.hpp"

namespace gantry::cli {
namespace {

using Kind = link::LinkNews::Kind;

struct Watched : ::testing::Test {
    Watched() { log::start(log::Level::info); }

    void up(std::size_t reader = 0) { watch.told(reader, "gate", {Kind::up}, now); }
    void down(bool heard, std::chrono::milliseconds lasted, bool ours = false) {
        watch.told(0, "gate", {Kind::down, "closed by the gateway", heard, ours, lasted}, now);
    }
    void not_reached(std::size_t reader = 0) {
        watch.told(reader, "gate", {Kind::not_reached, "cannot connect to x:1: connection refused"}, now);
    }

    log::Capture said;
    LinkWatch watch{"x:1", 2};
    Steady now = Steady{} + 1h;
};

TEST_F(Watched, TroubleIsToldAtOnceAndThenRarely) {
    not_reached();
    EXPECT_EQ(said.take(), "warn emulate gate: cannot connect to x:1: connection refused; it keeps trying\n");
    for (int i = 0; i < 29; ++i) {
        now += 1s;
        not_reached(1);
    }
    EXPECT_EQ(said.take(), "");
    now += 1s;
    not_reached();
    EXPECT_EQ(
        said.take(),
        "warn emulate gate: cannot connect to x:1: connection refused (31 times so far); it keeps trying\n");
}

TEST_F(Watched, ALinkThatIsClosedAtOnceIsTold) {
    up();
    down(false, 5ms);
    EXPECT_EQ(
        said.take(),
        "warn emulate gate: connected to x:1, and at once closed by the gateway; does the gateway know a "
        "reader of that name? Its log says why; this one keeps trying\n");
    EXPECT_EQ(watch.last_reason(), "closed by the gateway");
    EXPECT_EQ(watch.never_taken(now), 2u);
}

TEST_F(Watched, ALinkThatServedIsNotComplainedOf) {
    up();
    down(true, 5ms);
    EXPECT_EQ(watch.never_taken(now), 1u);
    down(false, 11s);
    down(false, 5ms, true);
    EXPECT_EQ(said.take(), "");
}

TEST_F(Watched, OnlyReadersThatWereTakenCount) {
    EXPECT_EQ(watch.never_taken(now), 2u);
    not_reached();
    EXPECT_EQ(watch.never_taken(now), 2u);
    up();
    EXPECT_EQ(watch.never_taken(now), 1u);
    down(false, 5ms);
    up();  // as young as the one that was cut: nobody knows yet
    EXPECT_EQ(watch.never_taken(now + 5s), 2u);
    EXPECT_EQ(watch.never_taken(now + 10s), 1u);
}

}  // namespace
}  // namespace gantry::cli
