// gantry reader start, stop, restart.
#include <ostream>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "cli/job_text.hpp"
#include "cli/reader_commands.hpp"

namespace gantry::cli {

namespace {
struct Options {
    Target target;
    std::vector<std::string> words;
};

std::string success(const Target& target, std::string_view op) {
    auto name = target.shown();
    if (op == "restart") return name + " restarts";
    if (op == "reader.start") return name + " reads";
    if (target.direct()) return name + " stopped";
    return fmt::format("{0} stopped: it stays so until `gantry reader start {0}`", name);
}

int tell(Context& context, Options& options, std::string_view op, const std::string& verb) {
    if (auto fine = take_words(options.target, options.words, {}); !fine)
        return misuse(context, verb, fine.error());
    boost::json::object request;
    request["op"] = op;
    auto job = run_job(options.target, std::move(request));
    if (!job) return complain(context, verb, job.error());
    if (!options.target.json && job->at("status").get_string() == "done")
        context.out << success(options.target, op) << '\n';
    return conclude(context, options.target, *job, verb);
}
}  // namespace

void add_reader_state(CLI::App& reader, Context& context) {
    struct Verb {
        std::string_view name, op, about;
    };
    for (auto& verb : {
             Verb{"start", "reader.start", "Let a stopped reader read again"},
             Verb{"stop", "reader.stop",
                  "Let a reader rest until `gantry reader start`, over restarts of the gateway too. With "
                  "--address it lasts only if the reader keeps it by itself"},
             Verb{"restart", "restart", "Restart a reader's hardware"},
         }) {
        auto& command =
            add_command(reader, verb.name, verb.about, "gantry reader " + std::string(verb.name) + " dock-1");
        auto options = std::make_shared<Options>();
        add_target(command, options->target, "The job as JSON");
        add_words(command, context, options->words, {{"READER", "The reader"}});
        on_run(command, context, [&context, options, verb] {
            return tell(context, *options, verb.op, "reader " + std::string(verb.name));
        });
    }
}

}  // namespace gantry::cli
