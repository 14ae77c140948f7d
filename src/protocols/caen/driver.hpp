#pragma once
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "protocols/caen/driver_dialog.hpp"
#include "protocols/caen/driver_inventory.hpp"
#include "protocols/caen/driver_jobs.hpp"
#include "protocols/caen/driver_notify.hpp"
#include "protocols/caen/walker.hpp"
#include "reader/driver.hpp"
#include "reader/plugin.hpp"

namespace gantry::caen {

// Our end of the command channel of one reader: one command at a time. After the set-up it does, in this
// order, what jobs want, what keeps the link known to be alive, and the inventory. driver_reading.cpp has the
// part that reads tags, driver_sync.cpp the one that keeps both ends in step.
class CaenDriver final : public Driver {
public:
    static constexpr unsigned max_timeouts = 3;  // in a row
    static constexpr unsigned max_trouble = 5;   // resynchronisations of late
    static constexpr std::uint64_t max_astray = 64 * 1024;
    static constexpr std::chrono::milliseconds drain_silence{750};  // after an abort (section 8)
    static constexpr std::chrono::seconds drain_wait{4};  // for the result code of a reader that sends one
    static constexpr std::chrono::seconds drain_limit{10};
    static constexpr std::chrono::seconds longest_patience{60};  // for an inventory
    static constexpr std::chrono::seconds silence_limit{
        27};  // then it is offline, unless it has needed longer
    static constexpr std::chrono::seconds keep_alive{10};
    static constexpr std::chrono::seconds stream_check{15};  // a stream silent for so long is looked at
    static constexpr std::chrono::milliseconds poll_floor{10};
    static constexpr std::chrono::seconds job_slice{1};  // of a long job, then a round is read
    static constexpr std::chrono::milliseconds job_pause{300};

    explicit CaenDriver(const DriverOptions& options);

    void start(Now now) override;
    void received(ByteView bytes, Now now) override;
    void time_passed(Now now) override;
    std::optional<Steady> deadline() const override;
    bool wants_input() const override { return !finished_ && !(stream_ == Stream::on && stalled()); }
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
    enum class Purpose : std::uint8_t { task, poll, stream, cycle, cycle_check, keep_alive };
    struct Asked {
        Request request;
        std::uint16_t id;
        Steady at, due;
        Purpose purpose;
        bool is_inventory() const { return purpose == Purpose::poll || purpose == Purpose::stream; }
    };
    enum class Doing : std::uint8_t { setup, job, output, notify, notify_off };
    enum class Stream : std::uint8_t { off, on, draining };
    enum class Cycle : std::uint8_t { untouched, endless, unknown };  // ReadCycle of the streamed source
    struct WaitingJob {
        JobOrder order;
        Job job;
    };
    struct RunningJob {
        JobOrder order;
        bool sent = false, ended = false;
    };

    void finish(std::string reason);
    void flush() {
        if (!flush_at_) gather_.flush();
    }
    void describe();
    void fault(std::int64_t code, std::string text, Now now);

    // The dialog.
    void ask(const Request& request, Purpose purpose, Now now);
    void take_items(Now now);
    void on_message(ByteView message, Now now);
    void answered(const Reply& reply, Now now);

    // In step.
    void count_tally();
    void check_stream(Now now);
    void abort_leftover(Now now);
    void answer_came(Now now);
    std::chrono::microseconds inventory_patience() const;
    Steady silence_end() const;
    void inventory_took(Steady asked_at, Now now);
    const Asked* inventory_with(std::uint16_t id) const;
    bool came_late(std::uint16_t id, Purpose purpose, Now now);
    bool answer_flows(Now now) const;
    void timed_out(Now now);
    void salvage(Now now);
    void look_after_silence(Now now);
    void look_after_silent_stream(Now now);
    void cycle_told(const Reply& reply, Now now);

    // What next.
    void go_on(Now now);
    bool choose(Now now);
    void begin(Doing doing, std::unique_ptr<Task> task);
    void set_up_done();
    void notify_done(Now now);
    void task_done(Now now);
    bool start_job(Now now);
    void end_job(JobId job, JobResult result);
    void end_job(JobId job, JobResult::Status status, std::string text);
    bool work_waits(Now now) const;
    void watch_notifications(Now now);
    bool pause_job(Now now);
    void take_job_tags(ByteView message, Now now);

    // Reading.
    bool polls() const;
    bool read_next(Now now);
    void round_goes_on(Now now);
    void on_poll(ByteView message, Now now);
    void took(Report& report, std::size_t from, const Walked& walked, ByteView bytes);
    void reading_result(std::uint16_t result, Now now);
    void fall_back(std::string why, Now now);
    std::optional<std::uint16_t> take_tags(ByteView message, Now now);
    void on_stream_head(ByteView header, Now now);
    void on_other_stream(std::uint16_t id, Now now);
    void on_pair(ByteView pair, Now now);
    void on_stream_result(std::uint16_t result, Now now);
    void stream_over(Now now, std::chrono::microseconds pause);
    void abort_stream(Now now);
    Steady drained_at() const;
    void drained(Now now);
    void look_for_restart(std::span<const Observation> observations, Now now);

    const DriverOptions options_;
    Reports gather_{reports_};
    Framer framer_{to_host_head};
    Framer::Tally counted_;
    ReaderState reader_;
    ReadingPlan plan_{options_.settings};
    Notifications notifications_;
    Described described_, told_;
    bool ever_told_ = false;

    bool finished_ = false, reading_ = true;
    std::string finish_reason_;
    Bytes first_bytes_;  // what the peer said before its first message

    std::uint16_t next_id_ = 0;
    std::optional<Asked> asked_;
    std::deque<Asked> given_up_;  // the last inventories without an answer in time
    bool doubted_ = false;        // it was silent: is it still set up?
    Steady next_doubt_{};
    unsigned timeouts_ = 0, trouble_ = 0;
    std::uint64_t astray_ = 0;  // skipped bytes since the last good message
    bool ever_answered_ = false;
    std::optional<Steady> leftover_quiet_at_;  // an old stream was aborted: silence until then, and we begin
    Steady leftover_end_{};
    bool leftover_tried_ = false;
    Steady last_answer_{}, silent_since_{};  // silent since: the first command of those without an answer

    std::unique_ptr<Task> task_;
    Doing doing_ = Doing::setup;
    bool set_up_ = false, started_ = false;
    Steady set_up_at_{};
    std::deque<WaitingJob> jobs_;
    std::optional<RunningJob> running_;
    OutputTimers outputs_;
    bool poll_owed_ = false;           // a round between two jobs
    Steady pause_at_{};                // of the running job
    std::optional<Steady> pause_end_;  // it waits for a round

    bool notify_on_ = false, notify_missed_ = false;
    bool notify_left_ = false;  // an earlier run's channel may be there
    Steady notify_again_{}, notify_since_{}, notify_begun_{};

    TagWalker walker_;
    std::size_t source_ = 0;
    Steady poll_at_{}, round_start_{};
    bool first_inventory_ = true;
    std::chrono::microseconds inventory_patience_ = Request::usual_patience;
    OncePerMinute malformed_;
    std::map<std::string, std::uint16_t> source_faults_;  // told, by source
    bool no_mode_told_ = false;
    Cycle cycle_ = Cycle::untouched;
    Stream stream_ = Stream::off;
    bool stream_tags_ = false, stream_result_ = false, silent_stream_ = false, ask_cycle_ = false;
    // How this reader's streams go, as far as they showed it.
    std::optional<bool> starts_with_result_;
    bool ends_with_result_ = false;
    Steady last_heard_{}, drain_end_{};
    std::optional<Steady> flush_at_;  // a tag of the stream may not be whole yet
    Steady flush_end_{};
    std::int64_t last_reader_time_us_ = 0;
};

}  // namespace gantry::caen
