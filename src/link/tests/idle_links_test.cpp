#include <malloc.h>
#include <sys/resource.h>

#include "toy.hpp"

namespace gantry::link {
namespace {

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool sanitized = true;
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
constexpr bool sanitized = true;
#else
constexpr bool sanitized = false;
#endif
#else
constexpr bool sanitized = false;
#endif

std::chrono::microseconds cpu_time() {
    rusage use{};
    ::getrusage(RUSAGE_SELF, &use);
    return std::chrono::seconds(use.ru_utime.tv_sec + use.ru_stime.tv_sec) +
           std::chrono::microseconds(use.ru_utime.tv_usec + use.ru_stime.tv_usec);
}

TEST(Links, AThousandIdleOnesNeedLittleMemoryAndNoTime) {
    constexpr std::size_t count = 1000;
    if (raise_file_limit() < 2 * count + 100) GTEST_SKIP() << "the limit of open files is too low";
    Loop loop("idle");
    std::vector<std::unique_ptr<Toy>> toys;
    for (std::size_t i = 0; i < count; ++i) {
        toys.push_back(std::make_unique<Toy>());
        toys.back()->at_start = [](Toy& self, Now now) { self.due = now.steady + 1h; };
    }
    std::vector<std::shared_ptr<Link>> links;
    links.reserve(count);
    std::unique_ptr<Listener> listener;
    std::atomic<int> turns = 0;
    loop.run_and_wait([&] {
        listener = std::move(*Listener::open(loop, any_port, [&](Socket socket) {
            Link::Callbacks callbacks;
            callbacks.after_turn = [&turns] { ++turns; };
            callbacks.closed = [](std::string_view) {};
            links.push_back(Link::start(loop, std::move(socket), *toys[links.size()], std::move(callbacks)));
        }));
    });
    auto before = ::mallinfo2().uordblks;
    std::vector<Peer> peers;
    peers.reserve(count);
    for (std::size_t i = 0; i < count; ++i)
        peers.push_back(Peer::to(listener->local().port));
    ASSERT_TRUE(eventually([&] { return turns == static_cast<int>(count); }));
    if (!sanitized) {
        auto each = (::mallinfo2().uordblks - before) / count;
        RecordProperty("bytes_per_idle_link", std::to_string(each));
        EXPECT_LT(each, 2048u);
    }
    // A look at the meter, not a wait for something to happen.
    auto cpu = cpu_time();
    std::this_thread::sleep_for(200ms);
    if (!sanitized) {
        EXPECT_LT(cpu_time() - cpu, 10ms);
    }
    EXPECT_EQ(turns, static_cast<int>(count));
    for (auto& peer : peers)
        EXPECT_TRUE(peer.send("x"));
    for (auto& peer : peers)
        EXPECT_EQ(peer.receive(1), "x");
    loop.run_and_wait([&] {
        links.clear();
        listener.reset();
    });
}

}  // namespace
}  // namespace gantry::link
