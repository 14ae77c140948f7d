#include <fmt/format.h>
#include <sys/socket.h>
#include <unistd.h>

#include <boost/asio/ip/basic_resolver.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <cerrno>
#include <vector>

#include "link/asio_impl.hpp"
#include "link/loop_impl.hpp"
#include "link/socket.hpp"

namespace gantry::link {

namespace {

using Resolver = asio::ip::basic_resolver<asio::ip::tcp, Executor>;

class Attempt final : public Part, public std::enable_shared_from_this<Attempt> {
public:
    Attempt(Loop::Impl& loop, Endpoint endpoint, std::chrono::milliseconds timeout,
            std::function<void(Result<Socket>)> done)
        : Part(loop), endpoint_(std::move(endpoint)), timeout_(timeout), done_(std::move(done)) {}
    ~Attempt() override { drop(); }

    void begin() {
        if (loop_ == nullptr) return;
        end_ = read_clocks().steady + timeout_;
        timer_.emplace(io().get_executor());
        if (endpoint_.host.empty()) endpoint_.host = "localhost";
        addresses_ = numeric_addresses(endpoint_);
        if (addresses_.empty()) return resolve();
        asio::post(io(), [weak = weak_from_this()] {
            if (auto self = weak.lock(); self && self->done_) self->try_next();
        });
    }

    void drop() override {
        descriptor_.reset();
        resolver_.reset();
        timer_.reset();
        auto done = std::exchange(done_, nullptr);  // may own us
    }

private:
    void resolve() {
        resolver_.emplace(io().get_executor());
        resolver_->async_resolve(
            endpoint_.host, std::to_string(endpoint_.port),
            [weak = weak_from_this()](const ErrorCode& error, const Resolver::results_type& results) {
                auto self = weak.lock();
                if (!self || !self->done_) return;
                if (error) {
                    return self->finish(fail(
                        fmt::format("cannot find the host \"{}\": {}", self->endpoint_.host, error.message()),
                        "check the name, or write the address"));
                }
                for (auto& each : results) {
                    auto found = each.endpoint();
                    self->addresses_.push_back(
                        address_of(found.data(), static_cast<socklen_t>(found.size())));
                }
                self->try_next();
            });
        set_timer(end_, [this] {
            finish(fail(fmt::format("cannot find the host \"{}\": the name service did not answer within {}",
                                    endpoint_.host, gantry::to_text(timeout_)),
                        "check the name service, or write the address"));
        });
    }

    void try_next() {
        for (;;) {
            if (next_ == addresses_.size()) return finish(failure());
            auto& address = addresses_[next_++];
            descriptor_.reset();
            int fd = ::socket(address.storage.ss_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
            if (fd < 0) {
                last_error_ = errno;
                continue;
            }
            bool under_way = ::connect(fd, address.get(), address.size) == 0 || errno == EINPROGRESS;
            int error = errno;
            if (!under_way) {
                ::close(fd);
                last_error_ = error;
                continue;
            }
            ErrorCode failed;
            descriptor_.emplace(io().get_executor());
            descriptor_->assign(fd, failed);
            if (failed) {
                ::close(fd);
                last_error_ = failed.value();
                continue;
            }
            descriptor_->async_wait(Descriptor::wait_write,
                                    [weak = weak_from_this(), which = next_](const ErrorCode& cancelled) {
                                        auto self = weak.lock();
                                        if (!cancelled && self && self->done_ && self->next_ == which)
                                            self->answered();
                                    });
            // An address that does not answer leaves time for those behind it.
            auto now = read_clocks().steady;
            auto left = addresses_.size() - next_ + 1;
            return set_timer(now + (end_ - now) / left, [this] {
                last_error_ = ETIMEDOUT;
                try_next();
            });
        }
    }

    void answered() {
        int error = 0;
        socklen_t size = sizeof error;
        int fd = descriptor_->native_handle();
        ::getsockopt(fd, SOL_SOCKET, SO_ERROR, &error, &size);
        auto peer = peer_address(fd);
        // Dialling a free local port can end at itself (simultaneous open): nobody listens there.
        if (error == 0 && peer == local_address(fd)) error = ECONNREFUSED;
        if (error != 0) {
            last_error_ = error;
            return try_next();
        }
        fd = descriptor_->release();
        tune(fd);
        finish(make_socket(fd, peer));
    }

    Result<Socket> failure() const {
        auto what = fmt::format("cannot connect to {}: ", to_text(endpoint_));
        switch (last_error_) {
            case ECONNREFUSED:
                return fail(what + "connection refused",
                            "nothing listens there: check the port, and that the other side is on");
            case ETIMEDOUT:
                return fail(what + fmt::format("no answer within {}", gantry::to_text(timeout_)),
                            "check the address, the cable, and that no firewall is between");
            default:
                return fail(what + describe_errno(last_error_), "check the address and the network");
        }
    }

    void finish(Result<Socket> result) {
        auto done = std::exchange(done_, nullptr);
        drop();
        if (done) done(std::move(result));
    }

    void set_timer(Steady when, std::function<void()> then) {
        timer_->expires_at(when);
        timer_->async_wait(
            [weak = weak_from_this(), then = std::move(then), which = next_](const ErrorCode& cancelled) {
                auto self = weak.lock();
                if (!cancelled && self && self->done_ && self->next_ == which) then();
            });
    }

    Endpoint endpoint_;
    std::chrono::milliseconds timeout_;
    std::function<void(Result<Socket>)> done_;  // null: over
    Steady end_{};
    std::vector<SocketAddress> addresses_;
    std::size_t next_ = 0;
    int last_error_ = 0;
    std::optional<Resolver> resolver_;
    std::optional<Descriptor> descriptor_;
    std::optional<Clock> timer_;
};

class TcpDial final : public Dial {
public:
    explicit TcpDial(std::shared_ptr<Attempt> attempt) : attempt_(std::move(attempt)) {}
    ~TcpDial() override { attempt_->drop(); }

private:
    std::shared_ptr<Attempt> attempt_;
};

}  // namespace

std::unique_ptr<Dial> Dial::start(Loop& loop, const Endpoint& endpoint, std::chrono::milliseconds timeout,
                                  std::function<void(Result<Socket>)> done) {
    auto attempt = std::make_shared<Attempt>(loop.impl(), endpoint, timeout, std::move(done));
    attempt->begin();
    return std::make_unique<TcpDial>(std::move(attempt));
}

}  // namespace gantry::link
