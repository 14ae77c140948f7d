#include "gateway/writer.hpp"

#include <algorithm>

#include "base/failpoint.hpp"
#include "base/log.hpp"
#include "link/link.hpp"

namespace gantry::gateway {

namespace {
constexpr std::size_t ring_places = 4096;
constexpr std::size_t ring_weight = 32u << 20;  // bytes a loop may have waiting
constexpr std::size_t batch_reads = 50'000;     // a commit of more would only hold up its first
constexpr std::size_t batch_bytes = 16u << 20;
constexpr auto retry_store = 250ms;
constexpr std::size_t stale_records_a_turn = 5'000;

constexpr auto say_again = 1min;

std::size_t weight_of(const Notice& notice) {
    auto weight = sizeof(Notice);
    if (const auto* fault = std::get_if<FaultNotice>(&notice))
        weight += fault->text.size() + fault->bytes.size();
    else if (const auto* overflow = std::get_if<OverflowNotice>(&notice))
        weight += overflow->scope.size();
    return weight;
}

// All of it: a reader that sends nothing but faults must not get past the bounds.
std::size_t weight_of(const Item& item) {
    auto& report = item.report;
    auto weight = sizeof(Item) + report.observations.size() * sizeof(Observation) + report.data.size() +
                  item.reason.size() + (report.mark ? report.mark->size() : 0);
    for (auto& notice : report.notices)
        weight += weight_of(notice);
    return weight;
}
}  // namespace

Writer::Channel::Channel(Writer& writer, std::function<void(std::vector<Answer>)> answer)
    : writer_(writer), ring_(ring_places, ring_weight), answer_(std::move(answer)) {}

bool Writer::Channel::push(Item& item) {
    auto weight = weight_of(item);
    if (!ring_.push(item, weight)) return false;
    writer_.wake();
    return true;
}

// The writer says that it sleeps, looks at what there is once more, and only then sleeps; so either it saw
// what has just been put there, or this sees that it sleeps.
void Writer::wake() {
    if (!asleep_.load(std::memory_order_seq_cst)) return;
    std::lock_guard lock(sleep_mutex_);
    wake_.notify_one();
}

void Writer::store_job(journal::JobRow row) {
    {
        std::lock_guard lock(jobs_mutex_);
        jobs_.push_back(std::move(row));
        jobs_wait_.store(true, std::memory_order_seq_cst);
    }
    wake();
}

void Writer::store_reading(std::string reader, bool reading) {
    {
        std::lock_guard lock(jobs_mutex_);
        reading_.emplace_back(std::move(reader), reading);
        jobs_wait_.store(true, std::memory_order_seq_cst);
    }
    wake();
}

// A cursor replaces the one before it that comes alone: a store that takes nothing must not make them pile
// up.
void Writer::store_delivery(Delivery delivery) {
    {
        std::lock_guard lock(jobs_mutex_);
        auto replaced = [&](const Delivery& each) {
            return each.sink == delivery.sink && each.letters.empty() && each.letters_gone.empty() &&
                   !each.stored;
        };
        if (delivery.cursor) std::erase_if(deliveries_, replaced);
        deliveries_.push_back(std::move(delivery));
        jobs_wait_.store(true, std::memory_order_seq_cst);
    }
    wake();
}

Writer::Writer(std::unique_ptr<journal::Journal> journal, Roster& roster, Options options)
    : journal_(std::move(journal)),
      roster_(roster),
      options_(std::move(options)),
      gateway_id_(journal_->gateway_id()),
      presence_(2'000'000, journal_->max_presence_id() + 1) {
    batch_.next_seq = journal_->last_seq() + 1;
}

Writer::~Writer() {
    stop();
}

Writer::Channel& Writer::add_channel(std::function<void(std::vector<Answer>)> answer) {
    return *channels_.emplace_back(std::make_unique<Channel>(*this, std::move(answer)));
}

Result<void> Writer::start(Now now) {
    auto loaded = journal_->load_presence([&](const journal::PresenceRow& row) { restore(row, now); });
    if (!loaded) return tl::unexpected(loaded.error().error);
    next_housekeeping_ = now.steady + 1s;
    age_clock_.emplace(journal_->last_commit(), now);
    publish();
    thread_ = std::thread([this] { run(); });
    return {};
}

void Writer::stop() {
    if (!thread_.joinable()) return;
    {
        std::lock_guard lock(sleep_mutex_);
        stopping_ = true;
        wake_.notify_one();
    }
    thread_.join();
}

void Writer::run() {
    take_turns();
    say_dropped(link::read_clocks().steady);
}

void Writer::take_turns() {
    for (;;) {
        // Read before the rings: what was pushed before stop() is taken in the last round.
        bool last_round = stopping_;
        bool took = gather();
        auto now = link::read_clocks();
        if (took && batch_.reads.size() < 1000 && !last_round) {
            // A first few items: wait a moment for company, so that a trickle does not cost a sync each.
            std::this_thread::sleep_for(options_.group_window);
            gather();
            now = link::read_clocks();
        }
        bool all_taken = nothing_waits();
        advance_presence(now);
        if (now.steady >= next_housekeeping_) housekeeping(now);
        if (!commit(now)) return;  // told to stop while nothing could be stored
        if (last_round && all_taken) return;
        if (compacting_) compact_slice();
        if (!took && !stopping_ && !compacting_) {
            auto due = presence_.deadline();
            if (due) *due += stalled_for_;
            sleep_until(due ? std::min(*due, next_housekeeping_) : next_housekeeping_);
        }
    }
}

void Writer::sleep_until(std::optional<Steady> deadline) {
    std::unique_lock lock(sleep_mutex_);
    asleep_.store(true, std::memory_order_seq_cst);
    if (!stopping_ && !compacting_.load(std::memory_order_seq_cst) && nothing_waits())
        wake_.wait_until(lock, deadline.value_or(Steady::max()));
    asleep_.store(false, std::memory_order_seq_cst);
}

bool Writer::nothing_waits() const {
    return !jobs_wait_.load(std::memory_order_seq_cst) &&
           std::ranges::all_of(channels_, [](auto& channel) { return channel->ring_.empty(); });
}

bool Writer::gather_jobs() {
    if (!jobs_wait_.load(std::memory_order_seq_cst)) return false;
    std::lock_guard lock(jobs_mutex_);
    jobs_wait_ = false;
    std::ranges::move(jobs_, std::back_inserter(batch_.jobs));
    std::ranges::move(reading_, std::back_inserter(batch_.reading));
    jobs_.clear();
    reading_.clear();
    take_deliveries();
    return true;
}

// With jobs_mutex_.
void Writer::take_deliveries() {
    for (auto& each : deliveries_) {
        if (each.cursor) batch_.cursors.emplace_back(each.sink, *each.cursor);
        std::ranges::move(each.letters, std::back_inserter(batch_.dead_letters));
        for (auto seq : each.letters_gone)
            batch_.dead_letters_deleted.emplace_back(each.sink, seq);
        if (each.stored) to_tell_.push_back(std::move(each.stored));
    }
    deliveries_.clear();
}

bool Writer::gather() {
    bool took = gather_jobs();
    std::size_t bytes = 0;
    Item item;
    // Each loop comes first in its turn, or one that is never empty would starve the others.
    for (std::size_t i = 0; i < channels_.size(); ++i) {
        auto& channel = *channels_[(first_channel_ + i) % channels_.size()];
        while (batch_.reads.size() < batch_reads && bytes < batch_bytes && channel.ring_.pop(item)) {
            bytes += weight_of(item);
            take(channel, item);
            took = true;
        }
    }
    if (took) ++first_channel_;
    return took;
}

// Deadlines may only fall when every sighting before them has been taken: with a queue behind us time stands
// at the newest report taken from it.
void Writer::advance_presence(Now now) {
    auto until = now;
    for (auto& channel : channels_) {
        if (channel->ring_.empty() || channel->taken_up_to_ >= until.steady) continue;
        until.wall -=
            std::chrono::duration_cast<std::chrono::microseconds>(until.steady - channel->taken_up_to_);
        until.steady = channel->taken_up_to_;
    }
    presence_.time_passed(presence_time(until), transitions_);
    take_transitions();
}

bool Writer::commit(Now now) {
    presence_.take_changes(changes_);
    for (auto id : changes_.stored)
        store_presence(id);
    batch_.presence_deleted.insert(batch_.presence_deleted.end(), changes_.deleted.begin(),
                                   changes_.deleted.end());
    changes_.stored.clear();
    changes_.deleted.clear();

    // Neighbours on a page are written together.
    std::ranges::sort(batch_.presence, {}, &journal::PresenceRow::id);

    // A read of a tag that is present anyway leaves no row behind; what covers it after a crash is the time
    // of the commit. A report that is to be acknowledged brings a mark, so there is one; with nothing at all
    // to store nothing was promised, and no sync is spent on it.
    tell_dropped(now.wall);
    if (batch_.empty()) {
        answer_all();
        return true;
    }
    if (failpoint("ack_before_commit")) answer_all();
    if (failpoint("slow_commit")) std::this_thread::sleep_for(20ms);

    batch_.time = now.wall;
    std::vector<JobId> jobs;
    for (auto& row : batch_.jobs)
        jobs.push_back(row.id);
    std::size_t events = 0;
    Hold hold;
    hold.since = now.steady;
    while (true) {
        events = batch_.events.size() + batch_.reads.size();
        auto done = journal_->commit(batch_);
        if (done) break;
        if (!wait_for_store(done.error(), hold)) return false;
        batch_.time = link::read_clocks().wall;
        tell_dropped(batch_.time);
    }
    overflow_at_.reset();
    if (hold.held) {
        auto after = link::read_clocks();
        stalled_for_ += after.steady - hold.since;
        log::info(
            "store", "the store takes data again after {}",
            approximate(std::chrono::duration_cast<std::chrono::microseconds>(after.steady - hold.since)));
        publish();
        if (hold.long_held && options_.store_is_away) options_.store_is_away(false);
    }
    events_ += events;
    ++commits_;
    for (auto& [index, mark] : new_marks_) {
        readers_[index].known = {};
        readers_[index].known.mark = std::move(mark);
    }
    new_marks_.clear();
    die_at("committed");  // stored, and no reader knows
    answer_all();
    if (!jobs.empty() && options_.jobs_stored) options_.jobs_stored(jobs);
    for (auto& tell : std::exchange(to_tell_, {}))
        tell();
    if (events != 0 && options_.committed) options_.committed();
    return true;
}

// Nothing can be stored: nothing is answered, so the readers keep their data. Mends what can be mended, or
// waits a moment. False: told to stop.
bool Writer::wait_for_store(const journal::StoreError& error, Hold& hold) {
    if (error.kind == journal::StoreError::Kind::full) {
        store_deliveries();
        if (make_room(hold)) return true;
    }
    hold.held = true;
    set_trouble(error.error.what);
    if (hold.is_new(error.error.what))
        log::error("store", "{}; readers are held until it works again", error.error.text());
    for (;;) {
        std::unique_lock lock(sleep_mutex_);
        wake_.wait_for(lock, retry_store, [this] { return stopping_.load(); });
        lock.unlock();
        say_that_it_is_away(hold);
        if (stopping_) {
            log::error("store", "stopping with data that could not be stored; it was not acknowledged");
            return false;
        }
        if (error.kind == journal::StoreError::Kind::full) return true;
        auto reopened = journal_->reopen();
        if (reopened) return true;
        // The cause stays in front; this is why it cannot be mended.
        auto& why = reopened.error().error;
        set_trouble(why.what == error.error.what ? why.what : error.error.what + "; " + why.what);
        if (hold.is_new(why.what)) log::error("store", "{}", why.text());
    }
}

void Writer::say_that_it_is_away(Hold& hold) {
    if (hold.long_held || link::read_clocks().steady - hold.since < options_.patience) return;
    hold.long_held = true;
    if (options_.store_is_away) options_.store_is_away(true);
}

// What has been delivered while the store is full may go, so the cursors must not wait behind events that
// find no room. They need none: each takes the place of the one before. The time of the commit stays: it says
// until when the tags present were seen, and what was seen since is not stored.
void Writer::store_deliveries() {
    {
        std::lock_guard lock(jobs_mutex_);
        take_deliveries();
    }
    journal::Batch only;
    only.time = journal_->last_commit();
    only.next_seq = journal_->last_seq() + 1;
    only.cursors.swap(batch_.cursors);
    only.dead_letters.swap(batch_.dead_letters);
    only.dead_letters_deleted.swap(batch_.dead_letters_deleted);
    auto done = journal_->commit(only);
    if (done)
        for (auto& tell : std::exchange(to_tell_, {}))
            tell();
    only.cursors.swap(batch_.cursors);
    only.dead_letters.swap(batch_.dead_letters);
    only.dead_letters_deleted.swap(batch_.dead_letters_deleted);
}

void Writer::set_trouble(std::string trouble) {
    std::lock_guard lock(stats_mutex_);
    stats_.trouble = std::move(trouble);
}

// One slice. True: another try is worth it at once. That ends where max_size is not what is short: a disk
// that others fill must not empty the store in no time.
bool Writer::make_room(Hold& hold) {
    auto now = link::read_clocks();
    auto retained = journal_->retain(age_clock_->look(now));
    if (!retained) return false;
    log_retained(*retained, now.steady);
    if (retained->more) return true;
    return retained->deleted + retained->dropped != 0 && !std::exchange(hold.made_room, true);
}

void Writer::answer_all() {
    for (auto& channel : channels_) {
        if (channel->pending_.empty()) continue;
        for (auto& answer : channel->pending_) {
            if (answer.kind != Item::Kind::reader_up && answer.kind != Item::Kind::ask_known) continue;
            auto& state = readers_[answer.reader];
            answer.known = state.known;
        }
        channel->answer_(std::exchange(channel->pending_, {}));
    }
}

void Writer::housekeeping(Now now) {
    next_housekeeping_ = now.steady + 1s;
    stale_.clear();
    presence_.take_stale(stale_records_a_turn, stale_);
    for (auto id : stale_)
        store_presence(id);
    auto retained = journal_->retain(age_clock_->look(now));
    if (!retained) {
        auto text = retained.error().error.text();
        if (text != retain_error_said_ || now.steady >= retain_error_again_) {
            log::error("store", "old events could not be deleted: {}", text);
            retain_error_said_ = std::move(text);
            retain_error_again_ = now.steady + say_again;
        }
    } else {
        log_retained(*retained, now.steady);
        if (retained->more) next_housekeeping_ = now.steady + 20ms;
    }
    if (now.steady >= dropped_again_) say_dropped(now.steady);
    publish();
}

void Writer::log_retained(const journal::Retained& retained, Steady now) {
    if (retained.dead_letters != 0)
        log::warn("store", "there are too many dead letters: the {} oldest are deleted",
                  retained.dead_letters);
    if (retained.dropped == 0) return;
    if (dropped_unsaid_ == 0 || retained.dropped_since < dropped_since_)
        dropped_since_ = retained.dropped_since;
    dropped_unsaid_ += retained.dropped;
    if (now >= dropped_again_) say_dropped(now);
}

void Writer::say_dropped(Steady now) {
    if (dropped_unsaid_ == 0) return;
    log::warn("store", "the store is full: {} events dropped, the oldest of {}",
              std::exchange(dropped_unsaid_, 0), to_rfc3339(dropped_since_));
    dropped_again_ = now + say_again;
}

// What was dropped because the user chose so is told by one event of the batch under way, also what a process
// before this one dropped. Until that event is stored the journal keeps the count.
void Writer::tell_dropped(Wall now) {
    auto untold = journal_->untold();
    if (untold.count == 0) return;
    if (!overflow_at_) {
        overflow_at_ = batch_.events.size();
        add_event(event::Type::overflow, now).scope = journal::store_scope;
    }
    auto& event = batch_.events[*overflow_at_];
    event.count = untold.count;
    event.since = untold.since;
}

void Writer::publish() {
    auto size = journal_->size();
    std::lock_guard lock(stats_mutex_);
    stats_ = {.events = events_,
              .reads = reads_,
              .commits = commits_,
              .last_seq = journal_->last_seq(),
              .present = presence_.present(),
              .size = size,
              .trouble = {}};
}

void Writer::compact() {
    {
        std::lock_guard lock(stats_mutex_);
        if (compaction_.running) return;
        compaction_ = {.number = compaction_.number + 1, .running = true};
    }
    compacting_.store(true, std::memory_order_seq_cst);
    wake();
}

Compaction Writer::compaction() const {
    std::lock_guard lock(stats_mutex_);
    return compaction_;
}

void Writer::compact_slice() {
    auto before = journal_->size().file_bytes;
    auto more = journal_->compact();
    bool ends = !more || !*more;
    auto after = journal_->size().file_bytes;
    std::lock_guard lock(stats_mutex_);
    if (compaction_.bytes_before == 0) compaction_.bytes_before = before;
    compaction_.bytes_after = after;
    compaction_.running = !ends;
    if (!more) compaction_.error = more.error().error;
    if (ends) compacting_ = false;
}

Writer::Stats Writer::stats() const {
    std::lock_guard lock(stats_mutex_);
    return stats_;
}

}  // namespace gantry::gateway
