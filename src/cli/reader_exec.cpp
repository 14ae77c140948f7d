// gantry reader exec: any command of a make's own tables.
#include <algorithm>
#include <ostream>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "api/message_json.hpp"
#include "cli/job_text.hpp"
#include "cli/reader_commands.hpp"
#include "cli/typed_message.hpp"

namespace gantry::cli {

namespace {
constexpr auto to_reader = wire::Direction::to_reader;

struct Options {
    Target target;
    std::vector<std::string> words;  // READER COMMAND
    std::vector<std::string> fields;
    bool yes = false;
};

// With an address the reader's name may be missing: then the command comes first, and what stands in its
// place is a field.
void shift(Options& options, const Plugin& make) {
    auto names = make.codec().names(to_reader);
    if (options.words.empty() || std::ranges::find(names, options.words.front()) == names.end()) return;
    if (options.words.size() > 1) options.fields.insert(options.fields.begin(), options.words.back());
    options.words.resize(1);
}

int exec(Context& context, Options& options) {
    constexpr std::string_view verb = "reader exec";
    auto& target = options.target;
    const Plugin* make = nullptr;
    if (target.direct()) {
        auto found = make_of(target);
        if (!found) return complain(context, verb, found.error());
        make = *found;
        shift(options, *make);
    }
    if (auto fine = take_words(target, options.words, {"COMMAND"}); !fine)
        return misuse(context, verb, fine.error());
    if (make == nullptr) {
        auto found = make_of(target);
        if (!found) return complain(context, verb, found.error());
        make = *found;
    }
    auto& codec = make->codec();
    auto& name = options.words.front();
    auto message = typed_message(name, options.fields);
    if (!message) return misuse(context, verb, message.error());
    Bytes frame;
    auto fine = codec.check(*message, to_reader);
    if (fine) fine = codec.encode(*message, to_reader, frame);
    if (!fine) return complain(context, verb, explain(fine.error(), name, codec, to_reader));

    boost::json::object request;
    request["op"] = "exec";
    request["command"] = name;
    request["fields"] = api::pairs_to_json(message->fields);
    if (make->is_final(name)) {
        if (!options.yes) {
            auto answer = confirmed(context, fmt::format("{} cannot be undone. Send it?", name));
            if (!answer)
                return misuse(
                    context, verb,
                    {fmt::format("{} cannot be undone, and nobody sits at a terminal to be asked", name),
                     "add --yes"});
            if (!*answer) {
                context.err << "nothing was done\n" << std::flush;
                return failed;
            }
        }
        request["confirm"] = true;
    }
    auto job = run_job(target, std::move(request));
    if (!job) return complain(context, verb, job.error());
    auto unit_of = [&](std::string_view field) { return codec.unit(name, field, wire::Direction::to_host); };
    if (!target.json) print_values(context.out, *job, unit_of);
    return conclude(context, target, *job, verb);
}
}  // namespace

void add_reader_exec(CLI::App& reader, Context& context) {
    auto& command =
        add_command(reader, "exec", "Send a command of the make's own tables, and print what comes back",
                    "gantry reader exec dock-1 GetPower\n"
                    "gantry reader exec dock-1 SetSourceConfig SourceName=Source_0 "
                    "ConfigParameter=G2Session ConfigValue=1\n"
                    "gantry reader exec --address caen://192.168.0.125 GetReaderInfo");
    auto options = std::make_shared<Options>();
    add_target(command, options->target, "The job as JSON");
    add_words(command, context, options->words,
              {{"READER", "The reader"}, {"COMMAND", "A command, as the make's manual calls it"}});
    context.asked.insert(
        command.add_option("FIELD=VALUE", options->fields,
                           "The command's fields by name. A value that starts with [, { or \" is JSON"));
    command.add_flag("--yes", options->yes, "Do not ask, even when it cannot be undone");
    on_run(command, context, [&context, options] { return exec(context, *options); });
}

}  // namespace gantry::cli
