#include "protocols/harting/driver.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "base/text.hpp"
#include "protocols/harting/driver_setup.hpp"
#include "reader/tag_steps.hpp"

namespace gantry::harting {

using JobStatus = JobResult::Status;

static constexpr std::chrono::seconds try_again{10};
static constexpr std::chrono::seconds notify_patience{30}, long_wait{1};

static Way way_of(const DriverOptions& options) {
    auto mode = options.settings.text("mode");
    if (mode == "host") return Way::host;
    if (mode == "notification") return Way::notification;
    if (mode == "scan") return Way::scan;
    if (mode == "keep") return Way::keep;
    if (mode == "buffered") return Way::buffered;
    return options.notify_at.empty() ? Way::buffered : Way::notification;
}

HartingDriver::HartingDriver(const DriverOptions& options)
    : options_(options),
      com_address_(static_cast<std::uint8_t>(options.settings.number("com_address"))),
      poll_(options.settings.duration("poll")),
      buffer_(gather_, [this](Count which, std::uint64_t by) { count(which, by); }),
      notifications_(buffer_, gather_, [this](Count which, std::uint64_t by) { count(which, by); }),
      keep_(way_of(options) == Way::keep),
      way_(way_of(options)) {
    auto keepalive = options.settings.duration("keepalive");
    notifications_.configure(options.settings.boolean("acknowledge"), com_address_, 3 * keepalive);
}

void HartingDriver::admitted(const Known& known, Now) {
    reading_ = known.reading;
    guest_ = !known.reading;
    buffer_.know(known);
}

SideParty* HartingDriver::notifications() {
    return options_.notify_at.empty() ? nullptr : &notifications_;
}

void HartingDriver::start(Now now) {
    started_ = true;
    last_byte_ = poll_at_ = now.steady;
    go_on(now);
}

void HartingDriver::finish(std::string reason) {
    if (finished_) return;
    finished_ = true;
    finish_reason_ = std::move(reason);
    asked_.reset();
}

void HartingDriver::describe() {
    static constexpr std::array<std::string_view, 5> words = {"host commands", "buffered read",
                                                              "notification", "scan mode", "as configured"};
    auto way = guest_ ? Way::keep : way_;
    auto now = described_;
    now.detail +=
        set_up_ ? fmt::format("reads by {}", words[static_cast<std::size_t>(way)]) : "not read from";
    if (ever_told_ && now.model == told_.model && now.firmware == told_.firmware &&
        now.detail == told_.detail)
        return;
    ever_told_ = true;
    told_ = now;
    signals_.emplace_back(std::move(now));
}

// --- what next ---------------------------------------------------------------------------------------------

void HartingDriver::begin(Doing doing, std::unique_ptr<Task> task) {
    doing_ = doing;
    task_ = std::move(task);
}

void HartingDriver::go_on(Now now) {
    while (started_ && !finished_ && !asked_) {
        if (out_of_step_) return ask(Request(Command::baud_rate_detection), Purpose::in_step, now);
        if (auto* task = current()) {
            if (auto request = task->next(now)) return ask(std::move(*request), Purpose::task, now);
            task_done(now);
        } else if (!choose(now)) {
            return;
        }
    }
}

// True: something was begun or asked.
bool HartingDriver::choose(Now now) {
    if (!set_up_ && now.steady >= set_up_again_at_) {
        described_ = {};
        reader_ = {};
        auto way = keep_ || guest_ ? Way::keep : way_;
        begin(Doing::setup,
              std::make_unique<DriverSetup>(options_, way, reader_, described_, gather_, said_));
        return true;
    }
    if (clear_after_ && gather_.last_committed() >= *clear_after_ && now.steady >= poll_at_) {
        // What overflowed while the disk was slow is forgotten with the clearing.
        bool waited = now.steady >= read_at_ + long_wait && !std::exchange(fill_looked_at_, true);
        if (waited)
            ask(Request(Command::read_data_buffer_info), Purpose::look_fill, now);
        else
            ask(Request(Command::clear_data_buffer), Purpose::clear, now);
        return true;
    }
    if (running_) return go_on_with_job(now);
    bool astray = set_up_ && reader_.interface_known && reader_.mode() != wanted_mode();
    if (astray && !next_job_needs_host_mode() && now.steady >= mode_again_at_) {
        begin(Doing::leave, std::make_unique<ModeTask>(reader_, wanted_mode()));
        return true;
    }
    tell_held();
    if (start_job(now)) return true;
    if (!set_up_) return false;
    bool quiet = way_ != Way::scan || now.steady >= last_byte_ + look_after;
    if (now.steady >= look_at_ && quiet) {
        look_at_ = now.steady + look_after / 2;
        look(now);
        return true;
    }
    return read_next(now);
}

void HartingDriver::task_done(Now now) {
    if (doing_ == Doing::job) {
        if (!running_->ended) held_.push_back(JobEnded{running_->order.id, running_->task->result()});
        if (running_->sent) use_known();  // it may have changed them
        if (running_->sent && running_->task->touches_buffer()) {
            clear_after_.reset();
            buffer_.link_lost();
        }
        if (!left_) tell_held();
        running_.reset();
        doing_ = Doing::setup;
        return;
    }
    auto task = std::move(task_);
    if (doing_ == Doing::setup) {
        auto& setup = static_cast<const DriverSetup&>(*task);
        set_up_tried_ = true;
        if (setup.locked_out() || setup.broken()) {
            set_up_again_at_ = now.steady + try_again;
            return describe();
        }
        return set_up_done(now);
    }
    auto& refused = static_cast<const ModeTask&>(*task).refused();
    if (doing_ == Doing::leave) left_.reset();
    if (refused.empty()) return;
    mode_again_at_ = now.steady + try_again;
    if (doing_ == Doing::enter && running_) {
        if (!running_->ended)
            end_job(running_->order.id, JobStatus::failed,
                    fmt::format("the reader does not leave its way of reading for this: {}", refused));
        running_.reset();
    } else if (auto told = told_faults_.pass(
                   fmt::format("the reader does not take the way of reading back: {}", refused), now)) {
        fault(fault_reading, *told, now);
    }
    doing_ = Doing::setup;
}

void HartingDriver::set_up_done(Now now) {
    if (!reader_.interface_known) {
        if (auto told = told_faults_.pass("its configuration cannot be read, so it is not read from", now))
            fault(fault_setting, *told, now);
        set_up_again_at_ = now.steady + try_again;
        return describe();
    }
    set_up_ = true;
    set_up_at_ = poll_at_ = now.steady;
    look_at_ = now.steady + look_after;
    buffer_empty_ = false;
    clear_after_.reset();
    more_ = plain_inventory_ = false;
    reading_fault_ = 0;
    notify_missed_ = false;
    if (keep_) {
        switch (reader_.mode()) {
            case Mode::buffered_read:
                way_ = Way::buffered;
                break;
            case Mode::notification:
                way_ = Way::notification;
                break;
            case Mode::scan:
                way_ = Way::scan;
                break;
            case Mode::host:
                way_ = Way::host;
                break;
        }
    }
    use_known();
    describe();
}

void HartingDriver::use_known() {
    scan_.configure(reader_.scan_format, reader_.read_data);
    notifications_.set_block_bank(reader_.block_bank());
}

void HartingDriver::set_up_again(std::string why, Now now) {
    if (auto told = told_faults_.pass(std::move(why), now)) fault(fault_reading, *told, now);
    set_up_ = false;
    clear_after_.reset();
    buffer_.link_lost();  // as after a new link: is what it holds still the same?
    // Not without a pause: there are readers whose refusals no set-up changes.
    set_up_again_at_ = std::max(now.steady, set_up_at_ + try_again);
}

// --- jobs --------------------------------------------------------------------------------------------------

void HartingDriver::tell_held() {
    for (auto& ended : std::exchange(held_, {}))
        signals_.emplace_back(std::move(ended));
}

void HartingDriver::end_job(JobId job, JobResult result) {
    signals_.emplace_back(JobEnded{job, std::move(result)});
}

void HartingDriver::end_job(JobId job, JobStatus status, std::string text) {
    end_job(job, JobResult{.status = status, .text = std::move(text), .values = {}});
}

void HartingDriver::run(const JobOrder& order, const Job& job, Now now) {
    if (finished_) return end_job(order.id, JobStatus::cancelled, "never sent: the link is ending");
    jobs_.push_back({order, job});
    go_on(now);
    gather_.flush();
}

bool HartingDriver::next_job_needs_host_mode() const {
    if (jobs_.empty()) return false;
    auto& job = jobs_.front().job;
    if (auto* execute = std::get_if<Execute>(&job)) {
        auto* row = find_command(execute->command.name);
        return row != nullptr && row->when == When::host_mode;
    }
    return TagSteps::access_of(job) != nullptr;
}

bool HartingDriver::start_job(Now now) {
    if (jobs_.empty() || !set_up_tried_) return false;
    auto waiting = std::move(jobs_.front());
    jobs_.pop_front();
    bool start = std::holds_alternative<StartReading>(waiting.job);
    if (start || std::holds_alternative<StopReading>(waiting.job)) {
        if (start && !reading_) poll_at_ = now.steady;
        if (std::exchange(guest_, false) && start) {
            set_up_ = false;
            set_up_again_at_ = now.steady;
        }
        reading_ = start;
        mode_again_at_ = now.steady;
        held_.push_back(JobEnded{waiting.order.id, JobResult{}});
        return true;
    }
    running_ = RunningJob{waiting.order, make_job_task(waiting.order, waiting.job, reader_)};
    drained_ = 0;
    buffer_empty_ = false;
    doing_ = Doing::setup;
    return true;
}

// What lies in the reader's buffer is taken before the reader leaves its way of reading for a job.
bool HartingDriver::go_on_with_job(Now now) {
    constexpr unsigned most_drained = 3;
    if (running_->ended) {
        running_.reset();
        return true;
    }
    bool host =
        !running_->task->needs_host_mode() || !reader_.interface_known || reader_.mode() == Mode::host;
    if (host) {
        doing_ = Doing::job;
        return true;
    }
    if (way_ == Way::buffered && reading_ && set_up_ && !buffer_empty_ && drained_ < most_drained &&
        !stalled()) {
        if (clear_after_) return false;  // until it is on disk
        ++drained_;
        ask(Request(Command::read_buffer, {0, sets_at_once}), Purpose::read, now);
        return true;
    }
    if (clear_after_) return false;
    if (guest_) left_ = reader_.mode();
    begin(Doing::enter, std::make_unique<ModeTask>(reader_, Mode::host));
    return true;
}

void HartingDriver::cancel(JobId id, Now) {
    auto waiting = std::ranges::find(jobs_, id, [](const WaitingJob& each) { return each.order.id; });
    if (waiting != jobs_.end()) {
        jobs_.erase(waiting);
        end_job(id, JobStatus::cancelled, "cancelled before it was sent");
        return;
    }
    if (!running_ || running_->order.id != id || running_->ended) return;
    running_->ended = true;
    running_->task->stop();
    end_job(id, running_->sent ? JobStatus::unknown : JobStatus::cancelled,
            running_->sent ? "cancelled after it was sent: the reader may have done it"
                           : "cancelled before it was sent");
}

void HartingDriver::link_lost(Now) {
    finish(stranger());
    drop_output();
    scan_.reset();
    gather_.flush();
    if (running_ && !running_->ended) {
        bool sent = running_->sent;
        end_job(running_->order.id, sent ? JobStatus::unknown : JobStatus::cancelled,
                sent ? "the link broke before the reader answered" : "never sent: the link is gone");
    }
    tell_held();
    running_.reset();
    task_.reset();
    for (auto& waiting : std::exchange(jobs_, {}))
        end_job(waiting.order.id, JobStatus::cancelled, "never sent: the link is gone");
}

// --- time --------------------------------------------------------------------------------------------------

void HartingDriver::committed(Ticket ticket, Now now) {
    gather_.committed(ticket);
    notifications_.committed(ticket, now);
    if (finished_) return;
    go_on(now);
    gather_.flush();
}

std::chrono::milliseconds HartingDriver::pause() const {
    return options_.link == LinkKind::serial ? character_gap : std::chrono::milliseconds(partial_patience);
}

// An answer that is coming in is waited for.
Steady HartingDriver::due() const {
    if (!framer_.partial()) return asked_->due;
    return std::clamp(last_byte_ + pause(), asked_->due, asked_->due + longest_reply);
}

std::optional<Steady> HartingDriver::deadline() const {
    if (finished_ || !started_) return {};
    std::optional<Steady> next;
    auto sooner = [&](Steady at) { next = next ? std::min(*next, at) : at; };
    if (asked_) sooner(due());
    if (framer_.partial()) sooner(last_byte_ + pause());
    for (auto& waiting : jobs_)
        sooner(waiting.order.deadline);
    if (running_ && !running_->ended) sooner(running_->order.deadline);
    if (auto at = notifications_due()) sooner(*at);
    if (asked_) return next;
    if (!set_up_) sooner(set_up_again_at_);
    if (clear_after_ && gather_.last_committed() >= *clear_after_) sooner(poll_at_);
    if (!set_up_ || running_) return next;  // a job that waits for the disk
    sooner(way_ == Way::scan ? std::max(look_at_, last_byte_ + look_after) : look_at_);
    if (reader_.mode() != wanted_mode()) sooner(mode_again_at_);
    bool polls = reading_ && (way_ == Way::buffered || way_ == Way::host) && !stalled() && !clear_after_;
    if (polls) sooner(poll_at_);
    return next;
}

// When it is odd that the reader has not dialled with a notification or a sign of life.
std::optional<Steady> HartingDriver::notifications_due() const {
    auto keepalive = options_.settings.duration("keepalive");
    if (way_ != Way::notification || !set_up_ || !reading_ || options_.notify_at.empty() ||
        keepalive.count() == 0 || notify_missed_ || notifications_.connected_since(set_up_at_))
        return {};
    return set_up_at_ + std::max<std::chrono::microseconds>(notify_patience, 2 * keepalive);
}

void HartingDriver::time_passed(Now now) {
    if (finished_ || !started_) return;
    if (framer_.partial() && now.steady >= last_byte_ + pause()) {
        framer_.drop();
        count_tally();
    }
    for (std::size_t i = 0; i < jobs_.size();) {
        if (now.steady < jobs_[i].order.deadline) {
            ++i;
            continue;
        }
        auto id = jobs_[i].order.id;
        jobs_.erase(jobs_.begin() + static_cast<std::ptrdiff_t>(i));
        end_job(id, JobStatus::cancelled, "never sent: the reader was still busy with what came before it");
    }
    if (running_ && !running_->ended && now.steady >= running_->order.deadline) {
        running_->ended = true;
        running_->task->stop();
        end_job(running_->order.id, running_->sent ? JobStatus::timed_out : JobStatus::cancelled,
                running_->sent ? "the reader did not answer in time: what it did is not known"
                               : "never sent: the reader was still busy with what came before it");
    }
    if (auto at = notifications_due(); at && now.steady >= *at) {
        notify_missed_ = true;
        fault(fault_notifications,
              fmt::format("the reader has not dialled {} for notifications; can it reach that address?",
                          printable(options_.notify_at)),
              now);
    }
    if (asked_ && now.steady >= due()) timed_out(now);
    go_on(now);
    gather_.flush();
}

}  // namespace gantry::harting
