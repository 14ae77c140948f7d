#pragma once
#include <chrono>
#include <functional>
#include <string>
#include <vector>

namespace gantry::bench {

// A process beside this one: a program, or a function of ours in a fork. Killed when the object goes.
class Child {
public:
    // Its stdout comes here, its stderr goes into the file `log`.
    Child(const std::vector<std::string>& arguments, const std::string& log);
    // Runs `work` in a fork; what it writes to the descriptor that it gets comes here.
    explicit Child(const std::function<void(int)>& work);
    ~Child();
    Child(const Child&) = delete;
    Child& operator=(const Child&) = delete;

    int pid() const { return pid_; }
    // The next line that begins so, without its end. Throws Failure when none comes in time.
    std::string line(const std::string& beginning, std::chrono::milliseconds timeout);
    // Asks it to end (SIGTERM) and waits; its exit code, or minus the signal that ended it.
    int stop();
    int wait();

private:
    int pid_ = -1;
    int out_ = -1;
    std::string buffer_;
};

}  // namespace gantry::bench
