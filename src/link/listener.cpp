#include <fmt/format.h>
#include <netdb.h>
#include <sys/socket.h>
#include <unistd.h>

#include <netinet/in.h>
#include <cerrno>
#include <vector>

#include "base/log.hpp"
#include "link/asio_impl.hpp"
#include "link/loop_impl.hpp"
#include "link/socket.hpp"

namespace gantry::link {

namespace {

constexpr int batch = 64;  // connections a turn; then the links have theirs
constexpr auto out_of_files_pause = 1s;

tl::unexpected<Error> refuse(const Endpoint& endpoint, int error) {
    auto text = to_text(endpoint);
    switch (error) {
        case EADDRINUSE:
            return fail(
                fmt::format("cannot listen on {}: the port is in use", text),
                fmt::format("stop the program that has it (`ss -ltnp sport = :{}` names it) or choose "
                            "another port",
                            endpoint.port));
        case EACCES:
            return fail(fmt::format("cannot listen on {}: no permission", text),
                        "ports below 1024 need root or CAP_NET_BIND_SERVICE");
        case EADDRNOTAVAIL:
            return fail(fmt::format("cannot listen on {}: this machine does not have that address", text),
                        fmt::format("`ip address` lists those it has; :{} listens on all", endpoint.port));
        default:
            return fail(fmt::format("cannot listen on {}: {}", text, describe_errno(error)));
    }
}

// A descriptor, or errno below zero.
int listen_on(const SocketAddress& address) {
    int fd = ::socket(address.storage.ss_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    if (fd < 0) return -errno;
    int on = 1, off = 0;
    ::setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    if (address.storage.ss_family == AF_INET6) {  // IPv4 comes in through it too
        ::setsockopt(fd, IPPROTO_IPV6, IPV6_V6ONLY, &off, sizeof off);
    }
    if (::bind(fd, address.get(), address.size) == 0 && ::listen(fd, SOMAXCONN) == 0) return fd;
    int error = errno;
    ::close(fd);
    return -error;
}

Result<std::vector<SocketAddress>> addresses_of(const Endpoint& endpoint) {
    auto addresses = numeric_addresses(endpoint);
    if (!addresses.empty()) return addresses;
    addrinfo hints{};
    hints.ai_socktype = SOCK_STREAM;
    addrinfo* found = nullptr;
    auto port = std::to_string(endpoint.port);
    if (int error = ::getaddrinfo(endpoint.host.c_str(), port.c_str(), &hints, &found); error != 0) {
        return fail(fmt::format("cannot listen on {}: the host is not known ({})", to_text(endpoint),
                                ::gai_strerror(error)),
                    "check the name, or write an address of this machine");
    }
    for (auto* each = found; each != nullptr; each = each->ai_next) {
        // IPv4 first: who listens on "localhost" is looked for at 127.0.0.1.
        auto where = each->ai_family == AF_INET ? addresses.begin() : addresses.end();
        addresses.insert(where, address_of(each->ai_addr, each->ai_addrlen));
    }
    ::freeaddrinfo(found);
    return addresses;
}

class Acceptor final : public Part, public std::enable_shared_from_this<Acceptor> {
public:
    Acceptor(Loop::Impl& loop, int fd, Endpoint local, std::function<void(Socket)> accepted)
        : Part(loop), accepted_(std::move(accepted)), fd_(fd), local_(std::move(local)) {}
    ~Acceptor() override { drop(); }

    const Endpoint& local() const { return local_; }

    Result<void> begin() {
        if (loop_ == nullptr) return fail("cannot listen: the gateway is stopping");
        descriptor_.emplace(io().get_executor());
        timer_.emplace(io().get_executor());
        ErrorCode error;
        descriptor_->assign(fd_, error);
        if (error) return refuse(local_, error.value());
        fd_ = -1;  // the descriptor closes it
        wait();
        return {};
    }

    void drop() override {
        descriptor_.reset();
        timer_.reset();
        if (fd_ >= 0) ::close(std::exchange(fd_, -1));
        auto accepted = std::exchange(accepted_, nullptr);  // may own us
    }

private:
    void wait() {
        descriptor_->async_wait(Descriptor::wait_read, [weak = weak_from_this()](const ErrorCode& error) {
            if (auto self = weak.lock(); self && !error) self->accept_some();
        });
    }

    void accept_some() {
        for (int i = 0; i < batch && descriptor_; ++i) {
            SocketAddress peer;
            int fd =
                ::accept4(descriptor_->native_handle(), peer.get(), &peer.size, SOCK_NONBLOCK | SOCK_CLOEXEC);
            if (fd >= 0) {
                starved_ = false;
                tune(fd);
                accepted_(make_socket(fd, peer));
                continue;
            }
            if (errno == EAGAIN) break;
            if (errno == EMFILE || errno == ENFILE || errno == ENOBUFS || errno == ENOMEM)
                return pause(errno);
            // The others are troubles of the one connection that was to be taken: the next may be well.
        }
        if (descriptor_) wait();
    }

    void pause(int error) {
        if (!starved_) {
            log::warn(
                "link",
                "cannot accept connections on {}: {}; trying again every second (raise the limit of open "
                "files, `ulimit -n`, or LimitNOFILE= in the unit)",
                to_text(local_), describe_errno(error));
        }
        starved_ = true;
        timer_->expires_after(out_of_files_pause);
        timer_->async_wait([weak = weak_from_this()](const ErrorCode& cancelled) {
            if (auto self = weak.lock(); self && !cancelled && self->descriptor_) self->accept_some();
        });
    }

    std::function<void(Socket)> accepted_;
    int fd_;
    Endpoint local_;
    std::optional<Descriptor> descriptor_;
    std::optional<Clock> timer_;
    bool starved_ = false;  // said so already
};

class TcpListener final : public Listener {
public:
    explicit TcpListener(std::shared_ptr<Acceptor> acceptor) : acceptor_(std::move(acceptor)) {}
    ~TcpListener() override { acceptor_->drop(); }
    Endpoint local() const override { return acceptor_->local(); }

private:
    std::shared_ptr<Acceptor> acceptor_;
};

}  // namespace

Result<std::unique_ptr<Listener>> Listener::open(Loop& loop, const Endpoint& endpoint,
                                                 std::function<void(Socket)> accepted) {
    auto addresses = addresses_of(endpoint);
    if (!addresses) return tl::unexpected(addresses.error());
    int fd = -EADDRNOTAVAIL;
    for (auto& address : *addresses) {
        fd = listen_on(address);
        if (fd != -EAFNOSUPPORT && fd != -EADDRNOTAVAIL) break;  // a machine without IPv6 has the other
    }
    if (fd < 0) return refuse(endpoint, -fd);
    auto acceptor =
        std::make_shared<Acceptor>(loop.impl(), fd, to_endpoint(local_address(fd)), std::move(accepted));
    if (auto begun = acceptor->begin(); !begun) return tl::unexpected(begun.error());
    return std::make_unique<TcpListener>(std::move(acceptor));
}

}  // namespace gantry::link
