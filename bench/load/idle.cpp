#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <thread>

#include <fmt/format.h>

#include "bench/load/measurements.hpp"
#include "bench/load/outcome.hpp"
#include "bench/load/site.hpp"
#include "bench/machine.hpp"
#include "bench/tag_frame.hpp"
#include "journal/journal.hpp"

namespace gantry::bench {

using namespace std::chrono_literals;

namespace {
constexpr std::uint32_t connects_at_once = 250;  // readers without a name yet that a gateway must bear
constexpr auto heartbeat = 10s;

class QuietFleet {
public:
    explicit QuietFleet(Site& site) : site_(site) {}
    ~QuietFleet() {
        for (int fd : sockets_)
            ::close(fd);
    }
    QuietFleet(const QuietFleet&) = delete;
    QuietFleet& operator=(const QuietFleet&) = delete;

    // Adds readers until there are `count`, all of them known to the gateway.
    void grow(std::uint32_t count) {
        while (sockets_.size() < count) {
            for (std::uint32_t i = 0; i < connects_at_once && sockets_.size() < count; ++i) {
                sockets_.push_back(connect_loopback(site_.port()));
                beat(sockets_.size() - 1);
            }
            wait_until_known();
        }
    }

    // Heartbeats at even distances.
    void live(std::chrono::milliseconds time) {
        auto start = Clock::now();
        auto distance = std::chrono::duration_cast<Clock::duration>(heartbeat) / sockets_.size();
        for (std::size_t beats = 0; beats * distance < time; ++beats) {
            std::this_thread::sleep_until(start + beats * distance);
            beat(next_);
            next_ = (next_ + 1) % sockets_.size();
        }
        std::this_thread::sleep_until(start + time);
    }

private:
    void beat(std::size_t reader) {
        auto name = Fleet::name(static_cast<std::uint32_t>(reader));
        auto frame = heartbeat_frame(name, ++beats_);
        if (::send(sockets_[reader], frame.data(), frame.size(), MSG_NOSIGNAL) < 0)
            throw Failure(fmt::format("an idle reader was cut off: {}", std::strerror(errno)));
    }

    void wait_until_known() {
        auto give_up = Clock::now() + 60s;
        auto reader = journal::Reader::open(site_.store());
        if (!reader) throw Failure(reader.error().error.text());
        journal::Filter filter;
        filter.types = {event::Type::reader_connected};
        while (known_ < sockets_.size()) {
            filter.after = known_up_to_;
            auto done = (*reader)->query(filter, [this](const event::Event& event) {
                known_up_to_ = event.seq;
                return ++known_ > 0;
            });
            if (!done) throw Failure(done.error().error.text());
            if (Clock::now() >= give_up)
                throw Failure(fmt::format("{} readers dialled in, {} are known", sockets_.size(), known_));
            std::this_thread::sleep_for(5ms);
        }
    }

    Site& site_;
    std::vector<int> sockets_;
    std::size_t known_ = 0, next_ = 0;
    journal::Seq known_up_to_ = 0;
    std::uint32_t beats_ = 0;
};
}  // namespace

void measure_ready(const std::string& program) {
    Site site(program, false);
    site.start();
    site.stop();
    print_figure("ready_ms", site.ready_ms(), "ms");
}

void measure_idle(const std::string& program, const std::vector<std::uint32_t>& counts,
                  std::chrono::milliseconds time) {
    Site site(program, false);
    site.start();
    QuietFleet fleet(site);
    auto empty = usage_of(site.pid());
    bool first = true;
    for (auto count : counts) {
        fleet.grow(count);
        fleet.live(500ms);  // what connecting has left to do is done
        auto before = usage_of(site.pid());
        fleet.live(time);
        auto after = usage_of(site.pid());
        auto seconds = std::chrono::duration<double>(time).count();
        auto suffix = first ? std::string() : fmt::format("_{}_readers", count);
        print_figure("idle_connection_bytes" + suffix,
                     (static_cast<double>(after.anonymous) - static_cast<double>(empty.anonymous)) / count,
                     "bytes");
        print_figure(fmt::format("idle_rss_{}_readers_bytes", count), static_cast<double>(after.resident),
                     "bytes");
        print_figure("idle_cpu_percent" + suffix, (after.cpu_s - before.cpu_s) / seconds * 100, "%");
        first = false;
    }
    site.stop();
}

}  // namespace gantry::bench
