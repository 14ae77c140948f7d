// gantry events export: what happened, for other programs.
#include <ostream>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "base/text.hpp"
#include "cli/csv.hpp"
#include "cli/events_commands.hpp"
#include "cli/signals.hpp"
#include "cli/values.hpp"
#include "cli/whole_file.hpp"
#include "event/event_json.hpp"

namespace gantry::cli {

namespace {
constexpr std::string_view export_verb = "events export";

struct ExportOptions {
    std::shared_ptr<EventsOptions> events = std::make_shared<EventsOptions>();
    std::string format = "jsonl", output;
    bool raw = false, no_header = false, skip_damaged = false;
};

// Events as lines of the format, in pieces large enough for the system.
class Exporter {
public:
    Exporter(std::ostream& out, const ExportOptions& options, journal::IdPrefixes prefixes)
        : out_(out), options_(options), prefixes_(std::move(prefixes)) {
        if (options.format == "csv" && !options.no_header) buffer_ = csv_header();
    }
    bool add(const event::Event& event) {
        auto& prefix = prefixes_.of(event.seq);
        if (options_.format == "csv") {
            append_csv(buffer_, event, prefix, options_.raw ? Cells::raw : Cells::safe);
        } else {
            event::append_json(buffer_, event, prefix);
            buffer_ += '\n';
        }
        return buffer_.size() < piece || flush();
    }
    bool flush() {
        out_ << buffer_;
        buffer_.clear();
        return static_cast<bool>(out_);
    }

private:
    static constexpr std::size_t piece = 64 * 1024;
    std::ostream& out_;
    const ExportOptions& options_;
    journal::IdPrefixes prefixes_;
    std::string buffer_;
};

int export_events(Context& context, const ExportOptions& options) {
    Signals signals;
    auto store = open_store(options.events->store);
    if (!store) return complain(context, export_verb, store.error());
    auto prefixes = (*store)->id_prefixes();
    if (!prefixes) return complain(context, export_verb, prefixes.error().error);
    auto filter = filter_of(*options.events);
    // What comes while we write is for the next time, or under load there would be no end.
    auto last = (*store)->last_seq();
    if (!last) return complain(context, export_verb, last.error().error);
    filter.up_to = *last;
    std::uint64_t damaged = 0;
    if (options.skip_damaged)
        filter.on_damage = [&](const std::string& what) {
            ++damaged;
            complain(context, export_verb, {what, "it is left out"});
        };

    std::optional<WholeFile> file;
    if (!options.output.empty()) {
        auto opened = WholeFile::open(options.output);
        if (!opened) return complain(context, export_verb, opened.error());
        file.emplace(std::move(*opened));
    }
    Exporter exporter(file ? file->stream() : context.out, options, std::move(*prefixes));
    auto left = options.events->limit;
    std::uint64_t events = 0;
    bool stopped = false;
    if (filter.after < filter.up_to) {
        auto read = (*store)->query(filter, [&](const event::Event& event) {
            if (++events % 4096 == 0) stopped = signals.wait(0ms);
            return exporter.add(event) && --left > 0 && !stopped;
        });
        if (!read) {
            exporter.flush();
            return complain(context, export_verb, read.error().error);
        }
    }
    bool written = exporter.flush();
    if (stopped) return stopped_by_user;
    if (file) {
        if (auto finished = file->finish(); !finished)
            return complain(context, export_verb, finished.error());
    } else if (!written) {
        return done;  // whoever reads us is told, or has gone: see run()
    }
    if (events == 0) mention_unknown_reader(context, **store, options.events->reader);
    if (damaged == 0) return done;
    return complain(
        context, export_verb,
        {fmt::format("{} place{} of the store could not be read", damaged, damaged == 1 ? "" : "s"),
         "all else was exported; see `gantry store check`"});
}
}  // namespace

void add_events_export(CLI::App& events, Context& context) {
    auto options = std::make_shared<ExportOptions>();
    auto& command = add_events_verb(
        events, context, options->events, "export", "Write the events that match to a file or stdout",
        "gantry events export --since 24h -o yesterday.jsonl\n"
        "gantry events export --format csv --type tag.read -o reads.csv\n"
        "gantry events export --format csv --no-header --after 184467 >> all.csv");
    command.add_flag("--newest-first", options->events->newest_first, "Begin with the newest");
    add_count(command, "--limit", options->events->limit, 1, "At most so many");
    add_choice(command, context, "--format", options->format, {"jsonl", "csv"}, "Format");
    command
        .add_option("-o,--output", options->output,
                    "The file, which gets its name when it is whole (default: stdout)")
        ->type_name("FILE");
    command.add_flag("--raw", options->raw,
                     "CSV: text as it is, also what a spreadsheet would take for a formula");
    command.add_flag("--no-header", options->no_header, "CSV: no line with the names of the columns");
    command.add_flag("--skip-damaged", options->skip_damaged,
                     "Go on behind what is damaged in the store, and end with exit code 1");
    on_run(command, context, [&context, options] { return export_events(context, *options); });
}

}  // namespace gantry::cli
