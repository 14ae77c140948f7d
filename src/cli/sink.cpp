// gantry sink: destinations, how far each is, and what they would not take.
#include <algorithm>
#include <ostream>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "api/json_text.hpp"
#include "base/text.hpp"
#include "cli/commands.hpp"
#include "cli/remote.hpp"
#include "http/message.hpp"

namespace gantry::cli {

namespace json = boost::json;

namespace {
struct SinkOptions {
    Place place;
    bool json = false;
    std::string name;
    std::vector<std::uint64_t> events;
    bool all = false, dead = false;
};

std::string text_in(const json::object& object, std::string_view key) {
    const auto* value = object.if_contains(key);
    if (value == nullptr || value->is_null()) return {};
    if (const auto* text = value->if_string()) return std::string(*text);
    return api::json_text(*value);
}

std::string path_of(const SinkOptions& options, std::string_view verb = {}) {
    return fmt::format("/api/v1/sinks/{}{}", http::encode_component(options.name), verb);
}

int list_sinks(Context& context, const SinkOptions& options) {
    auto answer = ask(options.place, "GET", "/api/v1/sinks");
    if (!answer) return complain(context, "sink list", answer.error());
    auto& sinks = answer->as_object().at("sinks").as_array();
    if (options.json) {
        for (auto& sink : sinks)
            context.out << api::json_text(sink) << '\n';
        return done;
    }
    if (sinks.empty()) {
        context.out
            << "No sink is configured: events are in the store only. See: gantry config example mqtt\n";
        return done;
    }
    auto width = std::size_t{4};
    for (auto& sink : sinks)
        width = std::max(width, text_in(sink.as_object(), "name").size());
    context.out << fmt::format("{:<{}}  {:<8} {:>11} {:>9} {:>6}  {}\n", "NAME", width, "TYPE", "DELIVERED",
                               "BEHIND", "DEAD", "STATE");
    for (auto& each : sinks) {
        auto& sink = each.as_object();
        context.out << fmt::format("{:<{}}  {:<8} {:>11} {:>9} {:>6}  {}\n", text_in(sink, "name"), width,
                                   text_in(sink, "type"), text_in(sink, "delivered"), text_in(sink, "behind"),
                                   text_in(sink, "dead_letters"), printable(text_in(sink, "state")));
    }
    return done;
}

void show_letter(Context& context, const json::object& letter) {
    std::string about;
    if (const auto* content = letter.if_contains("content"); content != nullptr && content->is_object())
        about = fmt::format("{} {}", text_in(content->get_object(), "type"),
                            printable(text_in(content->get_object(), "tag")));
    context.out << fmt::format("{:>10}  {}  {:>5}  {}  {}\n", text_in(letter, "event"),
                               text_in(letter, "time"), text_in(letter, "tries"), about,
                               printable(text_in(letter, "reason")));
}

int show_letters(Context& context, const SinkOptions& options) {
    bool first = true;
    for (std::uint64_t after = 0;;) {
        auto answer =
            ask(options.place, "GET", path_of(options, fmt::format("/dead?limit=500&after={}", after)));
        if (!answer) return complain(context, "sink show", answer.error());
        auto& object = answer->as_object();
        for (auto& each : object.at("dead_letters").as_array()) {
            auto& letter = each.as_object();
            after = letter.at("event").to_number<std::uint64_t>();
            if (options.json) {
                context.out << api::json_text(letter) << '\n';
                continue;
            }
            if (std::exchange(first, false))
                context.out << fmt::format("{:>10}  {:<27}  {:>5}  {}\n", "EVENT", "REFUSED", "TRIES",
                                           "WHAT AND WHY");
            show_letter(context, letter);
        }
        if (const auto* damage = object.if_contains("damage"))
            return complain(context, "sink show", {std::string(damage->as_string())});
        if (!object.contains("more")) break;
    }
    if (first && !options.json) context.out << "No dead letters.\n";
    return done;
}

int show_sink(Context& context, const SinkOptions& options) {
    if (options.dead) return show_letters(context, options);
    auto answer = ask(options.place, "GET", path_of(options));
    if (!answer) return complain(context, "sink show", answer.error());
    if (options.json) {
        context.out << api::json_text(*answer) << '\n';
        return done;
    }
    auto& sink = answer->as_object();
    for (auto& [key, value] : sink)
        context.out << fmt::format("{:<16} {}\n", std::string_view(key), printable(text_in(sink, key)));
    return done;
}

int act(Context& context, const SinkOptions& options, std::string_view command, std::string_view verb,
        const json::value& body, std::string_view said) {
    auto answer = ask(options.place, "POST", path_of(options, verb), body);
    if (!answer) return complain(context, command, answer.error());
    if (options.json) {
        context.out << api::json_text(*answer) << '\n';
        return done;
    }
    auto text = std::string(said);
    if (const auto* letters = answer->as_object().if_contains("letters")) {
        auto count = letters->to_number<std::uint64_t>();
        text = fmt::format("{} dead {} {}", count, count == 1 ? "letter is" : "letters are", said);
    }
    context.out << fmt::format("{}: {}\n", options.name, text);
    return done;
}

json::value which(const SinkOptions& options) {
    json::object body;
    if (options.all)
        body["all"] = true;
    else
        body["events"] = json::array(options.events.begin(), options.events.end());
    return body;
}

int retry_sink(Context& context, const SinkOptions& options) {
    if (!options.all && options.events.empty())
        return act(context, options, "sink retry", "/retry", json::object(), "tries at once");
    return act(context, options, "sink retry", "/dead/retry", which(options), "offered again");
}

int skip_sink(Context& context, const SinkOptions& options) {
    if (!options.all && options.events.empty())
        return act(context, options, "sink skip", "/skip", json::object(),
                   "what blocked gives way, and the next one goes; see gantry sink show");
    return act(context, options, "sink skip", "/dead/discard", which(options), "thrown away");
}

CLI::App& add_verb(CLI::App& sink, SinkOptions& options, const char* name, const char* help,
                   const char* examples, bool names_one) {
    auto& command = add_command(sink, name, help, examples);
    add_place(command, options.place);
    command.add_flag("--json", options.json, "One JSON object a line");
    if (names_one)
        command.add_option("SINK", options.name, "The sink's name in the configuration")->required();
    return command;
}
}  // namespace

void add_sink(CLI::App& app, Context& context) {
    auto& sink =
        add_command(app, "sink", "Destinations of events: how far each is, and what they would not take",
                    "gantry sink list\ngantry sink show broker --dead\ngantry sink retry broker --all");
    sink.require_subcommand(1);
    {
        auto options = std::make_shared<SinkOptions>();
        auto& command =
            add_verb(sink, *options, "list", "Every sink and how it is", "gantry sink list", false);
        on_run(command, context, [&context, options] { return list_sinks(context, *options); });
    }
    {
        auto options = std::make_shared<SinkOptions>();
        auto& command = add_verb(sink, *options, "show", "All that is known of one sink, or its dead letters",
                                 "gantry sink show broker\ngantry sink show broker --dead --json", true);
        command.add_flag("--dead", options->dead,
                         "The events that its destination would not take, with the reason");
        on_run(command, context, [&context, options] { return show_sink(context, *options); });
    }
    auto letters = [](CLI::App& command, SinkOptions& options, const char* one, const char* all) {
        auto* events = command.add_option("EVENT", options.events, one)->type_name("SEQ");
        command.add_flag("--all", options.all, all)->excludes(events);
    };
    {
        auto options = std::make_shared<SinkOptions>();
        auto& command = add_verb(sink, *options, "retry", "Try at once, or offer dead letters again",
                                 "gantry sink retry broker\ngantry sink retry broker --all\n"
                                 "gantry sink retry broker 184467",
                                 true);
        letters(command, *options, "Dead letters, by the number of their event", "All its dead letters");
        on_run(command, context, [&context, options] { return retry_sink(context, *options); });
    }
    {
        auto options = std::make_shared<SinkOptions>();
        auto& command = add_verb(sink, *options, "skip",
                                 "Make a dead letter of the event that blocks, or throw dead letters away",
                                 "gantry sink skip broker\ngantry sink skip broker --all", true);
        letters(command, *options, "Dead letters to throw away, by the number of their event",
                "All its dead letters");
        on_run(command, context, [&context, options] { return skip_sink(context, *options); });
    }
}

}  // namespace gantry::cli
