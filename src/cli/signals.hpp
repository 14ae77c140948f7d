#pragma once
#include <chrono>
#include <functional>
#include <optional>
#include <string>
#include <string_view>

namespace gantry::cli {

// Ctrl-C, SIGTERM and SIGHUP as things to wait for. Made before any thread is started, so that every thread
// leaves them to this one.
class Signals {
public:
    Signals();
    ~Signals();
    Signals(const Signals&) = delete;
    Signals& operator=(const Signals&) = delete;

    // True when a signal asked the process to end, false after `timeout`. Meanwhile what comes on stdin goes
    // to `typed`, if given; true from it ends the wait as a signal does.
    bool wait(std::optional<std::chrono::milliseconds> timeout = {},
              const std::function<bool(std::string_view)>& typed = {});

private:
    int fd_;
    bool stdin_open_ = true;
};

// Cuts what comes in pieces into lines. What is longer than any command is cut off.
class Lines {
public:
    void add(std::string_view piece, const std::function<void(std::string_view)>& line);

private:
    std::string text_;
};

}  // namespace gantry::cli
