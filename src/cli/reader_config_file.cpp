// gantry reader config dump, diff: a reader's parameters as a file, and what differs from one.
#include <algorithm>
#include <array>
#include <filesystem>
#include <fstream>
#include <ostream>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <CLI/CLI.hpp>

#include "api/json_text.hpp"
#include "base/text.hpp"
#include "base/time.hpp"
#include "cli/job_text.hpp"
#include "cli/parameter_session.hpp"
#include "cli/reader_commands.hpp"
#include "link/link.hpp"

namespace gantry::cli {

namespace json = boost::json;

namespace {
// --- dump --------------------------------------------------------------------------------------------------

std::string lines_about(const Plugin& make, const ParameterValues& values, bool secret) {
    std::vector<std::string_view> names;
    for (auto& row : make.parameters)
        if (row.secret == secret && find(values, row.name) == nullptr) names.push_back(row.name);
    return fmt::format("{}", fmt::join(names, ", "));
}

Result<void> write_file(const std::string& file, const std::string& text) {
    // Whoever reads it meanwhile sees the old one or the new one.
    std::filesystem::path path(file), part(file + ".part");
    {
        std::ofstream out(part, std::ios::binary | std::ios::trunc);
        out << text;
        if (!out.flush()) return fail(fmt::format("{} cannot be written", printable(file)), "see --output");
    }
    std::error_code error;
    std::filesystem::rename(part, path, error);
    if (error) return fail(fmt::format("{} cannot be written: {}", printable(file), error.message()));
    return {};
}

int dump(Context& context, ParameterOptions& options) {
    constexpr std::string_view verb = "reader config dump";
    auto& target = options.target;
    if (auto fine = take_words(target, options.words, {}); !fine) return misuse(context, verb, fine.error());
    auto make = make_of(target);
    if (!make) return complain(context, verb, make.error());
    ParameterSession session(context, options, verb);
    auto values = session.get(options.permanent);
    if (!values) return values.error().code;
    if (target.json) {
        json::object out;
        for (auto& [name, value] : *values)
            out[name] = value;
        context.out << api::json_text(out) << '\n';
        return done;
    }
    std::vector<std::string> about;
    about.push_back(fmt::format("{} ({}): its parameters {}, {}", target.shown(), (*make)->name,
                                options.permanent ? "as they are stored" : "at work",
                                to_rfc3339(link::read_clocks().wall)));
    about.emplace_back(
        "To set them: gantry reader config apply READER FILE; what is left out stays as it is.");
    if (auto secrets = lines_about(**make, *values, true); !secrets.empty())
        about.push_back(fmt::format("Left out, because it is secret: {}", secrets));
    if (auto others = lines_about(**make, *values, false); !others.empty())
        about.push_back(fmt::format("This reader does not tell: {}", others));
    auto text = parameters_to_toml(**make, *values, about);
    if (options.output.empty()) {
        context.out << text;
        return done;
    }
    if (auto written = write_file(options.output, text); !written)
        return complain(context, verb, written.error());
    context.out << fmt::format("{}: {} parameters of {}\n", printable(options.output), values->size(),
                               target.shown());
    return done;
}

// --- diff --------------------------------------------------------------------------------------------------

constexpr int same = 0, different = 1, trouble = 2;

int diff(Context& context, ParameterOptions& options) {
    constexpr std::string_view verb = "reader config diff";
    auto& target = options.target;
    auto in_trouble = [&](const Error& error) { return complain(context, verb, error), trouble; };
    if (auto fine = take_words(target, options.words, {"FILE"}); !fine)
        return misuse(context, verb, fine.error());
    auto make = make_of(target);
    if (!make) return in_trouble(make.error());
    auto file = read_parameters(context, options.words[0], **make);
    if (!file) {
        context.err << file.error().text() << '\n';
        return trouble;
    }
    ParameterSession session(context, options, verb);
    auto values = session.get(options.permanent);
    if (!values) return values.error().code == failed ? trouble : values.error().code;
    std::vector<const FileParameter*> found, secrets;
    for (auto& each : *file) {
        if (each.row->secret)
            secrets.push_back(&each);
        else if (differs(**make, each, *values))
            found.push_back(&each);
    }
    auto now = [&](const FileParameter& each) {
        const auto* value = find(*values, each.row->name);
        return value != nullptr ? *value : json::value(nullptr);
    };
    if (target.json) {
        for (const auto* each : found) {
            json::object line;
            line["parameter"] = std::string(each->row->name);
            line["reader"] = now(*each);
            line["file"] = text_of(*each);
            context.out << api::json_text(line) << '\n';
        }
        return found.empty() ? same : different;
    }
    std::vector<std::array<std::string, 3>> lines;
    if (found.empty())
        context.out << fmt::format("{} is as {} says\n", target.shown(), printable(options.words[0]));
    else
        lines.push_back({"PARAMETER", target.shown(), printable(options.words[0])});
    for (const auto* each : found) {
        auto value = now(*each);
        lines.push_back({std::string(each->row->name), value.is_null() ? "-" : plain(value), text_of(*each)});
    }
    std::array<std::size_t, 2> width{};
    for (auto& line : lines)
        for (std::size_t i = 0; i < width.size(); ++i)
            width[i] = std::max(width[i], line[i].size());
    for (auto& line : lines)
        context.out << fmt::format("{:<{}}  {:<{}}  {}\n", line[0], width[0], line[1], width[1], line[2]);
    context.out << std::flush;
    if (!secrets.empty())
        context.err << fmt::format("not compared, because it is secret: {}\n", names_of(secrets));
    return found.empty() ? same : different;
}

}  // namespace

void add_reader_config_file(CLI::App& config, Context& context) {
    {
        auto options = std::make_shared<ParameterOptions>();
        auto& command =
            add_command(config, "dump",
                        "All parameters as TOML, with what they mean. Secrets are left out, and it says so",
                        "gantry reader config dump dock-1 -o dock-1.toml\n"
                        "gantry reader config dump --address harting://192.168.10.10 --permanent");
        add_target(command, options->target, "The values as one JSON object");
        add_words(command, context, options->words, {{"READER", "The reader"}});
        command.add_option("-o,--output", options->output, "Write this file instead of the standard output")
            ->type_name("FILE");
        command.add_flag("--permanent", options->permanent, "As they are stored, for after a power-down");
        on_run(command, context, [&context, options] { return dump(context, *options); });
    }
    {
        auto options = std::make_shared<ParameterOptions>();
        auto& command = add_command(
            config, "diff",
            "What differs between a reader and a file; of what the file leaves out nothing is said. Exits as "
            "diff does: 0 the same, 1 different, 2 trouble",
            "gantry reader config diff dock-1 dock-1.toml");
        add_target(command, options->target, "One JSON object a difference");
        add_words(command, context, options->words,
                  {{"READER", "The reader"}, {"FILE", "As dump writes it; - for the standard input", true}});
        command.add_flag("--permanent", options->permanent,
                         "Compare with what is stored, for after a power-down");
        on_run(command, context, [&context, options] { return diff(context, *options); });
    }
}

}  // namespace gantry::cli
