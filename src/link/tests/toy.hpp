#pragma once
#include <atomic>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <random>
#include <string>

#include "net.hpp"

// A party as a test wants it, and the fixture of a link that carries it.
namespace gantry::link {

// Echoes; what else it does a test says with the functions.
struct Toy : Party {
    std::function<void(Toy&, Now)> at_start, at_input, at_time;
    std::function<void()> in_received;
    std::optional<Steady> due;
    bool wants = true, done = false, echo = true;
    std::size_t seen = 0, times = 0;
    std::string text;

    void say(std::string_view bytes) { out().insert(out().end(), bytes.begin(), bytes.end()); }

    void start(Now now) override {
        if (at_start) at_start(*this, now);
    }
    void received(ByteView bytes, Now now) override {
        seen += bytes.size();
        text += as_text(bytes);
        if (echo) say(as_text(bytes));
        if (at_input) at_input(*this, now);
        if (in_received) in_received();
    }
    void time_passed(Now now) override {
        ++times;
        if (at_time) at_time(*this, now);
    }
    std::optional<Steady> deadline() const override { return due; }
    bool wants_input() const override { return wants; }
    bool finished() const override { return done; }
};

// One toy behind one listening port; all of it lives on the loop.
struct LinkTest : ::testing::Test {
    Loop loop{"test"};
    Toy toy;
    std::unique_ptr<Listener> listener;
    std::shared_ptr<Link> link;
    std::function<void()> after_turn;
    std::atomic<int> turns = 0;  // here, as turns go on while a test's own variables are gone already
    std::mutex mutex;
    std::string reason;
    std::atomic<int> closed = 0;
    Endpoint local;

    void on_loop(std::function<void()> work) { loop.run_and_wait(std::move(work)); }
    template <class Question>
    auto ask(Question question) {
        decltype(question()) answer{};
        on_loop([&] { answer = question(); });
        return answer;
    }

    void listen() {
        on_loop([&] {
            auto opened = Listener::open(loop, any_port, [this](Socket socket) {
                Link::Callbacks callbacks;
                callbacks.after_turn = [this] {
                    if (after_turn) after_turn();
                };
                callbacks.closed = [this](std::string_view why) {
                    std::lock_guard lock(mutex);
                    reason = why;
                    ++closed;
                };
                link = Link::start(loop, std::move(socket), toy, std::move(callbacks));
            });
            ASSERT_TRUE(opened) << opened.error().text();
            listener = std::move(*opened);
            local = listener->local();
        });
    }
    Peer connected() {
        listen();
        auto peer = Peer::to(local.port);
        EXPECT_TRUE(eventually([&] { return ask([&] { return link != nullptr; }); }));
        return peer;
    }
    std::string closed_because() {
        EXPECT_TRUE(eventually([&] { return closed > 0; }));
        std::lock_guard lock(mutex);
        return reason;
    }
    ~LinkTest() override {
        on_loop([&] {
            link.reset();
            listener.reset();
        });
    }
};

inline std::string random_text(std::size_t size) {
    std::mt19937 random(7);
    std::string text(size, '\0');
    for (auto& c : text)
        c = static_cast<char>(random());
    return text;
}

}  // namespace gantry::link
