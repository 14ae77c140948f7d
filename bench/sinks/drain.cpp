#include "bench/sinks/drain.hpp"

#include <fstream>
#include <thread>

#include <fmt/format.h>

#include "bench/load/fleet.hpp"
#include "bench/load/outcome.hpp"
#include "bench/load/site.hpp"
#include "bench/load/store_check.hpp"
#include "journal/journal.hpp"

namespace gantry::bench {

using namespace std::chrono_literals;

namespace {
constexpr Fleet::Shape readers{.readers = 50};
constexpr auto longest_drain = 300s;
constexpr auto slice = 200ms;

std::string content(const std::string& path) {
    std::ifstream in(path);
    return {std::istreambuf_iterator<char>(in), {}};
}

// How far the sink is, as the store says.
class Progress {
public:
    explicit Progress(const Site& site) {
        auto opened = journal::Reader::open(site.store());
        if (!opened) throw Failure(opened.error().error.text());
        reader_ = std::move(*opened);
    }
    journal::Seq cursor() const {
        auto cursor = reader_->cursor("bench");
        if (!cursor) throw Failure(cursor.error().error.text());
        return cursor->value_or(0);
    }
    journal::Seq last() const {
        auto last = reader_->last_seq();
        if (!last) throw Failure(last.error().error.text());
        return *last;
    }

private:
    std::unique_ptr<journal::Reader> reader_;
};
}  // namespace

void measure_drain(const DrainOptions& options) {
    Site site(options.program, true, content(options.section));
    site.start();
    Fleet fleet(readers, site.port());
    fleet.run(options.away, options.rate);
    Progress progress(site);
    auto from = progress.cursor(), backlog = progress.last();
    if (backlog <= from) throw Failure("the sink was not away: there is no backlog");
    fmt::print("backlog\n");
    std::fflush(stdout);

    // The clock starts at the first event that gets through: how long the sink waits for another try is its
    // own matter.
    std::uint64_t live = 0;
    double live_seconds = 0;
    auto begun = Clock::time_point{};
    auto give_up = Clock::now() + longest_drain;
    auto near = static_cast<journal::Seq>(options.rate * std::chrono::duration<double>(slice).count());
    for (auto cursor = from;; cursor = progress.cursor()) {
        auto now = Clock::now();
        if (begun == Clock::time_point{} && cursor > from) {
            begun = now;
            from = cursor;
            live = 0;
            live_seconds = 0;
        }
        if (begun != Clock::time_point{} && progress.last() - cursor <= 2 * near && cursor > from) {
            auto seconds = std::chrono::duration<double>(now - begun).count();
            auto drained = static_cast<double>(cursor - from) / seconds;
            auto prefix = fmt::format("drain_{}_", options.kind);
            print_figure(prefix + "events_per_s", drained, "events/s");
            print_figure(prefix + "live_reads_per_s", static_cast<double>(live) / live_seconds, "reads/s");
            print_figure(prefix + "times_live", drained / (static_cast<double>(live) / live_seconds), "x");
            break;
        }
        if (now >= give_up)
            throw Failure(
                fmt::format("the sink did not catch up: {} events are left", progress.last() - cursor));
        auto phase = fleet.run(slice, options.rate);
        live += phase.reads;
        live_seconds += phase.seconds;
    }
    site.stop();
    check_reads(site.store(), fleet);
}

}  // namespace gantry::bench
