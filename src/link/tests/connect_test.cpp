#include <netinet/in.h>
#include <poll.h>
#include <sys/resource.h>

#include <atomic>
#include <mutex>

#include "base/log.hpp"
#include "net.hpp"

namespace gantry::link {
namespace {

struct Connect : ::testing::Test {
    Loop loop{"test"};
    std::unique_ptr<Listener> listener;
    std::mutex mutex;
    std::vector<Socket> accepted;
    std::unique_ptr<Dial> dial;
    std::optional<Result<Socket>> result;

    Result<Endpoint> listen(const Endpoint& at) {
        Result<Endpoint> local;
        loop.run_and_wait([&] {
            auto opened = Listener::open(loop, at, [this](Socket socket) {
                std::lock_guard lock(mutex);
                accepted.push_back(std::move(socket));
            });
            if (!opened) {
                local = tl::unexpected(opened.error());
                return;
            }
            listener = std::move(*opened);
            local = listener->local();
        });
        return local;
    }
    std::size_t count() {
        std::lock_guard lock(mutex);
        return accepted.size();
    }
    Result<Socket> dial_to(const Endpoint& endpoint, std::chrono::milliseconds timeout = 10s) {
        loop.run_and_wait([&] {
            dial = Dial::start(loop, endpoint, timeout, [this](Result<Socket> answer) {
                dial.reset();  // inside its own answer
                std::lock_guard lock(mutex);
                result = std::move(answer);
            });
            EXPECT_FALSE(result);
        });
        EXPECT_TRUE(eventually(
            [&] {
                std::lock_guard lock(mutex);
                return result.has_value();
            },
            timeout + 20s));
        return std::move(*std::exchange(result, std::nullopt));
    }
    ~Connect() override {
        loop.run_and_wait([&] {
            listener.reset();
            dial.reset();
        });
    }
};

TEST_F(Connect, ADialReachesAListener) {
    auto local = listen(any_port);
    ASSERT_TRUE(local);
    EXPECT_GT(local->port, 0);
    auto socket = dial_to(*local);
    ASSERT_TRUE(socket) << socket.error().text();
    EXPECT_EQ(socket->peer(), to_text(*local));
    ASSERT_TRUE(eventually([&] { return count() == 1; }));
    EXPECT_EQ(accepted[0].peer_host(), "127.0.0.1");
}

TEST_F(Connect, ANameIsResolved) {
    auto local = listen(any_port);
    ASSERT_TRUE(local);
    auto socket = dial_to({"localhost", local->port});
    ASSERT_TRUE(socket) << socket.error().text();
}

TEST_F(Connect, NoHostMeansThisMachine) {
    auto local = listen(any_port);
    ASSERT_TRUE(local);
    ASSERT_TRUE(dial_to({"", local->port}));
}

TEST_F(Connect, AllAddressesTakeBothFamiliesAndShowIPv4AsIPv4) {
    auto local = listen({"", 0});
    ASSERT_TRUE(local) << local.error().text();
    ASSERT_TRUE(dial_to({"127.0.0.1", local->port}));
    ASSERT_TRUE(eventually([&] { return count() == 1; }));
    EXPECT_EQ(accepted[0].peer_host(), "127.0.0.1");
    if (local->host == "::") {
        ASSERT_TRUE(dial_to({"::1", local->port}));
        ASSERT_TRUE(eventually([&] { return count() == 2; }));
        EXPECT_EQ(accepted[1].peer_host(), "::1");
        EXPECT_TRUE(accepted[1].peer().starts_with("[::1]:")) << accepted[1].peer();
    }
}

TEST_F(Connect, AListenerByNameIsFoundAtIPv4) {
    auto local = listen({"localhost", 0});
    ASSERT_TRUE(local) << local.error().text();
    EXPECT_EQ(local->host, "127.0.0.1");
}

TEST_F(Connect, APortInUseIsSaidWithWhatToDo) {
    auto local = listen(any_port);
    ASSERT_TRUE(local);
    auto second = Listener::open(loop, *local, [](Socket) {});
    ASSERT_FALSE(second);
    EXPECT_EQ(second.error().what, "cannot listen on " + to_text(*local) + ": the port is in use");
    EXPECT_NE(second.error().hint.find("choose another port"), std::string::npos);
}

TEST_F(Connect, AnAddressOfAnotherMachineCannotBeListenedOn) {
    auto local = listen({"192.0.2.1", 9055});
    ASSERT_FALSE(local);
    EXPECT_EQ(local.error().what, "cannot listen on 192.0.2.1:9055: this machine does not have that address");
}

TEST_F(Connect, AnUnknownNameCannotBeListenedOn) {
    auto local = listen({"no-such-host.invalid", 0});
    ASSERT_FALSE(local);
    EXPECT_NE(local.error().what.find("the host is not known"), std::string::npos) << local.error().what;
}

TEST_F(Connect, AListenerMayBeDestroyedByItsOwnAnswer) {
    std::atomic<int> taken = 0;
    Endpoint local;
    loop.run_and_wait([&] {
        listener = std::move(*Listener::open(loop, any_port, [&](Socket) {
            ++taken;
            listener.reset();
        }));
        local = listener->local();
    });
    auto peer = Peer::to(local.port);
    EXPECT_TRUE(peer.at_end());
    EXPECT_EQ(taken, 1);
}

TEST_F(Connect, ARefusedDialSaysWhatToCheck) {
    HeldPort port;
    auto local = listen(port.endpoint);
    ASSERT_TRUE(local);
    loop.run_and_wait([&] { listener.reset(); });
    auto socket = dial_to(*local);
    ASSERT_FALSE(socket);
    EXPECT_EQ(socket.error().what, "cannot connect to " + to_text(*local) + ": connection refused");
    EXPECT_NE(socket.error().hint.find("nothing listens there"), std::string::npos);
}

TEST_F(Connect, ADialThatNobodyAnswersTimesOut) {
    // A full queue of connections drops what comes next, like a machine that is not there.
    int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    ASSERT_EQ(::bind(fd, reinterpret_cast<sockaddr*>(&address), size), 0);
    ASSERT_EQ(::listen(fd, 0), 0);
    ASSERT_EQ(::getsockname(fd, reinterpret_cast<sockaddr*>(&address), &size), 0);
    Endpoint there{"127.0.0.1", ntohs(address.sin_port)};
    Peer full = Peer::to(there.port);
    pollfd queue{fd, POLLIN, 0};
    ASSERT_EQ(::poll(&queue, 1, 60'000), 1);  // it is in the queue
    auto socket = dial_to(there, 100ms);
    ASSERT_FALSE(socket);
    EXPECT_EQ(socket.error().what, "cannot connect to " + to_text(there) + ": no answer within 100ms");
    ::close(fd);
}

TEST_F(Connect, AnUnknownNameIsSaid) {
    auto socket = dial_to({"no-such-host.invalid", 80}, 60s);
    ASSERT_FALSE(socket);
    EXPECT_TRUE(socket.error().what.starts_with("cannot find the host \"no-such-host.invalid\""))
        << socket.error().what;
}

TEST_F(Connect, ADialThatIsLetGoOfSaysNothing) {
    auto local = listen(any_port);
    ASSERT_TRUE(local);
    bool said = false;
    loop.run_and_wait([&] {
        dial = Dial::start(loop, *local, 1s, [&](Result<Socket>) { said = true; });
        dial.reset();
        dial = Dial::start(loop, {"localhost", local->port}, 1s, [&](Result<Socket>) { said = true; });
        dial.reset();
    });
    ASSERT_TRUE(dial_to(*local));
    EXPECT_FALSE(said);
}

TEST_F(Connect, RunningOutOfFileDescriptorsIsSaidOnceAndSurvived) {
    auto local = listen(any_port);
    ASSERT_TRUE(local);
    Peer first(::socket(AF_INET, SOCK_STREAM, 0)), second(::socket(AF_INET, SOCK_STREAM, 0));
    rlimit before{};
    ASSERT_EQ(::getrlimit(RLIMIT_NOFILE, &before), 0);
    auto tight = before;
    int lowest = ::dup(0);
    ::close(lowest);
    tight.rlim_cur = static_cast<rlim_t>(lowest);
    log::Capture capture;
    std::string said;
    ASSERT_EQ(::setrlimit(RLIMIT_NOFILE, &tight), 0);
    bool both = first.connect(local->port) && second.connect(local->port);
    bool warned = eventually([&] { return !(said += capture.take()).empty(); });
    ASSERT_EQ(::setrlimit(RLIMIT_NOFILE, &before), 0);
    ASSERT_TRUE(both && warned);
    EXPECT_TRUE(eventually([&] { return count() == 2; }));
    said += capture.take();
    EXPECT_EQ(said.find("no free file descriptors"), said.rfind("no free file descriptors")) << said;
    EXPECT_NE(said.find("cannot accept connections on " + to_text(*local)), std::string::npos) << said;
}

TEST_F(Connect, AFloodOfConnectionsIsTaken) {
    auto local = listen(any_port);
    ASSERT_TRUE(local);
    std::vector<Peer> peers;
    for (int i = 0; i < 300; ++i)
        peers.push_back(Peer::to(local->port));
    EXPECT_TRUE(eventually([&] { return count() == 300; }));
}

}  // namespace
}  // namespace gantry::link
