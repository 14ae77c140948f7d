#pragma once
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "link/device_host.hpp"
#include "net.hpp"

// A virtual reader as a test wants it, and the fixture of a host that carries it.
namespace gantry::link {

// Says "hi" on every link and whatever is injected, ticks every 5 ms with or without one, and dials again 5
// ms after it lost its link.
struct ToyDevice : Device {
    std::string story;  // what happened to it, a letter each
    std::size_t ticks = 0, power = 0;
    std::optional<Steady> next_tick, next_dial;
    bool dials = false, done = false, echo = false;
    std::string heard;
    std::vector<std::shared_ptr<DialOut>> channels;

    void say(std::string_view bytes) { out().insert(out().end(), bytes.begin(), bytes.end()); }

    void power_on(Now now) override {
        ++power;
        next_tick = now.steady + 5ms;
        if (dials) next_dial = now.steady;
    }
    void start(Now) override {
        story += 's';
        done = false;
        next_dial.reset();
        say("hi");
    }
    void received(ByteView bytes, Now) override {
        done = bytes.front() == 'q';
        heard += as_text(bytes);
        if (echo) say(as_text(bytes));
    }
    void time_passed(Now now) override {
        ++ticks;
        next_tick = now.steady + 5ms;
    }
    std::optional<Steady> deadline() const override { return next_tick; }
    bool finished() const override { return done; }
    void link_lost(Now now) override {
        story += 'l';
        drop_output();
        if (dials) next_dial = now.steady + 5ms;
    }
    std::optional<Steady> dial_at() const override { return next_dial; }
    void dial_failed(Now) override { story += 'f'; }
    Result<void> inject(std::string_view command, Now) override {
        say(command);
        return {};
    }
    wire::Fields state() const override { return {}; }
    std::vector<std::shared_ptr<DialOut>> dial_outs() const override { return channels; }
};

struct DeviceHosts : ::testing::Test {
    Loop loop{"test"};
    ToyDevice* device = nullptr;
    std::unique_ptr<DeviceHost> host;

    std::unique_ptr<ToyDevice> make(bool dials) {
        auto made = std::make_unique<ToyDevice>();
        made->dials = dials;
        device = made.get();
        return made;
    }
    template <class Question>
    auto ask(Question question) {
        decltype(question()) answer{};
        host->with_device([&](Device&, Now) { answer = question(); });
        return answer;
    }
    std::string story() {
        return ask([&] { return device->story; });
    }
    void listen() {
        auto made = DeviceHost::listen(loop, make(false), any_port);
        ASSERT_TRUE(made) << made.error().text();
        host = std::move(*made);
    }
};

}  // namespace gantry::link
