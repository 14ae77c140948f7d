#include "testkit/process.hpp"

#include <fcntl.h>
#include <poll.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>

#include <gtest/gtest.h>

extern char** environ;

namespace gantry::testkit {

Process::Process(const std::vector<std::string>& arguments, const std::vector<std::string>& environment,
                 const std::string& log) {
    int pipe_ends[2];
    if (pipe2(pipe_ends, O_CLOEXEC) != 0) {
        ADD_FAILURE() << "no pipe";
        return;
    }
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addopen(&actions, 0, "/dev/null", O_RDONLY, 0);
    posix_spawn_file_actions_adddup2(&actions, pipe_ends[1], 1);
    posix_spawn_file_actions_addopen(&actions, 2, log.c_str(), O_WRONLY | O_CREAT | O_APPEND, 0600);
    std::vector<char*> argv, env;
    for (auto& each : arguments)
        argv.push_back(const_cast<char*>(each.c_str()));
    argv.push_back(nullptr);
    for (char** each = environ; *each != nullptr; ++each)
        env.push_back(*each);
    for (auto& each : environment)
        env.push_back(const_cast<char*>(each.c_str()));
    env.push_back(nullptr);
    if (posix_spawn(&pid_, argv[0], &actions, nullptr, argv.data(), env.data()) != 0) {
        ADD_FAILURE() << "cannot start " << arguments.front();
        pid_ = -1;
    }
    posix_spawn_file_actions_destroy(&actions);
    ::close(pipe_ends[1]);
    out_ = pipe_ends[0];
}

Process::~Process() {
    signal(SIGKILL);
    wait();
    if (out_ >= 0) ::close(out_);
}

std::string Process::wait_for_line(const std::string& beginning, std::chrono::milliseconds timeout) {
    auto end = std::chrono::steady_clock::now() + timeout;
    for (;;) {
        for (auto newline = buffer_.find('\n'); newline != std::string::npos; newline = buffer_.find('\n')) {
            auto line = buffer_.substr(0, newline);
            buffer_.erase(0, newline + 1);
            if (line.starts_with(beginning)) return line;
        }
        auto left =
            std::chrono::duration_cast<std::chrono::milliseconds>(end - std::chrono::steady_clock::now());
        pollfd waiting{out_, POLLIN, 0};
        if (left.count() <= 0 || poll(&waiting, 1, static_cast<int>(left.count())) <= 0) return {};
        char chunk[4096];
        auto size = ::read(out_, chunk, sizeof chunk);
        if (size <= 0) return {};
        buffer_.append(chunk, static_cast<std::size_t>(size));
    }
}

void Process::signal(int number) {
    if (pid_ > 0) ::kill(pid_, number);
}

int Process::wait() {
    if (pid_ > 0) {
        int status = 0;
        while (waitpid(pid_, &status, 0) < 0 && errno == EINTR) {
        }
        status_ = WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
        pid_ = -1;
    }
    return status_;
}

bool Process::running() {
    if (pid_ <= 0) return false;
    siginfo_t info{};
    return waitid(P_PID, static_cast<id_t>(pid_), &info, WEXITED | WNOHANG | WNOWAIT) == 0 &&
           info.si_pid == 0;
}

}  // namespace gantry::testkit
