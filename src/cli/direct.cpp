#include "cli/direct.hpp"

#include <algorithm>
#include <condition_variable>
#include <map>
#include <mutex>

#include <fmt/format.h>

#include "base/text.hpp"
#include "link/link.hpp"
#include "link/serial.hpp"

namespace gantry::cli {

namespace {
// A driver knows the deadline of its job and says how it ended; this is for one that does not.
constexpr auto grace = 2s;

class Direct final : public DirectReader {
public:
    explicit Direct(Options options) : options_(std::move(options)), loop_("direct") {}
    ~Direct() override { loop_.stop(); }

    Result<void> connect(std::chrono::milliseconds timeout);
    JobResult run(const Job& job, std::chrono::milliseconds timeout) override;
    Status wait_described(std::chrono::milliseconds timeout) override;
    Status status() override;
    const gateway::Address& address() const override { return options_.address; }

private:
    using Lock = std::unique_lock<std::mutex>;

    // On the loop.
    Result<void> listen();
    Result<void> open_line();
    void dial(std::chrono::milliseconds timeout);
    void taken(link::Socket socket);
    void admit();
    void after_turn();
    void take_signals();
    void take_reports();
    void closed(std::string_view reason);

    Known known() const {
        Known known;
        known.reading = options_.reading;
        return known;
    }
    std::uint64_t counted(Count which) const { return status_.counters[static_cast<std::size_t>(which)]; }
    bool dials_in() const { return options_.address.scheme->kind == LinkKind::listen; }
    // On the main thread, until `condition` or a time; false: it was interrupted, or too late.
    template <class Condition>
    bool wait_until(Lock& lock, Steady end, const Condition& condition);
    bool was_interrupted() const { return options_.interrupted && options_.interrupted(); }
    // Any thread; for what the main thread waits for.
    template <class Change>
    void tell(const Change& change) {
        {
            std::lock_guard lock(mutex_);
            change();
        }
        changed_.notify_all();
    }

    const Options options_;
    std::mutex mutex_;
    std::condition_variable changed_;
    // Guarded:
    Status status_;
    bool admitted_ = false;
    std::optional<Error> trouble_;  // there will be no link
    std::map<JobId, JobResult> results_;

    JobId last_job_ = 0;  // of the main thread
    link::Loop loop_;     // before what lives on it
    std::unique_ptr<Driver> driver_;
    std::shared_ptr<link::Link> link_;
    std::unique_ptr<link::Dial> dial_;
    std::unique_ptr<link::Listener> listener_;
    bool holds_ = false;  // a report that must not be acknowledged
};

template <class Condition>
bool Direct::wait_until(Lock& lock, Steady end, const Condition& condition) {
    constexpr auto glance = 50ms;  // how often to look for an interruption
    for (;;) {
        auto now = link::read_clocks().steady;
        auto next = options_.interrupted ? std::min(end, now + glance) : end;
        if (changed_.wait_until(lock, next, condition)) return true;
        if (next == end || was_interrupted()) return false;
    }
}

Result<void> Direct::connect(std::chrono::milliseconds timeout) {
    auto& address = options_.address;
    Result<void> begun;
    loop_.run_and_wait([&] {
        if (dials_in())
            begun = listen();
        else if (address.scheme->kind == LinkKind::serial)
            begun = open_line();
        else
            dial(timeout);
    });
    if (!begun) return begun;
    Lock lock(mutex_);
    auto ready = [this] { return admitted_ || trouble_; };
    auto end = link::read_clocks().steady + timeout + (dials_in() ? 0s : grace);
    if (!wait_until(lock, end, ready)) {
        if (was_interrupted()) return fail("interrupted before the reader was there");
        return fail(fmt::format("{}: no reader{} has dialled in", printable(address.text),
                                options_.name.empty() ? "" : " called " + printable(options_.name)),
                    "is it set up to dial this machine and port? --timeout gives it longer");
    }
    if (trouble_) return tl::unexpected(*trouble_);
    return {};
}

Result<void> Direct::listen() {
    auto listener = link::Listener::open(loop_, {options_.address.host, options_.address.port},
                                         [this](link::Socket socket) { taken(std::move(socket)); });
    if (!listener) return tl::unexpected(listener.error());
    listener_ = std::move(*listener);
    return {};
}

Result<void> Direct::open_line() {
    auto line = link::parse_serial(options_.address.path, options_.address.options);
    if (!line) return tl::unexpected(line.error());
    auto socket = link::open_serial(*line);
    if (!socket) return tl::unexpected(socket.error());
    taken(std::move(*socket));
    return {};
}

void Direct::dial(std::chrono::milliseconds timeout) {
    auto done = [this](Result<link::Socket> socket) {
        if (socket) return taken(std::move(*socket));
        tell([&] { trouble_ = socket.error(); });
    };
    dial_ = link::Dial::start(loop_, {options_.address.host, options_.address.port}, timeout, done);
}

// One link at a time: of readers that dial in together the others wait for their next try.
void Direct::taken(link::Socket socket) {
    if (link_) return;
    DriverOptions options;
    options.settings = options_.settings;
    options.model = options_.model;
    options.link = options_.address.scheme->kind;
    if (!dials_in()) options.name = options_.name.empty() ? options_.address.text : options_.name;
    driver_ = options_.address.plugin->make_driver(options);
    tell([&] {
        status_ = {};
        status_.connected = true;
        status_.answered = options_.address.scheme->kind != LinkKind::serial;
        status_.peer = socket.peer();
        status_.name = options.name;
    });
    if (!dials_in()) driver_->admitted(known(), link::read_clocks());
    link::Link::Callbacks callbacks;
    callbacks.after_turn = [this] { after_turn(); };
    callbacks.closed = [this](std::string_view reason) { closed(reason); };
    link_ = link::Link::start(loop_, std::move(socket), *driver_, std::move(callbacks));
    if (!dials_in()) tell([&] { admitted_ = true; });
}

void Direct::after_turn() {
    take_signals();
    take_reports();
    tell([&] {
        status_.counters = driver_->counters();
        status_.stalled = driver_->stalled();
        status_.answered = status_.answered || counted(Count::frames) > 0;
    });
}

void Direct::take_signals() {
    for (auto& signal : std::exchange(driver_->signals(), {})) {
        if (auto* who = std::get_if<Identified>(&signal)) {
            auto name = printable(who->name);
            if (!options_.name.empty() && name != options_.name)
                return link_->close(fmt::format("{} is not the reader that was asked for", name));
            driver_->admitted(known(), link::read_clocks());
            tell([&] {
                status_.name = name;
                admitted_ = true;
            });
        } else if (auto* what = std::get_if<Described>(&signal)) {
            tell([&] { status_.described = std::move(*what); });
        } else if (auto* ended = std::get_if<JobEnded>(&signal)) {
            tell([&] { results_.insert_or_assign(ended->job, std::move(ended->result)); });
        }
    }
}

void Direct::take_reports() {
    for (auto& report : std::exchange(driver_->reports(), {})) {
        std::uint64_t reads = 0;
        for (auto& each : report.observations)
            reads += each.reads;
        tell([&] { status_.reads += reads; });
        // What has a mark would be acknowledged, and the reader would forget it. A ticket stands for all
        // before it.
        holds_ = holds_ || report.mark.has_value();
        if (!holds_) driver_->committed(report.ticket, link::read_clocks());
    }
}

void Direct::closed(std::string_view reason) {
    driver_->link_lost(link::read_clocks());
    take_signals();
    bool waits_for_another = false;
    tell([&] {
        status_.connected = false;
        // A driver has given up a line on which there was nothing at all.
        bool silent = !status_.answered && counted(Count::bytes) == 0 && driver_->finished();
        status_.ended = silent ? nobody_answers : reason;
        waits_for_another = dials_in() && !admitted_;
    });
    if (waits_for_another) loop_.post([this] { link_.reset(); });  // not under its own feet
}

JobResult Direct::run(const Job& job, std::chrono::milliseconds timeout) {
    auto id = ++last_job_;
    loop_.run_and_wait([&] {
        auto now = link::read_clocks();
        driver_->run({.id = id, .deadline = now.steady + timeout}, job, now);
        take_signals();  // refused at once, or by a link that has ended
        link_->wake();
    });
    Lock lock(mutex_);
    auto over = [&] { return results_.contains(id) || !status_.connected; };
    if (!wait_until(lock, link::read_clocks().steady + timeout + grace, over) && was_interrupted()) {
        lock.unlock();
        loop_.run_and_wait([&] {
            driver_->cancel(id, link::read_clocks());
            take_signals();
            link_->wake();
        });
        lock.lock();
        changed_.wait_for(lock, grace, over);
        if (!over())
            return {.status = JobResult::Status::unknown,
                    .text = "cancelled while the reader had it: what it did is not known",
                    .values = {}};
    }
    if (auto result = results_.extract(id); !result.empty()) {
        auto ended = std::move(result.mapped());
        // Nothing that a driver can say of one job tells more than that.
        using Ended = JobResult::Status;
        bool no_answer = ended.status == Ended::timed_out || ended.status == Ended::unknown ||
                         ended.status == Ended::cancelled;
        bool silent = !status_.answered && (status_.connected || status_.ended == nobody_answers);
        if (no_answer && silent && !was_interrupted()) ended.text = nobody_answers;
        return ended;
    }
    if (!status_.connected)
        return {.status = JobResult::Status::unknown,
                .text = fmt::format("the link ended: {}", status_.ended),
                .values = {}};
    return {.status = JobResult::Status::timed_out,
            .text = !status_.answered ? std::string(nobody_answers)
                                      : fmt::format("nothing came back for {}",
                                                    to_text(std::chrono::microseconds(timeout))),
            .values = {}};
}

DirectReader::Status Direct::wait_described(std::chrono::milliseconds timeout) {
    Lock lock(mutex_);
    changed_.wait_for(lock, timeout, [this] { return status_.described || !status_.connected; });
    return status_;
}

DirectReader::Status Direct::status() {
    std::lock_guard lock(mutex_);
    return status_;
}
}  // namespace

Result<std::unique_ptr<DirectReader>> DirectReader::open(Options options, std::chrono::milliseconds timeout) {
    auto direct = std::make_unique<Direct>(std::move(options));
    if (auto connected = direct->connect(timeout); !connected) return tl::unexpected(connected.error());
    return direct;
}

}  // namespace gantry::cli
