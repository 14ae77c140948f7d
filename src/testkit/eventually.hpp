#pragma once
#include <chrono>
#include <thread>

namespace gantry::testkit {

// Asks every few milliseconds until it is true; false when the time is over first.
template <class Condition>
bool eventually(Condition condition, std::chrono::milliseconds timeout = std::chrono::seconds{20}) {
    auto end = std::chrono::steady_clock::now() + timeout;
    while (!condition()) {
        if (std::chrono::steady_clock::now() >= end) return false;
        std::this_thread::sleep_for(std::chrono::milliseconds{3});
    }
    return true;
}

}  // namespace gantry::testkit
