#pragma once
#include <chrono>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <utility>

#include "sink/sink.hpp"

namespace gantry::sink {

// Runs `call` on a thread that nobody waits for; here, if no thread is to be had. When the program ends it
// waits a second for such threads: client libraries are taken down then, under whoever still uses them. A
// library must therefore be initialised before the first attempt, as those that end first were initialised
// last.
void run_apart(std::function<void()> call);

// A call of a client library that blocks for longer than anybody's patience, as name servers and silent hosts
// make it. It runs on a thread of its own. Whoever loses patience may wait for it again later; whoever goes
// leaves it behind, and what it brings is destroyed there. So it must own all that it uses.
template <class T>
class Attempt {
public:
    explicit Attempt(std::function<T()> call) : shared_(std::make_shared<Shared>()) {
        run_apart([shared = shared_, call = std::move(call)] {
            auto result = call();
            std::lock_guard lock(shared->mutex);
            shared->result = std::move(result);
            shared->done.notify_all();
        });
    }

    // The result, once; nothing as long as the call is under way.
    std::optional<T> wait(const Patience& patience) {
        std::unique_lock lock(shared_->mutex);
        shared_->done.wait_until(lock, patience.stop, patience.until,
                                 [&] { return shared_->result.has_value(); });
        return std::exchange(shared_->result, std::nullopt);
    }

private:
    struct Shared {
        std::mutex mutex;
        std::condition_variable_any done;
        std::optional<T> result;
    };
    std::shared_ptr<Shared> shared_;
};

}  // namespace gantry::sink
