// What the machine can do at most: the loopback and the store, with nothing between.
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include <fmt/format.h>

#include "bench/load/bare_host.hpp"
#include "bench/load/measurements.hpp"
#include "bench/load/outcome.hpp"
#include "bench/raw_store.hpp"
#include "bench/temp_dir.hpp"

namespace gantry::bench {

namespace {
constexpr std::size_t frame_size = 64;

double seconds_since(Clock::time_point start) {
    return std::chrono::duration<double>(Clock::now() - start).count();
}
}  // namespace

void measure_loopback(std::uint32_t connections, unsigned frames_a_send, std::chrono::milliseconds time) {
    BareHost host(BareHost::Work::count, connections);
    std::vector<int> sockets;
    for (std::uint32_t i = 0; i < connections; ++i)
        sockets.push_back(connect_loopback(host.port()));
    Bytes bytes(frame_size * frames_a_send, 0x5A);
    auto start = Clock::now();
    std::uint64_t sent = 0;
    for (auto end = start + time; Clock::now() < end;) {
        for (int fd : sockets) {
            auto size = ::send(fd, bytes.data(), bytes.size(), MSG_NOSIGNAL);
            if (size < 0) throw Failure(fmt::format("cannot send: {}", std::strerror(errno)));
            sent += static_cast<std::uint64_t>(size);
        }
    }
    for (int fd : sockets)
        ::close(fd);
    auto received = host.bytes_received();
    auto seconds = seconds_since(start);
    if (received != sent)
        throw Failure(fmt::format("{} bytes sent on loopback, {} received", sent, received));
    print_figure(frames_a_send == 1 ? "raw_loopback_frames_per_s"
                                    : fmt::format("raw_loopback_{}_a_send_frames_per_s", frames_a_send),
                 static_cast<double>(received) / frame_size / seconds, "frames/s");
}

void measure_bare_acknowledge(const Fleet::Shape& shape, std::chrono::milliseconds time) {
    BareHost host(BareHost::Work::acknowledge, shape.readers);
    Fleet fleet(shape, host.port());
    auto phase = fleet.run(time, 0);
    print_figure(shape.records == 1 ? "raw_acknowledge_single_reads_per_s" : "raw_acknowledge_reads_per_s",
                 static_cast<double>(phase.reads) / phase.seconds, "reads/s");
}

void measure_bare_store(std::chrono::milliseconds time) {
    constexpr std::uint32_t batch = 1000;
    TempDir dir;
    RawStore store(dir.path() / "raw.db", RawStore::Layout::blob_a_batch);
    std::uint64_t records = 0;
    auto start = Clock::now();
    for (auto end = start + time; Clock::now() < end; records += batch)
        store.commit(batch);
    print_figure("raw_journal_records_per_s", static_cast<double>(records) / seconds_since(start),
                 "records/s");
}

}  // namespace gantry::bench
