#pragma once
#include <functional>
#include <memory>
#include <string>
#include <thread>

#include "base/error.hpp"
#include "base/time.hpp"
#include "reader/party.hpp"

// Carries bytes and time between sockets and parties. The only module that reads a clock for them. Asio stays
// in the .cpp files: no header of this module includes it.
namespace gantry::link {

Now read_clocks();

// One thread with an event loop. Everything that belongs to a loop (links, timers, listeners) is touched on
// its thread only, unless a function says otherwise.
class Loop {
public:
    explicit Loop(std::string name);                // the thread's name, up to 15 characters; starts it
    ~Loop();                                        // stops and joins
    void post(std::function<void()> work);          // any thread; runs `work` on the loop
    void run_and_wait(std::function<void()> work);  // any other thread; returns when `work` has run
    bool here() const;                              // is this the loop's thread?
    // Any thread but the loop's: ends the thread; later posts are dropped. What still lives on the loop is
    // closed and inert from then on: nothing calls back, `closed` included. It may be destroyed on any
    // thread.
    void stop();

    struct Impl;
    Impl& impl() { return *impl_; }

private:
    std::unique_ptr<Impl> impl_;
};

// Calls back once at a steady time. Setting it anew replaces what was set.
class Timer {
public:
    explicit Timer(Loop& loop);
    ~Timer();
    void at(Steady when, std::function<void()> then);
    void cancel();

private:
    struct Impl;
    std::shared_ptr<Impl> impl_;
};

// An open, non-blocking stream (a socket, a serial line) with a name for its far end.
class Socket {
public:
    Socket() = default;
    Socket(int fd, std::string peer, std::string peer_host)
        : fd_(fd), peer_(std::move(peer)), peer_host_(std::move(peer_host)) {}
    Socket(Socket&& other) noexcept;
    Socket& operator=(Socket&& other) noexcept;
    ~Socket();
    int release();
    explicit operator bool() const { return fd_ >= 0; }
    const std::string& peer() const { return peer_; }  // "192.168.0.5:41234", "[::1]:41234", "/dev/ttyS0"
    const std::string& peer_host() const { return peer_host_; }  // without the port
    std::string local_host() const;                              // our own address; empty: it has none

private:
    int fd_ = -1;
    std::string peer_, peer_host_;
};

// "127.0.0.1:9055", "[::1]:0", "localhost:80", ":9055" (all IPv4 and IPv6 addresses), "0.0.0.0:9055".
struct Endpoint {
    std::string host;
    std::uint16_t port = 0;
    friend bool operator==(const Endpoint&, const Endpoint&) = default;
};
Result<Endpoint> parse_endpoint(std::string_view text);
std::string to_text(const Endpoint& endpoint);

// Is `address` (numeric) inside `network` ("192.168.0.0/24", "10.0.0.7", "fe80::/10")? IPv4 addresses mapped
// into IPv6 count as IPv4.
bool in_network(std::string_view address, std::string_view network);
bool is_network(std::string_view text);

// One socket and one party, pumped until either ends. Keep it alive by the shared pointer; after `closed` it
// is inert. All calls on the loop's thread.
class Link {
public:
    struct Callbacks {
        std::function<void()> after_turn;  // after every turn, before output is sent: drain the driver here
        std::function<void(std::string_view reason)> closed;  // once, last; never inside start() or a turn
        std::string_view peer_is = "the reader";              // in reasons: "closed by the reader"
    };
    // The party must outlive the link or be kept by the callbacks. Calls party.start() at once; the first
    // turn comes after it returned. Letting go of the last pointer (on the loop) ends the link without a
    // word.
    static std::shared_ptr<Link> start(Loop& loop, Socket socket, Party& party, Callbacks callbacks);
    virtual ~Link() = default;
    // The party was changed from outside (a commit, a job): send its output, look at its deadline and its
    // wish for input again. A turn of its own, so after_turn runs; called inside a turn it is a no-op.
    virtual void wake() = 0;
    // At once, output that waits is lost. Inside a turn `closed` comes when the turn is over, else before
    // this returns.
    virtual void close(std::string_view reason) = 0;
    // No more input; what waits may still go out for a moment, then it closes.
    virtual void finish(std::string_view reason) = 0;
    virtual const std::string& peer() const = 0;
    virtual const std::string& peer_host() const = 0;
    virtual Steady last_input() const = 0;
    virtual Now last_heard() const = 0;  // the same, by both clocks: what the party was told then
};

// Accepts connections. Goes on after errors (no descriptors left: waits and tries again, and says so).
class Listener {
public:
    // `accepted` runs on the loop's thread and may destroy the listener. A host name is looked up at once.
    static Result<std::unique_ptr<Listener>> open(Loop& loop, const Endpoint& endpoint,
                                                  std::function<void(Socket)> accepted);
    virtual ~Listener() = default;
    virtual Endpoint local() const = 0;  // with the port that was given for port 0
};

// Connects, resolving names without blocking the loop; tries every address that a name has. `done` runs on
// the loop's thread, once, after start() returned. Destroying the handle cancels; `done` may do that.
class Dial {
public:
    static std::unique_ptr<Dial> start(Loop& loop, const Endpoint& endpoint,
                                       std::chrono::milliseconds timeout,
                                       std::function<void(Result<Socket>)> done);
    virtual ~Dial() = default;
};

// Waits between tries: doubling from `first` to `most`, with jitter of a quarter either way.
class Backoff {
public:
    explicit Backoff(std::chrono::milliseconds first = 500ms, std::chrono::milliseconds most = 30s,
                     std::uint64_t seed = 1)
        : first_(first), most_(most), state_(seed) {}
    std::chrono::milliseconds next();
    void reset() { tries_ = 0; }

private:
    std::chrono::milliseconds first_, most_;
    std::uint64_t state_;
    unsigned tries_ = 0;
};

// Raises this process's limit of open files to its hard limit; returns the limit now in force.
std::uint64_t raise_file_limit();

}  // namespace gantry::link
