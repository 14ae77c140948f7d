// Back-pressure, both ways: a party that wants no input, a peer that does not read.
#include "toy.hpp"

namespace gantry::link {
namespace {

TEST_F(LinkTest, InputThatIsNotWantedStaysInTheKernelAndThenArrivesWhole) {
    toy.wants = toy.echo = false;
    auto peer = connected();
    std::size_t sent = 0;
    // Until the peer's kernel takes no more: nobody reads.
    std::string block(64 * 1024, 'b');
    ASSERT_TRUE(eventually([&] {
        auto size = ::send(peer.fd(), block.data(), block.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
        if (size > 0) sent += static_cast<std::size_t>(size);
        return size < 0 && errno == EAGAIN;
    }));
    EXPECT_EQ(ask([&] { return toy.seen; }), 0u);
    on_loop([&] {
        toy.wants = true;
        link->wake();
    });
    EXPECT_TRUE(eventually([&] { return ask([&] { return toy.seen; }) == sent; }));
}

TEST_F(LinkTest, APauseInTheMiddleOfAFloodHoldsAtTheNextRead) {
    toy.echo = false;
    toy.at_input = [](Toy& self, Now) { self.wants = false; };
    auto peer = connected();
    auto text = random_text(400'000);
    std::thread writer([&] { EXPECT_TRUE(peer.send(text)); });
    std::size_t before = 0;
    while (before < text.size()) {
        ASSERT_TRUE(eventually([&] { return ask([&] { return !toy.wants; }); }));
        auto seen = ask([&] { return toy.seen; });
        EXPECT_LE(seen - before, 64u * 1024);  // one buffer a time, not one more
        before = seen;
        on_loop([&] {
            toy.wants = true;
            link->wake();
        });
    }
    writer.join();
    EXPECT_TRUE(ask([&] { return toy.text; }) == text);
}

TEST_F(LinkTest, TimeAndOutputGoOnWhileInputIsPaused) {
    toy.wants = false;
    toy.at_start = [](Toy& self, Now now) { self.due = now.steady + 2ms; };
    toy.at_time = [](Toy& self, Now now) {
        self.say("t");
        self.due = now.steady + 2ms;
    };
    auto peer = connected();
    peer.send("ignored for now");
    EXPECT_EQ(peer.receive(5), "ttttt");
    EXPECT_EQ(ask([&] { return toy.seen; }), 0u);
}

TEST_F(LinkTest, AResetShowsWhileInputIsPaused) {
    toy.wants = false;
    auto peer = connected();
    on_loop([&] { link->wake(); });
    peer.reset();
    EXPECT_EQ(closed_because(), "connection reset by the reader");
}

TEST_F(LinkTest, UrgentDataDuringAPauseDoesNotSpinTheLoop) {
    toy.wants = false;
    after_turn = [this] { ++turns; };
    auto peer = connected();
    ASSERT_EQ(::send(peer.fd(), "!", 1, MSG_OOB), 1);
    ASSERT_TRUE(eventually([&] { return turns >= 2; }));
    for (int i = 0; i < 100; ++i)
        on_loop([] {});
    EXPECT_LE(turns, 4);
    EXPECT_EQ(closed, 0);
}

TEST_F(LinkTest, BigOutputArrivesWhole) {
    auto text = random_text(1'000'000);
    toy.at_start = [&](Toy& self, Now) { self.say(text); };
    auto peer = connected();
    EXPECT_TRUE(peer.receive(text.size()) == text);
}

TEST_F(LinkTest, APeerThatDoesNotReadIsClosedBeforeItsOutputFillsTheMemory) {
    toy.at_start = [](Toy& self, Now now) { self.due = now.steady; };
    toy.at_time = [](Toy& self, Now now) {
        self.say(std::string(500'000, 'o'));
        self.due = now.steady + 1ms;
    };
    auto peer = connected();
    EXPECT_EQ(closed_because(), "the reader does not read what is sent to it: more than 1 MiB are waiting");
}

TEST_F(LinkTest, APeerThatReadsSlowlyDoesNotMakeTheOutputGrow) {
    std::size_t said = 0;
    toy.at_start = [](Toy& self, Now now) { self.due = now.steady; };
    toy.at_time = [&](Toy& self, Now now) {
        if (self.output().size() < 200'000) {
            self.say(std::string(100'000, 'o'));
            said += 100'000;
        }
        self.due = now.steady + 1ms;
        self.done = said >= 20'000'000;
    };
    auto peer = connected();
    std::size_t got = 0;
    for (std::string piece = peer.receive(50'000); !piece.empty(); piece = peer.receive(50'000))
        got += piece.size();
    EXPECT_EQ(got, 20'000'000u);
    EXPECT_EQ(closed_because(), "finished");
}

TEST_F(LinkTest, WhatWasSaidBeforeFinishingIsSent) {
    auto text = random_text(900'000);
    toy.echo = false;
    toy.at_input = [&](Toy& self, Now) {
        self.say(text);
        self.done = true;
    };
    auto peer = connected();
    peer.send("bye");
    EXPECT_TRUE(peer.receive(text.size()) == text);
    EXPECT_TRUE(peer.at_end());
    EXPECT_EQ(closed_because(), "finished");
}

TEST_F(LinkTest, APartyThatHasFinishedDoesNotWaitForEverForAPeerThatDoesNotRead) {
    toy.at_start = [](Toy& self, Now now) { self.due = now.steady; };
    toy.at_time = [](Toy& self, Now now) {  // until the kernel is full
        self.say(std::string(300'000, 'o'));
        self.due = now.steady + 1ms;
        if (self.output().size() > 400'000) self.done = true;
    };
    auto peer = connected();
    // Which waits for it only so long.
    EXPECT_NE(closed_because().find("could not be sent"), std::string::npos) << reason;
}

TEST_F(LinkTest, TheLastBytesArriveAlthoughThePeerGoesOnSending) {
    toy.echo = false;
    toy.at_input = [](Toy& self, Now) {
        self.say("the end");
        self.done = true;
    };
    auto peer = connected();
    peer.send(std::string(200'000, 'x'));  // it may be cut off, that is the point
    EXPECT_EQ(peer.receive(7), "the end");
}

}  // namespace
}  // namespace gantry::link
