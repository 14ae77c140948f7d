#include "link/pty.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/inotify.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <boost/asio/post.hpp>
#include <cerrno>
#include <cstdlib>
#include <vector>

#include "base/log.hpp"
#include "base/text.hpp"
#include "link/asio_impl.hpp"
#include "link/loop_impl.hpp"
#include "link/serial.hpp"
#include "link/socket.hpp"

namespace gantry::link {

namespace {

constexpr std::size_t most_held =
    256;  // bytes taken from one side at a time: the rest waits where it is seen
constexpr std::size_t most_rest = 65'536;  // of ends that were closed
constexpr int small_buffer = 4096;         // of the way to the device, for the same reason
constexpr auto most_late = 50ms;           // what a late timer may make good
constexpr std::uint32_t slowest = 50, fastest = 4'000'000;

// One direction. Bytes are delivered in slices that take a millisecond or one byte's time.
struct Way {
    bool outward;  // from the device to the program
    Bytes held = {};
    std::size_t gone = 0, slice = 0;                     // of what is held: delivered, and under way
    Steady arrives{};                                    // when the slice has passed the line
    bool rested = true;                                  // the line stood still: the next slice begins now
    bool reads = false, writes = false, sleeps = false;  // waits that are armed
    std::optional<Clock> clock = {};
};

tl::unexpected<Error> cannot(std::string_view what, int error, std::string_view hint = {}) {
    return fail(fmt::format("cannot open a pseudo-terminal: {}: {}", what, describe_errno(error)),
                std::string(hint));
}

// Where a symbolic link leads; empty: it is none.
std::string target_of(const std::string& link) {
    std::array<char, 4096> target{};
    auto size = ::readlink(link.c_str(), target.data(), target.size());
    return size > 0 ? std::string(target.data(), static_cast<std::size_t>(size)) : std::string{};
}

Result<void> make_link(const std::string& link, const std::string& target) {
    auto shown = printable(link);
    // Fails on everything but a symbolic link.
    if (auto old = target_of(link); !old.empty()) {
        // A terminal is there as long as somebody has its other side. One that was killed may have left a
        // link to the number that is ours now.
        struct stat file {};
        if (old.starts_with("/dev/pts/") && old != target && ::stat(old.c_str(), &file) == 0)
            return fail(fmt::format("cannot make the link {}: it leads to {}, which is in use", shown, old),
                        "end the program that made it, choose another name, or remove it if it is left over");
        ::unlink(link.c_str());
    }
    if (::symlink(target.c_str(), link.c_str()) == 0) return {};
    switch (errno) {
        case EEXIST:
            return fail(fmt::format("cannot make the link {}: something else is there", shown),
                        "only a symbolic link is replaced: move it away, or choose another name");
        case ENOENT:
        case ENOTDIR:
            return fail(fmt::format("cannot make the link {}: its folder does not exist", shown));
        default:
            return fail(fmt::format("cannot make the link {}: {}", shown, describe_errno(errno)),
                        "choose a place where you may write, like /tmp/reader");
    }
}

// Between the terminal and the socket that the device's Link pumps.
class Line final : public Part, public std::enable_shared_from_this<Line> {
public:
    Line(Loop::Impl& loop, std::string link, std::uint32_t baud, std::function<void()> used)
        : Part(loop), link_(std::move(link)), baud_(baud), used_(std::move(used)) {}
    ~Line() override { drop(); }

    Result<void> begin() {
        if (loop_ == nullptr) return fail("cannot open a pseudo-terminal: the program is stopping");
        int master = ::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
        if (master < 0) return cannot("posix_openpt", errno, "is /dev/pts mounted?");
        if (auto error = watch(master_, master)) return cannot("the terminal cannot be watched", error);
        if (::grantpt(master) != 0 || ::unlockpt(master) != 0) return cannot("grantpt", errno);
        std::array<char, 128> name{};
        if (int error = ::ptsname_r(master, name.data(), name.size()); error != 0)
            return cannot("ptsname", error);
        terminal_ = name.data();
        // Kept open: without any program at the other side the master would be at its end.
        slave_ = ::open(name.data(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
        if (slave_ < 0) return cannot(terminal_, errno);
        SerialSettings settings;
        settings.baud = baud_;
        if (int error = set_mode(slave_, settings); error != 0) return cannot(terminal_, error);
        watch_programs();
        for (auto* way : {&inward_, &outward_})
            way->clock.emplace(io().get_executor());
        if (auto made = make_link(link_, terminal_); !made) return made;
        linked_ = true;
        return {};
    }

    Result<Socket> connect() {
        if (loop_ == nullptr) return fail("the program is stopping");
        int ends[2];
        if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0, ends) != 0)
            return fail(fmt::format("cannot connect to {}: {}", printable(link_), describe_errno(errno)));
        Socket device(ends[1], link_, link_);
        for (int end : ends)
            ::setsockopt(end, SOL_SOCKET, SO_SNDBUF, &small_buffer, sizeof small_buffer);
        take_rest();
        if (auto error = watch(device_, ends[0]))
            return fail(fmt::format("cannot connect to {}: {}", printable(link_), describe_errno(error)));
        inward_.writes = outward_.reads = false;  // those were of the old end
        go(inward_);
        go(outward_);
        return device;
    }

    bool opened() {
        count_programs();
        return !programs_fd_ || programs_ > 0;
    }

    void drop() override {
        used_ = nullptr;
        device_.reset();
        master_.reset();
        programs_fd_.reset();
        inward_.clock.reset();
        outward_.clock.reset();
        if (slave_ >= 0) ::close(std::exchange(slave_, -1));
        if (!std::exchange(linked_, false)) return;
        // Another one may have taken the name.
        if (target_of(link_) == terminal_) ::unlink(link_.c_str());
    }

private:
    // 0, or errno; then the descriptor is closed.
    int watch(std::optional<Descriptor>& where, int fd) {
        ErrorCode error;
        where.emplace(io().get_executor());
        where->assign(fd, error);
        if (!error) return 0;
        where.reset();
        ::close(fd);
        return error.value();
    }

    // The terminal itself does not tell that its last program has closed it, as we have it open too. Without
    // this watch it counts as open all the time.
    void watch_programs() {
        int fd = ::inotify_init1(IN_NONBLOCK | IN_CLOEXEC);
        if (fd < 0) return;
        if (::inotify_add_watch(fd, terminal_.c_str(), IN_OPEN | IN_CLOSE) < 0) {
            ::close(fd);
            return;
        }
        if (watch(programs_fd_, fd) == 0) wait_for_programs();
    }

    void wait_for_programs() {
        programs_fd_->async_wait(Descriptor::wait_read, [weak = weak_from_this()](const ErrorCode& error) {
            auto self = weak.lock();
            if (error || !self || !self->programs_fd_) return;
            self->count_programs();
            // What waits for one that has gone is lost.
            if (self->programs_ == 0 && self->outward_.writes) self->go(self->outward_);
            self->wait_for_programs();
        });
    }

    void count_programs() {
        if (!programs_fd_) return;
        alignas(inotify_event) std::array<char, 4096> events;
        bool closed = false, any = false;
        for (;;) {
            auto size = ::read(programs_fd_->native_handle(), events.data(), events.size());
            if (size <= 0) break;
            for (std::size_t at = 0; at < static_cast<std::size_t>(size);) {
                const auto& event = *reinterpret_cast<const inotify_event*>(events.data() + at);
                at += sizeof event + event.len;
                any = true;
                if ((event.mask & IN_OPEN) != 0) ++programs_;
                if ((event.mask & IN_CLOSE) != 0) {
                    programs_ = std::max(programs_ - 1, 0);
                    closed = true;
                }
            }
        }
        if (any) tell_used();
        if (!closed || programs_ > 0) return;
        // The next program finds a fresh line. A program that was killed could not let go of it, and as we
        // keep the terminal open the kernel does not do it either.
        end_exclusive(slave_);
        flush_input(slave_);
    }

    // Not at once: whoever hears it may end this, and the count is taken in the middle of other things.
    void tell_used() {
        if (!used_) return;
        asio::post(io(), [weak = weak_from_this()] {
            auto self = weak.lock();
            if (!self || !self->used_) return;
            auto used = self->used_;  // ending this forgets it
            used();
        });
    }

    std::chrono::nanoseconds time_of(std::size_t bytes) const {
        return std::chrono::nanoseconds(bytes * 10'000'000'000ULL / baud_);
    }

    // Moves what may be moved, and arms the wait for what comes next.
    void go(Way& way) {
        while (master_) {
            if (way.slice == 0) {
                if (way.gone == way.held.size() && !fill(way)) return;
                auto now = read_clocks().steady;
                auto begins = std::exchange(way.rested, false) ? now : std::max(way.arrives, now - most_late);
                way.slice = std::min<std::size_t>(way.held.size() - way.gone, (baud_ + 9'999) / 10'000);
                way.arrives = begins + time_of(way.slice);
            }
            if (way.arrives > read_clocks().steady) return sleep(way);
            if (!deliver(way)) return;
        }
    }

    bool fill(Way& way) {
        if (!device_) {  // until the next one comes: the program's bytes wait in the terminal
            way.rested = true;
            return false;
        }
        auto& from = way.outward ? device_ : master_;
        way.held.resize(most_held);
        way.gone = 0;
        auto size = ::read(from->native_handle(), way.held.data(), way.held.size());
        int error = errno;
        way.held.resize(size > 0 ? static_cast<std::size_t>(size) : 0);
        if (size > 0) return true;
        way.rested = true;
        if (size < 0 && (error == EAGAIN || error == EINTR)) {
            wait(*from, Descriptor::wait_read, way, way.reads);
        } else if (way.outward) {
            device_.reset();
        } else {
            log::error("link", "the pseudo-terminal of {} is gone: {}", printable(link_),
                       describe_errno(size < 0 ? error : EIO));
        }
        return false;
    }

    // False: it must wait, or waits for a new end already.
    bool deliver(Way& way) {
        const auto* bytes = way.held.data() + way.gone;
        ssize_t size = 0;
        if (way.outward) {
            size = opened() ? ::write(master_->native_handle(), bytes, way.slice) : 0;
        } else if (device_) {
            size = ::send(device_->native_handle(), bytes, way.slice, MSG_DONTWAIT | MSG_NOSIGNAL);
        }
        if (size < 0 && errno == EAGAIN) {
            way.rested = true;  // no catching up on the time that the other side did not read
            wait(way.outward ? *master_ : *device_, Descriptor::wait_write, way, way.writes);
            return false;
        }
        // Nobody at the other side, or he went just now: on a line bytes go out all the same.
        auto moved = size > 0 ? static_cast<std::size_t>(size) : way.slice;
        way.gone += moved;
        way.slice -= moved;
        return true;
    }

    // What the device said before its end was closed, and has not been read yet: a small buffer's worth.
    void take_rest() {
        if (!device_) return;
        std::array<std::uint8_t, 4096> buffer;
        for (;;) {
            auto size = ::read(device_->native_handle(), buffer.data(), buffer.size());
            if (size <= 0 || outward_.held.size() > most_rest) break;
            outward_.held.insert(outward_.held.end(), buffer.begin(), buffer.begin() + size);
        }
        device_.reset();
    }

    void wait(Descriptor& where, Descriptor::wait_type what, Way& way, bool& waits) {
        if (waits) return;
        waits = true;
        where.async_wait(what, [weak = weak_from_this(), &way, &waits](const ErrorCode& error) {
            auto self = weak.lock();
            if (error || !self) return;
            waits = false;
            self->go(way);
        });
    }

    void sleep(Way& way) {
        if (way.sleeps) return;
        way.sleeps = true;
        way.clock->expires_at(way.arrives);
        way.clock->async_wait([weak = weak_from_this(), &way](const ErrorCode& error) {
            auto self = weak.lock();
            if (error || !self) return;
            way.sleeps = false;
            self->go(way);
        });
    }

    std::string link_, terminal_;
    std::uint32_t baud_;
    std::function<void()> used_;
    std::optional<Descriptor> master_, device_, programs_fd_;
    int slave_ = -1;
    int programs_ = 0;  // that have the terminal open
    bool linked_ = false;
    Way inward_{false}, outward_{true};
};

class RealPty final : public Pty {
public:
    explicit RealPty(std::shared_ptr<Line> line) : line_(std::move(line)) {}
    ~RealPty() override { line_->drop(); }
    Result<Socket> connect() override { return line_->connect(); }
    bool opened() override { return line_->opened(); }

private:
    std::shared_ptr<Line> line_;
};

}  // namespace

Result<std::unique_ptr<Pty>> Pty::open(Loop& loop, const std::string& link, std::uint32_t baud,
                                       std::function<void()> used) {
    if (baud < slowest || baud > fastest)
        return fail(fmt::format("{} baud is no speed of a serial line", baud), "9600 to 921600 are usual");
    auto line = std::make_shared<Line>(loop.impl(), link, baud, std::move(used));
    if (auto begun = line->begin(); !begun) return tl::unexpected(begun.error());
    return std::make_unique<RealPty>(std::move(line));
}

}  // namespace gantry::link
