// gantry reader: what there is, and how one is. Its other verbs have files of their own.
#include <ostream>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "api/json_text.hpp"
#include "base/text.hpp"
#include "cli/commands.hpp"
#include "cli/reader_commands.hpp"
#include "cli/reader_json.hpp"
#include "cli/remote.hpp"
#include "cli/target.hpp"
#include "http/message.hpp"

namespace gantry::cli {

namespace {
std::string text_of(const boost::json::object& object, std::string_view key) {
    const auto* value = object.if_contains(key);
    if (value == nullptr || value->is_null()) return {};
    if (const auto* text = value->if_string()) return std::string(*text);
    return api::json_text(*value);
}

// Readers that were turned away are in no list, but somebody may be looking for them.
void mention_refused(Context& context, const Place& place) {
    auto status = ask(place, "GET", "/api/v1/status");
    if (!status) return;
    std::uint64_t refused = 0;
    for (auto& listener : status->as_object().at("listeners").as_array())
        refused += listener.as_object().at("refused").to_number<std::uint64_t>();
    if (refused == 0) return;
    context.out << std::flush;  // first the list
    context.err << fmt::format("{} {} refused: see the gateway's log\n", refused,
                               refused == 1 ? "connection was" : "connections were");
}

std::string with_fault(const boost::json::object& reader) {
    auto state = text_of(reader, "state"), fault = text_of(reader, "fault");
    if (fault.empty()) return state;
    return fmt::format("{}; fault at {}: {}", state, text_of(reader, "fault_time"), printable(fault));
}

int list(Context& context, const Place& place, bool json) {
    auto answer = ask(place, "GET", "/api/v1/readers");
    if (!answer) return complain(context, "reader list", answer.error());
    auto& readers = answer->as_object().at("readers").as_array();
    if (json) {
        for (auto& reader : readers)
            context.out << api::json_text(reader) << '\n';
        return done;
    }
    if (readers.empty()) {
        context.out << "No reader is configured, and none has dialled in. See: gantry config example\n";
        mention_refused(context, place);
        return done;
    }
    std::size_t name_width = 4, from_width = 4;
    for (auto& reader : readers) {
        name_width = std::max(name_width, text_of(reader.as_object(), "name").size());
        from_width = std::max(from_width, text_of(reader.as_object(), "peer").size());
    }
    context.out << fmt::format("{:<{}}  {:<8} {:>10}  {:<{}}  {}\n", "NAME", name_width, "MAKE", "READS",
                               "FROM", from_width, "STATE");
    for (auto& each : readers) {
        auto& reader = each.as_object();
        context.out << fmt::format("{:<{}}  {:<8} {:>10}  {:<{}}  {}\n", text_of(reader, "name"), name_width,
                                   text_of(reader, "make"), text_of(reader, "reads"), text_of(reader, "peer"),
                                   from_width, with_fault(reader));
    }
    mention_refused(context, place);
    return done;
}

struct InfoOptions {
    Target target;
    std::vector<std::string> words;
};

Result<boost::json::value> info_of(const Target& target) {
    if (!target.direct())
        return ask(target.place, "GET",
                   fmt::format("/api/v1/readers/{}", http::encode_component(target.reader)));
    auto reader = open_direct(target);
    if (!reader) return tl::unexpected(reader.error());
    auto status = (*reader)->wait_described(*target.timeout);
    if (!status.connected) return fail(fmt::format("{}: {}", target.shown(), printable(status.ended)));
    if (!status.answered)
        return fail(fmt::format("{}: {}", target.shown(), DirectReader::nobody_answers),
                    "--timeout gives a reader longer that seldom says something");
    return to_json(status, (*reader)->address());
}

int info(Context& context, InfoOptions& options) {
    if (auto fine = take_words(options.target, options.words, {}); !fine)
        return misuse(context, "reader info", fine.error());
    auto answer = info_of(options.target);
    if (!answer) return complain(context, "reader info", answer.error());
    if (options.target.json) {
        context.out << api::json_text(*answer) << '\n';
        return done;
    }
    for (auto& [key, value] : answer->as_object()) {
        if (const auto* counters = value.if_object()) {
            for (auto& [counter, count] : *counters)
                if (!answer->as_object().contains(counter))  // `reads` is both
                    context.out << fmt::format("{:<24} {}\n", std::string_view(counter),
                                               api::json_text(count));
            continue;
        }
        if (value.is_array()) continue;  // names that there are to complete, too many for a line
        context.out << fmt::format("{:<24} {}\n", std::string_view(key), text_of(answer->as_object(), key));
    }
    return done;
}
}  // namespace

void add_reader(CLI::App& app, Context& context) {
    auto& reader = add_command(app, "reader", "Readers: of the running gateway, or by their address",
                               "gantry reader list\ngantry reader info gate-1\n"
                               "gantry reader stop dock-1");
    reader.require_subcommand(1);
    struct Options {
        Place place;
        bool json = false;
    };
    {
        auto options = std::make_shared<Options>();
        auto& command =
            add_command(reader, "list", "Every reader and how it is",
                        "gantry reader list\ngantry reader list --json | jq -r 'select(.connected) | .name'");
        add_place(command, options->place);
        command.add_flag("--json", options->json, "One JSON object a line");
        on_run(command, context,
               [&context, options] { return list(context, options->place, options->json); });
    }
    {
        auto options = std::make_shared<InfoOptions>();
        auto& command = add_command(reader, "info", "All that is known of one reader, with its counters",
                                    "gantry reader info gate-1\n"
                                    "gantry reader info --address caen://192.168.0.125");
        add_target(command, options->target, "As one JSON object");
        add_words(command, context, options->words, {{"READER", "The reader"}});
        on_run(command, context, [&context, options] { return info(context, *options); });
    }
    add_reader_watch(reader, context);
    add_reader_state(reader, context);
    add_reader_config(reader, context);
    add_reader_exec(reader, context);
}

}  // namespace gantry::cli
