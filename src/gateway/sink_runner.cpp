#include "gateway/sink_runner.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "base/log.hpp"
#include "base/text.hpp"
#include "link/link.hpp"

namespace gantry::gateway {

namespace {
constexpr auto leave_every = 100ms;  // a crash doubles at most what was delivered in this time
constexpr auto idle_every = 1s;
constexpr auto complain_every = 1min;
constexpr std::uint64_t most_unstored_letters = 10'000;
constexpr unsigned most_doublings = 20;
constexpr std::uint64_t skipped_at_once = 1000;
}  // namespace

SinkRunner::SinkRunner(const SinkConfig& config, std::unique_ptr<sink::Sink> sink, Start start, Store store)
    : config_(config),
      start_(std::move(start)),
      store_(std::move(store)),
      sink_(std::move(sink)),
      unstored_letters_(std::make_shared<std::atomic<std::uint64_t>>(0)) {
    cursor_ = start_.cursor.value_or(config_.from_oldest ? 0 : start_.last_seq);
    scanned_ = left_ = cursor_;
    tell_cursor_ = !start_.cursor;
    last_seq_ = start_.last_seq;
    delivery_.sink = config_.name;
    status_.name = config_.name;
    status_.kind = config_.kind->name;
    status_.url = config_.url.substr(0, config_.url.find_first_of("?#"));  // where some have a secret
    status_.state = "starting";
}

SinkRunner::~SinkRunner() {
    stop();
}

void SinkRunner::start() {
    thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
}

void SinkRunner::ask_to_stop() {
    thread_.request_stop();
}

void SinkRunner::stop() {
    if (!thread_.joinable()) return;
    thread_.request_stop();
    thread_.join();
}

// --- any thread
// ---------------------------------------------------------------------------------------------

SinkStatus SinkRunner::status() const {
    std::lock_guard lock(mutex_);
    return status_;
}

void SinkRunner::committed() {
    std::lock_guard lock(mutex_);
    news_ = true;
    wake_.notify_one();
}

void SinkRunner::retry() {
    std::lock_guard lock(mutex_);
    orders_.retry = has_orders_ = true;
    wake_.notify_one();
}

Result<void> SinkRunner::skip() {
    std::lock_guard lock(mutex_);
    if (status_.trouble.empty())
        return gantry::fail(fmt::format("nothing blocks the sink \"{}\"", config_.name),
                            "only an event that its destination does not take can be skipped");
    orders_.skip = orders_.retry = has_orders_ = true;
    wake_.notify_one();
    return {};
}

void SinkRunner::offer_again(std::vector<journal::Seq> letters) {
    std::lock_guard lock(mutex_);
    orders_.all_again = orders_.all_again || letters.empty();
    orders_.again.insert(letters.begin(), letters.end());
    orders_.retry = has_orders_ = true;
    wake_.notify_one();
}

void SinkRunner::discard(std::vector<journal::Seq> letters) {
    std::lock_guard lock(mutex_);
    orders_.discard_all = orders_.discard_all || letters.empty();
    orders_.discard.insert(letters.begin(), letters.end());
    has_orders_ = true;
    wake_.notify_one();
}

// --- the runner's thread
// ------------------------------------------------------------------------------------

void SinkRunner::run(const std::stop_token& stop) {
    while (!stop.stop_requested()) {
        auto now = link::read_clocks();
        if (!reader_) {
            if (auto opened = open_store(); !opened) {
                fail(opened.error().text(), {}, false, now);
                publish(now);
                // Orders need the store, too: they wait for it.
                std::unique_lock lock(mutex_);
                wake_.wait_until(lock, stop, not_before_, [] { return false; });
                continue;
            }
        }
        take_orders(now);
        if (letters_changed_) count_letters();
        leave_progress(now, false);
        publish(now);
        if (now.steady < not_before_) {
            rest(stop, not_before_, false);
        } else if (unstored_letters_->load() > most_unstored_letters) {
            rest(stop, now.steady + leave_every, false);
        } else if (!letters_.empty() && now.steady >= letters_at_) {
            offer_letters(stop);
        } else if (!line_.empty() || refill(now)) {
            offer_line(stop);
        } else {
            if (now.steady >= next_idle_) idle(now, stop);
            auto until = cursor_ != left_ || tell_cursor_ ? std::min(next_idle_, next_leave_) : next_idle_;
            if (!letters_.empty()) until = std::min(until, letters_at_);
            if (now.steady >= not_before_) rest(stop, until, true);
        }
    }
    leave_progress(link::read_clocks(), true);
    sink_.reset();
}

void SinkRunner::idle(Now now, const std::stop_token& stop) {
    next_idle_ = now.steady + idle_every;
    try {
        sink_->idle({.until = now.steady + idle_every, .stop = stop});
    } catch (const std::exception& error) {  // as in deliver()
        fail(printable(error.what()), {}, false, now);
    }
}

Result<void> SinkRunner::open_store() {
    auto opened = journal::Reader::open(start_.store);
    if (!opened) return tl::unexpected(opened.error().error);
    auto prefixes = (*opened)->id_prefixes();
    if (!prefixes) return tl::unexpected(prefixes.error().error);
    prefixes_ = std::move(*prefixes);
    reader_ = std::move(*opened);
    return {};
}

void SinkRunner::rest(const std::stop_token& stop, Steady until, bool for_news) {
    std::unique_lock lock(mutex_);
    wake_.wait_until(lock, stop, until, [&] { return has_orders_ || (for_news && news_); });
}

void SinkRunner::take_orders(Now now) {
    Orders orders;
    {
        std::lock_guard lock(mutex_);
        if (!std::exchange(has_orders_, false)) return;
        orders = std::exchange(orders_, {});
    }
    if (orders.retry) {
        not_before_ = letters_at_ = now.steady;
        failures_ = 0;
    }
    if (orders.skip) skip_blocker(now);
    if (orders.discard_all || !orders.discard.empty()) discard_letters(orders);
    if (orders.all_again || !orders.again.empty()) queue_letters(orders);
}

void SinkRunner::skip_blocker(Now now) {
    std::string trouble;
    {
        std::lock_guard lock(mutex_);
        trouble = status_.trouble;
    }
    switch (std::exchange(blocker_, Blocker::none)) {
        case Blocker::none:
            return;
        case Blocker::line:
            if (line_.empty()) return;
            bury(line_.front(), fmt::format("skipped by hand: {}", trouble), now.wall);
            line_.pop_front();
            cursor_ = line_.empty() ? scanned_ : line_.front().event.seq - 1;
            return;
        case Blocker::letter:
            if (!letters_.empty()) letters_.pop_front();
            return;
        case Blocker::unreadable:
            return skip_unreadable();
    }
}

// The row that cannot be read, and those right behind it that cannot either: damaged reads are many in one.
void SinkRunner::skip_unreadable() {
    auto is_unreadable = [this](journal::Seq seq) {
        journal::Filter filter;
        filter.after = seq - 1;
        filter.up_to = seq;
        filter.types = config_.selection.types;
        auto read = reader_->query(filter, [](auto&) { return true; });
        return !read && read.error().kind == journal::StoreError::Kind::corrupt;
    };
    auto before = scanned_;
    while (scanned_ < last_seq_ && scanned_ - before < skipped_at_once && is_unreadable(scanned_ + 1))
        ++scanned_;
    if (scanned_ == before) return;
    cursor_ = scanned_;
    log::warn("sink", "{}: events {} to {}, which cannot be read, are skipped by hand", config_.name,
              before + 1, scanned_);
}

void SinkRunner::queue_letters(const Orders& orders) {
    std::set<journal::Seq> wanted = orders.again;
    if (orders.all_again)
        (void)reader_->dead_letters(config_.name, 0, [&](const journal::DeadLetter& letter) {
            wanted.insert(letter.seq);
            return true;
        });
    for (auto seq : letters_)
        wanted.insert(seq);
    letters_.assign(wanted.begin(), wanted.end());
}

void SinkRunner::discard_letters(const Orders& orders) {
    std::set<journal::Seq> gone = orders.discard;
    if (orders.discard_all)
        (void)reader_->dead_letters(config_.name, 0, [&](const journal::DeadLetter& letter) {
            gone.insert(letter.seq);
            return true;
        });
    std::erase_if(letters_, [&](auto seq) { return gone.contains(seq); });
    delivery_.letters_gone.insert(delivery_.letters_gone.end(), gone.begin(), gone.end());
    log::info("sink", "{}: {} dead letters thrown away by hand", config_.name, gone.size());
}

void SinkRunner::settle_trouble(const sink::Outcome& outcome, Blocker blocker, bool progress, Now now) {
    bool kept = std::ranges::count(outcome.fates, sink::Fate::kept) != 0 || !outcome.trouble.empty();
    if (kept)
        fail(outcome.trouble.empty() ? "the destination did not confirm all events"
                                     : printable(outcome.trouble),
             outcome.retry_after, progress, now);
    else
        recover(now);
    if (kept) blocker_ = blocker;
}

void SinkRunner::fail(std::string trouble, std::optional<std::chrono::milliseconds> at_least, bool progress,
                      Now now) {
    if (progress) failures_ = 0;
    auto doublings = std::min(failures_++, most_doublings);
    auto wait =
        std::min<std::chrono::microseconds>(config_.retry_min * (1ll << doublings), config_.retry_max);
    // Many gateways that lost one broker must not all come back in the same moment.
    std::uniform_real_distribution<double> around(0.8, 1.2);
    wait = std::chrono::duration_cast<std::chrono::microseconds>(wait * around(dice_));
    wait = std::min(wait, config_.retry_max);
    if (at_least) wait = std::max<std::chrono::microseconds>(wait, *at_least);
    not_before_ = now.steady + wait;
    std::lock_guard lock(mutex_);
    if (trouble != said_trouble_ && now.steady >= complain_at_) {
        log::warn("sink", "{}: {}; its events wait in the store", config_.name, trouble);
        complain_at_ = now.steady + complain_every;
        said_trouble_ = trouble;
    }
    if (status_.trouble.empty()) status_.trouble_since = now.wall;
    status_.trouble = std::move(trouble);
    status_.next_try = now.wall + wait;
}

void SinkRunner::recover(Now now) {
    failures_ = 0;
    blocker_ = Blocker::none;
    std::lock_guard lock(mutex_);
    status_.next_try.reset();
    if (status_.trouble.empty()) return;
    if (!std::exchange(said_trouble_, {}).empty())
        log::info("sink", "{}: delivers again after {}", config_.name,
                  approximate(now.wall - *status_.trouble_since));
    status_.trouble.clear();
    status_.trouble_since.reset();
}

// What is left of a trouble is over, unless it is that of letters that are still to go.
void SinkRunner::nothing_waits(Now now) {
    if (blocker_ != Blocker::letter || letters_.empty()) recover(now);
}

// The cursor goes to the writer now and then, dead letters at once, and always both together.
void SinkRunner::leave_progress(Now now, bool at_once) {
    if (cursor_ != left_ || tell_cursor_) delivery_.cursor = cursor_;
    if (delivery_.empty()) return;
    bool letters = !delivery_.letters.empty() || !delivery_.letters_gone.empty();
    if (!letters && !at_once && now.steady < next_leave_) return;
    next_leave_ = now.steady + leave_every;
    left_ = cursor_;
    tell_cursor_ = false;
    if (letters) {
        letters_changed_ = true;
        auto count = delivery_.letters.size();
        unstored_letters_->fetch_add(count + 1);
        delivery_.stored = [pending = unstored_letters_, count] { pending->fetch_sub(count + 1); };
    }
    store_(std::exchange(delivery_, {.sink = config_.name}));
}

void SinkRunner::count_letters() {
    if (unstored_letters_->load() != 0) return;  // the store does not show them yet
    auto count = reader_->count_dead_letters(config_.name);
    if (!count) return;
    letters_changed_ = false;
    std::lock_guard lock(mutex_);
    status_.dead_letters = *count;
}

void SinkRunner::publish(Now now) {
    auto connected = sink_->connected();
    if (reader_)
        if (auto last = reader_->last_seq()) last_seq_ = *last;
    std::uint64_t bytes = 0;
    for (auto& lent : line_)
        bytes += lent.payload.size();
    std::lock_guard lock(mutex_);
    status_.connected = connected;
    status_.cursor = cursor_;
    status_.behind = last_seq_ - std::min(last_seq_, cursor_);
    status_.backlog_bytes = bytes;
    status_.oldest = line_.empty() ? std::nullopt : std::optional(line_.front().event.time);
    if (!status_.trouble.empty() && status_.next_try && *status_.next_try > now.wall)
        status_.state = fmt::format("{} events wait, next try in {}: {}", status_.behind,
                                    approximate(*status_.next_try - now.wall), status_.trouble);
    else if (!status_.trouble.empty())
        status_.state = fmt::format("{} events wait, trying: {}", status_.behind, status_.trouble);
    else if (status_.behind != 0)
        status_.state = fmt::format("delivering, {} events behind", status_.behind);
    else
        status_.state = connected ? "up to date" : "up to date, not connected";
}

}  // namespace gantry::gateway
