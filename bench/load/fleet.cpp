#include "bench/load/fleet.hpp"

#include <arpa/inet.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <utility>

#include <fmt/format.h>

#include "bench/load/outcome.hpp"
#include "bench/tag_frame.hpp"

namespace gantry::bench {

using namespace std::chrono_literals;

namespace {
constexpr auto patience = 20s;  // for acknowledgements that are still to come
constexpr std::int8_t weakest = -80;
constexpr unsigned strengths = 60;
}  // namespace

int connect_loopback(std::uint16_t port) {
    int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (fd < 0)
        throw Failure(
            fmt::format("no socket: {}; raise the limit of open files (`ulimit -n`)", std::strerror(errno)));
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    if (::connect(fd, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0) {
        int error = errno;
        ::close(fd);
        throw Failure(fmt::format("cannot connect to port {}: {}", port, std::strerror(error)));
    }
    int on = 1;
    ::setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    return fd;
}

std::string Fleet::name(std::uint32_t reader) {
    return fmt::format("r-{}", reader + 1);
}

Fleet::Fleet(const Shape& shape, std::uint16_t port)
    : shape_(shape), acknowledgement_(acknowledgement()), readers_(shape.readers) {
    epoll_ = ::epoll_create1(EPOLL_CLOEXEC);
    for (std::uint32_t i = 0; i < shape_.readers; ++i) {
        auto& reader = readers_[i];
        reader.name = name(i);
        for (std::uint32_t turn = 0; turn < (shape_.new_tags ? 1 : shape_.turns); ++turn)
            reader.frames.push_back(
                tag_frame(reader.name, {.first_tag = first_tag(i, turn), .records = shape_.records}));
        connect(reader, port);
        epoll_event event{};
        event.events = EPOLLIN;
        event.data.u32 = i;
        ::epoll_ctl(epoll_, EPOLL_CTL_ADD, reader.fd, &event);
    }
}

Fleet::~Fleet() {
    for (auto& reader : readers_)
        if (reader.fd >= 0) ::close(reader.fd);
    ::close(epoll_);
}

void Fleet::connect(Reader& reader, std::uint16_t port) {
    reader.fd = connect_loopback(port);
    send_all(reader.fd, heartbeat_frame(reader.name, 0));
}

std::uint32_t Fleet::first_tag(std::uint32_t reader, std::uint64_t frame) const {
    auto own = static_cast<std::uint32_t>(shape_.new_tags ? frame : frame % shape_.turns);
    auto block = shape_.new_tags ? own * shape_.readers + reader : reader * shape_.turns + own;
    return block * shape_.records;
}

std::int8_t Fleet::rssi(std::uint64_t frame) const {
    return static_cast<std::int8_t>(weakest + static_cast<std::int8_t>(frame / shape_.turns % strengths));
}

Clock::time_point Fleet::due_time(std::uint32_t index, std::uint64_t frame) const {
    auto number = static_cast<double>(frame * shape_.readers + index);
    return start_ + std::chrono::duration_cast<Clock::duration>(number * interval_);
}

Fleet::Phase Fleet::run(std::chrono::milliseconds time, double reads_per_second) {
    bool paced = reads_per_second > 0;
    interval_ = std::chrono::duration<double>(paced ? shape_.records / reads_per_second : 0);
    phase_ = {};
    start_ = Clock::now();
    end_ = start_ + time;
    for (auto& reader : readers_)
        reader.due = reader.begun = 0;
    if (!paced)
        for (std::uint32_t i = 0; i < readers_.size(); ++i)
            send(readers_[i], i, Clock::now());
    for (std::uint64_t next = 0;;) {
        auto index = static_cast<std::uint32_t>(next % readers_.size());
        auto due_at = paced ? due_time(index, next / readers_.size()) : end_;
        if (due_at >= end_) break;
        if (Clock::now() < due_at) {
            wait(due_at);
            continue;
        }
        auto& reader = readers_[index];
        ++reader.due;
        if (reader.sent == reader.acknowledged)
            send(reader, index, due_at);
        else
            ++phase_.late;
        ++next;
        if (next % 8 == 0) wait(Clock::now());  // acknowledgements are taken even when the fleet is behind
    }
    while (Clock::now() < end_)
        wait(end_);
    auto measured = phase_.reads;
    auto seconds = std::chrono::duration<double>(Clock::now() - start_).count();
    for (auto give_up = Clock::now() + patience; under_way_ > 0;) {
        if (Clock::now() >= give_up)
            throw Failure(fmt::format("{} of {} readers wait in vain for an acknowledgement", under_way_,
                                      readers_.size()));
        wait(Clock::now() + 10ms);
    }
    auto phase = std::exchange(phase_, {});
    phase.reads = measured;
    phase.seconds = seconds;
    return phase;
}

void Fleet::wait(Clock::time_point until) {
    std::array<epoll_event, 256> events{};
    auto left = std::max(until - Clock::now(), Clock::duration::zero());
    auto whole = std::chrono::floor<std::chrono::seconds>(left);
    timespec time{whole.count(), std::chrono::duration_cast<std::chrono::nanoseconds>(left - whole).count()};
    int count = ::epoll_pwait2(epoll_, events.data(), static_cast<int>(events.size()), &time, nullptr);
    for (int i = 0; i < count; ++i) {
        auto index = events[static_cast<std::size_t>(i)].data.u32;
        receive(readers_[index], index);
    }
}

void Fleet::send(Reader& reader, std::uint32_t index, Clock::time_point due_at) {
    auto& frame = reader.frames[shape_.new_tags ? 0 : reader.sent % shape_.turns];
    if (shape_.new_tags)
        frame =
            tag_frame(reader.name, {.first_tag = first_tag(index, reader.sent), .records = shape_.records});
    set_rssi(frame, reader.name, rssi(reader.sent));
    reader.due_at = due_at;
    ++reader.sent;
    ++reader.begun;
    ++under_way_;
    send_all(reader.fd, frame);
}

void Fleet::send_all(int fd, ByteView bytes) {
    while (!bytes.empty()) {
        auto sent = ::send(fd, bytes.data(), bytes.size(), MSG_NOSIGNAL);
        if (sent < 0) throw Failure(fmt::format("a reader cannot send: {}", std::strerror(errno)));
        bytes = bytes.subspan(static_cast<std::size_t>(sent));
    }
}

void Fleet::receive(Reader& reader, std::uint32_t index) {
    std::array<std::uint8_t, 256> bytes{};
    auto got = ::recv(reader.fd, bytes.data(), bytes.size(), MSG_DONTWAIT);
    if (got < 0 && errno == EAGAIN) return;
    if (got <= 0) throw Failure(fmt::format("the gateway closed the connection of {}", reader.name));
    for (auto byte : ByteView(bytes).first(static_cast<std::size_t>(got))) {
        if (byte != acknowledgement_[reader.partial] || reader.sent == reader.acknowledged)
            throw Failure(
                fmt::format("the gateway sent {} something that is no acknowledgement", reader.name));
        if (++reader.partial < acknowledgement_.size()) continue;
        reader.partial = 0;
        acknowledged(reader, index);
    }
}

void Fleet::acknowledged(Reader& reader, std::uint32_t index) {
    auto now = Clock::now();
    ++reader.acknowledged;
    --under_way_;
    phase_.reads += shape_.records;
    phase_.latency_ms.push_back(std::chrono::duration<double, std::milli>(now - reader.due_at).count());
    if (now >= end_) return;
    if (interval_.count() == 0)
        send(reader, index, now);
    else if (reader.begun < reader.due)
        send(reader, index, due_time(index, reader.begun));
}

}  // namespace gantry::bench
