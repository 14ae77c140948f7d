// gantry events: what happened, from the store. Works beside a running gateway and without one.
#include <algorithm>
#include <cctype>
#include <ostream>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "base/text.hpp"
#include "cli/commands.hpp"
#include "cli/event_text.hpp"
#include "cli/events_commands.hpp"
#include "cli/signals.hpp"
#include "cli/values.hpp"
#include "event/event_json.hpp"

namespace gantry::cli {

namespace {
Result<void> hex_digits(const std::string& text) {
    auto is_digit = [](unsigned char c) { return std::isxdigit(c) != 0; };
    if (!text.empty() && std::ranges::all_of(text, is_digit)) return {};
    return fail(fmt::format("{} is not hex", printable(text)), "write how the tag's hex begins, like 3034");
}
}  // namespace

journal::Filter filter_of(const EventsOptions& options) {
    journal::Filter filter;
    filter.after = options.after;
    filter.reader = options.reader;
    filter.zone = options.zone;
    filter.newest_first = options.newest_first;
    for (char c : options.tag)
        filter.tag += c >= 'a' && c <= 'f' ? static_cast<char>(c - 'a' + 'A') : c;
    for (auto& each : event::all_types())
        if (std::ranges::any_of(options.types, [&](auto& pattern) { return matches(pattern, each.name); }))
            filter.types.push_back(each.type);
    filter.since = options.since;
    filter.until = options.until;
    return filter;
}

namespace {
class Printer {
public:
    Printer(std::ostream& out, bool json, journal::IdPrefixes prefixes)
        : out_(out), json_(json), prefixes_(std::move(prefixes)) {}
    bool print(const event::Event& event) {
        line_.clear();
        if (json_)
            event::append_json(line_, event, prefixes_.of(event.seq));
        else
            line_ = for_people(event);
        line_ += '\n';
        out_ << line_;
        return static_cast<bool>(out_);
    }
    void use(journal::IdPrefixes prefixes) { prefixes_ = std::move(prefixes); }

private:
    std::ostream& out_;
    bool json_;
    journal::IdPrefixes prefixes_;
    std::string line_;
};

int query(Context& context, const EventsOptions& options) {
    constexpr std::string_view verb = "events query";
    auto store = open_store(options.store);
    if (!store) return complain(context, verb, store.error());
    auto prefixes = (*store)->id_prefixes();
    if (!prefixes) return complain(context, verb, prefixes.error().error);
    Printer printer(context.out, options.json, std::move(*prefixes));
    auto left = options.limit;
    auto read = (*store)->query(
        filter_of(options), [&](const event::Event& event) { return printer.print(event) && --left > 0; });
    if (read && left == options.limit) mention_unknown_reader(context, **store, options.reader);
    if (!read) return complain(context, verb, read.error().error);
    return done;
}

int tail(Context& context, const EventsOptions& options) {
    Signals signals;
    auto filter = filter_of(options);
    auto store = open_store(options.store);
    if (!store) return complain(context, "events tail", store.error());
    auto prefixes = (*store)->id_prefixes();
    if (!prefixes) return complain(context, "events tail", prefixes.error().error);
    Printer printer(context.out, options.json, std::move(*prefixes));
    if (options.after == 0) {
        auto top = (*store)->last_seq();
        if (!top) return complain(context, "events tail", top.error().error);
        filter.up_to = *top;
        auto newest = (*store)->newest(filter, options.last);
        if (!newest) return complain(context, "events tail", newest.error().error);
        for (auto& event : *newest)
            printer.print(event);
        filter.after = *top;
        filter.up_to = 0;
    }
    mention_unknown_reader(context, **store, options.reader);
    std::optional<std::uint64_t> seen;
    do {
        auto version = (*store)->version();
        if (!version) return complain(context, "events tail", version.error().error);
        if (seen == *version) continue;
        seen = *version;
        prefixes = (*store)->id_prefixes();  // a gateway that was started again may have another id
        if (!prefixes) return complain(context, "events tail", prefixes.error().error);
        printer.use(std::move(*prefixes));
        auto top = (*store)->last_seq();
        if (!top) return complain(context, "events tail", top.error().error);
        filter.up_to = *top;
        auto read = (*store)->query(filter, [&](const event::Event& event) { return printer.print(event); });
        if (!read) return complain(context, "events tail", read.error().error);
        filter.after = std::max(filter.after, *top);
        if (!context.out.flush()) return done;  // whoever read it has gone
    } while (!nobody_reads(context) && !signals.wait(100ms));
    return done;
}

}  // namespace

CLI::App& add_events_verb(CLI::App& parent, Context& context, const std::shared_ptr<EventsOptions>& options,
                          std::string_view name, std::string_view about, std::string_view examples) {
    auto& command = add_command(parent, name, about, examples);
    add_store_place(command, options->store);
    std::vector<std::string> types;
    for (auto& each : event::all_types())
        types.emplace_back(each.name);
    for (auto* family : {"tag.*", "reader.*"})
        types.emplace_back(family);
    add_choice(command, context, "--type", options->types, std::move(types),
               "Only these types; may be given several times");
    command.add_option("--reader", options->reader, "Only this reader; * stands for anything");
    command.add_option("--zone", options->zone, "Only this zone; * stands for anything");
    must(*command.add_option("--tag", options->tag, "Only tags whose hex begins so"), hex_digits);
    add_moment(command, "--since", options->since,
               "From this time on: 2026-11-21T23:04:00Z, or 10min for ten minutes ago");
    add_moment(command, "--until", options->until, "Up to before this time");
    add_count(command, "--after", options->after, 0, "Only events with a greater seq");
    return command;
}

void add_events(CLI::App& app, Context& context) {
    auto& events = add_command(app, "events", "What happened: follow it, look it up, take it away",
                               "gantry events tail\ngantry events query --type tag.new --since 10min");
    events.require_subcommand(1);
    {
        auto options = std::make_shared<EventsOptions>();
        auto& command = add_events_verb(
            events, context, options, "tail", "Print the newest events, and new ones as they come",
            "gantry events tail --reader 'gate-*'\ngantry events tail --json | jq .tag");
        add_count(command, "-n,--last", options->last, 0, "How many old events first (default: 10)");
        command.add_flag("--json", options->json, "One JSON object a line");
        on_run(command, context, [&context, options] { return tail(context, *options); });
    }
    {
        auto options = std::make_shared<EventsOptions>();
        auto& command = add_events_verb(events, context, options, "query", "Print the events that match",
                                        "gantry events query --type tag.observed --zone dock --since 1h\n"
                                        "gantry events query --tag 3034 --newest-first --limit 20 --json");
        command.add_flag("--newest-first", options->newest_first, "Begin with the newest");
        add_count(command, "--limit", options->limit, 1, "At most so many");
        command.add_flag("--json", options->json, "One JSON object a line");
        on_run(command, context, [&context, options] { return query(context, *options); });
    }
    add_events_export(events, context);
}

}  // namespace gantry::cli
