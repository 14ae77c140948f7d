#pragma once
#include <condition_variable>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <unordered_map>
#include <vector>

#include "base/error.hpp"
#include "gateway/job_record.hpp"
#include "reader/driver.hpp"

namespace gantry::gateway {

// What Jobs needs around it. Called with its lock held: must not call back, must not wait.
class JobHost {
public:
    virtual ~JobHost() = default;
    virtual void store(const journal::JobRow& row) = 0;  // Jobs::stored(id) when it is on disk
    // Is this reader to read?
    virtual bool reading(std::uint32_t reader) const = 0;
    virtual void set_reading(std::uint32_t reader, bool reading) = 0;
    virtual void keep_reading(std::uint32_t reader, bool reading) = 0;  // also over restarts
    virtual void wake_at(Steady when) = 0;  // Jobs::time_passed() then, or earlier
};

// A reader that is there. Called with the lock of Jobs held: must not call back before it returned.
struct JobLine {
    std::uint64_t id = 0;                                                            // of the connection
    std::function<void(const JobOrder& order, std::shared_ptr<const Job> job)> run;  // Jobs::ended() later
    std::function<void(JobId job)> cancel;
};

// All jobs: waiting, with a reader, and of late. A job is on disk as running before its reader hears of it,
// so that after a crash nobody believes it was never sent. Any thread.
class Jobs {
public:
    static constexpr std::size_t max_kept = 10'000;   // ended ones
    static constexpr std::size_t max_values = 1'000;  // of these, with their results
    static constexpr std::size_t max_open = 4'096, max_open_of_a_reader = 256;

    explicit Jobs(JobHost& host) : host_(host) {}

    // What was stored before this start: what was under way ends as unknown, what waited as cancelled.
    void restore(std::vector<journal::JobRow> rows, Wall now);

    struct Reader {
        std::uint32_t index = 0;
        std::string name;
    };
    // `waits`: wait() follows. For a job that reads secrets of a tag there is no other way to its values.
    Result<JobId> submit(const Reader& reader, Job job, std::chrono::milliseconds timeout, Now now,
                         bool waits = true);
    // Until it has ended, at the latest a moment after its deadline. Nothing: there is no such job.
    std::optional<JobStatus> wait(JobId id);
    // Until it is on disk that there is such a job.
    void wait_stored(JobId id, Steady until);
    std::optional<JobStatus> find(JobId id) const;
    // The newest first; `reader` empty: of all.
    std::vector<JobStatus> list(std::string_view reader, std::size_t count) const;
    // False: there is no such job. One that has ended stays as it is.
    bool cancel(JobId id, Now now);

    void stored(const std::vector<JobId>& ids, Now now);
    void reader_up(std::uint32_t reader, JobLine line);
    void reader_down(std::uint32_t reader, std::uint64_t line);
    // `link_broke`: the result is no answer of the reader; the link to it is gone.
    void ended(JobId id, JobResult result, bool link_broke, Now now);
    void time_passed(Now now);
    // What was not sent ends now, nothing runs again, and no more is taken. `also_sent`: nobody is left who
    // could tell how the others end.
    void stop(Now now, bool also_sent = false);

private:
    struct Open {
        JobStatus status;
        std::shared_ptr<const Job> job;
        std::uint32_t reader = 0;
        Steady deadline{};
        std::size_t unstored = 0;  // rows on their way to the disk
        bool on_line = false;      // the reader has it
        std::uint64_t line = 0;    // over which it went last
        bool was_sent = false;     // over any link
        bool again = false;        // over one before the last, too
        bool cancel_asked = false;
        std::optional<bool> wants_reading;  // of a job that changes whether the reader reads
        bool waits = true;                  // somebody calls wait()
        bool secret = false;                // its values are for whoever waits, once
    };
    struct ReaderState {
        std::optional<JobLine> line;
        std::size_t open = 0;
        // While jobs are open that change whether it reads: what holds if all of these come to nothing, and
        // the newest job that had a say in it.
        std::optional<bool> settled_reading;
        JobId settled_by = 0;
    };
    using OpenJobs = std::map<JobId, Open>;

    void store(const journal::JobRow& row);
    void store(Open& job);
    void start(Open& job);
    void send(Open& job);
    void end(OpenJobs::iterator job, JobState state, std::string text, wire::Fields values, Wall now);
    void keep(JobStatus status);
    void settle_reading(const Open& job, bool came_to_nothing);
    Steady due(const Open& job) const;
    const JobStatus* find_locked(JobId id) const;

    JobHost& host_;
    mutable std::mutex mutex_;
    std::condition_variable changed_;
    OpenJobs open_;
    std::deque<JobStatus> ended_;            // oldest first
    std::map<JobId, wire::Fields> secrets_;  // values that somebody is about to fetch with wait()
    std::unordered_map<std::uint32_t, ReaderState> readers_;
    JobId next_ = 1;
    std::size_t rows_waiting_ = 0;  // for the disk
    bool stopping_ = false;
};

}  // namespace gantry::gateway
