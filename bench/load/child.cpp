#include "bench/load/child.hpp"

#include <fcntl.h>
#include <poll.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <utility>

#include <fmt/format.h>

#include "bench/load/outcome.hpp"

extern char** environ;

namespace gantry::bench {

namespace {
std::pair<int, int> pipe_ends() {
    std::array<int, 2> ends{};
    if (::pipe2(ends.data(), O_CLOEXEC) != 0) throw Failure(fmt::format("no pipe: {}", std::strerror(errno)));
    return {ends[0], ends[1]};
}
}  // namespace

Child::Child(const std::vector<std::string>& arguments, const std::string& log) {
    auto [from, to] = pipe_ends();
    out_ = from;
    posix_spawn_file_actions_t actions;
    ::posix_spawn_file_actions_init(&actions);
    ::posix_spawn_file_actions_adddup2(&actions, to, STDOUT_FILENO);
    ::posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, log.c_str(), O_WRONLY | O_CREAT | O_APPEND,
                                       0600);
    std::vector<char*> argv;
    for (auto& each : arguments)
        argv.push_back(const_cast<char*>(each.c_str()));  // POSIX does not write to them
    argv.push_back(nullptr);
    int error = ::posix_spawn(&pid_, argv[0], &actions, nullptr, argv.data(), environ);
    ::posix_spawn_file_actions_destroy(&actions);
    ::close(to);
    if (error == 0) return;
    ::close(from);
    throw Failure(fmt::format("{} cannot be started: {}", arguments[0], std::strerror(error)));
}

Child::Child(const std::function<void(int)>& work) {
    auto [from, to] = pipe_ends();
    out_ = from;
    std::fflush(nullptr);  // else what waits in a buffer would be written twice
    pid_ = ::fork();
    if (pid_ == 0) {
        ::close(from);
        int code = 0;
        try {
            work(to);
        } catch (const std::exception& error) {
            fmt::print(stderr, "{}\n", error.what());
            code = 1;
        }
        ::_exit(code);
    }
    ::close(to);
    if (pid_ > 0) return;
    ::close(from);
    throw Failure(fmt::format("no second process: {}", std::strerror(errno)));
}

Child::~Child() {
    if (pid_ > 0) {
        ::kill(pid_, SIGKILL);
        wait();
    }
    ::close(out_);
}

std::string Child::line(const std::string& beginning, std::chrono::milliseconds timeout) {
    auto end = std::chrono::steady_clock::now() + timeout;
    for (;;) {
        for (auto at = buffer_.find('\n'); at != std::string::npos; at = buffer_.find('\n')) {
            auto line = buffer_.substr(0, at);
            buffer_.erase(0, at + 1);
            if (line.starts_with(beginning)) return line;
        }
        auto left = std::chrono::ceil<std::chrono::milliseconds>(end - std::chrono::steady_clock::now());
        pollfd ready{out_, POLLIN, 0};
        std::array<char, 4096> bytes{};
        if (left.count() <= 0 || ::poll(&ready, 1, static_cast<int>(left.count())) <= 0)
            throw Failure(fmt::format("no line \"{}\" within {} ms", beginning, timeout.count()));
        auto got = ::read(out_, bytes.data(), bytes.size());
        if (got <= 0) throw Failure(fmt::format("it ended before it said \"{}\"", beginning));
        buffer_.append(bytes.data(), static_cast<std::size_t>(got));
    }
}

int Child::stop() {
    if (pid_ > 0) ::kill(pid_, SIGTERM);
    return wait();
}

int Child::wait() {
    int status = 0;
    if (pid_ <= 0) return 0;
    while (::waitpid(pid_, &status, 0) < 0 && errno == EINTR) {
    }
    pid_ = -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
}

}  // namespace gantry::bench
