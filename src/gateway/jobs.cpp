#include "gateway/jobs.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "base/log.hpp"

namespace gantry::gateway {

namespace {
// A driver ends its jobs at their deadlines by itself; one that does not must not keep them for ever.
constexpr auto patience = 5s;

// Done twice these are twice the trouble, and nothing tells whether they were done: a gate that was opened
// for a moment must not open a second time for nobody.
bool never_again(const Job& job) {
    if (const auto* set = std::get_if<SetOutputs>(&job))
        return std::ranges::any_of(set->changes, [](auto& change) { return change.for_ms != 0; });
    return std::holds_alternative<RestartReader>(job) || std::holds_alternative<Execute>(job);
}

std::optional<bool> wanted_reading(const Job& job) {
    if (std::holds_alternative<StartReading>(job)) return true;
    if (std::holds_alternative<StopReading>(job)) return false;
    return {};
}

// The passwords of a tag.
bool reads_secrets(const Job& job) {
    const auto* read = std::get_if<ReadTag>(&job);
    return read != nullptr && read->bank == Bank::reserved;
}
}  // namespace

void Jobs::restore(std::vector<journal::JobRow> rows, Wall now) {
    std::lock_guard lock(mutex_);
    std::ranges::sort(rows, {}, &journal::JobRow::id);
    for (auto& row : rows) {
        auto job = status_of(row);
        next_ = std::max(next_, job.id + 1);
        bool open = job.state == JobState::queued || job.state == JobState::running;
        if (open) {
            bool sent = job.state == JobState::running;
            job.state = sent ? JobState::unknown : JobState::cancelled;
            job.text = sent ? "the gateway restarted while it was under way: what the reader did is not known"
                            : "the gateway restarted; it was never sent";
        }
        if (open || !job.ended) {  // the latter: its row was damaged
            job.ended = now;
            store(row_of(job));
        }
        keep(std::move(job));
    }
}

Result<JobId> Jobs::submit(const Reader& reader, Job job, std::chrono::milliseconds timeout, Now now,
                           bool waits) {
    std::lock_guard lock(mutex_);
    if (stopping_) return fail("the gateway is stopping");
    if (rows_waiting_ >= max_kept)
        return fail("the store takes no data, so jobs cannot be kept", "see `gantry reader list` for why");
    auto& state = readers_[reader.index];
    if (open_.size() >= max_open || state.open >= max_open_of_a_reader)
        return fail(fmt::format("too many jobs are waiting for {}",
                                open_.size() >= max_open ? "readers" : reader.name),
                    "wait until some have ended, or cancel them");
    auto id = next_++;
    auto& open = open_[id];
    open.status.id = id;
    open.status.reader = reader.name;
    open.status.op = op_name(job);
    open.status.detail = describe(job);
    open.status.created = now.wall;
    open.status.deadline = now.wall + timeout;
    open.reader = reader.index;
    open.deadline = now.steady + timeout;
    open.waits = waits;
    open.secret = reads_secrets(job);
    open.wants_reading = wanted_reading(job);
    if (open.wants_reading) {
        if (!state.settled_reading) state.settled_reading = host_.reading(reader.index);
        host_.set_reading(reader.index, *open.wants_reading);
    }
    open.job = std::make_shared<const Job>(std::move(job));
    ++state.open;
    if (state.line)
        start(open);
    else
        store(open);
    host_.wake_at(due(open));
    return id;
}

void Jobs::store(const journal::JobRow& row) {
    ++rows_waiting_;
    host_.store(row);
}

void Jobs::store(Open& job) {
    ++job.unstored;
    auto row = row_of(job.status);
    // Whatever this process still hopes to do with it: it was sent once, and a crash must not forget that.
    if (job.was_sent && job.status.state == JobState::queued) row.state = to_text(JobState::running);
    store(row);
}

void Jobs::start(Open& job) {
    job.status.state = JobState::running;
    job.status.text.clear();
    store(job);
}

void Jobs::send(Open& job) {
    auto state = readers_.find(job.reader);
    if (state == readers_.end() || !state->second.line) return;
    job.on_line = true;
    job.line = state->second.line->id;
    job.again = std::exchange(job.was_sent, true);
    state->second.line->run({.id = job.status.id, .deadline = job.deadline, .again = job.again}, job.job);
}

void Jobs::stored(const std::vector<JobId>& ids, Now now) {
    std::lock_guard lock(mutex_);
    rows_waiting_ -= std::min(rows_waiting_, ids.size());
    for (auto id : ids) {
        auto job = open_.find(id);
        if (job == open_.end()) continue;
        auto& open = job->second;
        if (--open.unstored != 0 || open.on_line || open.status.state != JobState::running) continue;
        if (now.steady >= open.deadline) continue;  // time_passed() ends it
        send(open);
    }
    changed_.notify_all();
}

void Jobs::reader_up(std::uint32_t reader, JobLine line) {
    std::lock_guard lock(mutex_);
    readers_[reader].line = std::move(line);
    if (stopping_) return;
    for (auto& [id, job] : open_)
        if (job.reader == reader && job.status.state == JobState::queued) start(job);
}

void Jobs::reader_down(std::uint32_t reader, std::uint64_t line) {
    std::lock_guard lock(mutex_);
    auto state = readers_.find(reader);
    if (state == readers_.end() || !state->second.line || state->second.line->id != line) return;
    state->second.line.reset();
    if (state->second.open == 0) {
        readers_.erase(state);
        return;
    }
    for (auto& [id, job] : open_)
        if (job.reader == reader && job.status.state == JobState::running && !job.on_line)
            job.status.state = JobState::queued;
}

void Jobs::ended(JobId id, JobResult result, bool link_broke, Now now) {
    using Status = JobResult::Status;
    std::lock_guard lock(mutex_);
    auto found = open_.find(id);
    if (found == open_.end() || !found->second.on_line) return;
    auto& job = found->second;
    job.on_line = false;
    bool unsent = result.status == Status::cancelled;
    bool may_run_again =
        link_broke && (unsent || (result.status == Status::unknown && !never_again(*job.job)));
    if (may_run_again && !job.cancel_asked && !stopping_ && now.steady < job.deadline) {
        if (unsent) job.was_sent = job.again;
        job.status.state = JobState::queued;
        job.status.text = "the link broke; it runs when the reader is back";
        log::info("jobs", "{}: {} (job {}) waits for the reader to come back", job.status.reader,
                  job.status.op, id);
        auto state = readers_.find(job.reader);
        bool is_back = state != readers_.end() && state->second.line && state->second.line->id != job.line;
        if (is_back) start(job);
        changed_.notify_all();
        return;
    }
    if (unsent && job.again) {
        // The driver speaks for its own link alone: over an earlier one it was sent.
        end(found, JobState::unknown,
            job.cancel_asked ? "cancelled after the link broke: what the reader did is not known"
                             : "the link broke under it: what the reader did is not known",
            {}, now.wall);
        return;
    }
    end(found, state_of(result.status), std::move(result.text), std::move(result.values), now.wall);
}

void Jobs::end(OpenJobs::iterator job, JobState state, std::string text, wire::Fields values, Wall now) {
    auto node = open_.extract(job);
    auto& open = node.mapped();
    open.status.state = state;
    open.status.text = std::move(text);
    bool values_kept = !open.secret || open.waits || values.empty();
    if (values_kept)
        open.status.values = std::move(values);
    else if (open.status.text.empty())
        open.status.text = "what it read is secret and goes only to who waits for it";
    open.status.ended = now;
    bool came_to_nothing =
        state == JobState::failed || state == JobState::unsupported || state == JobState::cancelled;
    if (open.wants_reading) settle_reading(open, came_to_nothing);
    auto reader = readers_.find(open.reader);
    if (reader != readers_.end() && --reader->second.open == 0 && !reader->second.line)
        readers_.erase(reader);
    store(row_of(open.status));
    if (open.secret && !open.status.values.empty()) {
        secrets_[open.status.id] = std::exchange(open.status.values, {});
        if (secrets_.size() > max_open) secrets_.erase(secrets_.begin());
    }
    keep(std::move(open.status));
    changed_.notify_all();
}

// Of several jobs that overlap the newest open one says what is wanted; when none is left, what the newest of
// those that were not refused wanted.
void Jobs::settle_reading(const Open& job, bool came_to_nothing) {
    auto& state = readers_[job.reader];
    auto id = job.status.id;
    if (!came_to_nothing && id > state.settled_by) {
        state.settled_reading = job.wants_reading;
        state.settled_by = id;
        host_.keep_reading(job.reader, *job.wants_reading);
    }
    for (auto it = open_.rbegin(); it != open_.rend(); ++it) {
        if (it->second.reader != job.reader || !it->second.wants_reading) continue;
        bool newer = it->first > state.settled_by || !state.settled_reading;
        host_.set_reading(job.reader, newer ? *it->second.wants_reading : *state.settled_reading);
        return;
    }
    if (state.settled_reading) host_.set_reading(job.reader, *state.settled_reading);
    state.settled_reading.reset();
    state.settled_by = 0;
}

void Jobs::keep(JobStatus status) {
    ended_.push_back(std::move(status));
    if (ended_.size() > max_kept) ended_.pop_front();
    if (ended_.size() > max_values) ended_[ended_.size() - 1 - max_values].values = {};
}

bool Jobs::cancel(JobId id, Now now) {
    std::lock_guard lock(mutex_);
    auto found = open_.find(id);
    if (found == open_.end()) return find_locked(id) != nullptr;
    auto& job = found->second;
    if (!job.on_line) {
        end(found, job.was_sent ? JobState::unknown : JobState::cancelled,
            job.was_sent ? "cancelled after the link broke: what the reader did is not known"
                         : "cancelled; it was never sent",
            {}, now.wall);
        return true;
    }
    job.cancel_asked = true;
    auto state = readers_.find(job.reader);
    if (state != readers_.end() && state->second.line) state->second.line->cancel(id);
    return true;
}

Steady Jobs::due(const Open& job) const {
    return job.on_line ? job.deadline + patience : job.deadline;
}

void Jobs::time_passed(Now now) {
    std::lock_guard lock(mutex_);
    auto next = Steady::max();
    for (auto it = open_.begin(); it != open_.end();) {
        auto job = it++;
        auto& open = job->second;
        if (due(open) > now.steady) {
            next = std::min(next, due(open));
        } else if (open.on_line) {
            end(job, JobState::timed_out, "no answer before the deadline", {}, now.wall);
        } else if (open.was_sent) {
            end(job, JobState::unknown,
                fmt::format("the link broke under it and {} did not come back in time: what the reader did "
                            "is not known",
                            open.status.reader),
                {}, now.wall);
        } else {
            bool connected = open.status.state == JobState::running;
            end(job, JobState::cancelled,
                connected ? "the store took no data before the deadline; it was never sent"
                          : fmt::format("{} was not connected before the deadline; it was never sent",
                                        open.status.reader),
                {}, now.wall);
        }
    }
    if (next != Steady::max()) host_.wake_at(next);
}

void Jobs::stop(Now now, bool also_sent) {
    std::lock_guard lock(mutex_);
    stopping_ = true;
    for (auto it = open_.begin(); it != open_.end();) {
        auto job = it++;
        if (job->second.on_line && !also_sent) continue;  // its link ends it
        bool sent = job->second.was_sent;
        end(job, sent ? JobState::unknown : JobState::cancelled,
            sent ? "the gateway stopped under it: what the reader did is not known"
                 : "the gateway stopped; it was never sent",
            {}, now.wall);
    }
}

const JobStatus* Jobs::find_locked(JobId id) const {
    if (auto it = open_.find(id); it != open_.end()) return &it->second.status;
    auto it = std::ranges::find(ended_.rbegin(), ended_.rend(), id, &JobStatus::id);
    return it == ended_.rend() ? nullptr : &*it;
}

std::optional<JobStatus> Jobs::find(JobId id) const {
    std::lock_guard lock(mutex_);
    const auto* job = find_locked(id);
    return job == nullptr ? std::nullopt : std::optional(*job);
}

std::optional<JobStatus> Jobs::wait(JobId id) {
    std::unique_lock lock(mutex_);
    if (auto job = open_.find(id); job != open_.end())
        // The timer ends it; this only guards against a loop that is gone.
        changed_.wait_until(lock, job->second.deadline + 2 * patience, [&] { return !open_.contains(id); });
    const auto* job = find_locked(id);
    if (job == nullptr) return {};
    auto status = *job;
    if (auto secret = secrets_.extract(id); !secret.empty()) status.values = std::move(secret.mapped());
    return status;
}

void Jobs::wait_stored(JobId id, Steady until) {
    std::unique_lock lock(mutex_);
    changed_.wait_until(lock, until, [&] {
        auto it = open_.find(id);
        return it == open_.end() || it->second.unstored == 0;
    });
}

std::vector<JobStatus> Jobs::list(std::string_view reader, std::size_t count) const {
    std::lock_guard lock(mutex_);
    std::vector<JobStatus> out;
    for (auto it = open_.begin(); it != open_.end(); ++it)
        if (reader.empty() || it->second.status.reader == reader) out.push_back(it->second.status);
    for (auto it = ended_.rbegin(); it != ended_.rend() && out.size() < count + max_open; ++it)
        if (reader.empty() || it->reader == reader) out.push_back(*it);
    std::ranges::sort(out, std::ranges::greater{}, &JobStatus::id);
    if (out.size() > count) out.resize(count);
    return out;
}

}  // namespace gantry::gateway
