// gantry config: the configuration file, offline.
#include <ostream>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "base/text.hpp"
#include "cli/commands.hpp"
#include "cli/input.hpp"
#include "gateway/config.hpp"

namespace gantry::cli {

namespace {
struct CheckOptions {
    std::string file = "gantry.toml";
    bool json = false;
};

Result<gateway::Config> load(Context& context, const std::string& file) {
    if (file != "-") return gateway::load_config(file);
    auto input = Input::open(context, file);
    std::string text;
    // parse_config() refuses what is longer than any configuration, so there is no need to read it all.
    for (bool end = false; !end && text.size() <= Input::max_line;) {
        auto piece = input->next_piece();
        if (!piece) return tl::unexpected(piece.error());
        text += as_text(*piece);
        end = piece->empty();
    }
    return gateway::parse_config(text, "stdin");
}

// `text` holds one finding a line.
void append_json_lines(std::string& out, std::string_view text) {
    out += '[';
    for (bool first = true; !text.empty(); first = false) {
        auto line = text.substr(0, text.find('\n'));
        text.remove_prefix(std::min(text.size(), line.size() + 1));
        if (!first) out += ',';
        append_json_string(out, line);
    }
    out += ']';
}

std::string json_report(const std::string& file, const Result<gateway::Config>& config) {
    std::string out = "{\"file\":";
    append_json_string(out, file);
    out += fmt::format(",\"valid\":{},\"errors\":", config.has_value());
    append_json_lines(out, config ? "" : config.error().text());
    out += ",\"warnings\":";
    append_json_lines(out, config ? fmt::format("{}", fmt::join(config->warnings, "\n")) : "");
    if (config)
        out += fmt::format(",\"readers\":{},\"zones\":{}", config->readers.size(), config->zones.size());
    return out + "}\n";
}

int check(Context& context, const CheckOptions& options) {
    auto config = load(context, options.file);
    if (options.json) {
        context.out << json_report(options.file, config);
        return config ? done : failed;
    }
    if (!config) {
        context.err << config.error().text() << '\n';
        return failed;
    }
    for (auto& warning : config->warnings)
        context.err << warning << '\n';
    auto counted = [](std::size_t count, std::string_view what) {
        return fmt::format("{} {}{}", count, what, count == 1 ? "" : "s");
    };
    auto sinks = config->sinks.size();
    context.out << fmt::format(
        "{}: good, {}{}{}\n", printable(options.file), counted(config->readers.size(), "reader"),
        sinks == 0 ? "" : ", " + counted(sinks, "sink"), config->warnings.empty() ? "" : ", with warnings");
    return done;
}

std::vector<std::string> example_names() {
    auto names = make_names();
    for (auto kind : gateway::sink_kind_names())
        names.emplace_back(kind);
    return names;
}

int example(Context& context, const std::string& make) {
    auto text = gateway::config_example(make);
    if (!text) return complain(context, "config example", text.error());
    context.out << *text;
    return done;
}
}  // namespace

void add_config(CLI::App& app, Context& context) {
    auto& command = add_command(app, "config", "Check gantry.toml, or print an example or its schema",
                                "gantry config example > gantry.toml\n"
                                "gantry config check gantry.toml");
    command.require_subcommand(1);

    auto& checking =
        add_command(command, "check", "Say what is wrong with a file: file:line:column, and what to do",
                    "gantry config check\n"
                    "gantry config check /etc/gantry/gantry.toml");
    auto options = std::make_shared<CheckOptions>();
    checking.add_option("FILE", options->file, "The file, - for the standard input (default: gantry.toml)");
    checking.add_flag("--json", options->json, "One JSON object: valid, errors, warnings");
    on_run(checking, context, [&context, options] { return check(context, *options); });

    auto& schema = add_command(command, "schema", "The JSON Schema of gantry.toml, for editors",
                               "gantry config schema > gantry.schema.json");
    on_run(schema, context, [&context] {
        context.out << gateway::config_schema() << '\n';
        return done;
    });

    auto& printing =
        add_command(command, "example",
                    "A complete file with comments, or only the readers of one make or one kind of sink",
                    "gantry config example > gantry.toml\n"
                    "gantry config example " +
                        make_names().front());
    auto make = std::make_shared<std::string>();
    add_choice(printing, context, "NAME", *make, example_names(),
               "Only what a make's reader, or a kind of sink, needs");
    on_run(printing, context, [&context, make] { return example(context, *make); });
}

}  // namespace gantry::cli
