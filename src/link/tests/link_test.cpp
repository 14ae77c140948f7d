// A link in its daily life: bytes, deadlines, wakes.
#include <netinet/in.h>
#include <sys/socket.h>

#include <random>

#include "toy.hpp"

namespace gantry::link {
namespace {

TEST_F(LinkTest, BytesGoBothWaysInAnyPieces) {
    auto peer = connected();
    auto text = random_text(300'000);
    std::thread writer([&] {
        std::mt19937 random(3);
        for (std::string_view left = text; !left.empty();) {
            auto piece = left.substr(0, 1 + random() % 9000);
            ASSERT_TRUE(peer.send(piece));
            left.remove_prefix(piece.size());
        }
    });
    EXPECT_TRUE(peer.receive(text.size()) == text);
    writer.join();
    EXPECT_EQ(closed, 0);
}

TEST_F(LinkTest, WhatAPartySaysAtItsStartGoesOut) {
    toy.at_start = [](Toy& self, Now) { self.say("hello"); };
    auto peer = connected();
    EXPECT_EQ(peer.receive(5), "hello");
}

TEST_F(LinkTest, DeadlinesFireOneAfterAnother) {
    toy.at_start = [](Toy& self, Now now) { self.due = now.steady + 5ms; };
    toy.at_time = [](Toy& self, Now now) {
        EXPECT_GE(now.steady, *self.due);
        self.due = now.steady + 5ms;
        self.say("t");
        if (self.times == 4) self.done = true;
    };
    auto peer = connected();
    EXPECT_EQ(peer.receive(5), "tttt");
    EXPECT_EQ(closed_because(), "finished");
    EXPECT_EQ(toy.times, 4u);
}

TEST_F(LinkTest, ADeadlineThatIsMovedForwardFiresAtItsNewTime) {
    toy.at_start = [](Toy& self, Now now) { self.due = now.steady + 1h; };
    toy.at_input = [](Toy& self, Now now) { self.due = now.steady + 5ms; };
    toy.at_time = [](Toy& self, Now) { self.done = true; };
    auto peer = connected();
    peer.send("x");
    EXPECT_EQ(closed_because(), "finished");
}

TEST_F(LinkTest, ADeadlineThatIsMovedBackDoesNotFireAtItsOldTime) {
    Steady second;
    toy.at_start = [](Toy& self, Now now) { self.due = now.steady + 30ms; };
    toy.at_input = [&](Toy& self, Now now) { self.due = second = now.steady + 80ms; };
    toy.at_time = [&](Toy& self, Now now) {
        EXPECT_GE(now.steady, second);
        self.done = true;
    };
    auto peer = connected();
    peer.send("x");
    EXPECT_EQ(closed_because(), "finished");
    EXPECT_EQ(toy.times, 1u);
}

TEST_F(LinkTest, ADeadlineThatNeverMovesDoesNotSpinTheLoop) {
    Steady first;
    toy.at_start = [&](Toy& self, Now now) { self.due = first = now.steady; };
    auto peer = connected();
    ASSERT_TRUE(eventually([&] { return ask([&] { return toy.times >= 30; }); }));
    auto [times, passed] = ask([&] { return std::pair(toy.times, read_clocks().steady - first); });
    EXPECT_LE(times, static_cast<std::size_t>(passed / 1ms) + 3);
}

TEST_F(LinkTest, AWakeSendsWhatWasAddedFromOutside) {
    auto peer = connected();
    on_loop([&] {
        after_turn = [this] {
            auto before = ++turns;
            link->wake();  // inside a turn it does nothing
            EXPECT_EQ(turns, before);
        };
        toy.say("from outside");
        link->wake();
        EXPECT_EQ(turns, 1);
    });
    EXPECT_EQ(peer.receive(12), "from outside");
}

TEST_F(LinkTest, ALinkKnowsItsPeer) {
    auto peer = connected();
    sockaddr_in address{};
    socklen_t size = sizeof address;
    ASSERT_EQ(::getsockname(peer.fd(), reinterpret_cast<sockaddr*>(&address), &size), 0);
    EXPECT_EQ(ask([&] { return link->peer(); }), "127.0.0.1:" + std::to_string(ntohs(address.sin_port)));
    EXPECT_EQ(ask([&] { return link->peer_host(); }), "127.0.0.1");
    auto before = ask([&] { return link->last_input(); });
    peer.send("x");
    EXPECT_TRUE(eventually([&] { return ask([&] { return link->last_input(); }) > before; }));
}

}  // namespace
}  // namespace gantry::link
