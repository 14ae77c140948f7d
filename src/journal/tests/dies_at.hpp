#pragma once
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <functional>

namespace gantry::journal::tests {

// Runs `work` in a process of its own; true when it was killed, as it is at the failpoint.
inline bool dies_at(const char* failpoint, const std::function<void()>& work) {
    auto child = fork();
    if (child == 0) {
        setenv("GANTRY_FAILPOINT", failpoint, 1);
        work();
        _exit(0);
    }
    int status = 0;
    waitpid(child, &status, 0);
    return WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL;
}

}  // namespace gantry::journal::tests
