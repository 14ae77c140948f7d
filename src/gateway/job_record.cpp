#include "gateway/job_record.hpp"

#include <algorithm>
#include <array>

#include <fmt/format.h>

#include "base/bytes.hpp"
#include "base/text.hpp"

namespace gantry::gateway {

namespace {
constexpr std::array<std::string_view, 8> state_names = {"queued",      "running",   "done",      "failed",
                                                         "unsupported", "timed_out", "cancelled", "unknown"};

// One a row of the variant, in its order.
constexpr std::array<std::string_view, std::variant_size_v<Job>> op_names = {
    "gpio.get",    "gpio.set", "restart",  "reader.start", "reader.stop", "tag.read", "tag.write",
    "tag.program", "tag.lock", "tag.kill", "config.get",   "config.set",  "exec"};

std::string tag_text(const TagAccess& access) {
    return "tag " + to_hex(access.tag.view());
}

std::string place_text(Bank bank, std::uint32_t offset, std::uint64_t length) {
    if (length == 0) return fmt::format("{} from {}", gantry::to_text(bank), offset);
    return fmt::format("{} {} to {}", gantry::to_text(bank), offset, offset + length - 1);
}

bool names_a_secret(std::string_view name) {
    std::string lower(name);
    std::ranges::transform(lower, lower.begin(),
                           [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c + 32) : c; });
    return std::ranges::any_of(std::array<std::string_view, 4>{"password", "passwd", "secret", "key"},
                               [&](auto word) { return lower.find(word) != std::string::npos; });
}

std::string detail(const SetOutputs& job) {
    std::string out;
    for (auto& change : job.changes)
        out += fmt::format("{}output {} {}", out.empty() ? "" : ", ", change.output,
                           change.state ? "on" : "off");
    return out;
}
std::string detail(const ReadTag& job) {
    return fmt::format("{}, {}", tag_text(job.access), place_text(job.bank, job.offset, job.length));
}
std::string detail(const WriteTag& job) {
    if (job.bank == Bank::reserved)
        return fmt::format("{}, {} from {}", tag_text(job.access), gantry::to_text(job.bank), job.offset);
    return fmt::format("{}, {} from {}: {}", tag_text(job.access), gantry::to_text(job.bank), job.offset,
                       to_hex(job.data));
}
std::string detail(const ProgramTag& job) {
    return fmt::format("{} becomes {}", tag_text(job.access), to_hex(job.new_id.view()));
}
std::string detail(const LockTag& job) {
    if (job.address) return fmt::format("{}, address {}", tag_text(job.access), *job.address);
    return fmt::format("{}, mask {:03X}, action {:03X}", tag_text(job.access), job.mask, job.action);
}
std::string detail(const KillTag& job) {
    return tag_text(job.access);
}
std::string detail(const GetParameter& job) {
    return printable(job.name) + (job.permanent ? " as it is stored" : "");
}
std::string detail(const SetParameter& job) {
    return fmt::format("{} = {}{}", printable(job.name),
                       names_a_secret(job.name) ? "***" : printable(job.value),
                       job.permanent ? ", permanently" : "");
}
std::string detail(const Execute& job) {
    return printable(job.command.name);
}
template <class T>
std::string detail(const T& /*job*/) {
    return {};
}
}  // namespace

std::string_view to_text(JobState state) {
    return state_names.at(static_cast<std::size_t>(state));
}

std::optional<JobState> parse_job_state(std::string_view text) {
    const auto* it = std::ranges::find(state_names, text);
    if (it == state_names.end()) return {};
    return static_cast<JobState>(it - state_names.begin());
}

JobState state_of(JobResult::Status status) {
    return parse_job_state(gantry::to_text(status)).value_or(JobState::unknown);
}

std::optional<JobResult::Status> result_status(JobState state) {
    using Status = JobResult::Status;
    switch (state) {
        case JobState::queued:
        case JobState::running:
            return {};
        case JobState::done:
            return Status::done;
        case JobState::failed:
            return Status::failed;
        case JobState::unsupported:
            return Status::unsupported;
        case JobState::timed_out:
            return Status::timed_out;
        case JobState::cancelled:
            return Status::cancelled;
        case JobState::unknown:
            return Status::unknown;
    }
    return Status::unknown;
}

std::string_view op_name(const Job& job) {
    return op_names[job.index()];
}

std::string describe(const Job& job) {
    constexpr std::size_t most = 300;  // it is for a line in a list
    auto text = std::visit([](auto& each) { return detail(each); }, job);
    if (text.size() <= most) return text;
    auto cut = most;
    while ((static_cast<unsigned char>(text[cut]) & 0xC0) == 0x80)
        --cut;
    return text.substr(0, cut) + "…";
}

journal::JobRow row_of(const JobStatus& job) {
    return {job.id,   job.reader,  job.op,       job.detail, std::string(to_text(job.state)),
            job.text, job.created, job.deadline, job.ended};
}

JobStatus status_of(const journal::JobRow& row) {
    JobStatus job;
    job.id = row.id;
    job.reader = row.reader;
    job.op = row.op;
    job.detail = row.detail;
    job.state = parse_job_state(row.state).value_or(JobState::unknown);
    job.text = row.text;
    job.created = row.created;
    job.deadline = row.deadline;
    job.ended = row.ended;
    return job;
}

}  // namespace gantry::gateway
