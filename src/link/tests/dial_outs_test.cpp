// The channels that a virtual reader dials beside its link.
#include <netinet/in.h>
#include <sys/time.h>

#include "toy_device.hpp"

namespace gantry::link {
namespace {

// Says "on" on every link; dials again 5 ms after it lost its link or did not get one.
struct ToyChannel : DialOut {
    std::string story, heard, where;
    std::optional<Steady> next = Steady{};
    std::optional<Steady> due;
    std::function<void(ToyChannel&)> at_input;
    bool done = false;

    void say(std::string_view bytes) { out().insert(out().end(), bytes.begin(), bytes.end()); }

    void start(Now) override {
        story += 's';
        next.reset();
        say("on");
    }
    void received(ByteView bytes, Now) override {
        heard += as_text(bytes);
        if (at_input) at_input(*this);
    }
    void time_passed(Now) override {
        due.reset();
        say("tick");
    }
    std::optional<Steady> deadline() const override { return due; }
    bool finished() const override { return done; }
    void link_lost(Now now) override {
        story += 'l';
        drop_output();
        next = now.steady + 5ms;
    }
    std::string address() const override { return where; }
    std::optional<Steady> dial_at() const override { return next; }
    void dial_failed(Now now) override {
        story += 'f';
        next = now.steady;
    }
};

// A place to dial; plain and blocking, with patience.
struct Harbour {
    int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    std::uint16_t port = 0;

    Harbour() {
        sockaddr_in address{};
        address.sin_family = AF_INET;
        address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        socklen_t size = sizeof address;
        timeval patience{60, 0};
        ::setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
        EXPECT_EQ(::bind(fd, reinterpret_cast<sockaddr*>(&address), size), 0);
        EXPECT_EQ(::getsockname(fd, reinterpret_cast<sockaddr*>(&address), &size), 0);
        port = ntohs(address.sin_port);
    }
    ~Harbour() { ::close(fd); }
    void open() const { EXPECT_EQ(::listen(fd, 8), 0); }
    Peer next() const { return Peer(::accept(fd, nullptr, nullptr)); }
    std::string where() const { return "127.0.0.1:" + std::to_string(port); }
};

struct DialOutTest : DeviceHosts {
    Harbour harbour;

    std::shared_ptr<ToyChannel> channel() const {
        auto made = std::make_shared<ToyChannel>();
        made->where = harbour.where();
        return made;
    }
    void with(const std::function<void()>& work) {
        host->with_device([&](Device&, Now) { work(); });
    }
    std::string story_of(const std::shared_ptr<ToyChannel>& it) {
        return ask([&] { return it->story; });
    }
    std::shared_ptr<ToyChannel> added() {
        auto made = channel();
        with([&] { device->channels.push_back(made); });
        return made;
    }
};

TEST_F(DialOutTest, AChannelIsDialledWithAndWithoutALink) {
    harbour.open();
    listen();
    auto one = added();
    auto first = harbour.next();
    EXPECT_EQ(first.receive(2), "on");
    auto peer = Peer::to(host->local().port);
    EXPECT_EQ(peer.receive(2), "hi");
    auto two = added();
    auto second = harbour.next();
    EXPECT_EQ(second.receive(2), "on");
    first.send("abc");
    EXPECT_TRUE(eventually([&] { return ask([&] { return one->heard; }) == "abc"; }));
    EXPECT_EQ(ask([&] { return two->heard; }), "");
    EXPECT_EQ(story(), "s");
}

TEST_F(DialOutTest, ADeviceMayHaveItsChannelsFromTheStart) {
    harbour.open();
    auto made = make(false);
    auto it = channel();
    made->channels.push_back(it);
    auto opened = DeviceHost::listen(loop, std::move(made), any_port);
    ASSERT_TRUE(opened);
    host = std::move(*opened);
    EXPECT_EQ(harbour.next().receive(2), "on");
}

TEST_F(DialOutTest, AChannelComesBackAfterEveryLoss) {
    listen();
    auto it = added();
    EXPECT_TRUE(eventually([&] { return story_of(it).starts_with("ff"); }));  // nobody listens yet
    harbour.open();
    auto first = harbour.next();
    EXPECT_EQ(first.receive(2), "on");
    first.close();
    auto second = harbour.next();
    EXPECT_EQ(second.receive(2), "on");
    second.reset();
    EXPECT_EQ(harbour.next().receive(2), "on");
    EXPECT_TRUE(story_of(it).find("fslsls") != std::string::npos) << story_of(it);
}

TEST_F(DialOutTest, AChannelThatDoesNotWaitByItselfDoesNotSpin) {
    listen();
    auto begin = read_clocks().steady;
    auto nobody = added(), nowhere = channel();
    nowhere->where = "no address";
    with([&] { device->channels.push_back(nowhere); });
    for (auto& it : {nobody, nowhere}) {
        ASSERT_TRUE(eventually([&] { return story_of(it).size() >= 4; }));
        auto tries = story_of(it).size();
        EXPECT_LE(tries, static_cast<std::size_t>((read_clocks().steady - begin) / 50ms) + 2);
    }
}

TEST_F(DialOutTest, WhatTheDeviceSaysOnAChannelGoesOutAtOnce) {
    harbour.open();
    listen();
    auto it = added();
    auto channel_peer = harbour.next();
    EXPECT_EQ(channel_peer.receive(2), "on");
    with([&] { it->say("one"); });
    EXPECT_EQ(channel_peer.receive(3), "one");
    auto peer = Peer::to(host->local().port);
    EXPECT_EQ(peer.receive(2), "hi");
    with([&] { it->say("two"); });
    EXPECT_EQ(channel_peer.receive(3), "two");
    with([&] { it->due = read_clocks().steady + 5ms; });
    EXPECT_EQ(channel_peer.receive(4), "tick");
}

TEST_F(DialOutTest, WhatAChannelHearsMayMakeTheDeviceSpeak) {
    harbour.open();
    listen();
    auto one = added();
    auto first = harbour.next();
    auto two = added();
    auto second = harbour.next();
    auto peer = Peer::to(host->local().port);
    EXPECT_EQ(peer.receive(2), "hi");
    EXPECT_EQ(second.receive(2), "on");
    with([&] {
        one->at_input = [&](ToyChannel&) {
            device->say("device");
            two->say("two");
        };
    });
    first.send("x");
    EXPECT_EQ(peer.receive(6), "device");
    EXPECT_EQ(second.receive(3), "two");
}

TEST_F(DialOutTest, AChannelThatIsNoLongerWantedSendsWhatIsLeftAndEnds) {
    harbour.open();
    listen();
    auto it = added();
    auto peer = harbour.next();
    EXPECT_EQ(peer.receive(2), "on");
    std::string much(700'000, 'm');
    with([&] {
        it->say(much);
        device->channels.clear();
    });
    std::weak_ptr<ToyChannel> gone = it;
    it.reset();
    EXPECT_TRUE(peer.rest() == much);
    EXPECT_TRUE(eventually([&] { return gone.expired(); }));
}

TEST_F(DialOutTest, AChannelThatEndsItselfInsideItsTurnIsLetGo) {
    harbour.open();
    listen();
    auto it = added();
    auto peer = harbour.next();
    with([&] {
        it->at_input = [&](ToyChannel& self) {
            self.say("bye");
            self.done = true;
            device->channels.clear();
        };
    });
    std::weak_ptr<ToyChannel> gone = it;
    it.reset();
    peer.send("x");
    EXPECT_EQ(peer.rest(), "onbye");
    EXPECT_TRUE(eventually([&] { return gone.expired(); }));
}

TEST_F(DialOutTest, AChannelThatWasNeverConnectedIsLetGoAtOnce) {
    listen();
    auto it = added();
    EXPECT_TRUE(eventually([&] { return !story_of(it).empty(); }));
    std::weak_ptr<ToyChannel> gone = it;
    it.reset();
    with([&] { device->channels.clear(); });
    EXPECT_TRUE(gone.expired());
}

TEST_F(DialOutTest, DestroyingTheHostClosesItsChannels) {
    harbour.open();
    listen();
    auto it = added();
    auto peer = harbour.next();
    EXPECT_EQ(peer.receive(2), "on");
    host.reset();
    EXPECT_TRUE(peer.at_end());
    EXPECT_EQ(it->story, "s");
    listen();
    added();
    auto next = harbour.next();
    EXPECT_EQ(next.receive(2), "on");
    loop.stop();
    EXPECT_TRUE(next.at_end());
    host.reset();
}

}  // namespace
}  // namespace gantry::link
