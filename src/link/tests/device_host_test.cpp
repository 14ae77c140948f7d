// The link of a virtual reader, and time without one.
#include "toy_device.hpp"

namespace gantry::link {
namespace {

TEST_F(DeviceHosts, TimePassesWithAndWithoutALink) {
    listen();
    EXPECT_TRUE(eventually([&] { return ask([&] { return device->ticks; }) >= 3; }));
    EXPECT_FALSE(host->connected());
    auto peer = Peer::to(host->local().port);
    EXPECT_EQ(peer.receive(2), "hi");
    EXPECT_TRUE(host->connected());
    auto ticks = ask([&] { return device->ticks; });
    EXPECT_TRUE(eventually([&] { return ask([&] { return device->ticks; }) >= ticks + 3; }));
    peer.close();
    EXPECT_TRUE(eventually([&] { return !host->connected(); }));
    ticks = ask([&] { return device->ticks; });
    EXPECT_TRUE(eventually([&] { return ask([&] { return device->ticks; }) >= ticks + 3; }));
    EXPECT_EQ(story(), "sl");
    EXPECT_EQ(ask([&] { return device->power; }), 1u);
}

TEST_F(DeviceHosts, TheNewestLinkWins) {
    listen();
    auto first = Peer::to(host->local().port);
    EXPECT_EQ(first.receive(2), "hi");
    auto second = Peer::to(host->local().port);
    EXPECT_EQ(second.receive(2), "hi");
    EXPECT_TRUE(first.at_end());
    EXPECT_EQ(story(), "sls");
    EXPECT_TRUE(host->connected());
}

TEST_F(DeviceHosts, WhatIsInjectedGoesOutAtOnce) {
    listen();
    auto peer = Peer::to(host->local().port);
    EXPECT_EQ(peer.receive(2), "hi");
    host->with_device([](Device& it, Now now) { EXPECT_TRUE(it.inject("fault", now)); });
    EXPECT_EQ(peer.receive(5), "fault");
}

TEST_F(DeviceHosts, ADeviceThatFinishesLosesItsLinkAndTakesTheNext) {
    listen();
    auto peer = Peer::to(host->local().port);
    peer.send("q");
    EXPECT_EQ(peer.receive(3), "hi");
    EXPECT_TRUE(eventually([&] { return story() == "sl"; }));
    auto next = Peer::to(host->local().port);
    EXPECT_EQ(next.receive(2), "hi");
}

TEST_F(DeviceHosts, APortInUseIsRefused) {
    listen();
    auto second = DeviceHost::listen(loop, std::make_unique<ToyDevice>(), host->local());
    ASSERT_FALSE(second);
    EXPECT_NE(second.error().what.find("the port is in use"), std::string::npos);
}

TEST_F(DeviceHosts, ADeviceThatDialsComesBackAfterEveryCut) {
    HeldPort port;
    std::unique_ptr<Listener> listener;
    std::vector<Socket> sockets;
    loop.run_and_wait([&] {
        auto take = [&](Socket socket) { sockets.push_back(std::move(socket)); };
        listener = std::move(*Listener::open(loop, port.endpoint, take));
    });
    host = DeviceHost::dial(loop, make(true), listener->local());
    EXPECT_TRUE(eventually([&] { return story() == "s"; }));
    host->cut();
    EXPECT_TRUE(eventually([&] { return story() == "sls"; }));
    EXPECT_TRUE(eventually([&] { return ask([&] { return sockets.size(); }) == 2; }));
    loop.run_and_wait([&] { sockets.clear(); });  // the other side hangs up
    EXPECT_TRUE(eventually([&] { return story() == "slsls"; }));
    auto where = listener->local();
    loop.run_and_wait([&] {
        listener.reset();
        sockets.clear();
    });
    EXPECT_TRUE(eventually([&] { return story().starts_with("slslslff"); }));
    loop.run_and_wait([&] {
        auto opened =
            Listener::open(loop, where, [&](Socket socket) { sockets.push_back(std::move(socket)); });
        ASSERT_TRUE(opened) << opened.error().text();
        listener = std::move(*opened);
    });
    EXPECT_TRUE(eventually([&] { return story().ends_with("fs"); }));
    EXPECT_TRUE(host->connected());
    host.reset();
    loop.run_and_wait([&] {
        listener.reset();
        sockets.clear();
    });
}

TEST_F(DeviceHosts, WhoWantsTheNewsIsToldOfEveryLink) {
    struct Told {
        LinkNews::Kind kind;
        std::string reason;
        bool heard, ours;
        std::chrono::milliseconds lasted;
    };
    std::vector<Told> told;
    HeldPort port;
    std::unique_ptr<Listener> listener;
    std::vector<Socket> sockets;
    auto take = [&](Socket socket) { sockets.push_back(std::move(socket)); };
    loop.run_and_wait([&] { listener = std::move(*Listener::open(loop, port.endpoint, take)); });
    auto begin = read_clocks().steady;
    host = DeviceHost::dial(loop, make(true), listener->local(), [&](const LinkNews& news) {
        told.push_back({news.kind, std::string(news.reason), news.heard, news.ours, news.lasted});
    });
    auto count = [&] { return ask([&] { return told.size(); }); };
    auto at = [&](std::size_t i) { return ask([&] { return std::make_optional(told.at(i)); }).value(); };
    ASSERT_TRUE(eventually([&] { return count() == 1; }));
    EXPECT_EQ(at(0).kind, LinkNews::Kind::up);

    host->cut();
    ASSERT_TRUE(eventually([&] { return count() == 3; }));
    EXPECT_EQ(at(1).kind, LinkNews::Kind::down);
    EXPECT_EQ(at(1).reason, "cut");
    EXPECT_FALSE(at(1).heard);
    EXPECT_FALSE(at(1).ours);
    EXPECT_LE(at(1).lasted, read_clocks().steady - begin);
    EXPECT_EQ(at(2).kind, LinkNews::Kind::up);

    // The other side says something, and the device ends the link by that.
    ASSERT_TRUE(eventually([&] { return ask([&] { return sockets.size(); }) == 2; }));
    Peer peer(ask([&] { return sockets[1].release(); }));
    peer.send("q");
    ASSERT_TRUE(eventually([&] { return count() >= 4; }));
    EXPECT_EQ(at(3).kind, LinkNews::Kind::down);
    EXPECT_EQ(at(3).reason, "finished");
    EXPECT_TRUE(at(3).heard);
    EXPECT_TRUE(at(3).ours);

    loop.run_and_wait([&] {
        listener.reset();
        sockets.clear();
    });
    ASSERT_TRUE(
        eventually([&] { return count() != 0 && at(count() - 1).kind == LinkNews::Kind::not_reached; }));
    EXPECT_NE(at(count() - 1).reason.find("connection refused"), std::string::npos);
    host.reset();
}

TEST_F(DeviceHosts, ADeviceThatDoesNotWaitByItselfDoesNotSpin) {
    // It wants to dial at once and always; nobody listens.
    auto made = make(true);
    auto begin = read_clocks().steady;
    host = DeviceHost::dial(loop, std::move(made), {"127.0.0.1", 1});
    ASSERT_TRUE(eventually([&] { return story().size() >= 4; }));
    auto tries = story().size();
    EXPECT_LE(tries, static_cast<std::size_t>((read_clocks().steady - begin) / 50ms) + 2);
}

TEST_F(DeviceHosts, DestroyingOneFromAnyThreadClosesItsLink) {
    listen();
    auto peer = Peer::to(host->local().port);
    EXPECT_EQ(peer.receive(2), "hi");
    std::thread([&] { host.reset(); }).join();
    EXPECT_TRUE(peer.at_end());
    HeldPort port;
    auto made = DeviceHost::listen(loop, make(false), port.endpoint);
    ASSERT_TRUE(made) << made.error().text();
    host = std::move(*made);
    loop.run_and_wait([&] { host.reset(); });
    Peer late(::socket(AF_INET, SOCK_STREAM, 0));
    EXPECT_FALSE(late.connect(port.endpoint.port));
}

TEST_F(DeviceHosts, OneMayBeDestroyedAfterItsLoopHasStopped) {
    listen();
    auto peer = Peer::to(host->local().port);
    EXPECT_EQ(peer.receive(2), "hi");
    loop.stop();
    EXPECT_TRUE(peer.at_end());
    host.reset();
}

}  // namespace
}  // namespace gantry::link
