// gantry store downgrade: back to the schema of an older program.
#include <ostream>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "base/text.hpp"
#include "cli/place.hpp"
#include "cli/store_commands.hpp"
#include "cli/values.hpp"
#include "gateway/data_lock.hpp"

namespace gantry::cli {

namespace {
struct DowngradeOptions {
    Place place;
    std::uint64_t to = 0;
    bool yes = false, json = false;
};

int downgrade(Context& context, const DowngradeOptions& options) {
    constexpr std::string_view verb = "store downgrade";
    auto directory = options.place.directory();
    if (!directory) return complain(context, verb, directory.error());
    auto path = *directory / "gantry.db";
    std::error_code error;
    if (!std::filesystem::exists(path, error))
        return complain(context, verb,
                        {fmt::format("there is no store {}", printable(path.string())),
                         "name the gateway's place with -c FILE or --data-dir DIR"});
    auto lock = gateway::DataLock::take(*directory, "gantry store downgrade");
    if (!lock) return complain(context, verb, lock.error());
    auto to = static_cast<int>(options.to);
    auto gone = journal::downgrade_store(path, to, options.yes);
    if (!gone) return complain(context, verb, gone.error().error);
    auto lost = fmt::format("{}", fmt::join(gone->lost, ", "));
    if (!gone->done && !gone->lost.empty()) {
        auto question = fmt::format("Version {} has no place for: {}. Delete that?", to, lost);
        if (confirmed(context, question).value_or(false)) {
            gone = journal::downgrade_store(path, to, true);
            if (!gone) return complain(context, verb, gone.error().error);
        } else {
            return complain(context, verb,
                            {fmt::format("version {} has no place for: {}; nothing was changed", to, lost),
                             "make a backup, then say --yes to delete that"});
        }
    }
    if (options.json) {
        std::string list;
        for (auto& each : gone->lost) {
            if (!list.empty()) list += ',';
            append_json_string(list, each);
        }
        context.out << fmt::format("{{\"from\":{},\"to\":{},\"lost\":[{}]}}\n", gone->from, gone->to, list);
    } else if (!gone->done) {
        context.out << fmt::format("the store has version {} already\n", gone->to);
    } else {
        context.out << fmt::format("the store had version {} and has version {} now{}\n", gone->from,
                                   gone->to, gone->lost.empty() ? "; nothing was lost" : "; lost: " + lost);
    }
    return done;
}
}  // namespace

void add_store_downgrade(CLI::App& store, Context& context) {
    auto options = std::make_shared<DowngradeOptions>();
    auto& command =
        add_command(store, "downgrade", "Bring the store of a stopped gateway back to an older version",
                    "gantry store downgrade --to 3\ngantry store downgrade --to 3 --yes");
    add_place(command, options->place);
    add_count(command, "--to", options->to, 1, "The schema version that the older gantry knows", 1'000'000)
        .required();
    command.add_flag("--yes", options->yes, "Delete what that version has no place for");
    command.add_flag("--json", options->json, "The result as one JSON object");
    on_run(command, context, [&context, options] { return downgrade(context, *options); });
}

}  // namespace gantry::cli
