// gantry reader config: the parameters of a reader while it works.
#include <algorithm>
#include <ostream>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "base/text.hpp"
#include "cli/job_text.hpp"
#include "cli/reader_commands.hpp"
#include "protocols/registry.hpp"

namespace gantry::cli {

namespace {
struct Options {
    Target target;
    std::vector<std::string> words;
    bool permanent = false;
};

int run(Context& context, Options& options, boost::json::object request, std::string_view verb) {
    auto make = make_of(options.target);
    if (!make) return complain(context, verb, make.error());
    auto job = run_job(options.target, std::move(request));
    if (!job) return complain(context, verb, job.error());
    auto unit_of = [rows = (*make)->parameters](std::string_view name) {
        auto row = std::ranges::find(rows, name, &ParameterRow::name);
        return row == rows.end() ? std::string_view{} : row->unit;
    };
    if (!options.target.json) print_values(context.out, *job, unit_of);
    return conclude(context, options.target, *job, verb);
}

// With an address the reader's name may be missing: is a lone word the parameter?
bool is_parameter(const Target& target, const std::string& word) {
    auto make = make_of(target);
    if (!make) return false;
    std::vector<std::string_view> names;
    for (auto& row : (*make)->parameters)
        names.push_back(row.name);
    return !nearest(word, names).empty();  // or a slip in one
}

int get(Context& context, Options& options) {
    std::string parameter;
    auto& words = options.words;
    bool lone = options.target.direct() && words.size() == 1;
    if (words.size() > 1 || (lone && is_parameter(options.target, words.front()))) {
        parameter = words.back();
        words.pop_back();
    }
    if (auto fine = take_words(options.target, options.words, {}); !fine)
        return misuse(context, "reader config get", fine.error());
    boost::json::object request;
    request["op"] = "config.get";
    if (!parameter.empty()) request["parameter"] = parameter;
    request["permanent"] = options.permanent;
    return run(context, options, std::move(request), "reader config get");
}

int set(Context& context, Options& options) {
    if (auto fine = take_words(options.target, options.words, {"PARAMETER", "VALUE"}); !fine)
        return misuse(context, "reader config set", fine.error());
    boost::json::object request;
    request["op"] = "config.set";
    request["parameter"] = options.words[0];
    request["value"] = options.words[1];
    request["permanent"] = options.permanent;
    return run(context, options, std::move(request), "reader config set");
}
}  // namespace

void add_reader_config(CLI::App& reader, Context& context) {
    auto& config = add_command(reader, "config", "A reader's own parameters, while it works",
                               "gantry reader config get dock-1\n"
                               "gantry reader config set dock-1 Power 500\n"
                               "gantry reader config dump dock-1 -o dock-1.toml\n"
                               "gantry reader config diff dock-1 dock-1.toml\n"
                               "gantry reader config apply dock-1 dock-1.toml");
    config.require_subcommand(1);
    {
        auto options = std::make_shared<Options>();
        auto& command = add_command(config, "get", "What a parameter is, or all of them",
                                    "gantry reader config get dock-1\n"
                                    "gantry reader config get dock-1 Power\n"
                                    "gantry reader config get --address caen://192.168.0.125 Power");
        add_target(command, options->target, "The job as JSON");
        add_words(command, context, options->words,
                  {{"READER", "The reader"}, {"PARAMETER", "One of its parameters (default: all)"}});
        command.add_flag("--permanent", options->permanent, "As it is stored, for after a power-down");
        on_run(command, context, [&context, options] { return get(context, *options); });
    }
    {
        auto options = std::make_shared<Options>();
        auto& command =
            add_command(config, "set", "Change a parameter, until the reader forgets it or for good",
                        "gantry reader config set dock-1 Power 500");
        add_target(command, options->target, "The job as JSON");
        add_words(command, context, options->words,
                  {{"READER", "The reader"},
                   {"PARAMETER", "One of its parameters"},
                   {"VALUE", "What it is to be"}});
        command.add_flag("--permanent", options->permanent, "Also for after a power-down");
        on_run(command, context, [&context, options] { return set(context, *options); });
    }
    add_reader_config_file(config, context);
    add_reader_config_apply(config, context);
}

}  // namespace gantry::cli
