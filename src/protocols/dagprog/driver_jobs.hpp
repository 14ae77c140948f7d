#pragma once
#include <memory>

#include "protocols/dagprog/driver_dialog.hpp"
#include "reader/plugin.hpp"
#include "reader/tag_steps.hpp"

namespace gantry::dagprog {

// The parameters of a unit, by name: the registers, and what can only be looked at.
std::span<const ParameterRow> parameters();

// A job as requests. One that is over before its first says so by next().
class JobTask : public Task {
public:
    const JobResult& result() const { return result_; }
    // Must the unit be at rest (SO) before it? Asked before its first request.
    virtual bool needs_rest() const { return true; }
    bool over() const { return over_; }

protected:
    void end(JobResult::Status status, std::string text = {}) {
        over_ = true;
        result_.status = status;
        result_.text = std::move(text);
    }
    void end(const Reply& reply) { end(status_of(reply), reply.words()); }
    static JobResult::Status status_of(const Reply& reply);

    JobResult result_;

private:
    bool over_ = false;
};

// Never nullptr. StartReading and StopReading are the driver's own and not among these.
std::unique_ptr<JobTask> make_job_task(const JobOrder& order, const Job& job, UnitState& unit);
std::unique_ptr<JobTask> make_tag_task(const JobOrder& order, const Job& job, UnitState& unit);

// Why a block may not be written; empty: it may.
std::string why_not_written(const UnitState& unit, std::uint32_t block);

}  // namespace gantry::dagprog
