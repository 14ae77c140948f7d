#pragma once
#include <deque>
#include <memory>
#include <optional>
#include <set>
#include <string>

#include "protocols/harting/driver_dialog.hpp"
#include "protocols/harting/driver_jobs.hpp"
#include "protocols/harting/driver_notify.hpp"
#include "protocols/harting/driver_scan.hpp"
#include "protocols/harting/frame.hpp"
#include "reader/plugin.hpp"

namespace gantry::harting {

// Our end of a reader that we reach: one command at a time. After the set-up it does, in this order, what
// jobs want, what keeps the reader known to be as we left it, and the reading. driver_talk.cpp has the bytes,
// driver_reading.cpp the tags.
class HartingDriver final : public Driver {
public:
    static constexpr unsigned max_timeouts = 3;  // in a row
    static constexpr unsigned max_trouble = 8;   // resynchronisations of late
    static constexpr std::uint64_t max_astray = 64 * 1024;
    static constexpr std::chrono::seconds look_after{10};  // how often the reader is asked how it is
    static constexpr std::chrono::milliseconds character_gap{
        250};  // section 1: 12 ms, and what buffers and busy hosts add
    static constexpr std::chrono::seconds partial_patience{3};  // a frame does not pause longer on TCP
    static constexpr std::chrono::seconds longest_reply{30};    // on a slow line, once it has begun
    static constexpr std::uint16_t sets_at_once = 255;

    explicit HartingDriver(const DriverOptions& options);

    void start(Now now) override;
    void received(ByteView bytes, Now now) override;
    void time_passed(Now now) override;
    std::optional<Steady> deadline() const override;
    // Scan output cannot be left in the reader, and answers come between it.
    bool wants_input() const override { return !finished_ && !(scanning() && stalled() && !asked_); }
    bool finished() const override { return finished_; }

    void admitted(const Known& known, Now now) override;
    void committed(Ticket ticket, Now now) override;
    void run(const JobOrder& order, const Job& job, Now now) override;
    void cancel(JobId id, Now now) override;
    void link_lost(Now now) override;
    SideParty* notifications() override;
    bool stalled() const override { return gather_.full(); }
    std::string_view finish_reason() const override { return finish_reason_; }

private:
    enum class Purpose : std::uint8_t { task, read, clear, inventory, look, look_set, look_fill, in_step };
    enum class Doing : std::uint8_t { setup, job, enter, leave };
    struct Asked {
        Request request;
        Steady due;
        Purpose purpose;
    };
    struct WaitingJob {
        JobOrder order;
        Job job;
    };
    struct RunningJob {
        JobOrder order;
        std::unique_ptr<JobTask> task;
        bool sent = false, ended = false;
    };

    void finish(std::string reason);
    std::string stranger() const;  // what came instead of an answer, for people; empty: nothing
    void describe();
    void fault(std::int64_t code, std::string text, Now now) {
        gather_.notice(FaultNotice{code, std::move(text), {}}, now);
    }

    // The dialog.
    void ask(Request request, Purpose purpose, Now now);
    std::chrono::milliseconds pause() const;  // no frame pauses so long
    Steady due() const;                       // of what was asked
    void take_frames(Now now);
    void take_scan(ByteView bytes, Now now);
    void take_text(ByteView text, Now now);
    void on_frame(const Frame& frame, Now now);
    void answered(const Reply& reply, ByteView frame, Now now);
    void timed_out(Now now);
    void count_tally();

    // What next.
    void go_on(Now now);
    bool choose(Now now);
    void begin(Doing doing, std::unique_ptr<Task> task);
    void task_done(Now now);
    void set_up_done(Now now);
    void use_known();
    void set_up_again(std::string why, Now now);
    std::optional<Steady> notifications_due() const;
    bool start_job(Now now);
    bool go_on_with_job(Now now);
    bool next_job_needs_host_mode() const;
    Task* current() const { return doing_ == Doing::job && running_ ? running_->task.get() : task_.get(); }
    void tell_held();
    void end_job(JobId job, JobResult result);
    void end_job(JobId job, JobResult::Status status, std::string text);

    // Reading.
    Mode wanted_mode() const;
    bool scanning() const { return set_up_ && reading_ && way_ == Way::scan; }
    bool read_next(Now now);
    void on_buffer(const Reply& reply, ByteView frame, Now now);
    void on_cleared(const Reply& reply, Now now);
    void on_inventory(const Reply& reply, ByteView frame, Now now);
    void reading_refused(const Reply& reply, std::string_view what, Now now);
    void look(Now now);
    void on_look(const Reply& reply, Now now);
    void on_look_set(const Reply& reply, Now now);

    const DriverOptions options_;
    const std::uint8_t com_address_;
    const std::chrono::microseconds poll_;
    Reports gather_{reports_};
    BufferReports buffer_;
    Notifications notifications_;
    Framer framer_{wire::Direction::to_host};
    Framer::Tally counted_;
    ScanText scan_;
    KnownReader reader_;
    const bool keep_;  // as the reader is configured
    Way way_;
    Described described_, told_;
    bool ever_told_ = false;

    bool finished_ = false, started_ = false, reading_ = true;
    // Not told to read when the link came up: whatever the reader does then is somebody else's, and is left
    // or put back as it was.
    bool guest_ = false;
    std::optional<Mode> left_;    // as a guest: the mode that a job needed to leave
    std::vector<JobEnded> held_;  // told when the reader is in its way of reading again
    std::string finish_reason_;
    Bytes first_bytes_;
    bool ever_answered_ = false;
    unsigned timeouts_ = 0, trouble_ = 0;
    Steady last_byte_{};

    std::optional<Asked> asked_;
    std::unique_ptr<Task> task_;
    Doing doing_ = Doing::setup;
    bool set_up_ = false;
    Steady set_up_at_{};
    std::deque<WaitingJob> jobs_;
    std::optional<RunningJob> running_;

    Steady poll_at_{}, look_at_{}, read_at_{};
    bool fill_looked_at_ = false;  // since the buffer was read
    std::set<std::string> said_;   // what set-ups had to say, each once
    std::size_t looks_ = 0;
    std::uint8_t looked_at_ = 0;  // the block
    bool out_of_step_ = false;    // a command was given up, and its answer may still come
    Steady set_up_again_at_{}, mode_again_at_{};
    bool set_up_tried_ = false;
    std::optional<Ticket> clear_after_;  // the buffer is cleared when this is on disk
    bool buffer_empty_ = false;          // it was, when last asked
    unsigned drained_ = 0;               // reads since a job waits for host mode
    std::int64_t reading_fault_ = 0;
    bool more_ = false;             // the last inventory was not all
    bool plain_inventory_ = false;  // it does not know the form with antennas
    std::size_t last_sets_ = 0;
    bool notify_missed_ = false;
    OncePerMinute told_faults_;
};

// Our end of a reader that dials in and only speaks: harting-listen://.
class HartingListener final : public Driver {
public:
    explicit HartingListener(const DriverOptions& options);

    void start(Now now) override;
    void received(ByteView bytes, Now now) override;
    void time_passed(Now now) override;
    std::optional<Steady> deadline() const override;
    bool wants_input() const override { return !finished() && channel_.wants_input(); }
    bool finished() const override { return finished_ || channel_.finished(); }

    void admitted(const Known& known, Now now) override;
    void committed(Ticket ticket, Now now) override;
    void run(const JobOrder& order, const Job& job, Now now) override;
    void cancel(JobId, Now) override {}
    void link_lost(Now now) override;
    bool stalled() const override { return gather_.full(); }
    std::string_view finish_reason() const override {
        return finished_ ? std::string_view(finish_reason_) : std::string_view(channel_.finish_reason());
    }

private:
    void after();

    static constexpr std::chrono::seconds identify_within{30};

    const std::chrono::microseconds keepalive_;
    Reports gather_{reports_};
    BufferReports buffer_;
    Notifications channel_;
    bool identified_ = false, admitted_ = false, finished_ = false;
    std::string finish_reason_, told_;
    Steady started_{};
};

}  // namespace gantry::harting
