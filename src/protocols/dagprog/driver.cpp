#include "protocols/dagprog/driver.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "base/text.hpp"

namespace gantry::dagprog {

using Status = JobResult::Status;

static constexpr auto retry_pause = 10s;  // before a mode that was refused is asked for again
static constexpr unsigned max_unanswered = 2;

static ByteOrder order_of(std::string_view choice) {
    if (choice == "msb") return ByteOrder::msb;
    if (choice == "lsb") return ByteOrder::lsb;
    return ByteOrder::automatic;
}

DagprogDriver::DagprogDriver(const DriverOptions& options)
    : settings_(options.settings),
      reread_(settings_.duration("reread")),
      poll_(settings_.duration("poll")),
      alive_(settings_.duration("alive")) {
    unit_.order = order_of(settings_.text("byte_order"));
    unit_.crc8 = find_crc8(settings_.text("crc8"));
    unit_.rewrites_system_blocks = settings_.boolean("force_system_blocks");
    set_up_walker();
}

void DagprogDriver::start(Now now) {
    opened_ = heard_ = now.steady;
}

void DagprogDriver::admitted(const Known& known, Now) {
    wants_reading_ = known.reading;
    remembered_ = Remembered::parse(known.mark);
}

void DagprogDriver::finish(std::string reason) {
    if (finished_) return;
    finished_ = true;
    finish_reason_ = std::move(reason);
}

// --- what comes next ---------------------------------------------------------------------------------------

void DagprogDriver::begin_identifying(Now) {
    phase_ = Phase::identifying;
    auto task = make_identify_task(unit_, settings_, remembered_);
    identify_ = task.get();
    task_ = std::move(task);
    doing_ = Doing::identify;
}

void DagprogDriver::send(Request request, Now now) {
    out().insert(out().end(), request.line.begin(), request.line.end());
    if (doing_ == Doing::job && !request.line.empty()) job_sent_ = true;
    if (request.until == Request::Until::detection) unit_.reading = request.code;
    auto due = now.steady + request.patience;
    under_way_ = UnderWay{std::move(request), due, 1, false, {}};
}

void DagprogDriver::complete(Now now, Reply::What what) {
    auto reply = std::move(under_way_->reply);
    auto until = under_way_->request.until;
    reply.what = until == Request::Until::time && what == Reply::What::silent ? Reply::What::answered : what;
    under_way_.reset();
    if (reply.what == Reply::What::silent) count(Count::timeouts);
    switch (doing_) {
        case Doing::alive:
            if (!reply.ok() && reply.what == Reply::What::silent && ++unanswered_ >= max_unanswered)
                finish("the unit answers no more");
            doing_ = Doing::nothing;
            break;
        case Doing::ask_serial:
            doing_ = Doing::nothing;
            if (reply.ok() && reply.serial->what == Serial::What::number) {
                auto& to = report(now);
                walker_.serial(reply.serial->bytes, now.steady, to.observations, to.data);
            } else if (!reply.ok()) {
                if (reply.what == Reply::What::silent && ++unanswered_ >= 10)
                    finish("the unit answers no more");
                notice(fault_reading, fmt::format("asking for a serial number: {}", reply.words()), now);
            }
            break;
        case Doing::job:
            if (job_task_) job_task_->answered(reply);
            if (!job_task_) doing_ = Doing::nothing;  // given up meanwhile
            break;
        default:
            if (task_) task_->answered(reply);
            break;
    }
    set_up_walker();
}

void DagprogDriver::task_over(Now now) {
    auto done = std::exchange(doing_, Doing::nothing);
    auto task = std::move(task_);
    if (task)
        for (auto& trouble : task->troubles)
            notice(trouble.code, std::move(trouble.text), now);
    switch (done) {
        case Doing::identify:
            if (identify_->failed())
                finish(identify_->why());
            else
                identified(now);
            identify_ = nullptr;
            break;
        case Doing::start:
            if (!unit_.reading) next_start_ = now.steady + retry_pause;
            next_reread_ = now.steady + reread_;
            break;
        case Doing::stop:
            // A unit that does not stop is not told to write.
            if (unit_.reading) {
                next_start_ = now.steady + retry_pause;
                if (job_) {
                    end_job(
                        job_->order.id,
                        {.status = Status::timed_out, .text = "the unit did not stop reading", .values = {}});
                    job_task_.reset();
                }
            }
            break;
        case Doing::reread:
            next_reread_ = now.steady + reread_;
            break;
        default:
            break;
    }
    set_up_walker();
}

void DagprogDriver::identified(Now now) {
    phase_ = Phase::ready;
    decide_registers(unit_, settings_);
    auto setting = settings_.text("mode");
    mode_ = reading_mode(setting, unit_.kind());
    if (!mode_) {
        notice(
            fault_setting,
            fmt::format("units for {} have no mode \"{}\"; reading with ur", to_text(unit_.kind()), setting),
            now);
        mode_ = Code::read_forever;
    }
    unit_.reads_by_asking = mode_ == Code::read_serial;
    if (!unit_.proven) unit_.wanted = unit_.now;
    Remembered now_known{unit_.version, unit_.forms};
    if (unit_.proven && (!remembered_ || remembered_->mark() != now_known.mark())) {
        remembered_ = now_known;
        mark_due_ = now_known.mark();
    }
    describe();
    set_up_walker();
}

void DagprogDriver::describe() {
    Described described;
    described.model = unit_.kind() == Family::icode1 ? "DAGProg ICODE1" : "DAGProg ISO15693";
    described.firmware = printable(unit_.version);
    described.detail =
        fmt::format("commands {} STX, {}", unit_.forms.stx ? "with" : "without",
                    unit_.proven ? fmt::format("values after {}", to_text(unit_.forms.separator))
                                 : std::string("the form of values is not known: no writing"));
    if (auto crc8 = unit_.finder.found())
        described.detail += fmt::format(", CRC8 {}{}", crc8->row->name, crc8->reversed ? " reversed" : "");
    else if (unit_.finder.samples() > 0 && unit_.finder.left().empty())
        described.detail += ", CRC8 of none of the known kinds";
    if (described.model == described_.model && described.firmware == described_.firmware &&
        described.detail == described_.detail)
        return;
    described_ = described;
    signals_.emplace_back(std::move(described));
}

// Picks what is to be done; false: nothing now.
bool DagprogDriver::choose(Now now) {
    if (phase_ != Phase::ready) return false;
    auto take = [&](Doing doing, std::unique_ptr<Task> task) {
        doing_ = doing;
        task_ = std::move(task);
        return true;
    };
    if (!job_ && !waiting_.empty()) start_job(now);
    if (job_ && job_task_) {
        if (unit_.reading && !job_task_->over() && job_task_->needs_rest())
            return take(Doing::stop, make_stop_task(unit_));
        doing_ = Doing::job;
        return true;
    }
    bool differs = unit_.must_be_set_up();
    bool reads = wants_reading_ && !stalled();
    bool wrong_mode = unit_.reading && (!wants_reading_ || unit_.reading != mode_);
    if (unit_.reading && (differs || wrong_mode)) {
        if (now.steady < next_start_) return false;
        return take(Doing::stop, make_stop_task(unit_));
    }
    if (differs) return take(Doing::setup, make_setup_task(unit_));
    if (reads && unit_.reads_by_asking && now.steady >= next_poll_) {
        next_poll_ = now.steady + poll_;
        doing_ = Doing::ask_serial;
        auto request = unit_.ask(Code::read_serial);
        request.until = Request::Until::serial;
        request.tries = 1;
        send(std::move(request), now);
        return true;
    }
    if (reads && !unit_.reads_by_asking && !unit_.reading && now.steady >= next_start_)
        return take(Doing::start, make_start_task(unit_, *mode_));
    bool sleeping = unit_.reading == Code::read_once && reread_.count() > 0;
    if (sleeping && now.steady >= next_reread_) return take(Doing::reread, make_reread_task(unit_));
    if (now.steady >= heard_ + alive_) {
        heard_ = now.steady;
        doing_ = Doing::alive;
        send(unit_.ask(Code::version), now);
        return true;
    }
    return false;
}

void DagprogDriver::advance(Now now) {
    static constexpr unsigned most_turns = 64;  // no task takes that many without waiting
    for (unsigned turn = 0; turn < most_turns && !finished_ && !under_way_; ++turn) {
        if (doing_ == Doing::nothing && !choose(now)) return;
        if (under_way_) return;
        auto request = doing_ == Doing::job ? job_task_->next() : task_->next();
        if (request) return send(std::move(*request), now);
        if (doing_ != Doing::job) {
            task_over(now);
            continue;
        }
        doing_ = Doing::nothing;
        auto result = job_task_->result();
        job_task_.reset();
        end_job(job_->order.id, std::move(result));
        describe();
    }
}

// --- reports -----------------------------------------------------------------------------------------------

Report& DagprogDriver::report(Now now) {
    // Notices come after the tags of a report.
    if (open_ && !open_->notices.empty()) flush(now);
    if (!open_) {
        open_.emplace();
        open_->ticket = issued_ + 1;
        open_->received = now;
    }
    return *open_;
}

void DagprogDriver::notice(std::int64_t code, std::string text, Now now, Bytes bytes) {
    auto passed = told_.pass(std::move(text), now.steady);
    if (!passed) return;
    if (!open_) report(now);
    open_->notices.emplace_back(FaultNotice{code, std::move(*passed), std::move(bytes)});
}

void DagprogDriver::flush(Now now) {
    bool empty = !open_ || (open_->observations.empty() && open_->notices.empty());
    if (empty) open_.reset();  // what comes later has a time of its own
    if (empty && !mark_due_) return;
    if (!open_) report(now);
    if (mark_due_) open_->mark = std::exchange(mark_due_, {});
    issued_ = open_->ticket;
    reports_.push_back(std::move(*open_));
    open_.reset();
}

void DagprogDriver::committed(Ticket ticket, Now now) {
    committed_ = std::max(committed_, std::min(ticket, issued_));
    if (finished_) return;
    take_lines(now);  // nothing waits unless it stalled
    framer_.settle();
    check_stream();
    advance(now);
    flush(now);
}

// --- jobs and time -----------------------------------------------------------------------------------------

void DagprogDriver::end_job(JobId job, JobResult result) {
    signals_.emplace_back(JobEnded{job, std::move(result)});
    if (job_ && job_->order.id == job) job_.reset();
    job_sent_ = false;
}

void DagprogDriver::run(const JobOrder& order, const Job& job, Now now) {
    if (finished_)
        return end_job(order.id,
                       {.status = Status::cancelled, .text = "never sent: the link is ending", .values = {}});
    waiting_.push_back({order, job});
    advance(now);
    flush(now);
}

void DagprogDriver::start_job(Now now) {
    while (!job_ && !waiting_.empty()) {
        auto next = std::move(waiting_.front());
        waiting_.pop_front();
        bool starts = std::holds_alternative<StartReading>(next.job);
        if (starts || std::holds_alternative<StopReading>(next.job)) {
            wants_reading_ = starts;
            next_start_ = now.steady;
            end_job(next.order.id, {});
            continue;
        }
        job_ = std::move(next);
        job_task_ = make_job_task(job_->order, job_->job, unit_);
    }
}

void DagprogDriver::cancel(JobId id, Now now) {
    auto waits = std::ranges::find_if(waiting_, [&](auto& each) { return each.order.id == id; });
    if (waits != waiting_.end()) {
        waiting_.erase(waits);
        return end_job(id,
                       {.status = Status::cancelled, .text = "cancelled before it was sent", .values = {}});
    }
    if (!job_ || job_->order.id != id) return;
    auto text =
        job_sent_ ? "cancelled after it was sent: the unit may have done it" : "cancelled before it was sent";
    auto status = job_sent_ ? Status::unknown : Status::cancelled;
    job_task_.reset();
    if (doing_ == Doing::job && !under_way_) doing_ = Doing::nothing;
    end_job(id, {.status = status, .text = text, .values = {}});
    advance(now);
    flush(now);
}

void DagprogDriver::expire_jobs(Now now) {
    for (std::size_t i = 0; i < waiting_.size();) {
        if (now.steady < waiting_[i].order.deadline) {
            ++i;
            continue;
        }
        auto id = waiting_[i].order.id;
        waiting_.erase(waiting_.begin() + static_cast<std::ptrdiff_t>(i));
        end_job(id,
                {.status = Status::cancelled,
                 .text = phase_ == Phase::ready ? "never sent: the unit was still busy with the job before it"
                                                : "never sent: the unit did not say yet who it is",
                 .values = {}});
    }
    if (!job_ || now.steady < job_->order.deadline) return;
    count(Count::timeouts);
    auto id = job_->order.id;
    auto status = job_sent_ ? Status::timed_out : Status::cancelled;
    job_task_.reset();
    if (doing_ == Doing::job && !under_way_) doing_ = Doing::nothing;
    end_job(id, {.status = status,
                 .text = status == Status::timed_out ? "the time was over before it was done"
                                                     : "never sent: the unit was busy",
                 .values = {}});
}

void DagprogDriver::link_lost(Now) {
    finish("the link is gone");
    drop_output();
    under_way_.reset();
    task_.reset();
    job_task_.reset();
    identify_ = nullptr;
    doing_ = Doing::nothing;
    if (job_) {
        auto status = job_sent_ ? Status::unknown : Status::cancelled;
        end_job(job_->order.id, {.status = status,
                                 .text = job_sent_ ? "the link broke before the unit answered"
                                                   : "never sent: the link is gone",
                                 .values = {}});
    }
    for (auto& each : std::exchange(waiting_, {}))
        end_job(each.order.id,
                {.status = Status::cancelled, .text = "never sent: the link is gone", .values = {}});
}

std::optional<Steady> DagprogDriver::deadline() const {
    if (finished_) return {};
    auto due = walker_.deadline();
    auto sooner = [&](Steady at) { due = due ? std::min(*due, at) : at; };
    if (job_) sooner(job_->order.deadline);
    for (auto& each : waiting_)
        sooner(each.order.deadline);
    if (under_way_) {
        sooner(under_way_->due);
        return due;
    }
    if (phase_ == Phase::opening) sooner(opened_ + banner_time);
    if (phase_ != Phase::ready) return due;
    sooner(heard_ + alive_);
    if (unit_.reading && unit_.must_be_set_up()) sooner(next_start_);
    if (wants_reading_ && !stalled()) {
        if (unit_.reads_by_asking)
            sooner(next_poll_);
        else if (!unit_.reading || unit_.reading != mode_)
            sooner(next_start_);
    }
    if (unit_.reading == Code::read_once && reread_.count() > 0) sooner(next_reread_);
    return due;
}

void DagprogDriver::time_passed(Now now) {
    if (finished_) return;
    expire_jobs(now);
    if (auto due = walker_.deadline(); due && now.steady >= *due) {
        auto& to = report(now);
        walker_.time_passed(now.steady, to.observations, to.data);
    }
    if (under_way_ && now.steady >= under_way_->due) {
        auto& request = under_way_->request;
        if (request.until != Request::Until::time && under_way_->sent < request.tries) {
            ++under_way_->sent;
            under_way_->due = now.steady + request.patience;
            out().insert(out().end(), request.line.begin(), request.line.end());
        } else {
            complete(now, Reply::What::silent);
        }
    }
    if (phase_ == Phase::opening && now.steady >= opened_ + banner_time) begin_identifying(now);
    check_stream();
    advance(now);
    flush(now);
}

}  // namespace gantry::dagprog
