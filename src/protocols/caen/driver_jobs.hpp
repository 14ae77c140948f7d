#pragma once
#include <map>
#include <memory>

#include "protocols/caen/driver_dialog.hpp"
#include "reader/driver.hpp"

namespace gantry::caen {

// Outputs that go back by themselves: the make has no such thing, so the driver does it while the link lasts.
struct OutputTimers {
    struct Timer {
        Steady at{};
        bool state = false;  // what it becomes
    };
    std::map<std::uint16_t, Timer> due = {};  // by output, from 1

    std::optional<Steady> next() const;
};

// A job as commands. One that is over before its first command says so by next().
class JobTask : public Task {
public:
    const JobResult& result() const { return result_; }
    // The job ends early: only what puts the reader back as it was is still sent.
    virtual void stop() { stopped_ = true; }
    // True: an inventory round may come before the next command.
    virtual bool may_pause() const { return false; }

protected:
    void end(JobResult::Status status, std::string text = {});
    bool over() const { return over_ || stopped_; }

    JobResult result_;

private:
    bool over_ = false, stopped_ = false;
};

// What a job needs beside itself.
struct JobContext {
    ReaderState& reader;
    OutputTimers& outputs;
    Reports& reports;  // for what the user must know though the job is over
};

// Never nullptr. StartReading and StopReading are the driver's own and not among these.
std::unique_ptr<JobTask> make_job_task(const JobOrder& order, const Job& job, const JobContext& context);

// Sets the outputs whose time has come.
std::unique_ptr<JobTask> make_output_task(const JobContext& context, Steady now);

}  // namespace gantry::caen
