#pragma once
#include <chrono>
#include <string>
#include <utility>
#include <vector>

namespace gantry::testkit {

// A program of ours run beside the test. Killed when the object goes.
class Process {
public:
    // `arguments` with the program first; `environment` is added to our own. Its stderr goes to `log` or is
    // dropped.
    explicit Process(const std::vector<std::string>& arguments,
                     const std::vector<std::string>& environment = {}, const std::string& log = "/dev/null");
    ~Process();
    Process(const Process&) = delete;
    Process& operator=(const Process&) = delete;

    // Waits until a line of its stdout begins so; the line, or empty when it ended or the time is over.
    std::string wait_for_line(const std::string& beginning,
                              std::chrono::milliseconds timeout = std::chrono::seconds{30});
    void signal(int number);
    int wait();  // its exit code, or minus the signal that ended it
    bool running();
    int pid() const { return pid_; }

private:
    int pid_ = -1;
    int out_ = -1;
    std::string buffer_;
    int status_ = 0;
};

}  // namespace gantry::testkit
