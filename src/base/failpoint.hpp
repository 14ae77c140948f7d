#pragma once
#include <algorithm>
#include <atomic>
#include <charconv>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdlib>
#include <random>
#include <string_view>
#include <thread>

namespace gantry {

// Misbehaviour that a test arms with GANTRY_FAILPOINT=<name>[:<n>][,<name>…] to show that it would be caught,
// or that it does no harm; with a number only the n-th pass misbehaves, which one name of a process may have.
// Compiled in only with GANTRY_FAILPOINTS, never in a release.
inline bool failpoint([[maybe_unused]] std::string_view name) {
#ifdef GANTRY_FAILPOINTS
    const char* armed = std::getenv("GANTRY_FAILPOINT");
    for (std::string_view names = armed != nullptr ? armed : ""; !names.empty();) {
        auto each = names.substr(0, names.find(','));
        auto colon = each.find(':');
        if (each.substr(0, colon) == name) {
            if (colon == std::string_view::npos) return true;
            static std::atomic<std::uint64_t> passes = 0;
            std::uint64_t wanted = 0;
            std::from_chars(each.data() + colon + 1, each.data() + each.size(), wanted);
            return ++passes == wanted;
        }
        names.remove_prefix(std::min(names.size(), each.size() + 1));
    }
#endif
    return false;
}

// Where the process ends as by `kill -9`, if a test has armed it.
inline void die_at([[maybe_unused]] std::string_view name) {
#ifdef GANTRY_FAILPOINTS
    if (failpoint(name)) std::raise(SIGKILL);
#endif
}

// Likewise, at some instant of what comes next: within a few milliseconds.
inline void die_soon_at([[maybe_unused]] std::string_view name) {
#ifdef GANTRY_FAILPOINTS
    if (!failpoint(name)) return;
    std::chrono::microseconds wait(std::random_device{}() % 4000);
    std::thread([wait] {
        std::this_thread::sleep_for(wait);
        std::raise(SIGKILL);
    }).detach();
#endif
}

}  // namespace gantry
