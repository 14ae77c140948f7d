#include "cli/signals.hpp"

#include <poll.h>
#include <sys/signalfd.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <csignal>
#include <string>

namespace gantry::cli {

namespace {
constexpr std::size_t max_line = 4096;  // what is longer is no command

// False: stdin has ended.
bool read_stdin(const std::function<bool(std::string_view)>& typed, bool& end) {
    std::array<char, 1024> buffer;
    auto size = ::read(STDIN_FILENO, buffer.data(), buffer.size());
    if (size <= 0) return false;
    end = typed({buffer.data(), static_cast<std::size_t>(size)});
    return true;
}
}  // namespace

Signals::Signals() {
    sigset_t set;
    sigemptyset(&set);
    sigaddset(&set, SIGINT);
    sigaddset(&set, SIGTERM);
    sigaddset(&set, SIGHUP);
    pthread_sigmask(SIG_BLOCK, &set, nullptr);
    fd_ = signalfd(-1, &set, SFD_CLOEXEC | SFD_NONBLOCK);
}

Signals::~Signals() {
    ::close(fd_);
}

bool Signals::wait(std::optional<std::chrono::milliseconds> timeout,
                   const std::function<bool(std::string_view)>& typed) {
    using Clock = std::chrono::steady_clock;
    auto end = Clock::now() + timeout.value_or(std::chrono::milliseconds{0});
    for (;;) {
        int left = -1;
        if (timeout) {
            auto until = std::chrono::ceil<std::chrono::milliseconds>(end - Clock::now());
            if (until.count() <= 0 && timeout->count() > 0) return false;
            left = static_cast<int>(std::clamp<std::int64_t>(until.count(), 0, 3'600'000));
        }
        std::array<pollfd, 2> waiting{pollfd{fd_, POLLIN, 0}, pollfd{STDIN_FILENO, POLLIN, 0}};
        int ready = ::poll(waiting.data(), typed && stdin_open_ ? 2 : 1, left);
        if (ready < 0) continue;
        if (waiting[0].revents != 0) {
            signalfd_siginfo info{};
            if (::read(fd_, &info, sizeof info) == sizeof info) return true;
        }
        bool told = false;
        if (typed && stdin_open_ && waiting[1].revents != 0) stdin_open_ = read_stdin(typed, told);
        if (told) return true;
        if (timeout && timeout->count() == 0) return false;
    }
}

void Lines::add(std::string_view piece, const std::function<void(std::string_view)>& line) {
    for (char c : piece) {
        if (c != '\n') {
            if (text_.size() < max_line) text_ += c;
            continue;
        }
        if (!text_.empty()) line(text_);
        text_.clear();
    }
}

}  // namespace gantry::cli
