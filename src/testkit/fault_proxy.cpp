#include "testkit/fault_proxy.hpp"

#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <deque>
#include <functional>
#include <future>
#include <mutex>
#include <stdexcept>
#include <thread>
#include <utility>
#include <vector>

#include "base/bytes.hpp"
#include "base/time.hpp"

namespace gantry::testkit {

namespace proxy {

using Ending = Faults::Ending;

constexpr std::size_t most_held = 256 * 1024;  // bytes under way in one direction
constexpr auto longest_close = 5s;             // for an end to read what it was sent before an orderly close

class Descriptor {
public:
    explicit Descriptor(int fd = -1) : fd_(fd) {}
    Descriptor(Descriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
    Descriptor& operator=(Descriptor&& other) noexcept {
        std::swap(fd_, other.fd_);
        return *this;
    }
    ~Descriptor() { close(); }
    void close() {
        if (fd_ >= 0) ::close(std::exchange(fd_, -1));
    }
    int fd() const { return fd_; }

private:
    int fd_;
};

Descriptor new_socket() {
    Descriptor made(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
    if (made.fd() < 0) throw std::runtime_error("the fault proxy gets no socket");
    return made;
}

sockaddr_in loopback(std::uint16_t port) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    return address;
}

Descriptor bound_socket(std::uint16_t port) {
    auto made = new_socket();
    int on = 1;
    ::setsockopt(made.fd(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    auto address = loopback(port);
    if (::bind(made.fd(), reinterpret_cast<sockaddr*>(&address), sizeof address) != 0)
        throw std::runtime_error("the fault proxy gets no port");
    return made;
}

void send_at_once(int fd) {
    int on = 1;
    ::setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
}

bool is_passing(int error) {
    return error == EAGAIN || error == EWOULDBLOCK || error == EINTR;
}

enum class Step : std::uint8_t { fine, finished, broken };

// One direction of a connection.
struct Way {
    struct Piece {
        Steady due;
        Bytes bytes;
        std::size_t sent = 0;
    };
    int from = -1, to = -1;
    Faults faults;
    std::deque<Piece> pieces;
    Bytes gathered;  // waits for company
    Steady gathered_since{};
    Steady next_send{};                   // a gap, or a stall
    std::size_t held = 0;                 // in `pieces` and `gathered`
    std::uint64_t taken = 0, passed = 0;  // bytes
    bool stalled_once = false;
    bool ended = false;    // nothing more is read
    bool cut = false;      // it ended by `cut_after`
    bool over = false;     // and the other side knows
    bool blocked = false;  // the other side's buffer is full

    bool wants_input() const { return !ended && !faults.stall && held < most_held; }

    // False: `from` is broken.
    bool take(Steady now, std::span<std::uint8_t> buffer) {
        auto got = ::recv(from, buffer.data(), buffer.size(), MSG_DONTWAIT);
        if (got < 0) return is_passing(errno);
        if (got == 0) {
            ended = true;
            over = over || faults.swallow;
            return true;
        }
        auto size = static_cast<std::size_t>(got);
        auto begin = taken;
        taken += size;
        if (faults.swallow) return true;
        if (faults.cut_after && taken >= *faults.cut_after) {
            size = static_cast<std::size_t>(std::max(*faults.cut_after, begin) - begin);
            ended = cut = true;
        }
        auto bytes = buffer.first(size);
        flip(bytes, begin);
        if (gathered.empty()) gathered_since = now;
        gathered.insert(gathered.end(), bytes.begin(), bytes.end());
        held += size;
        return true;
    }

    void flip(std::span<std::uint8_t> bytes, std::uint64_t begin) const {
        for (std::size_t i = 0; i < bytes.size(); ++i) {
            auto place = begin + i;
            if (faults.flip_at == place) bytes[i] ^= 1U;
            if (faults.flip_every != 0 && (place + 1) % faults.flip_every == 0)
                bytes[i] ^= static_cast<std::uint8_t>(1U << ((place + 1) / faults.flip_every % 8));
        }
    }

    bool gathers(Steady now) const {
        return !ended && gathered.size() < faults.gather &&
               (faults.gather_for == Faults::Time{} || now < gathered_since + faults.gather_for);
    }

    Step give(Steady now) {
        if (faults.stall) return Step::fine;
        if (!gathered.empty() && !gathers(now))
            pieces.push_back({now + faults.delay, std::exchange(gathered, {}), 0});
        while (!pieces.empty() && !blocked && pieces.front().due <= now && next_send <= now) {
            auto& piece = pieces.front();
            auto most = piece.bytes.size() - piece.sent;
            if (faults.segment != 0) most = std::min(most, faults.segment);
            if (faults.stall_after && !stalled_once) {
                if (passed >= *faults.stall_after) {
                    stalled_once = true;
                    next_send = now + faults.stall_for;
                    break;
                }
                most = std::min<std::uint64_t>(most, *faults.stall_after - passed);
            }
            auto sent = ::send(to, piece.bytes.data() + piece.sent, most, MSG_DONTWAIT | MSG_NOSIGNAL);
            if (sent < 0 && !is_passing(errno)) return Step::broken;
            if (sent <= 0) {
                blocked = true;
                break;
            }
            passed += static_cast<std::uint64_t>(sent);
            held -= static_cast<std::size_t>(sent);
            piece.sent += static_cast<std::size_t>(sent);
            if (piece.sent == piece.bytes.size()) pieces.pop_front();
            if (faults.gap != Faults::Time{}) next_send = now + faults.gap;
            if (faults.segment != 0) break;  // the next one in a turn of its own
        }
        if (ended && !over && pieces.empty() && gathered.empty()) {
            over = true;
            return Step::finished;
        }
        return Step::fine;
    }

    // When there is something to do without new bytes.
    std::optional<Steady> due() const {
        if (faults.stall || blocked) return {};
        if (!pieces.empty()) return std::max(pieces.front().due, next_send);
        if (!gathered.empty() && faults.gather_for != Faults::Time{})
            return gathered_since + faults.gather_for;
        return {};
    }
};

class Pair {
public:
    Pair(Descriptor client, Descriptor target) : client_(std::move(client)), target_(std::move(target)) {
        there_.from = back_.to = client_.fd();
        there_.to = back_.from = target_.fd();
    }

    Way& there() { return there_; }
    Way& back() { return back_; }
    bool open() const { return !over_ && !closing_; }
    bool over() const { return over_; }

    void want(std::vector<pollfd>& out) const {
        out.push_back(wish(client_.fd(), there_, back_));
        out.push_back(wish(target_.fd(), back_, there_));
    }

    std::optional<Steady> due() const {
        if (over_ || silent_) return {};
        if (closing_) return closing_;
        auto first = connecting_ ? std::nullopt : there_.due(),
             second = connecting_ ? std::nullopt : back_.due();
        return first && second ? std::min(first, second) : first ? first : second;
    }

    void move_on(Steady now, short client, short target, std::span<std::uint8_t> buffer) {
        if (over_) return;
        if (connecting_) {
            if (target == 0) return;
            int error = 0;
            socklen_t size = sizeof error;
            ::getsockopt(target_.fd(), SOL_SOCKET, SO_ERROR, &error, &size);
            if (error != 0) return drop();
            connecting_ = false;
        }
        if ((client & POLLOUT) != 0) back_.blocked = false;
        if ((target & POLLOUT) != 0) there_.blocked = false;
        if (closing_ || silent_) {
            discard(there_, client, buffer);
            discard(back_, target, buffer);
            if ((there_.ended && back_.ended) || (closing_ && now >= *closing_)) drop();
            return;
        }
        turn(there_, now, client, buffer);
        if (open() && !silent_) turn(back_, now, target, buffer);
    }

    void end(Ending how, Steady now) {
        if (over_) return;
        if (how == Ending::half_open) {
            silent_ = true;
            there_.ended = back_.ended = false;
        } else if (how == Ending::reset || connecting_ || silent_) {
            if (how == Ending::reset) {
                linger at_once{1, 0};
                for (int fd : {client_.fd(), target_.fd()})
                    ::setsockopt(fd, SOL_SOCKET, SO_LINGER, &at_once, sizeof at_once);
            }
            drop();
        } else if (!closing_) {
            // A close with bytes unread would be a reset: they are read first.
            ::shutdown(client_.fd(), SHUT_WR);
            ::shutdown(target_.fd(), SHUT_WR);
            there_.ended = back_.ended = false;
            closing_ = now + longest_close;
        }
    }

private:
    pollfd wish(int fd, const Way& out_of, const Way& into) const {
        short events = 0;
        if (connecting_) {
            events = fd == target_.fd() ? POLLOUT : 0;
        } else if (closing_ || silent_) {
            events = out_of.ended ? 0 : POLLIN;
        } else {
            if (out_of.wants_input()) events |= POLLIN;
            if (into.blocked) events |= POLLOUT;
        }
        // Of an end that nobody looks at, poll must not report the death: there is nothing to do about it.
        return {events == 0 || over_ ? -1 : fd, events, 0};
    }

    void turn(Way& way, Steady now, short events, std::span<std::uint8_t> buffer) {
        if ((events & (POLLIN | POLLHUP | POLLERR)) != 0 && way.wants_input() && !way.take(now, buffer))
            return end(Ending::reset, now);
        auto step = way.give(now);
        if (step == Step::broken) return end(Ending::reset, now);
        if (step == Step::finished) {
            if (way.cut) return end(way.faults.ending, now);
            ::shutdown(way.to, SHUT_WR);  // a half-close stays a half-close
        }
        if (there_.over && back_.over) drop();
    }

    static void discard(Way& way, short events, std::span<std::uint8_t> buffer) {
        if (way.ended || (events & (POLLIN | POLLHUP | POLLERR)) == 0) return;
        auto got = ::recv(way.from, buffer.data(), buffer.size(), MSG_DONTWAIT);
        way.ended = got == 0 || (got < 0 && !is_passing(errno));
    }

    void drop() {
        over_ = true;
        client_.close();
        target_.close();
    }

    Descriptor client_, target_;
    Way there_, back_;
    bool connecting_ = true, silent_ = false, over_ = false;
    std::optional<Steady> closing_;
};

}  // namespace proxy

// Everything but the queue of calls belongs to the thread.
class FaultProxy::Loop {
public:
    explicit Loop(std::uint16_t target)
        : target_port(target), wake_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
        reserved_ = proxy::bound_socket(0);
        sockaddr_in address{};
        socklen_t size = sizeof address;
        ::getsockname(reserved_.fd(), reinterpret_cast<sockaddr*>(&address), &size);
        own_port = ntohs(address.sin_port);
        listen();
        thread_ = std::thread([this] { run(); });
    }
    ~Loop() {
        call([this] { stop_ = true; });
        thread_.join();
    }
    Loop(const Loop&) = delete;
    Loop& operator=(const Loop&) = delete;

    // Runs `work` on the thread and returns when it has run.
    void call(std::function<void()> work) {
        std::packaged_task<void()> task(std::move(work));
        auto done = task.get_future();
        {
            std::lock_guard lock(mutex_);
            calls_.push_back(std::move(task));
        }
        std::uint64_t one = 1;
        while (::write(wake_.fd(), &one, sizeof one) < 0 && errno == EINTR) {
        }
        done.get();
    }

    // The port stays bound all the time, so nobody else gets it while we do not listen.
    void listen() {
        listener_ = proxy::bound_socket(own_port);
        if (::listen(listener_.fd(), 1024) != 0) throw std::runtime_error("the fault proxy cannot listen");
    }
    void refuse(bool on) {
        if (on) listener_.close();
        if (!on && listener_.fd() < 0) listen();
    }
    void set(const Faults& to_target, const Faults& to_client) {
        to_target_ = to_target;
        to_client_ = to_client;
        for (auto& pair : pairs_) {
            pair.there().faults = to_target;
            pair.back().faults = to_client;
        }
    }
    void end_all(proxy::Ending how) {
        for (auto& pair : pairs_)
            pair.end(how, std::chrono::steady_clock::now());
    }
    std::size_t open() const {
        return static_cast<std::size_t>(std::ranges::count_if(pairs_, &proxy::Pair::open));
    }
    Passed passed() {
        auto sum = gone_;
        for (auto& pair : pairs_) {
            sum.to_target += pair.there().passed;
            sum.to_client += pair.back().passed;
        }
        return sum;
    }

    std::uint16_t own_port = 0, target_port;
    std::uint64_t accepted = 0;

private:
    void run() {
        std::vector<pollfd> waiting;
        while (!stop_) {
            waiting.clear();
            waiting.push_back({wake_.fd(), POLLIN, 0});
            waiting.push_back({listener_.fd(), POLLIN, 0});
            for (auto& pair : pairs_)
                pair.want(waiting);
            wait(waiting);
            auto now = std::chrono::steady_clock::now();
            // A call made while we waited comes first: what it sets holds for the bytes that woke us.
            run_calls();
            for (std::size_t i = 0; i < pairs_.size() && 2 * i + 3 < waiting.size(); ++i)
                pairs_[i].move_on(now, waiting[2 * i + 2].revents, waiting[2 * i + 3].revents, buffer_);
            std::erase_if(pairs_, [&](proxy::Pair& pair) {
                if (!pair.over()) return false;
                gone_.to_target += pair.there().passed;
                gone_.to_client += pair.back().passed;
                return true;
            });
            if (waiting[1].revents != 0 && listener_.fd() >= 0) accept();
        }
    }

    void wait(std::vector<pollfd>& waiting) {
        std::optional<Steady> due;
        for (auto& pair : pairs_)
            if (auto next = pair.due()) due = due ? std::min(*due, *next) : *next;
        timespec left{};
        if (due) {
            auto time = std::max<std::chrono::nanoseconds>(*due - std::chrono::steady_clock::now(), 0ns);
            left.tv_sec = time / 1s;
            left.tv_nsec = (time % 1s).count();
        }
        if (::ppoll(waiting.data(), waiting.size(), due ? &left : nullptr, nullptr) < 0)
            for (auto& each : waiting)
                each.revents = 0;
    }

    void run_calls() {
        std::uint64_t count = 0;
        while (::read(wake_.fd(), &count, sizeof count) > 0) {
        }
        std::deque<std::packaged_task<void()>> calls;
        {
            std::lock_guard lock(mutex_);
            calls.swap(calls_);
        }
        for (auto& each : calls)
            each();
    }

    void accept() {
        for (;;) {
            proxy::Descriptor client(
                ::accept4(listener_.fd(), nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK));
            if (client.fd() < 0) return;
            ++accepted;
            auto target = proxy::new_socket();
            proxy::send_at_once(client.fd());
            proxy::send_at_once(target.fd());
            auto address = proxy::loopback(target_port);
            if (::connect(target.fd(), reinterpret_cast<sockaddr*>(&address), sizeof address) != 0 &&
                errno != EINPROGRESS)
                continue;
            auto& pair = pairs_.emplace_back(std::move(client), std::move(target));
            pair.there().faults = to_target_;
            pair.back().faults = to_client_;
        }
    }

    proxy::Descriptor wake_, reserved_, listener_;
    Faults to_target_, to_client_;
    std::deque<proxy::Pair> pairs_;
    Passed gone_;  // by connections that are over
    std::array<std::uint8_t, 64 * 1024> buffer_{};
    bool stop_ = false;
    std::mutex mutex_;
    std::deque<std::packaged_task<void()>> calls_;
    std::thread thread_;
};

FaultProxy::FaultProxy(std::uint16_t target) : loop_(std::make_unique<Loop>(target)) {}
FaultProxy::~FaultProxy() = default;

std::uint16_t FaultProxy::port() const {
    return loop_->own_port;
}

void FaultProxy::set_target(std::uint16_t port) {
    loop_->call([&] { loop_->target_port = port; });
}

void FaultProxy::set(const Faults& to_target, const Faults& to_client) {
    loop_->call([&] { loop_->set(to_target, to_client); });
}

void FaultProxy::end_all(Faults::Ending how) {
    loop_->call([&] { loop_->end_all(how); });
}

void FaultProxy::refuse(bool on) {
    loop_->call([&] { loop_->refuse(on); });
}

std::size_t FaultProxy::open_connections() const {
    std::size_t count = 0;
    loop_->call([&] { count = loop_->open(); });
    return count;
}

std::uint64_t FaultProxy::accepted() const {
    std::uint64_t count = 0;
    loop_->call([&] { count = loop_->accepted; });
    return count;
}

FaultProxy::Passed FaultProxy::passed() const {
    Passed sum;
    loop_->call([&] { sum = loop_->passed(); });
    return sum;
}

}  // namespace gantry::testkit
