#include "protocols/caen/driver.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "base/text.hpp"
#include "protocols/caen/driver_setup.hpp"

namespace gantry::caen {

using Status = JobResult::Status;

static constexpr std::chrono::seconds notify_patience{30}, notify_pause{10};

CaenDriver::CaenDriver(const DriverOptions& options)
    : options_(options),
      notifications_(gather_, [this](Count which, std::uint64_t by) { count(which, by); }) {}

void CaenDriver::admitted(const Known& known, Now) {
    reading_ = known.reading;
}

void CaenDriver::start(Now now) {
    started_ = true;
    last_answer_ = last_heard_ = poll_at_ = notify_again_ = now.steady;
    go_on(now);
    flush();
}

void CaenDriver::finish(std::string reason) {
    if (finished_) return;
    finished_ = true;
    finish_reason_ = std::move(reason);
    asked_.reset();
}

void CaenDriver::describe() {
    auto now = described_;
    now.detail += plan_.detail();
    if (ever_told_ && now.model == told_.model && now.firmware == told_.firmware &&
        now.detail == told_.detail)
        return;
    ever_told_ = true;
    told_ = now;
    signals_.emplace_back(std::move(now));
}

void CaenDriver::fault(std::int64_t code, std::string text, Now now) {
    gather_.notice(FaultNotice{code, std::move(text), {}}, now);
}

SideParty* CaenDriver::notifications() {
    auto mode = options_.settings.text("mode");
    bool wanted = !options_.notify_at.empty() && (mode == "auto" || mode == "notify");
    return wanted ? &notifications_ : nullptr;
}

// --- the dialog --------------------------------------------------------------------------------------------

void CaenDriver::ask(const Request& request, Purpose purpose, Now now) {
    auto id = next_id_++;
    Builder builder(out(), to_reader_head, id);
    builder.command(request.command);
    out().insert(out().end(), request.pairs.begin(), request.pairs.end());
    // What does not fit is as good as unanswered; the codec refuses such a job before.
    bool fits = builder.finish();
    if (timeouts_ == 0) silent_since_ = now.steady;
    auto due = std::min(now.steady + request.patience, silence_end());
    asked_ = Asked{request, id, now.steady, fits ? due : now.steady, purpose};
    if (purpose == Purpose::task && doing_ == Doing::job && running_) running_->sent = true;
}

void CaenDriver::received(ByteView bytes, Now now) {
    if (finished_) return;
    count(Count::bytes, bytes.size());
    if (!ever_answered_ && first_bytes_.size() < 32) {
        auto some = bytes.first(std::min(bytes.size(), 32 - first_bytes_.size()));
        first_bytes_.insert(first_bytes_.end(), some.begin(), some.end());
    }
    last_heard_ = now.steady;
    if (leftover_quiet_at_) leftover_quiet_at_ = now.steady + drain_silence;
    framer_.add(bytes);
    take_items(now);
    if (flush_at_) flush_at_ = std::min(now.steady + std::chrono::milliseconds{20}, flush_end_);
    flush();
}

void CaenDriver::take_items(Now now) {
    while (!finished_) {
        auto item = framer_.next();
        check_stream(now);
        if (!item || finished_) break;
        switch (item->what) {
            case Framer::What::message:
                on_message(item->bytes, now);
                break;
            case Framer::What::stream_head:
                on_stream_head(item->bytes, now);
                break;
            case Framer::What::avp:
                on_pair(item->bytes, now);
                break;
            case Framer::What::abort:
            case Framer::What::out_of_band:
                break;  // never towards us
        }
        go_on(now);
    }
}

void CaenDriver::on_message(ByteView message, Now now) {
    if (stream_ != Stream::off) stream_over(now, poll_floor);
    auto header = read_header(message);
    AvpReader pairs(message.subspan(header_size));
    auto first = pairs.next();
    bool ours = asked_ && header && header->id == asked_->id && first && first->is(Attribute::command_name) &&
                first->number() == asked_->request.command;
    if (!ours) {
        auto* late =
            header && first && first->is(Attribute::command_name) ? inventory_with(header->id) : nullptr;
        if (late == nullptr || first->number() != late->request.command ||
            !came_late(header->id, late->purpose, now))
            return count(Count::unknown_code);  // the late answer to a command that was given up, or nobody's
        take_tags(message, now);
        return;
    }
    answer_came(now);
    look_after_silence(now);
    if (asked_->is_inventory()) return on_poll(message, now);
    Reply reply{.silent = false, .parsed = parse(message), .message = message};
    if (reply.parsed.fault || !reply.parsed.result) count(Count::malformed);
    bool inventory = asked_->request.is(Command::inventory_tag) || asked_->request.is(Command::raw_read_ids);
    if (inventory && reading_ && reply.ok()) take_job_tags(message, now);
    answered(reply, now);
}

// A job that looks which tags are there has read them.
void CaenDriver::take_job_tags(ByteView message, Now now) {
    auto& report = gather_.open_for_tags(now);
    auto from = report.observations.size();
    walker_.restart();
    auto walked = walker_.walk(message.subspan(header_size), header_size, report.observations, report.data);
    took(report, from, walked, message);
}

void CaenDriver::answered(const Reply& reply, Now now) {
    auto asked = std::move(*asked_);
    asked_.reset();
    reader_.learn(asked.request, reply);
    auto technology = reader_.protocol ? technology_of(*reader_.protocol) : event::Technology::unknown;
    walker_.set_technology(technology);
    notifications_.set_technology(technology);
    switch (asked.purpose) {
        case Purpose::task:
            if (sets_read_cycle(asked.request) && (reply.ok() || reply.silent)) cycle_ = Cycle::untouched;
            if (task_) task_->answered(reply, now);
            break;
        case Purpose::cycle:
            cycle_ = plan_.mode() != Mode::framed ? Cycle::untouched
                     : reply.ok()                 ? Cycle::endless
                                                  : Cycle::unknown;
            break;
        case Purpose::cycle_check:
            cycle_told(reply, now);
            break;
        case Purpose::keep_alive:
            break;
        case Purpose::poll:
        case Purpose::stream:  // silent; an answer is taken by on_poll
            round_goes_on(now);
            break;
    }
}

// --- what next ---------------------------------------------------------------------------------------------

void CaenDriver::begin(Doing doing, std::unique_ptr<Task> task) {
    doing_ = doing;
    task_ = std::move(task);
}

void CaenDriver::go_on(Now now) {
    bool paused_enough = task_ && pause_end_ && now.steady >= *pause_end_;
    if (stream_ == Stream::on && (work_waits(now) || paused_enough)) abort_stream(now);
    while (started_ && !finished_ && !asked_ && stream_ == Stream::off) {
        if (task_) {
            if (pause_job(now)) return;
            if (auto request = task_->next(now)) {
                ask(*request, Purpose::task, now);
                return;
            }
            task_done(now);
        } else if (!choose(now)) {
            return;
        }
    }
}

// A long job lets a round through now and then. True: a command of it was sent.
bool CaenDriver::pause_job(Now now) {
    if (doing_ != Doing::job || !static_cast<const JobTask&>(*task_).may_pause()) return false;
    if (!reading_ || !polls() || stalled()) return false;
    // At the end of a round the next one is due later.
    if (pause_end_ && (now.steady >= *pause_end_ || now.steady < poll_at_)) {
        pause_end_.reset();
        pause_at_ = now.steady + job_slice;
    }
    if (now.steady < pause_at_ || now.steady < poll_at_) return false;
    if (!pause_end_) pause_end_ = now.steady + job_pause;
    return read_next(now);
}

bool CaenDriver::work_waits(Now now) const {
    auto output = outputs_.next();
    return !jobs_.empty() || (output && *output <= now.steady) || !reading_ || !set_up_;
}

// True: something was begun.
bool CaenDriver::choose(Now now) {
    if (!set_up_) {
        described_ = {};
        reader_ = {};
        begin(Doing::setup, std::make_unique<Setup>(options_, reader_, described_, gather_));
        return true;
    }
    bool read = reading_ && polls() && !stalled() && now.steady >= poll_at_;
    if (read && poll_owed_) return read_next(now);
    if (start_job(now)) return true;
    if (auto due = outputs_.next(); due && *due <= now.steady) {
        begin(Doing::output, make_output_task({reader_, outputs_, gather_}, now.steady));
        return true;
    }
    bool notify = reading_ && plan_.mode() == Mode::notify;
    if ((notify_on_ || notify_left_) && !notify) {
        notify_on_ = notify_left_ = false;
        begin(Doing::notify_off, std::make_unique<NotifyTask>(options_, reader_, true));
        return true;
    }
    if (notify && !notify_on_ && now.steady >= notify_again_) {
        notify_left_ = false;
        notify_begun_ = now.steady;
        begin(Doing::notify, std::make_unique<NotifyTask>(options_, reader_, false));
        return true;
    }
    if (read) return read_next(now);
    if (now.steady >= last_answer_ + keep_alive) {
        ask(Request(Command::get_firmware_release), Purpose::keep_alive, now);
        return true;
    }
    if (reading_ && !plan_.mode() && now.steady >= poll_at_) {  // perhaps it does now
        plan_.offer(reader_, !options_.notify_at.empty());
        if (!plan_.mode()) fall_back({}, now);
        return plan_.mode().has_value();
    }
    return false;
}

void CaenDriver::task_done(Now now) {
    auto task = std::move(task_);
    switch (doing_) {
        case Doing::setup:
            set_up_done();
            set_up_at_ = now.steady;
            break;
        case Doing::job:
            if (running_ && !running_->ended)
                end_job(running_->order.id, static_cast<const JobTask&>(*task).result());
            running_.reset();
            poll_owed_ = true;
            break;
        case Doing::output:
            if (auto& result = static_cast<const JobTask&>(*task).result(); result.status != Status::done)
                fault(fault_setting, fmt::format("a timed output was not switched back: {}", result.text),
                      now);
            break;
        case Doing::notify: {
            auto& refused = static_cast<const NotifyTask&>(*task).refused();
            notify_on_ = refused.empty();
            if (notify_on_) {
                plan_.worked();
                notify_done(now);
            } else {
                notify_again_ = now.steady + notify_pause;
                if (plan_.refused(refused))
                    fall_back({}, now);
                else
                    fault(fault_notifications, fmt::format("notifications: {}", refused), now);
                begin(Doing::notify_off, std::make_unique<NotifyTask>(options_, reader_, true));
            }
            break;
        }
        case Doing::notify_off:
            break;
    }
}

void CaenDriver::set_up_done() {
    set_up_ = true;
    source_ = 0;
    source_faults_.clear();
    last_reader_time_us_ = 0;
    cycle_ = Cycle::untouched;
    doubted_ = ask_cycle_ = false;
    notify_on_ = false;
    notify_left_ = reader_.model != nullptr && reader_.model->notifies;
    plan_.offer(reader_, !options_.notify_at.empty());
    describe();
}

void CaenDriver::notify_done(Now now) {
    notify_since_ = now.steady;
    notify_missed_ = false;
}

void CaenDriver::watch_notifications(Now now) {
    // The end of a channel that we take away, or took away before this one was made, is no news.
    bool ours = task_ && (doing_ == Doing::notify || doing_ == Doing::notify_off);
    if (notifications_.take_killed() && notify_on_ && !ours && notifications_.started() >= notify_begun_) {
        fault(fault_notifications, "the reader ended its notification channel; it is made anew", now);
        notify_on_ = false;
        notify_again_ = now.steady + notify_pause;
    }
    if (notify_on_ && !notify_missed_ && !notifications_.connected() &&
        now.steady >= notify_since_ + notify_patience) {
        notify_missed_ = true;
        fault(fault_notifications,
              fmt::format("the reader has not dialled {} for notifications; can it reach that address?",
                          printable(options_.notify_at)),
              now);
    }
}

// --- jobs --------------------------------------------------------------------------------------------------

void CaenDriver::end_job(JobId job, JobResult result) {
    signals_.emplace_back(JobEnded{job, std::move(result)});
}

void CaenDriver::end_job(JobId job, Status status, std::string text) {
    end_job(job, JobResult{.status = status, .text = std::move(text), .values = {}});
}

void CaenDriver::run(const JobOrder& order, const Job& job, Now now) {
    if (finished_) return end_job(order.id, Status::cancelled, "never sent: the link is ending");
    jobs_.push_back({order, job});
    go_on(now);
    flush();
}

bool CaenDriver::start_job(Now now) {
    if (jobs_.empty()) return false;
    auto waiting = std::move(jobs_.front());
    jobs_.pop_front();
    bool start = std::holds_alternative<StartReading>(waiting.job);
    if (start || std::holds_alternative<StopReading>(waiting.job)) {
        if (start && !reading_) poll_at_ = notify_again_ = now.steady;
        reading_ = start;
        end_job(waiting.order.id, JobResult{});
        return true;
    }
    running_ = RunningJob{waiting.order};
    pause_at_ = now.steady + job_slice;
    pause_end_.reset();
    begin(Doing::job, make_job_task(waiting.order, waiting.job, {reader_, outputs_, gather_}));
    return true;
}

void CaenDriver::cancel(JobId id, Now) {
    auto waiting = std::ranges::find(jobs_, id, [](const WaitingJob& each) { return each.order.id; });
    if (waiting != jobs_.end()) {
        jobs_.erase(waiting);
        end_job(id, Status::cancelled, "cancelled before it was sent");
        return;
    }
    if (!running_ || running_->order.id != id || running_->ended) return;
    running_->ended = true;
    static_cast<JobTask&>(*task_).stop();
    end_job(id, Status::unknown, "cancelled after it was sent: the reader may have done it");
}

void CaenDriver::link_lost(Now now) {
    salvage(now);
    finish("the link is gone");
    drop_output();
    flush_at_.reset();
    for (auto& [output, timer] : outputs_.due)
        fault(fault_setting,
              fmt::format("output {} is not switched {} again: the link broke before its time", output,
                          timer.state ? "on" : "off"),
              now);
    outputs_.due.clear();
    gather_.flush();
    if (running_ && !running_->ended) {
        bool sent = running_->sent;
        end_job(running_->order.id, sent ? Status::unknown : Status::cancelled,
                sent ? "the link broke before the reader answered" : "never sent: the link is gone");
    }
    running_.reset();
    task_.reset();
    for (auto& waiting : std::exchange(jobs_, {}))
        end_job(waiting.order.id, Status::cancelled, "never sent: the link is gone");
}

// --- time --------------------------------------------------------------------------------------------------

void CaenDriver::committed(Ticket ticket, Now now) {
    bool was_stalled = stalled();
    gather_.committed(ticket);
    if (was_stalled && !stalled()) last_heard_ = now.steady;  // it could not be heard until now
    if (finished_) return;
    go_on(now);
    flush();
}

std::optional<Steady> CaenDriver::deadline() const {
    if (finished_) return {};
    std::optional<Steady> due;
    auto sooner = [&](Steady at) { due = due ? std::min(*due, at) : at; };
    if (flush_at_) sooner(*flush_at_);
    for (auto& waiting : jobs_)
        sooner(waiting.order.deadline);
    if (running_ && !running_->ended) sooner(running_->order.deadline);
    if (leftover_quiet_at_) sooner(std::min(*leftover_quiet_at_, leftover_end_));
    if (asked_ && !leftover_quiet_at_ && stream_ == Stream::off) sooner(asked_->due);
    if (stream_ == Stream::draining) sooner(drained_at());
    if (auto output = outputs_.next(); output && !asked_ && stream_ != Stream::draining) sooner(*output);
    if (stream_ == Stream::on && !stalled()) {
        bool doubtful = stream_result_ && !stream_tags_ && cycle_ != Cycle::endless;
        sooner(last_heard_ + (doubtful ? std::chrono::seconds{1} : stream_check));
    }
    if (started_ && !asked_ && stream_ == Stream::off) {
        sooner(last_answer_ + keep_alive);
        if (reading_ && !plan_.mode()) sooner(poll_at_);
        if (reading_ && polls() && !stalled()) sooner(poll_at_);
        if (reading_ && plan_.mode() == Mode::notify && !notify_on_) sooner(notify_again_);
    }
    if (task_ && pause_end_ && stream_ == Stream::on) sooner(*pause_end_);
    if (notifications_.killed()) sooner(set_up_at_);
    if (notify_on_ && !notify_missed_ && !notifications_.connected()) sooner(notify_since_ + notify_patience);
    return due;
}

void CaenDriver::time_passed(Now now) {
    if (finished_ || !started_) return;
    if (flush_at_ && now.steady >= *flush_at_) {
        flush_at_.reset();
        gather_.flush();
    }
    for (std::size_t i = 0; i < jobs_.size();) {
        if (now.steady < jobs_[i].order.deadline) {
            ++i;
            continue;
        }
        auto id = jobs_[i].order.id;
        jobs_.erase(jobs_.begin() + static_cast<std::ptrdiff_t>(i));
        end_job(id, Status::cancelled, "never sent: the reader was still busy with what came before it");
    }
    if (running_ && !running_->ended && now.steady >= running_->order.deadline) {
        running_->ended = true;
        static_cast<JobTask&>(*task_).stop();
        end_job(running_->order.id, Status::timed_out,
                "the reader did not answer in time: what it did is not known");
    }
    watch_notifications(now);
    if (leftover_quiet_at_) {
        if (now.steady >= leftover_end_) return finish("the reader does not stop an old inventory");
        if (now.steady >= *leftover_quiet_at_) {
            leftover_quiet_at_.reset();
            framer_.reset();
            auto again = std::move(*asked_);
            ask(again.request, again.purpose, now);
        }
    } else if (asked_ && stream_ == Stream::off && now.steady >= asked_->due) {
        timed_out(now);
    }
    if (stream_ == Stream::draining) {
        if (now.steady >= drain_end_) return finish("the reader does not stop its inventory");
        if (now.steady >= drained_at()) drained(now);
    } else if (stream_ == Stream::on && !stalled()) {
        bool doubtful = stream_result_ && !stream_tags_ && cycle_ != Cycle::endless;
        if (now.steady >= last_heard_ + (doubtful ? std::chrono::seconds{1} : stream_check)) {
            // Is it there at all? Nothing but the abort may be sent (section 1); the next start shows.
            abort_stream(now);
            silent_stream_ = !doubtful;
        }
    }
    go_on(now);
    flush();
}

}  // namespace gantry::caen
