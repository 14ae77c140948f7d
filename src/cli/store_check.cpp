// gantry store: what is done with a whole store. Here: is it as it was stored?
#include <ostream>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "base/text.hpp"
#include "cli/commands.hpp"
#include "cli/signals.hpp"
#include "cli/store.hpp"
#include "cli/store_commands.hpp"

namespace gantry::cli {

namespace {
struct CheckOptions {
    StorePlace store;
    bool json = false;
};

constexpr std::string_view when_damaged =
    "stop the gateway and put a backup in its place with `gantry store restore FILE`; what can still be read "
    "is "
    "saved with `gantry events export --skip-damaged`";

std::string json_text(std::string_view text) {
    std::string out;
    append_json_string(out, text);
    return out;
}

void print_json(Context& context, const std::filesystem::path& path, const journal::Checked& checked) {
    std::string problems;
    for (auto& problem : checked.problems)
        problems += (problems.empty() ? "" : ",") + json_text(problem);
    context.out << fmt::format("{{\"store\":{},\"sound\":{},{},\"problem_count\":{},\"problems\":[{}]}}\n",
                               json_text(path.string()), checked.sound(), checked_json(checked),
                               checked.problem_count, problems);
}

int store_check(Context& context, const CheckOptions& options) {
    constexpr std::string_view verb = "store check";
    Signals signals;
    auto path = store_file(options.store);
    if (!path) return complain(context, verb, path.error());
    bool stopped = false;
    auto checked = journal::check_store(*path, [&](std::uint64_t, std::uint64_t) {
        stopped = signals.wait(0ms);
        return !stopped;
    });
    if (stopped) return stopped_by_user;
    if (!checked) {
        auto error = checked.error().error;
        if (checked.error().kind == journal::StoreError::Kind::corrupt) error.hint = when_damaged;
        return complain(context, verb, error);
    }
    if (options.json)
        print_json(context, *path, *checked);
    else
        context.out << fmt::format("{}: {}\n", printable(path->string()), checked_text(*checked));
    if (checked->sound()) return done;
    if (!options.json) {
        for (auto& problem : checked->problems)
            context.out << "  " << printable(problem) << '\n';
        if (checked->problem_count > checked->problems.size())
            context.out << fmt::format("  and {} more\n", checked->problem_count - checked->problems.size());
    }
    context.out << std::flush;
    return complain(context, verb,
                    {fmt::format("the store {} is damaged in {} place{}", printable(path->string()),
                                 checked->problem_count, checked->problem_count == 1 ? "" : "s"),
                     std::string(when_damaged)});
}
}  // namespace

std::string checked_json(const journal::Checked& checked) {
    return fmt::format(
        "\"version\":{},\"bytes\":{},\"events\":{},\"last_seq\":{},\"deleted\":{},\"id_prefix\":{}",
        checked.version, checked.bytes, checked.events, checked.last_seq, checked.deleted,
        json_text(checked.id_prefix));
}

std::string checked_text(const journal::Checked& checked) {
    auto deleted = checked.deleted == 0 ? "" : fmt::format("; {} older ones were deleted", checked.deleted);
    return fmt::format("{} events, numbers up to {}{}; {} bytes, schema version {}", checked.events,
                       checked.last_seq, deleted, checked.bytes, checked.version);
}

void add_store(CLI::App& app, Context& context) {
    auto& store = add_command(app, "store", "Check, back up, restore or shrink the store",
                              "gantry store check\n"
                              "gantry store backup /backup/gantry.db\n"
                              "gantry store restore /backup/gantry.db");
    store.require_subcommand(1);
    auto options = std::make_shared<CheckOptions>();
    auto& command = add_command(store, "check", "Is all as it was stored? Also while the gateway runs",
                                "gantry store check\ngantry store check --db /backup/gantry.db --json");
    add_store_place(command, options->store);
    command.add_flag("--json", options->json, "The result as one JSON object");
    on_run(command, context, [&context, options] { return store_check(context, *options); });
    add_store_backup(store, context);
    add_store_compact(store, context);
    add_store_downgrade(store, context);
}

}  // namespace gantry::cli
