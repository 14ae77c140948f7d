// The ways a link ends.
#include "toy.hpp"

namespace gantry::link {
namespace {

TEST_F(LinkTest, AHalfClosedPeerStillGetsItsAnswer) {
    auto peer = connected();
    peer.send("abc");
    peer.shutdown();
    EXPECT_EQ(peer.receive(10), "abc");
    EXPECT_EQ(closed_because(), "closed by the reader");
}

TEST_F(LinkTest, AResetIsReported) {
    auto peer = connected();
    peer.send("x");
    EXPECT_EQ(peer.receive(1), "x");
    peer.reset();
    EXPECT_EQ(closed_because(), "connection reset by the reader");
    on_loop([&] {
        link->wake();
        link->close("again");
    });
    EXPECT_EQ(closed, 1);
}

TEST_F(LinkTest, ClosingInsideATurnEndsItAfterTheTurn) {
    auto peer = connected();
    on_loop([&] {
        toy.in_received = [&] {
            link->close("not inside received");
            EXPECT_EQ(closed, 0);
        };
        after_turn = [&] {
            link->close("the first reason wins");
            EXPECT_EQ(closed, 0);
        };
    });
    peer.send("x");
    EXPECT_EQ(closed_because(), "not inside received");
    EXPECT_TRUE(peer.at_end());
    EXPECT_EQ(closed, 1);
}

TEST_F(LinkTest, ClosingOutsideATurnEndsItAtOnce) {
    auto peer = connected();
    on_loop([&] {
        link->close("enough");
        EXPECT_EQ(closed, 1);
    });
    EXPECT_EQ(closed_because(), "enough");
    EXPECT_TRUE(peer.at_end());
}

TEST_F(LinkTest, AFinishedLinkSendsWhatIsLeftAndReadsNoMore) {
    toy.wants = false;
    auto peer = connected();
    auto text = random_text(800'000);
    peer.send("too late");
    on_loop([&] {
        toy.say(text);
        link->finish("no longer wanted");
        link->finish("the first reason wins");
    });
    EXPECT_TRUE(peer.receive(text.size() + 1) == text);
    EXPECT_EQ(closed_because(), "no longer wanted");
    EXPECT_EQ(toy.seen, 0u);
    on_loop([&] { link->finish("inert"); });
    EXPECT_EQ(closed, 1);
}

TEST_F(LinkTest, LettingGoOfALinkEndsItWithoutAWord) {
    auto peer = connected();
    on_loop([&] { link.reset(); });
    EXPECT_TRUE(peer.at_end());
    EXPECT_EQ(closed, 0);
}

TEST_F(LinkTest, LettingGoOfALinkAndItsPartyInsideATurnIsSafe) {
    auto peer = Peer(-1);
    auto own = std::make_unique<Toy>();
    on_loop([&] {
        auto opened = Listener::open(loop, any_port, [&](Socket socket) {
            Link::Callbacks callbacks;
            callbacks.after_turn = [&] {
                if (own->seen == 0) return;
                own.reset();
                link.reset();
            };
            callbacks.closed = [&](std::string_view) { ++closed; };
            link = Link::start(loop, std::move(socket), *own, std::move(callbacks));
        });
        ASSERT_TRUE(opened);
        listener = std::move(*opened);
    });
    peer = Peer::to(listener->local().port);
    peer.send(std::string(70'000, 'x'));
    EXPECT_TRUE(eventually([&] { return ask([&] { return own == nullptr; }); }));
    EXPECT_EQ(closed, 0);
}

TEST_F(LinkTest, StoppingTheLoopClosesItsLinksInSilence) {
    auto peer = connected();
    loop.stop();
    auto left = peer.receive(1);
    EXPECT_EQ(left, "");
    EXPECT_EQ(closed, 0);
    bool ran = false;
    loop.run_and_wait([&] { ran = true; });
    EXPECT_FALSE(ran);
    link->wake();  // inert
    link->close("late");
    EXPECT_EQ(closed, 0);
    link.reset();
    listener.reset();
}

}  // namespace
}  // namespace gantry::link
