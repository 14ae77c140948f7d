#include <pthread.h>

#include <boost/asio/post.hpp>
#include <csignal>
#include <future>

#include "link/asio_impl.hpp"
#include "link/loop_impl.hpp"

namespace gantry::link {

namespace {
thread_local const Loop::Impl* this_loop = nullptr;
}

Now read_clocks() {
    return {std::chrono::steady_clock::now(),
            std::chrono::floor<std::chrono::microseconds>(std::chrono::system_clock::now())};
}

Part::Part(Loop::Impl& loop) : loop_(&loop) {
    std::lock_guard lock(loop.mutex);
    if (loop.stopped) {
        loop_ = nullptr;
    } else {
        loop.parts.insert(this);
    }
}

Part::~Part() {
    if (loop_ == nullptr) return;
    std::lock_guard lock(loop_->mutex);
    loop_->parts.erase(this);
}

asio::io_context& Part::io() const {
    return *loop_->io;
}

Loop::Impl::Impl(std::string name) : io(std::make_unique<asio::io_context>(1)) {
    // Signals belong to the threads of the program, not to this one.
    sigset_t all, before;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    thread = std::thread([this, name = name.substr(0, 15)] {
        pthread_setname_np(pthread_self(), name.c_str());
        this_loop = this;
        auto work = asio::make_work_guard(*io);
        io->run();
        this_loop = nullptr;
    });
    pthread_sigmask(SIG_SETMASK, &before, nullptr);
}

Loop::Impl::~Impl() {
    stop();
}

void Loop::Impl::post(std::function<void()> work) {
    std::unique_lock lock(mutex);
    if (stopped) return;
    posted.push_back(std::move(work));
    if (posted.size() > 1) return;  // whoever put the first has asked for run_posted
    asio::post(*io, [this] { run_posted(); });
}

void Loop::Impl::run_posted() {
    std::vector<std::function<void()>> work;
    {
        std::lock_guard lock(mutex);
        work.swap(posted);
    }
    for (auto& one : work) {
        one();
        one = nullptr;  // what it holds goes now, not after the whole batch
    }
}

void Loop::Impl::stop() {
    std::lock_guard once(stopping);
    std::vector<std::function<void()>> dropped;
    {
        std::lock_guard lock(mutex);
        stopped = true;
        dropped.swap(posted);
    }
    dropped.clear();  // who waits in run_and_wait is set free by this
    if (!thread.joinable()) return;
    io->stop();
    thread.join();
    while (auto* part = take_part()) {
        part->loop_ = nullptr;
        part->drop();  // may destroy it, and other parts that it owns
    }
}

Part* Loop::Impl::take_part() {
    std::lock_guard lock(mutex);
    return parts.empty() ? nullptr : parts.extract(parts.begin()).value();
}

Loop::Loop(std::string name) : impl_(std::make_unique<Impl>(std::move(name))) {}
Loop::~Loop() = default;

void Loop::post(std::function<void()> work) {
    impl_->post(std::move(work));
}

void Loop::run_and_wait(std::function<void()> work) {
    if (here()) return work();
    auto done = std::make_shared<std::promise<void>>();
    auto ready = done->get_future();
    impl_->post([&work, done = std::move(done)] {
        work();
        done->set_value();
    });
    ready.wait();  // also when the loop has ended and dropped the promise with the post
}

bool Loop::here() const {
    return this_loop == impl_.get();
}

void Loop::stop() {
    impl_->stop();
}

struct Timer::Impl : Part, std::enable_shared_from_this<Timer::Impl> {
    explicit Impl(Loop::Impl& loop) : Part(loop) {
        if (loop_ != nullptr) clock.emplace(io());
    }
    void drop() override {
        clock.reset();
        then = nullptr;
    }

    std::optional<Clock> clock;
    std::function<void()> then;
    std::uint64_t round = 0;  // a callback that was cancelled may already be queued: it must not fire
};

Timer::Timer(Loop& loop) : impl_(std::make_shared<Impl>(loop.impl())) {}

Timer::~Timer() {
    cancel();
}

void Timer::at(Steady when, std::function<void()> then) {
    if (!impl_->clock) return;
    impl_->then = std::move(then);
    auto round = ++impl_->round;
    impl_->clock->expires_at(when);
    impl_->clock->async_wait([weak = impl_->weak_from_this(), round](const ErrorCode& error) {
        auto self = weak.lock();
        if (error || !self || self->round != round) return;
        auto call = std::exchange(self->then, nullptr);
        if (call) call();
    });
}

void Timer::cancel() {
    ++impl_->round;
    impl_->then = nullptr;
    if (impl_->clock) impl_->clock->cancel();
}

}  // namespace gantry::link
