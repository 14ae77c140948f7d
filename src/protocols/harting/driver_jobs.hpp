#pragma once
#include <memory>
#include <string>

#include "protocols/harting/driver_dialog.hpp"
#include "reader/driver.hpp"

namespace gantry::harting {

// A job as commands. One that is over before its first command says so by next().
class JobTask : public Task {
public:
    const JobResult& result() const { return result_; }
    // The job ends early: only what puts the reader back as it was is still sent.
    void stop() { stopped_ = true; }
    // Its commands are refused while the reader reads by itself: it must be in host mode.
    virtual bool needs_host_mode() const { return false; }
    // True: it may have moved or removed what the driver has read from the buffer and not cleared yet.
    virtual bool touches_buffer() const { return false; }

protected:
    void end(JobResult::Status status, std::string text = {});
    bool over() const { return over_ || stopped_; }

    JobResult result_;

private:
    bool over_ = false, stopped_ = false;
};

JobResult::Status refusal(const Reply& reply);
std::string refusal_text(const Reply& reply);

// Never nullptr. StartReading and StopReading are the driver's own and not among these.
std::unique_ptr<JobTask> make_job_task(const JobOrder& order, const Job& job, KnownReader& reader);
// For a link on which the reader only speaks.
JobResult no_jobs_here();

// Puts the reader into another way of working, in RAM, by one write; and says how that went.
class ModeTask final : public Task {
public:
    ModeTask(KnownReader& reader, Mode mode) : reader_(reader), mode_(mode) {}
    std::optional<Request> next(Now now) override;
    void answered(const Reply& reply, Now now) override;
    const std::string& refused() const { return refused_; }  // empty: it works so now

private:
    enum class Stage : std::uint8_t { read, write, over };
    KnownReader& reader_;
    const Mode mode_;
    Stage stage_ = Stage::read;
    Block block_{};
    std::string refused_;
};

}  // namespace gantry::harting
