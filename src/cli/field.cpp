// gantry field: scenarios of the virtual field, without any reader of any make.
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <ostream>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "base/text.hpp"
#include "cli/commands.hpp"
#include "cli/scenario.hpp"
#include "cli/values.hpp"
#include "field/picture.hpp"

namespace gantry::cli {

namespace {
constexpr std::string_view examples_folder = "examples/scenarios";
// A scene needs a time to begin at, and takes any.
constexpr Steady beginning = Steady{} + 24h;

struct FieldOptions {
    std::string file, output;
    std::vector<std::string> files;
    std::optional<std::chrono::milliseconds> at, run_for;
    double turned_db = 0;
    bool json = false;
};

std::string json_text(std::string_view text) {
    std::string out;
    append_json_string(out, text);
    return out;
}

std::size_t antennas(const field::Scenario& scenario) {
    std::size_t sum = 0;
    for (auto& reader : scenario.readers)
        sum += reader.antennas.size();
    return sum;
}

std::string counted(std::size_t count, std::string_view what) {
    return fmt::format("{} {}{}", count, what, count == 1 ? "" : "s");
}

std::string json_head(const std::string& file, const field::Scenario& scenario) {
    return fmt::format(R"({{"file":{},"name":{},"about":{},"readers":{},"antennas":{},"tags":{})",
                       json_text(file), json_text(scenario.name), json_text(scenario.about),
                       scenario.readers.size(), antennas(scenario), scenario.tags());
}

// --- check
// ---------------------------------------------------------------------------------------------------

std::string json_refusal(const std::string& file, const Error& error) {
    std::string out = fmt::format(R"({{"file":{},"valid":false,"errors":[)", json_text(file));
    auto text = error.text();
    for (std::string_view left = text; !left.empty();) {
        auto line = left.substr(0, left.find('\n'));
        left.remove_prefix(std::min(left.size(), line.size() + 1));
        out += json_text(line) + (left.empty() ? "" : ",");
    }
    return out + "]}\n";
}

int check(Context& context, const FieldOptions& options) {
    int result = done;
    for (auto& file : options.files) {
        auto scenario = load_scenario(context, file);
        if (!scenario) {
            result = failed;
            if (options.json)
                context.out << json_refusal(file, scenario.error());
            else
                (void)refuse_scenario(context, scenario.error());
        } else if (options.json) {
            context.out << json_head(file, *scenario) << ",\"valid\":true}\n";
        } else {
            context.out << fmt::format(
                "{}: fine; {}, {}, {}\n", printable(file), counted(scenario->readers.size(), "reader"),
                counted(antennas(*scenario), "antenna"), counted(scenario->tags(), "tag"));
        }
    }
    context.out << std::flush;
    return result;
}

// --- list
// ----------------------------------------------------------------------------------------------------

Result<std::vector<std::string>> scenarios_in(const std::string& folder) {
    std::error_code error;
    std::vector<std::string> files;
    for (auto& entry : std::filesystem::directory_iterator(folder, error))
        if (entry.path().extension() == ".toml") files.push_back(entry.path().string());
    if (error)
        return fail(fmt::format("{}: {}", printable(folder), error.message()),
                    "name a folder of scenarios, or scenario files");
    std::ranges::sort(files);
    return files;
}

void list_one(Context& context, const FieldOptions& options, const std::string& file,
              const field::Scenario& scenario) {
    if (options.json) {
        std::string out = json_head(file, scenario) + ",\"reader_names\":[";
        for (std::size_t i = 0; i < scenario.readers.size(); ++i)
            out += (i == 0 ? "" : ",") + json_text(scenario.readers[i].name);
        context.out << out << "]}\n";
        return;
    }
    context.out << fmt::format("{:<16} {}\n{:<16} {}; {}\n", printable(scenario.name),
                               printable(scenario.about), "", printable(file),
                               counted(scenario.tags(), "tag"));
    for (auto& reader : scenario.readers)
        context.out << fmt::format(
            "{:<16} reader {} ({}): {}, session {}, q {}, {}{}\n", "", printable(reader.name), reader.make,
            counted(reader.antennas.size(), "antenna"), reader.session, reader.q, field::name_of(reader.mode),
            reader.anticollision ? "" : ", no anticollision");
    for (auto& group : scenario.groups)
        context.out << fmt::format("{:<16} tags {}: {} {}, {}\n", "", printable(group.name), group.count,
                                   event::to_text(group.technology), group.motion ? "moving" : "still");
}

int list(Context& context, FieldOptions options) {
    std::error_code error;
    if (options.files.empty()) options.files.emplace_back(examples_folder);
    std::vector<std::string> files;
    for (auto& each : options.files) {
        if (each != "-" && (std::filesystem::is_directory(each, error) || each == examples_folder)) {
            auto found = scenarios_in(each);
            if (!found) return complain(context, "field list", found.error());
            files.insert(files.end(), found->begin(), found->end());
        } else {
            files.push_back(each);
        }
    }
    int result = done;
    for (auto& file : files) {
        auto scenario = load_scenario(context, file);
        if (scenario)
            list_one(context, options, file, *scenario);
        else
            result = refuse_scenario(context, scenario.error());
    }
    context.out << std::flush;
    return result;
}

// --- run
// -----------------------------------------------------------------------------------------------------

void report(Context& context, const FieldOptions& options, const field::Scenario& scenario,
            const field::Survey& survey, double seconds) {
    auto rate = [seconds](std::uint64_t reads) { return static_cast<double>(reads) / seconds; };
    for (std::size_t i = 0; i < scenario.readers.size(); ++i) {
        auto& reads = survey.readers()[i];
        auto& name = scenario.readers[i].name;
        if (options.json)
            context.out << fmt::format(
                R"({{"reader":{},"reads":{},"reads_per_s":{:.1f},"tags":{},"by_antenna":[{}]}})"
                "\n",
                json_text(name), reads.reads, rate(reads.reads), reads.tags,
                fmt::join(reads.by_antenna, ","));
        else
            context.out << fmt::format("reader {:<16} {:>7} reads, {:>5.0f}/s, of {} tags; by antenna: {}\n",
                                       printable(name), reads.reads, rate(reads.reads), reads.tags,
                                       fmt::join(reads.by_antenna, ", "));
    }
    for (std::uint32_t i = 0; i < scenario.groups.size(); ++i) {
        auto& group = scenario.groups[i];
        auto read = survey.read_of(i);
        if (options.json)
            context.out << fmt::format(R"({{"group":{},"tags":{},"read":{},"missed":{}}})"
                                       "\n",
                                       json_text(group.name), group.count, read, group.count - read);
        else
            context.out << fmt::format("tags   {:<16} {:>7} of {} read, {} missed\n", printable(group.name),
                                       read, group.count, group.count - read);
    }
    context.out << std::flush;
}

int run_scene(Context& context, const FieldOptions& options) {
    auto scenario = load_scenario(context, options.file);
    if (!scenario) return refuse_scenario(context, scenario.error());
    auto lasts = options.run_for ? std::chrono::microseconds(*options.run_for) : scenario->lasts;
    field::Scene scene(*scenario, beginning);
    field::Survey survey(scene, beginning, options.turned_db);
    survey.run_to(beginning + lasts);
    report(context, options, *scenario, survey, std::chrono::duration<double>(lasts).count());
    return done;
}

// --- draw
// ----------------------------------------------------------------------------------------------------

int draw(Context& context, const FieldOptions& options) {
    auto scenario = load_scenario(context, options.file);
    if (!scenario) return refuse_scenario(context, scenario.error());
    field::Scene scene(*scenario, beginning);
    field::Survey survey(scene, beginning);
    survey.run_to(beginning + options.at.value_or(0ms));
    auto picture = field::draw(scene, survey);
    if (options.output.empty() || options.output == "-") {
        context.out << picture << std::flush;
        return done;
    }
    std::ofstream file(options.output, std::ios::binary);
    file << picture << std::flush;
    if (!file)
        return complain(context, "field draw",
                        {fmt::format("{} cannot be written", printable(options.output)),
                         "is its folder there, and may this user write to it?"});
    return done;
}

CLI::Option* add_file(CLI::App& command, FieldOptions& options) {
    return command.add_option("SCENARIO", options.file, "The scenario file; - is the standard input")
        ->type_name("FILE")
        ->required();
}
}  // namespace

void add_field(CLI::App& app, Context& context) {
    auto& command =
        add_command(app, "field", "Scenarios of the virtual field: check, list, play and draw them",
                    "gantry field check my-dock.toml\n"
                    "gantry field list\n"
                    "gantry field run examples/scenarios/dock-door.toml\n"
                    "gantry field draw examples/scenarios/dock-door.toml --at 1.5s -o dock.svg");
    command.require_subcommand(1);
    auto options = std::make_shared<FieldOptions>();

    auto& checking = add_command(command, "check", "What is wrong with scenario files",
                                 "gantry field check examples/scenarios/*.toml");
    checking.add_option("SCENARIO", options->files, "Scenario files; - is the standard input")
        ->type_name("FILE")
        ->required();
    checking.add_flag("--json", options->json, "One JSON object a file");
    on_run(checking, context, [&context, options] { return check(context, *options); });

    auto& listing = add_command(command, "list", "What scenarios hold: readers, antennas, tags",
                                "gantry field list\ngantry field list my-scenarios dock.toml");
    listing
        .add_option("SCENARIO", options->files,
                    "Scenario files and folders of them (default: examples/scenarios)")
        ->type_name("FILE");
    listing.add_flag("--json", options->json, "One JSON object a scenario");
    on_run(listing, context, [&context, options] { return list(context, *options); });

    auto& running = add_command(command, "run", "Play a scenario as fast as can be, and count who reads what",
                                "gantry field run examples/scenarios/shelf.toml --for 30s\n"
                                "gantry field run examples/scenarios/dock-door.toml --turn -6");
    add_file(running, *options);
    add_duration(running, "--for", options->run_for, "How much of it (default: what the scenario says)");
    running.add_option("--turn", options->turned_db, "All readers' power turned up or down, in dB")
        ->check(CLI::Range(-60.0, 9.0))
        ->type_name("NUMBER");
    running.add_flag("--json", options->json, "One JSON object a reader and a group of tags");
    on_run(running, context, [&context, options] { return run_scene(context, *options); });

    auto& drawing = add_command(command, "draw", "A picture of a scenario at a moment, as SVG",
                                "gantry field draw examples/scenarios/dock-door.toml --at 1.5s -o dock.svg");
    add_file(drawing, *options);
    add_duration(drawing, "--at", options->at,
                 "The moment, from the start of the scene (default: the start)");
    drawing.add_option("-o,--output", options->output, "The file (default: stdout)")->type_name("FILE");
    on_run(drawing, context, [&context, options] { return draw(context, *options); });
}

}  // namespace gantry::cli
