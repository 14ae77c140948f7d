#pragma once
#include <optional>
#include <string>
#include <string_view>

#include "base/time.hpp"
#include "journal/job_row.hpp"
#include "reader/job.hpp"

namespace gantry::gateway {

// The life of a job. Where it ends the names are those of JobResult::Status.
enum class JobState : std::uint8_t {
    queued,   // waits for its reader
    running,  // with the reader, or on its way
    done,
    failed,
    unsupported,
    timed_out,
    cancelled,
    unknown,
};
std::string_view to_text(JobState state);
std::optional<JobState> parse_job_state(std::string_view text);
JobState state_of(JobResult::Status status);
std::optional<JobResult::Status> result_status(JobState state);  // nothing: it has not ended

// "tag.read": what the job is called in the interface.
std::string_view op_name(const Job& job);
// What it is to do, for people: "tag 3074257B, user words 0 to 3". Passwords, and what is written over them,
// never show; of a command there is only the name.
std::string describe(const Job& job);

// A job as it is shown.
struct JobStatus {
    JobId id = 0;
    std::string reader, op, detail;
    JobState state = JobState::queued;
    std::string text;     // for people; empty when done
    wire::Fields values;  // the result, while this process remembers it; never on disk
    Wall created{}, deadline{};
    std::optional<Wall> ended;
};

journal::JobRow row_of(const JobStatus& job);
JobStatus status_of(const journal::JobRow& row);

}  // namespace gantry::gateway
