#include "sink/attempt.hpp"

#include <algorithm>
#include <iterator>
#include <list>
#include <system_error>
#include <thread>

namespace gantry::sink {

namespace {
struct Apart {
    std::thread thread;
    bool ended = false;  // its call is over; what the libraries keep a thread goes a moment later
};

struct Running {
    std::mutex mutex;
    std::condition_variable one_ended;
    std::list<Apart> threads;

    // Joined, an ended thread has given back all that libraries kept for it.
    void join_ended(std::unique_lock<std::mutex>& lock) {
        std::list<Apart> ended;
        for (auto each = threads.begin(); each != threads.end();) {
            auto next = std::next(each);
            if (each->ended) ended.splice(ended.end(), threads, each);
            each = next;
        }
        lock.unlock();
        for (auto& each : ended)
            each.thread.join();
        lock.lock();
    }
};

struct WaitAtTheEnd {
    Running& running;
    ~WaitAtTheEnd() {
        std::unique_lock lock(running.mutex);
        running.one_ended.wait_for(lock, std::chrono::seconds{1}, [&] {
            return std::ranges::all_of(running.threads, [](const Apart& each) { return each.ended; });
        });
        running.join_ended(lock);
    }
};

// Never destroyed: one that is stuck in a call may come back even later.
Running& all_running() {
    static auto& running = *new Running;
    static WaitAtTheEnd wait{running};
    return running;
}
}  // namespace

void run_apart(std::function<void()> call) {
    auto& running = all_running();
    std::unique_lock lock(running.mutex);
    running.join_ended(lock);
    auto mine = running.threads.emplace(running.threads.end());
    auto run = [&running, mine, call]() mutable {
        call();
        call = nullptr;  // what it owns goes before it counts as ended
        std::lock_guard ending(running.mutex);
        mine->ended = true;
        running.one_ended.notify_all();
    };
    try {
        mine->thread = std::thread(std::move(run));
    } catch (const std::system_error&) {
        running.threads.erase(mine);
        lock.unlock();
        call();
    }
}

}  // namespace gantry::sink
