// gantry store backup, restore
#include <ostream>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "base/text.hpp"
#include "cli/signals.hpp"
#include "cli/store.hpp"
#include "cli/store_commands.hpp"
#include "gateway/data_lock.hpp"
#include "link/link.hpp"

namespace gantry::cli {

namespace {
struct BackupOptions {
    StorePlace store;
    std::string file;
    bool force = false, json = false;
};

std::string json_path(const std::filesystem::path& path) {
    std::string out;
    append_json_string(out, path.string());
    return out;
}

// Until Ctrl-C: then what was begun is taken away again.
journal::Progress while_wanted(Signals& signals, bool& stopped) {
    return [&signals, &stopped](std::uint64_t, std::uint64_t) {
        stopped = stopped || signals.wait(0ms);
        return !stopped;
    };
}

int backup(Context& context, const BackupOptions& options) {
    constexpr std::string_view verb = "store backup";
    Signals signals;
    auto path = store_file(options.store);
    if (!path) return complain(context, verb, path.error());
    bool stopped = false;
    auto made = journal::back_up(*path, options.file, options.force, while_wanted(signals, stopped));
    if (stopped) return stopped_by_user;
    if (!made) return complain(context, verb, made.error().error);
    if (options.json)
        context.out << fmt::format("{{\"backup\":{},{}}}\n", json_path(options.file), checked_json(*made));
    else
        context.out << fmt::format("{}: {}\n", printable(options.file), checked_text(*made));
    return done;
}

int restore(Context& context, const BackupOptions& options) {
    constexpr std::string_view verb = "store restore";
    Signals signals;
    auto directory = options.store.place.directory();
    if (!directory) return complain(context, verb, directory.error());
    std::error_code error;
    if (!std::filesystem::is_regular_file(options.file, error))
        return complain(context, verb,
                        {fmt::format("there is no file {}", printable(options.file)),
                         "give the file that `gantry store backup` wrote"});
    auto lock = gateway::DataLock::take(*directory, "gantry store restore");
    if (!lock) return complain(context, verb, lock.error());
    bool stopped = false;
    auto path = *directory / "gantry.db";
    auto restored =
        journal::restore(path, options.file, {.now = link::read_clocks().wall, .another = options.force},
                         while_wanted(signals, stopped));
    if (stopped && !restored) return stopped_by_user;
    if (!restored) return complain(context, verb, restored.error().error);
    auto next_id = fmt::format("{}{}", restored->id_prefix, restored->next_seq);
    if (options.json) {
        auto aside = restored->aside.empty() ? "" : ",\"set_aside\":" + json_path(restored->aside);
        std::string next;
        append_json_string(next, next_id);
        context.out << fmt::format("{{\"store\":{},\"epoch\":{},\"next_id\":{},\"numbers_go_on\":{}{},{}}}\n",
                                   json_path(path), restored->epoch, next, restored->numbers_go_on, aside,
                                   checked_json(restored->backup));
        return done;
    }
    context.out << fmt::format("{}: {}\n", printable(path.string()), checked_text(restored->backup));
    context.out << fmt::format("the next event is {}\n", printable(next_id));
    if (!restored->numbers_go_on)
        context.out << fmt::format(
            "which numbers were used after the backup is not known: some from {} on may come again, never an "
            "id\n",
            restored->next_seq);
    if (!restored->aside.empty())
        context.out << fmt::format("the store before is in {}; remove it when nobody needs it any more\n",
                                   printable(restored->aside.string()));
    return done;
}
}  // namespace

void add_store_backup(CLI::App& store, Context& context) {
    {
        auto options = std::make_shared<BackupOptions>();
        auto& command =
            add_command(store, "backup", "Write a checked copy of the store; also while the gateway runs",
                        "gantry store backup /backup/gantry.db\n"
                        "gantry store backup --force -c /etc/gantry/gantry.toml /backup/gantry.db");
        add_store_place(command, options->store);
        command.add_option("FILE", options->file, "The copy")->required();
        command.add_flag("--force", options->force, "Replace the file if there is one");
        command.add_flag("--json", options->json, "The result as one JSON object");
        on_run(command, context, [&context, options] { return backup(context, *options); });
    }
    auto options = std::make_shared<BackupOptions>();
    auto& command =
        add_command(store, "restore", "Put a backup in the place of the store of a stopped gateway",
                    "gantry store restore /backup/gantry.db\n"
                    "gantry store restore --data-dir /var/lib/gantry /backup/gantry.db");
    add_place(command, options->store.place);
    command.add_option("FILE", options->file, "What `gantry store backup` wrote")->required();
    command.add_flag("--force", options->force, "Although the store in place is of another gateway");
    command.add_flag("--json", options->json, "The result as one JSON object");
    on_run(command, context, [&context, options] { return restore(context, *options); });
}

}  // namespace gantry::cli
