// A link over a serial line.
#include "line.hpp"
#include "toy.hpp"

namespace gantry::link {
namespace {

struct LineLink : LinkTest {
    Cable cable;

    void open() {
        on_loop([&] {
            auto socket = open_serial(cable.line);
            ASSERT_TRUE(socket) << socket.error().text();
            Link::Callbacks callbacks;
            callbacks.closed = [this](std::string_view why) {
                std::lock_guard lock(mutex);
                reason = why;
                ++closed;
            };
            link = Link::start(loop, std::move(*socket), toy, std::move(callbacks));
        });
    }
};

TEST_F(LineLink, BytesGoBothWaysInAnyPieces) {
    open();
    auto text = random_text(100'000);
    std::thread writer([&] {
        std::mt19937 random(3);
        for (std::string_view left = text; !left.empty();) {
            auto piece = left.substr(0, 1 + random() % 900);
            ASSERT_TRUE(cable.master.send(piece));
            left.remove_prefix(piece.size());
        }
    });
    EXPECT_TRUE(cable.master.receive(text.size()) == text);
    writer.join();
    EXPECT_EQ(ask([&] { return link->peer(); }), cable.line.path);
    EXPECT_EQ(closed, 0);
}

TEST_F(LineLink, BytesThatDripInOneByOneArrive) {
    open();
    for (char c : std::string_view("drip\0drop\n", 10)) {
        ASSERT_TRUE(cable.master.send({&c, 1}));
        EXPECT_EQ(cable.master.receive(1), std::string(1, c));
    }
    EXPECT_EQ(ask([&] { return toy.seen; }), 10u);
}

TEST_F(LineLink, ALineThatGoesAwayEndsTheLink) {
    open();
    cable.master.send("x");
    EXPECT_EQ(cable.master.receive(1), "x");
    cable.master.close();
    EXPECT_NE(closed_because().find("the serial line is gone"), std::string::npos) << reason;
}

TEST_F(LineLink, ALineThatGoesAwayWhileNothingIsReadEndsTheLinkToo) {
    toy.wants = false;
    open();
    ask([] { return 0; });  // the first turn is over, and with it the wait is armed
    cable.master.close();
    EXPECT_NE(closed_because().find("the serial line is gone"), std::string::npos) << reason;
}

TEST_F(LineLink, AClosedLineIsFreeForOthers) {
    Program other(cable.line.path);  // a terminal forgets nothing while somebody has it open
    open();
    EXPECT_TRUE(is_exclusive(other.fd()));
    on_loop([&] { link->close("enough"); });
    EXPECT_FALSE(is_exclusive(other.fd()));
    open();
    cable.master.send("x");
    EXPECT_EQ(cable.master.receive(1), "x");
}

TEST_F(LineLink, APartyThatFinishesSendsItsLastBytes) {
    toy.at_input = [](Toy& self, Now) {
        self.say("bye");
        self.done = true;
    };
    toy.echo = false;
    Program other(cable.line.path);
    open();
    cable.master.send("x");
    EXPECT_EQ(cable.master.receive(3), "bye");
    EXPECT_EQ(closed_because(), "finished");
}

}  // namespace
}  // namespace gantry::link
