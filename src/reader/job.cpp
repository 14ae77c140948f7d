#include "reader/job.hpp"

namespace gantry {

std::string_view to_text(JobResult::Status status) {
    switch (status) {
        case JobResult::Status::done:
            return "done";
        case JobResult::Status::failed:
            return "failed";
        case JobResult::Status::unsupported:
            return "unsupported";
        case JobResult::Status::timed_out:
            return "timed_out";
        case JobResult::Status::cancelled:
            return "cancelled";
        case JobResult::Status::unknown:
            return "unknown";
    }
    return "unknown";
}

bool changes_something(const Job& job) {
    return !std::holds_alternative<GetInputs>(job) && !std::holds_alternative<ReadTag>(job) &&
           !std::holds_alternative<GetParameter>(job);
}

}  // namespace gantry
