#pragma once
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <string>
#include <thread>

#include "base/error.hpp"

namespace gantry::sinks::jsonl {

struct Keeping {
    std::string dir, stem;
    bool gzip = false;        // full files are compressed
    std::uint64_t files = 0;  // how many stay, the one that is written to included; 0: all
    unsigned mode = 0600;
};

// Sees to the files that are full, on a thread of its own, so that no event waits for it. It holds no state:
// what there is to do is seen in the directory, so after a crash it goes on where it was.
class Keeper {
public:
    explicit Keeper(Keeping keeping);
    // File `current` is being written to now; those below it are full. Returns at once.
    void tidy_below(std::uint64_t current);

private:
    void run(const std::stop_token& stop);

    const Keeping keeping_;
    std::mutex mutex_;
    std::condition_variable_any changed_;
    std::uint64_t current_ = 0;
    bool due_ = false;
    std::jthread thread_;  // only where there is something to keep
};

// What the keeper does, once.
Result<void> tidy(const Keeping& keeping, std::uint64_t current, const std::stop_token& stop);

}  // namespace gantry::sinks::jsonl
