// gantry store compact: through the gateway, which alone writes, or without one.
#include <ostream>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "base/text.hpp"
#include "cli/remote.hpp"
#include "cli/signals.hpp"
#include "cli/store_commands.hpp"
#include "gateway/data_lock.hpp"

namespace gantry::cli {

namespace {
namespace json = boost::json;
constexpr std::string_view compact_verb = "store compact";

struct CompactOptions {
    Place place;
    bool json = false;
};

int tell_compacted(Context& context, const CompactOptions& options, std::uint64_t before,
                   std::uint64_t after) {
    context.out << (options.json ? fmt::format("{{\"bytes_before\":{},\"bytes_after\":{}}}\n", before, after)
                                 : fmt::format("{} bytes before, {} bytes after\n", before, after));
    return done;
}

std::uint64_t number_in(const json::object& object, std::string_view key) {
    const auto* value = object.if_contains(key);
    boost::system::error_code error;
    return value != nullptr && value->is_number() ? value->to_number<std::uint64_t>(error) : 0;
}

std::string text_in(const json::object& object, std::string_view key) {
    const auto* value = object.if_contains(key);
    return value != nullptr && value->is_string() ? std::string(value->get_string()) : std::string();
}

// `held`: why we cannot do it ourselves.
int compact_through_gateway(Context& context, const CompactOptions& options, const Error& held) {
    Signals signals;
    auto answer = ask(options.place, "POST", "/api/v1/store/compact");
    if (!answer) return complain(context, compact_verb, {held.what, answer.error().text()});
    for (;;) {
        if (!answer) return complain(context, compact_verb, answer.error());
        const auto* store = answer->if_object();
        const auto* compaction = store != nullptr ? store->if_contains("compaction") : nullptr;
        const auto* state = compaction != nullptr ? compaction->if_object() : nullptr;
        if (state == nullptr)
            return complain(context, compact_verb,
                            {"the gateway does not say how it goes", "are both of the same version?"});
        const auto* running = state->if_contains("running");
        if (running == nullptr || !running->is_bool() || !running->get_bool()) {
            if (auto error = text_in(*state, "error"); !error.empty())
                return complain(context, compact_verb, {error, text_in(*state, "hint")});
            return tell_compacted(context, options, number_in(*state, "bytes_before"),
                                  number_in(*state, "bytes_after"));
        }
        if (auto trouble = text_in(*store, "trouble"); !trouble.empty())
            return complain(
                context, compact_verb,
                {"the gateway cannot write its store: " + trouble, "it compacts as soon as it can again"});
        // What is under way goes on without us.
        if (signals.wait(100ms)) return stopped_by_user;
        answer = ask(options.place, "GET", "/api/v1/store");
    }
}

int compact(Context& context, const CompactOptions& options) {
    auto directory = options.place.directory();
    if (!directory) return complain(context, compact_verb, directory.error());
    auto path = *directory / "gantry.db";
    std::error_code error;
    if (!std::filesystem::exists(path, error))
        return complain(context, compact_verb,
                        {fmt::format("there is no store {}", printable(path.string())),
                         "name the gateway's place with -c FILE or --data-dir DIR"});
    auto lock = gateway::DataLock::take(*directory, "gantry store compact");
    if (!lock) return compact_through_gateway(context, options, lock.error());
    Signals signals;
    bool stopped = false;
    auto compacted = journal::compact_store(path, [&](std::uint64_t, std::uint64_t) {
        stopped = stopped || signals.wait(0ms);
        return !stopped;
    });
    if (!compacted) return complain(context, compact_verb, compacted.error().error);
    tell_compacted(context, options, compacted->bytes_before, compacted->bytes_after);
    return stopped ? stopped_by_user : done;
}
}  // namespace

void add_store_compact(CLI::App& store, Context& context) {
    auto options = std::make_shared<CompactOptions>();
    auto& command = add_command(
        store, "compact", "Give free room in the store back to the disk; also while the gateway runs",
        "gantry store compact\ngantry store compact --data-dir /var/lib/gantry --json");
    add_place(command, options->place);
    command.add_flag("--json", options->json, "The result as one JSON object");
    on_run(command, context, [&context, options] { return compact(context, *options); });
}

}  // namespace gantry::cli
