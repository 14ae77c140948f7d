#pragma once
#include <fcntl.h>
#include <grp.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cstdlib>
#include <string>
#include <utility>

#include "link/serial.hpp"
#include "net.hpp"

// Terminals as the tests of this module want them.
namespace gantry::link {

// A program that has a terminal open, plain: it waits a minute at most for bytes to come or to go.
class Program {
public:
    explicit Program(int fd) : fd_(fd) {}
    explicit Program(const std::string& path)
        : fd_(::open(path.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC)) {
        EXPECT_GE(fd_, 0) << path;
    }
    Program(Program&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
    Program& operator=(Program&& other) noexcept {
        std::swap(fd_, other.fd_);
        return *this;
    }
    ~Program() { close(); }
    void close() {
        if (fd_ >= 0) ::close(std::exchange(fd_, -1));
    }
    int fd() const { return fd_; }

    bool send(std::string_view text) const {
        while (!text.empty()) {
            if (!ready(POLLOUT)) return false;
            auto size = ::write(fd_, text.data(), text.size());
            if (size < 0 && errno != EAGAIN) return false;
            text.remove_prefix(static_cast<std::size_t>(std::max<ssize_t>(size, 0)));
        }
        return true;
    }
    // Up to `size` bytes; fewer only at the end or when nothing comes any more.
    std::string receive(std::size_t size) const {
        std::string text;
        std::array<char, 4096> buffer;
        while (text.size() < size && ready(POLLIN)) {
            auto got = ::read(fd_, buffer.data(), std::min(buffer.size(), size - text.size()));
            if (got < 0 && errno == EAGAIN) continue;
            if (got <= 0) break;
            text.append(buffer.data(), static_cast<std::size_t>(got));
        }
        return text;
    }
    std::string until(std::string_view mark) const {
        std::string text;
        while (!text.ends_with(mark)) {
            auto byte = receive(1);
            if (byte.empty()) break;
            text += byte;
        }
        return text;
    }

private:
    bool ready(short what) const {
        pollfd state{fd_, what, 0};
        return ::poll(&state, 1, 60'000) > 0;
    }
    int fd_;
};

// A terminal whose master the test holds: what is at the other end of a serial cable.
struct Cable {
    Program master{::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC)};
    SerialSettings line;

    Cable() {
        EXPECT_EQ(::grantpt(master.fd()), 0);
        EXPECT_EQ(::unlockpt(master.fd()), 0);
        std::array<char, 128> name{};
        EXPECT_EQ(::ptsname_r(master.fd(), name.data(), name.size()), 0);
        line.path = name.data();
    }
};

inline bool is_exclusive(int fd) {
    int on = 0;
    EXPECT_EQ(::ioctl(fd, TIOCGEXCL, &on), 0);
    return on != 0;
}

// Runs `work` in a process of its own, as the user nobody if that is asked for, and returns what it says.
template <class Work>
std::string in_child(bool as_nobody, Work work) {
    int ends[2];
    EXPECT_EQ(::pipe(ends), 0);
    auto child = ::fork();
    if (child == 0) {
        constexpr uid_t nobody = 65534;
        std::string text;
        if (as_nobody && (::setgroups(0, nullptr) != 0 || ::setgid(nobody) != 0 || ::setuid(nobody) != 0)) {
            text = "cannot become nobody";
        } else {
            text = work();
        }
        auto written = ::write(ends[1], text.data(), text.size());
        ::_exit(written < 0 ? 1 : 0);  // nothing of ours is taken down
    }
    ::close(ends[1]);
    Program reader(ends[0]);
    auto text = reader.receive(4096);
    int status = 0;
    EXPECT_EQ(::waitpid(child, &status, 0), child);
    return text;
}

}  // namespace gantry::link
