#pragma once
#include <deque>
#include <memory>
#include <optional>
#include <string>

#include "protocols/dagprog/driver_jobs.hpp"
#include "protocols/dagprog/driver_setup.hpp"
#include "protocols/dagprog/framer.hpp"
#include "reader/plugin.hpp"

namespace gantry::dagprog {

// Our end of a serial line to one unit. One thing is under way on the line at a time; what the unit says of
// tags meanwhile is taken as it comes.
class DagprogDriver final : public Driver {
public:
    static constexpr std::size_t max_open_tickets = 16;      // more are never open: then no input is wanted
    static constexpr std::chrono::seconds banner_time{2};    // to wait for a unit that is just starting
    static constexpr std::uint64_t max_skipped = 64 * 1024;  // bytes without a line

    explicit DagprogDriver(const DriverOptions& options);

    void start(Now now) override;
    void received(ByteView bytes, Now now) override;
    void time_passed(Now now) override;
    std::optional<Steady> deadline() const override;
    bool wants_input() const override { return !finished_ && !stalled(); }
    bool finished() const override { return finished_; }

    void admitted(const Known& known, Now now) override;
    void committed(Ticket ticket, Now now) override;
    void run(const JobOrder& order, const Job& job, Now now) override;
    void cancel(JobId id, Now now) override;
    void link_lost(Now now) override;
    bool stalled() const override { return issued_ - committed_ >= max_open_tickets; }
    std::string_view finish_reason() const override { return finish_reason_; }

private:
    enum class Phase : std::uint8_t { opening, identifying, ready };
    enum class Doing : std::uint8_t { nothing, identify, setup, start, stop, reread, alive, ask_serial, job };
    struct Waiting {
        JobOrder order;
        Job job;
    };
    struct UnderWay {
        Request request;
        Steady due;
        unsigned sent = 1;
        bool echoed = false;
        Reply reply;
    };

    void finish(std::string reason);
    void take_lines(Now now);
    void on_line(const Line& line, Now now);
    void on_tag_line(const Line& line, Now now);
    bool belongs_to_request(const Line& line);
    void restarted(const Line& line, Now now);
    void begin_identifying(Now now);
    void set_up_walker();
    void check_stream();

    void advance(Now now);  // does what is to be done next, until something is under way
    void send(Request request, Now now);
    void complete(Now now, Reply::What what);
    bool choose(Now now);
    void task_over(Now now);
    void identified(Now now);
    void describe();
    bool gathers_tags() const;  // tag lines belong to what is under way

    void end_job(JobId job, JobResult result);
    void start_job(Now now);
    void expire_jobs(Now now);

    Report& report(Now now);
    void notice(std::int64_t code, std::string text, Now now, Bytes bytes = {});
    void flush(Now now);

    const Settings settings_;
    const std::chrono::microseconds reread_, poll_, alive_;
    UnitState unit_;
    std::optional<Remembered> remembered_;
    std::optional<Bytes> mark_due_;
    Framer framer_{wire::Direction::to_host};
    Framer::Tally counted_;
    TagWalker walker_;
    TagWalker::Tally walked_;
    std::uint64_t walked_lines_ = 0;

    Phase phase_ = Phase::opening;
    bool finished_ = false;
    std::string finish_reason_;
    bool wants_reading_ = true;
    std::optional<Code> mode_;
    Steady opened_{}, heard_{}, next_reread_{}, next_poll_{}, next_start_{};
    std::uint64_t skipped_at_line_ = 0;
    unsigned unanswered_ = 0;

    Doing doing_ = Doing::nothing;
    std::unique_ptr<Task> task_;
    IdentifyTask* identify_ = nullptr;  // task_, while it is that one
    std::optional<UnderWay> under_way_;
    std::deque<Waiting> waiting_;
    std::optional<Waiting> job_;
    std::unique_ptr<JobTask> job_task_;
    bool job_sent_ = false;  // something of it went out

    std::optional<Report> open_;
    Ticket issued_ = 0, committed_ = 0;
    OncePerMinute told_;
    Described described_;
};

}  // namespace gantry::dagprog
