// One job from its start to its end, over the gateway or straight to the reader.
#include <algorithm>

#include <fmt/format.h>

#include "api/job_json.hpp"
#include "base/text.hpp"
#include "cli/remote.hpp"
#include "cli/signals.hpp"
#include "cli/target.hpp"
#include "link/link.hpp"

namespace gantry::cli {

namespace json = boost::json;

namespace {
constexpr auto short_request = 10s;  // nothing that is asked here waits for a reader
// The gateway ends a job that its reader has at most this long after its deadline.
constexpr auto patience = 6s;
// After Ctrl-C: how long to wait for what became of the job.
constexpr auto farewell = 3s;

std::string text_of(const json::object& job, std::string_view key) {
    const auto* value = job.if_contains(key);
    const auto* text = value != nullptr ? value->if_string() : nullptr;
    return text != nullptr ? std::string(*text) : std::string();
}

bool has_ended(const json::object& job) {
    auto status = text_of(job, "status");
    return status != "queued" && status != "running";
}

Result<json::object> job_of(Result<json::value> answer) {
    if (!answer) return tl::unexpected(answer.error());
    auto* object = answer->if_object();
    if (object == nullptr || !object->contains("status") || !object->at("status").is_string())
        return fail("the gateway's answer is no job", "are both of the same version?");
    return std::move(*object);
}

// Passwords of a tag are kept by nobody: only the request that waits gets them.
bool reads_secrets(const json::object& request) {
    auto bank = parse_bank(text_of(request, "bank"));
    return text_of(request, "op") == "tag.read" && bank == Bank::reserved;
}

class RemoteJob {
public:
    RemoteJob(const Target& target, Steady begun) : target_(target), end_(begun + *target.timeout) {}

    Result<json::object> run(json::object request) {
        bool waits = reads_secrets(request);
        request["reader"] = target_.reader;
        request["timeout_ms"] =
            std::max(std::chrono::ceil<std::chrono::milliseconds>(end_ - link::read_clocks().steady), 1ms)
                .count();
        request["wait"] = waits;
        std::chrono::milliseconds longest = short_request;
        if (waits) longest += *target_.timeout;
        if (waits) return job_of(ask(target_.place, "POST", "/api/v1/jobs", request, longest));
        Signals signals;
        auto job = job_of(ask(target_.place, "POST", "/api/v1/jobs", request, longest));
        if (!job) return job;
        id_ = json::serialize(job->at("id"));
        return follow(signals, std::move(*job));
    }

private:
    Result<json::object> get() {
        auto job = job_of(ask(target_.place, "GET", "/api/v1/jobs/" + id_, nullptr, short_request));
        if (!job)
            return fail(job.error().text(),
                        fmt::format("job {0} may be under way still: `gantry job show {0}`", id_));
        return job;
    }

    // Short questions, so that a job for a reader that is away keeps nobody else from the gateway.
    Result<json::object> follow(Signals& signals, json::object job) {
        constexpr std::chrono::milliseconds longest_pause = 250ms;
        auto pause = 5ms;
        while (!has_ended(job)) {
            if (signals.wait(pause)) return take_back(signals, "interrupted");
            if (link::read_clocks().steady >= end_ + patience) return take_back(signals, "");
            pause = std::min(pause * 3 / 2, longest_pause);
            auto next = get();
            if (!next) return next;
            job = std::move(*next);
        }
        return job;
    }

    Result<json::object> take_back(Signals& signals, const std::string& why) {
        auto job = job_of(
            ask(target_.place, "POST", fmt::format("/api/v1/jobs/{}/cancel", id_), nullptr, short_request));
        auto end = link::read_clocks().steady + farewell;
        bool hurried = false;  // a second Ctrl-C
        while (job && !has_ended(*job) && !hurried && link::read_clocks().steady < end) {
            hurried = signals.wait(50ms);
            job = get();
        }
        if (!job) {
            job = json::object{{"status", "unknown"}};
            (*job)["text"] = fmt::format("the gateway does not tell: `gantry job show {}`", id_);
        } else if (!has_ended(*job)) {
            (*job)["text"] =
                fmt::format("it was asked to end and may be under way still: `gantry job show {}`", id_);
        }
        if (!why.empty()) (*job)[why] = true;
        return job;
    }

    const Target& target_;
    Steady end_;
    std::string id_;
};

json::object finished(const Target& target, const Job& job, JobResult result, Wall begun) {
    gateway::JobStatus status;
    status.reader = target.shown();
    status.op = gateway::op_name(job);
    status.detail = gateway::describe(job);
    status.state = gateway::state_of(result.status);
    status.text = std::move(result.text);
    status.values = std::move(result.values);
    status.created = begun;
    status.deadline = begun + *target.timeout;
    status.ended = link::read_clocks().wall;
    json::object out;
    for (auto& member : api::job_to_json(status))
        if (member.key() != "id") out.insert(member);  // nobody keeps it
    return out;
}
}  // namespace

class JobRunner::Direct {
public:
    explicit Direct(const Target& target) : target_(target) {}

    Result<json::object> run(const json::object& request) {
        auto make = make_of(target_);
        if (!make) return tl::unexpected(make.error());
        auto job = api::job_from_json(request, **make);
        if (!job) return tl::unexpected(job.error());
        auto begun = link::read_clocks();
        auto stop = [this] { return interrupted_ = interrupted_ || signals_.wait(0ms); };
        if (!reader_) {
            auto opened = open_direct(target_, false, stop);
            if (opened)
                reader_ = std::move(*opened);
            else if (!interrupted_)
                return tl::unexpected(opened.error());
        }
        JobResult result;
        if (reader_ && !stop()) {
            // What the connection took is not there any more; something is, so that a slow link says so
            // itself.
            auto left = std::chrono::ceil<std::chrono::milliseconds>(begun.steady + *target_.timeout -
                                                                     link::read_clocks().steady);
            result = reader_->run(*job, std::max(left, std::chrono::milliseconds{100}));
        } else {
            result = {.status = JobResult::Status::cancelled, .text = "it was never sent", .values = {}};
        }
        auto out = finished(target_, *job, std::move(result), begun.wall);
        if (interrupted_) out["interrupted"] = true;
        return out;
    }

private:
    const Target& target_;
    Signals signals_;  // before the thread of the link
    bool interrupted_ = false;
    std::unique_ptr<DirectReader> reader_;
};

JobRunner::JobRunner(const Target& target) : target_(target) {}
JobRunner::~JobRunner() = default;

Result<json::object> JobRunner::run(json::object request) {
    if (!target_.direct()) return RemoteJob(target_, link::read_clocks().steady).run(std::move(request));
    if (!direct_) direct_ = std::make_unique<Direct>(target_);
    return direct_->run(request);
}

Result<json::object> run_job(const Target& target, json::object request) {
    return JobRunner(target).run(std::move(request));
}

}  // namespace gantry::cli
