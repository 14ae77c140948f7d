#include "testkit/fault_proxy.hpp"

#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include <cerrno>
#include <string>
#include <thread>

#include <gtest/gtest.h>

#include "testkit/eventually.hpp"
#include "testkit/peer.hpp"

namespace gantry::testkit {
namespace {

using namespace std::chrono_literals;
using Ending = Faults::Ending;

// A client, the proxy, and the listening socket of its target.
struct FaultProxies : ::testing::Test {
    int listener = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    std::unique_ptr<FaultProxy> proxy;

    FaultProxies() {
        sockaddr_in address{};
        address.sin_family = AF_INET;
        address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        socklen_t size = sizeof address;
        EXPECT_EQ(::bind(listener, reinterpret_cast<sockaddr*>(&address), size), 0);
        ::listen(listener, 10);
        ::getsockname(listener, reinterpret_cast<sockaddr*>(&address), &size);
        proxy = std::make_unique<FaultProxy>(ntohs(address.sin_port));
    }
    ~FaultProxies() override {
        proxy.reset();
        if (listener >= 0) ::close(listener);
    }
    // The turn of the first call may have begun before the bytes came; that of the second has seen them.
    void settle() const {
        proxy->passed();
        proxy->passed();
    }
    Peer client() const { return Peer::to(proxy->port()); }
    Peer other_end() const { return Peer(::accept4(listener, nullptr, nullptr, SOCK_CLOEXEC)); }
};

std::string pattern(std::size_t size) {
    std::string text(size, '\0');
    for (std::size_t i = 0; i < size; ++i)
        text[i] = static_cast<char>(i * 7 + i / 251);
    return text;
}

// Up to `size` bytes of one receive call: what came together.
std::string one_receive(const Peer& peer, std::size_t size = 4096) {
    std::string text(size, '\0');
    auto got = ::recv(peer.fd(), text.data(), size, 0);
    text.resize(got > 0 ? static_cast<std::size_t>(got) : 0);
    return text;
}

// Nothing comes for a short while.
bool hears_nothing(const Peer& peer) {
    timeval brief{0, 50'000}, patience{10, 0};
    ::setsockopt(peer.fd(), SOL_SOCKET, SO_RCVTIMEO, &brief, sizeof brief);
    char byte = 0;
    bool nothing = ::recv(peer.fd(), &byte, 1, 0) == -1 && (errno == EAGAIN || errno == EWOULDBLOCK);
    ::setsockopt(peer.fd(), SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    return nothing;
}

bool is_reset(const Peer& peer) {
    char byte = 0;
    return ::recv(peer.fd(), &byte, 1, 0) == -1 && errno == ECONNRESET;
}

TEST_F(FaultProxies, WithoutFaultsBytesPassUnchanged) {
    auto near = client(), far = other_end();
    auto text = pattern(3'000'000);
    std::thread writer([&] { EXPECT_TRUE(near.send(text)); });
    EXPECT_TRUE(far.receive(text.size()) == text);
    writer.join();
    EXPECT_TRUE(far.send("back"));
    EXPECT_EQ(near.receive(4), "back");
    EXPECT_EQ(proxy->open_connections(), 1u);
    EXPECT_EQ(proxy->accepted(), 1u);
    EXPECT_EQ(proxy->passed().to_target, text.size());
    EXPECT_EQ(proxy->passed().to_client, 4u);
}

TEST_F(FaultProxies, AHalfCloseStaysAHalfClose) {
    auto near = client(), far = other_end();
    near.send("ask");
    near.shutdown();
    EXPECT_EQ(far.receive(10), "ask");
    far.send("answer");
    far.close();
    EXPECT_EQ(near.receive(10), "answer");
    EXPECT_TRUE(eventually([&] { return proxy->open_connections() == 0; }));
    EXPECT_EQ(proxy->passed().to_client, 6u) << "what a closed connection passed is not forgotten";
}

TEST_F(FaultProxies, ADelayIsKeptAndSoIsTheOrder) {
    proxy->set({.delay = 30ms}, {});
    auto near = client(), far = other_end();
    auto before = std::chrono::steady_clock::now();
    near.send("one");
    near.send("two");
    EXPECT_EQ(far.receive(6), "onetwo");
    EXPECT_GE(std::chrono::steady_clock::now() - before, 30ms);
}

TEST_F(FaultProxies, SegmentsOfOneByteArriveWhole) {
    proxy->set({.segment = 1}, {.segment = 3});
    auto near = client(), far = other_end();
    auto text = pattern(20'000);
    near.send(text);
    EXPECT_TRUE(far.receive(text.size()) == text);
    far.send(text);
    EXPECT_TRUE(near.receive(text.size()) == text);
}

TEST_F(FaultProxies, SegmentsWithAGapCanBeToldApart) {
    proxy->set({.segment = 3, .gap = 50ms}, {});
    auto near = client(), far = other_end();
    auto before = std::chrono::steady_clock::now();
    near.send("abcdef");
    EXPECT_EQ(far.receive(3), "abc");
    EXPECT_EQ(far.receive(3), "def");
    EXPECT_GE(std::chrono::steady_clock::now() - before, 50ms);
}

TEST_F(FaultProxies, FiftyFramesThatCameApartLeaveTogether) {
    proxy->set({.gather = 50 * 8}, {});
    auto near = client(), far = other_end();
    for (int i = 0; i < 49; ++i)
        near.send("8 bytes.");
    EXPECT_TRUE(hears_nothing(far));
    near.send("8 bytes.");
    EXPECT_EQ(one_receive(far).size(), 400u);
}

TEST_F(FaultProxies, WhatWasGatheredLeavesWithTimeOrWithTheEnd) {
    proxy->set({.gather = 1000, .gather_for = 20ms}, {});
    auto near = client(), far = other_end();
    near.send("few");
    EXPECT_EQ(far.receive(3), "few") << "the time was over";
    proxy->set({.gather = 1000}, {});
    near.send("last");
    EXPECT_TRUE(hears_nothing(far));
    near.shutdown();
    EXPECT_EQ(far.receive(10), "last");
}

TEST_F(FaultProxies, ACutLetsExactlySoManyBytesThrough) {
    for (std::uint64_t place : {0u, 1u, 5u, 9u}) {
        proxy->set({.cut_after = place}, {});
        auto near = client(), far = other_end();
        near.send("123456789");
        EXPECT_EQ(far.receive(9), std::string("123456789").substr(0, place));
        EXPECT_TRUE(near.at_end()) << "an orderly close, though bytes of ours came to nothing";
        EXPECT_TRUE(eventually([&] { return proxy->open_connections() == 0; }));
    }
}

TEST_F(FaultProxies, ACutOfTheAnswerIsOneToo) {
    proxy->set({}, {.cut_after = 2});
    auto near = client(), far = other_end();
    near.send("question");
    EXPECT_EQ(far.receive(8), "question");
    far.send("answer");
    EXPECT_EQ(near.receive(9), "an");
    EXPECT_TRUE(far.at_end());
}

TEST_F(FaultProxies, AResetIsAResetForBoth) {
    proxy->set({.cut_after = 2, .ending = Ending::reset}, {});
    auto near = client(), far = other_end();
    near.send("12");
    EXPECT_TRUE(is_reset(near));
    EXPECT_TRUE(eventually([&] { return proxy->open_connections() == 0; }));
    proxy->set({});
    auto another = client(), its_end = other_end();
    another.send("a");
    EXPECT_EQ(its_end.receive(1), "a");
    proxy->end_all(Ending::reset);
    EXPECT_TRUE(is_reset(another));
    EXPECT_TRUE(is_reset(its_end));
}

TEST_F(FaultProxies, AResetByOneEndReachesTheOther) {
    auto near = client(), far = other_end();
    near.send("a");
    EXPECT_EQ(far.receive(1), "a");
    near.reset();
    EXPECT_TRUE(is_reset(far));
}

TEST_F(FaultProxies, AHalfOpenLinkSwallowsAllAndSaysNothing) {
    auto near = client(), far = other_end();
    near.send("a");
    EXPECT_EQ(far.receive(1), "a");
    proxy->end_all(Ending::half_open);
    auto much = pattern(8'000'000);
    EXPECT_TRUE(near.send(much)) << "no back-pressure: it goes into the void";
    far.close();
    EXPECT_TRUE(hears_nothing(near));
    EXPECT_EQ(proxy->open_connections(), 1u);
    EXPECT_EQ(proxy->passed().to_target, 1u);
    proxy->end_all(Ending::close);
    EXPECT_EQ(proxy->open_connections(), 0u);
}

TEST_F(FaultProxies, ALinkCanBecomeHalfOpenInMidStream) {
    proxy->set({.cut_after = 3, .ending = Ending::half_open}, {});
    auto near = client(), far = other_end();
    near.send("12345");
    EXPECT_EQ(far.receive(3), "123");
    far.send("lost");
    EXPECT_TRUE(hears_nothing(near));
    near.close();
    EXPECT_TRUE(hears_nothing(far));
}

TEST_F(FaultProxies, OneWayCanBeSwallowedAlone) {
    proxy->set({}, {.swallow = true});
    auto near = client(), far = other_end();
    near.send("question");
    EXPECT_EQ(far.receive(8), "question");
    far.send("answer");
    EXPECT_TRUE(hears_nothing(near));
    settle();
    proxy->set({});
    far.send("another");
    EXPECT_EQ(near.receive(7), "another");
}

TEST_F(FaultProxies, AStallHoldsTheBytesAndLetsThemGo) {
    auto near = client(), far = other_end();
    proxy->set({.stall = true});
    near.send("held");
    EXPECT_TRUE(hears_nothing(far));
    proxy->set({});
    EXPECT_EQ(far.receive(4), "held");
}

TEST_F(FaultProxies, AStallIsFeltByTheSender) {
    proxy->set({.stall = true});
    auto near = client();
    timeval brief{0, 50'000};
    ::setsockopt(near.fd(), SOL_SOCKET, SO_SNDTIMEO, &brief, sizeof brief);
    EXPECT_FALSE(near.send(pattern(64'000'000))) << "its buffers are full";
}

TEST_F(FaultProxies, AStallInMidStreamComesAtItsPlaceAndEnds) {
    proxy->set({.stall_after = 3, .stall_for = 60ms}, {});
    auto near = client(), far = other_end();
    auto before = std::chrono::steady_clock::now();
    near.send("abcdef");
    EXPECT_EQ(far.receive(3), "abc");
    EXPECT_EQ(far.receive(3), "def");
    EXPECT_GE(std::chrono::steady_clock::now() - before, 60ms);
}

TEST_F(FaultProxies, BitsAreFlippedWhereTheyWereAskedFor) {
    proxy->set({.flip_every = 4}, {.flip_at = 2});
    auto near = client(), far = other_end();
    near.send(std::string(16, '\0'));
    auto got = far.receive(16);
    ASSERT_EQ(got.size(), 16u);
    for (std::size_t i = 0; i < 16; ++i)
        EXPECT_EQ(got[i] != 0, i % 4 == 3) << i;
    far.send("@@@@");
    EXPECT_EQ(near.receive(4), "@@A@");
}

TEST_F(FaultProxies, ATargetThatIsNotThereIsAClose) {
    ::close(std::exchange(listener, -1));
    EXPECT_TRUE(client().at_end());
    EXPECT_EQ(proxy->open_connections(), 0u);
}

TEST_F(FaultProxies, RefusedAndLetInAgainOnTheSamePort) {
    auto early = client(), its_end = other_end();
    proxy->refuse(true);
    Peer refused(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
    EXPECT_FALSE(refused.connect(proxy->port()));
    EXPECT_EQ(errno, ECONNREFUSED);
    early.send("still here");
    EXPECT_EQ(its_end.receive(10), "still here");
    proxy->refuse(false);
    auto near = client(), far = other_end();
    near.send("again");
    EXPECT_EQ(far.receive(5), "again");
}

TEST_F(FaultProxies, AnotherTargetIsForTheConnectionsToCome) {
    auto near = client(), far = other_end();
    FaultProxy second(proxy->port());  // a proxy to the proxy
    second.set_target(1);              // nobody listens there
    EXPECT_TRUE(Peer::to(second.port()).at_end());
    near.send("a");
    EXPECT_EQ(far.receive(1), "a");
}

TEST_F(FaultProxies, HundredsOfConnectionsAtOnce) {
    std::vector<Peer> near, far;
    for (int i = 0; i < 200; ++i) {
        near.push_back(client());
        far.push_back(other_end());
    }
    for (std::size_t i = 0; i < near.size(); ++i)
        near[i].send(std::to_string(1000 + i));
    for (std::size_t i = 0; i < far.size(); ++i)
        EXPECT_EQ(far[i].receive(4), std::to_string(1000 + i));
    EXPECT_EQ(proxy->open_connections(), 200u);
    far.clear();
    near.clear();
    EXPECT_TRUE(eventually([&] { return proxy->open_connections() == 0; }));
}

}  // namespace
}  // namespace gantry::testkit
