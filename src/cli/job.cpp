// gantry job: the jobs of the running gateway.
#include <ostream>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "api/json_text.hpp"
#include "base/text.hpp"
#include "cli/commands.hpp"
#include "cli/job_text.hpp"
#include "cli/remote.hpp"
#include "cli/values.hpp"
#include "http/message.hpp"

namespace gantry::cli {

namespace {
namespace json = boost::json;

struct JobOptions {
    Place place;
    std::string reader;
    std::uint64_t id = 0, limit = 20;
    bool json = false;
};

std::string member(const json::object& object, std::string_view key) {
    const auto* value = object.if_contains(key);
    return value != nullptr ? plain(*value) : std::string();
}

// The gateway's hint is for programs.
Error no_such(Error error) {
    if (error.what.starts_with("there is no job"))
        error.hint = "see `gantry job list`; old ones are forgotten";
    return error;
}

int list(Context& context, const JobOptions& options) {
    auto target = fmt::format("/api/v1/jobs?limit={}", options.limit);
    if (!options.reader.empty()) target += "&reader=" + http::encode_component(options.reader);
    auto answer = ask(options.place, "GET", target);
    if (!answer) return complain(context, "job list", answer.error());
    auto& jobs = answer->as_object().at("jobs").as_array();
    if (jobs.empty()) {
        if (!options.reader.empty()) {
            auto path = "/api/v1/readers/" + http::encode_component(options.reader);
            if (auto reader = ask(options.place, "GET", path); !reader)
                return complain(context, "job list", reader.error());
        }
        if (!options.json) context.out << "No job is known.\n";
        return done;
    }
    if (options.json) {
        for (auto& job : jobs)
            context.out << api::json_text(job) << '\n';
        return done;
    }
    context.out << fmt::format("{:>6}  {:<16} {:<12} {:<11} {:<20} {}\n", "ID", "READER", "JOB", "STATUS",
                               "SINCE", "WHAT");
    for (auto& each : jobs) {
        auto& job = each.as_object();
        auto created = member(job, "created"), what = member(job, "detail"), why = member(job, "text");
        if (member(job, "status") != "done" && !why.empty())
            what += fmt::format("{}({})", what.empty() ? "" : " ", why);
        context.out << fmt::format("{:>6}  {:<16} {:<12} {:<11} {:<20} {}\n", member(job, "id"),
                                   member(job, "reader"), member(job, "op"), member(job, "status"),
                                   created.substr(0, created.find('.')) + "Z", what);
    }
    return done;
}

void print(Context& context, const json::object& job) {
    for (auto& [key, value] : job) {
        if (key == "values") continue;
        context.out << fmt::format("{:<10} {}\n", std::string_view(key), plain(value));
    }
    for (auto& [name, value] : values_of(job))
        context.out << fmt::format("  {}: {}\n", printable(name), plain(value));
}

int show(Context& context, const JobOptions& options) {
    auto answer = ask(options.place, "GET", fmt::format("/api/v1/jobs/{}", options.id));
    if (!answer) return complain(context, "job show", no_such(answer.error()));
    if (options.json)
        context.out << api::json_text(*answer) << '\n';
    else
        print(context, answer->as_object());
    return done;
}

int cancel(Context& context, const JobOptions& options) {
    auto answer = ask(options.place, "POST", fmt::format("/api/v1/jobs/{}/cancel", options.id));
    if (!answer) return complain(context, "job cancel", no_such(answer.error()));
    auto& job = answer->as_object();
    auto status = member(job, "status");
    bool ended_before = job.contains("ended") && status != "cancelled";
    if (options.json)
        context.out << api::json_text(job) << '\n';
    else if (!ended_before)
        context.out << fmt::format("job {}: {}\n", options.id,
                                   status == "cancelled" ? status : status + ", it was asked to end");
    if (!ended_before) return done;
    if (options.json) return failed;
    return complain(context, "job cancel", {fmt::format("job {} had ended: {}", options.id, status), ""});
}
}  // namespace

void add_job(CLI::App& app, Context& context) {
    auto& job =
        add_command(app, "job", "The jobs of the running gateway", "gantry job list\ngantry job show 7");
    job.require_subcommand(1);
    {
        auto options = std::make_shared<JobOptions>();
        auto& command = add_command(job, "list", "The newest jobs, and how they went",
                                    "gantry job list\ngantry job list --reader dock-1 --json");
        add_place(command, options->place);
        command.add_option("--reader", options->reader, "Only those of this reader");
        add_count(command, "--limit", options->limit, 1, "At most so many (default: 20)", 10'000);
        command.add_flag("--json", options->json, "One JSON object a line");
        on_run(command, context, [&context, options] { return list(context, *options); });
    }
    struct Verb {
        std::string_view name, about;
        int (*action)(Context&, const JobOptions&);
    };
    for (auto& verb : {Verb{"show", "All that is known of a job", show},
                       Verb{"cancel", "Take back a job that has not ended", cancel}}) {
        auto options = std::make_shared<JobOptions>();
        auto& command = add_command(job, verb.name, verb.about, fmt::format("gantry job {} 7", verb.name));
        add_place(command, options->place);
        auto& id =
            add_count(command, "ID", options->id, 1, "The job's number, as `gantry job list` shows it");
        context.asked.insert(id.required());
        command.add_flag("--json", options->json, "The job as JSON");
        on_run(command, context,
               [&context, options, action = verb.action] { return action(context, *options); });
    }
}

}  // namespace gantry::cli
