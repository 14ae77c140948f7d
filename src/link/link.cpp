#include "link/link.hpp"

#include <fmt/format.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <boost/asio/post.hpp>
#include <cerrno>

#include "link/asio_impl.hpp"
#include "link/loop_impl.hpp"
#include "link/serial.hpp"
#include "link/socket.hpp"

namespace gantry::link {

namespace {

constexpr std::size_t max_unsent = 1024 * 1024;
constexpr int max_reads = 4;          // full buffers a turn; then the other links have theirs
constexpr auto finish_time = 2s;      // for the last output of a party that has finished
constexpr auto shortest_timer = 1ms;  // a deadline that does not move must not spin the loop
constexpr auto line_pause = 5ms;      // between looks whether a serial line has sent all

bool is_line(int fd) {
    struct stat file {};
    return ::fstat(fd, &file) == 0 && S_ISCHR(file.st_mode);
}

// Waits for readiness and then moves bytes without blocking: a wait that is cancelled loses nothing. The
// waits hold weak pointers, so letting go of the link ends it.
class StreamLink final : public Link, public Part, public std::enable_shared_from_this<StreamLink> {
public:
    StreamLink(Loop::Impl& loop, Socket socket, Party& party, Callbacks callbacks)
        : Part(loop), party_(&party), callbacks_(std::move(callbacks)), socket_(std::move(socket)) {}

    void begin() {
        auto now = read_clocks();
        last_input_ = now;
        party_->start(now);
        if (loop_ == nullptr) return drop();
        ErrorCode error;
        descriptor_.emplace(io().get_executor());
        int fd = socket_.release();
        line_ = is_line(fd);
        descriptor_->assign(fd, error);
        if (error) {
            ::close(fd);
            reason_ = fmt::format("the socket cannot be watched: {}", describe_errno(error.value()));
        }
        timer_.emplace(io().get_executor());
        asio::post(io(), [weak = weak_from_this()] {
            if (auto self = weak.lock(); self && self->party_ != nullptr) turn(std::move(self), false);
        });
    }

    void wake() override {
        if (party_ != nullptr && !in_turn_) turn(shared_from_this(), false);
    }

    void close(std::string_view reason) override {
        if (party_ == nullptr) return;
        if (reason_.empty()) reason_ = reason.empty() ? "closed" : reason;
        if (!in_turn_) end(shared_from_this());
    }

    void finish(std::string_view reason) override {
        if (party_ == nullptr) return;
        no_more_input(std::string(reason));
        wake();
    }

    const std::string& peer() const override { return socket_.peer(); }
    const std::string& peer_host() const override { return socket_.peer_host(); }
    Steady last_input() const override { return last_input_.steady; }
    Now last_heard() const override { return last_input_; }

    void drop() override {
        release();
        auto callbacks = std::move(callbacks_);  // may own the party, and this link
        callbacks_ = {};
    }

private:
    bool ending() const { return !reason_.empty() || finishing_; }

    // Input, time, drain, output, and then the waits for the next turn.
    static void turn(std::shared_ptr<StreamLink> self, bool input, bool time = false) {
        self->in_turn_ = true;
        auto now = read_clocks();
        if (input) self->take_input(now);
        if (self->party_ == nullptr) return;
        if (auto due = self->party_->deadline(); due && *due <= now.steady && !self->ending()) {
            self->party_->time_passed(now);
            if (time) self->not_before_ = now.steady + shortest_timer;
        }
        if (!self->after_turn()) return;
        self->send_output();
        self->look_for_end(now.steady);
        self->in_turn_ = false;
        if (!self->reason_.empty()) return end(std::move(self));
        self->arm();
    }

    // False: the owner let go of the link meanwhile, the party may be gone.
    bool after_turn() {
        if (callbacks_.after_turn) callbacks_.after_turn();
        if (weak_from_this().use_count() > 1) return true;
        release();
        return false;
    }

    // Into the loop's buffer. A line's descriptor does not block by itself.
    ssize_t read_some() {
        auto& buffer = loop_->buffer;
        int fd = descriptor_->native_handle();
        return line_ ? ::read(fd, buffer.data(), buffer.size())
                     : ::recv(fd, buffer.data(), buffer.size(), MSG_DONTWAIT);
    }

    void take_input(const Now& now) {
        for (int round = 0; round < max_reads; ++round) {
            if (ending() || party_->finished() || !party_->wants_input()) return;
            auto& buffer = loop_->buffer;
            auto size = read_some();
            if (size < 0 && errno == EINTR) continue;
            if (size < 0) {
                if (errno != EAGAIN) give_up(errno);
                return;
            }
            if (size == 0 && line_) return give_up(EIO);
            if (size == 0) return no_more_input(fmt::format("closed by {}", callbacks_.peer_is));
            last_input_ = now;
            party_->received(ByteView(buffer.data(), static_cast<std::size_t>(size)), now);
            if (static_cast<std::size_t>(size) < buffer.size()) return;  // that was all there is
            if (!after_turn()) return;
            send_output();
        }
    }

    void send_output() {
        while (reason_.empty() && !party_->output().empty() && !write_waits_) {
            auto output = party_->output();
            int fd = descriptor_->native_handle();
            auto size = line_ ? ::write(fd, output.data(), output.size())
                              : ::send(fd, output.data(), output.size(), MSG_DONTWAIT | MSG_NOSIGNAL);
            if (size >= 0) {
                party_->output_sent(static_cast<std::size_t>(size));
                if (static_cast<std::size_t>(size) < output.size()) break;
            } else if (errno == EAGAIN) {
                break;
            } else if (errno != EINTR) {
                give_up(errno);
            }
        }
        if (reason_.empty() && party_->output().size() > max_unsent) {
            reason_ = fmt::format("{} does not read what is sent to it: more than {} MiB are waiting",
                                  callbacks_.peer_is, max_unsent >> 20);
        }
    }

    // No more input; what is left of the output may still go out.
    void no_more_input(std::string why) {
        if (finishing_) return;
        finishing_ = true;
        finish_by_ = read_clocks().steady + finish_time;
        finish_reason_ = std::move(why);
    }

    void look_for_end(Steady now) {
        if (!reason_.empty()) return;
        if (party_->finished()) no_more_input("finished");
        if (!finishing_) return;
        if (party_->output().empty()) {
            if (line_ && now < finish_by_ && still_sending(descriptor_->native_handle())) {
                look_again_ = now + line_pause;
                return;
            }
            // Unread input would turn the close into a reset, and that can overtake our last bytes.
            for (int round = 0; round < max_reads; ++round) {
                if (read_some() <= 0) break;
            }
            reason_ = finish_reason_;
        } else if (now >= finish_by_) {
            reason_ = fmt::format("{}; {} bytes could not be sent", finish_reason_, party_->output().size());
        }
    }

    void give_up(int error) {
        if (!reason_.empty()) return;
        switch (error) {
            case ECONNRESET:
                reason_ = fmt::format("connection reset by {}", callbacks_.peer_is);
                break;
            case EPIPE:
                reason_ = fmt::format("closed by {}", callbacks_.peer_is);
                break;
            case ETIMEDOUT:
                reason_ = fmt::format("no answer from {} for 30 s", callbacks_.peer_is);
                break;
            case EIO:
            case ENXIO:
            case ENODEV:
                reason_ = line_ ? "the serial line is gone: the adapter was pulled out, or the other program "
                                  "ended"
                                : "the connection failed: " + describe_errno(error);
                break;
            default:
                reason_ = fmt::format("the connection failed: {}", describe_errno(error));
        }
    }

    // `self` by value: the callbacks may hold the last other pointer to this link.
    static void end(std::shared_ptr<StreamLink> self) {
        self->release();
        auto callbacks = std::exchange(self->callbacks_, {});
        if (callbacks.closed) callbacks.closed(self->reason_);
    }

    void release() {
        party_ = nullptr;
        in_turn_ = false;
        if (descriptor_ && line_) leave_line(descriptor_->native_handle());
        descriptor_.reset();  // closes
        timer_.reset();
    }

    void arm() {
        bool reading = !finishing_ && party_->wants_input();
        if (reading) {
            paused_and_seen_ = false;
            wait(Descriptor::wait_read, read_waits_);
        } else if (!paused_and_seen_) {
            wait(Descriptor::wait_error, error_waits_);
        }
        if (!party_->output().empty()) wait(Descriptor::wait_write, write_waits_);
        arm_timer();
    }

    void wait(Descriptor::wait_type what, bool& waits) {
        if (waits) return;
        waits = true;
        descriptor_->async_wait(what, [weak = weak_from_this(), what](const ErrorCode& error) {
            auto self = weak.lock();
            if (error || !self || self->party_ == nullptr) return;
            if (what == Descriptor::wait_error) return failed(std::move(self));
            (what == Descriptor::wait_read ? self->read_waits_ : self->write_waits_) = false;
            turn(std::move(self), what == Descriptor::wait_read);
        });
    }

    // While nothing is read, only a reset shows. Urgent data wakes us too; it is looked at once a pause, as
    // it stays there.
    static void failed(std::shared_ptr<StreamLink> self) {
        self->error_waits_ = false;
        self->paused_and_seen_ = true;
        bool reads = !self->finishing_ && self->party_->wants_input();
        if (!reads) {
            if (int error = self->pending_error(); error != 0) self->give_up(error);
        }
        turn(std::move(self), reads);
    }

    int pending_error() {
        int error = 0, fd = descriptor_->native_handle();
        if (line_) {
            pollfd state{fd, 0, 0};
            return ::poll(&state, 1, 0) > 0 && (state.revents & (POLLHUP | POLLERR)) != 0 ? EIO : 0;
        }
        socklen_t size = sizeof error;
        ::getsockopt(fd, SOL_SOCKET, SO_ERROR, &error, &size);
        return error;
    }

    // What is next to come by itself, the party's deadline or our own.
    std::optional<Steady> next_due() const {
        if (!finishing_) return party_->deadline();
        return look_again_ ? std::min(*look_again_, finish_by_) : finish_by_;
    }

    // Armed lazily: a deadline that moved on is looked at when the old one fires.
    void arm_timer() {
        auto deadline = next_due();
        if (!deadline) return;
        auto when = std::max(*deadline, not_before_);
        if (timer_waits_ && timer_at_ <= when) return;
        timer_waits_ = true;
        timer_at_ = when;
        timer_->expires_at(when);
        timer_->async_wait([weak = weak_from_this()](const ErrorCode& error) {
            auto self = weak.lock();
            if (error || !self || self->party_ == nullptr) return;
            self->timer_waits_ = false;
            auto due = self->next_due();
            if (!due || *due > read_clocks().steady) return self->arm_timer();
            // Input first: after a pause of the whole process the answer may be lying there.
            turn(std::move(self), true, true);
        });
    }

    Party* party_;  // null: closed, inert
    Callbacks callbacks_;
    Socket socket_;  // only its names, once the descriptor has taken it over
    std::optional<Descriptor> descriptor_;
    std::optional<Clock> timer_;
    Now last_input_{};
    Steady timer_at_{}, not_before_{}, finish_by_{};
    std::string reason_, finish_reason_;
    bool in_turn_ = false, finishing_ = false;
    bool read_waits_ = false, write_waits_ = false, error_waits_ = false, timer_waits_ = false;
    bool paused_and_seen_ = false;
    bool line_ = false;                 // a serial line, not a socket
    std::optional<Steady> look_again_;  // whether the line has sent all
};

}  // namespace

std::shared_ptr<Link> Link::start(Loop& loop, Socket socket, Party& party, Callbacks callbacks) {
    auto link = std::make_shared<StreamLink>(loop.impl(), std::move(socket), party, std::move(callbacks));
    link->begin();
    return link;
}

}  // namespace gantry::link
