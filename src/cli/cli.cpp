#include "cli/cli.hpp"

#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <istream>
#include <ostream>
#include <string>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "base/log.hpp"
#include "base/text.hpp"
#include "protocols/registry.hpp"

namespace gantry::cli {

namespace {
constexpr std::string_view summary =
    "Gantry, an RFID gateway: readers on one side, events that are safe on disk on the other.";
const std::vector<std::string> log_levels = {"debug", "info", "warn", "error", "off"};

log::Level level_of(std::string_view name) {
    auto at = std::ranges::find(log_levels, name) - log_levels.begin();
    return static_cast<log::Level>(at);
}

// "decoed is none of: …" is what CLI11 says; people want to know what they meant.
std::string refuse_word(const std::vector<std::string>& words, const std::string& given) {
    if (std::ranges::find(words, given) != words.end()) return {};
    std::vector<std::string_view> candidates(words.begin(), words.end());
    auto near = nearest(given, candidates);
    if (!near.empty()) return fmt::format("{} is not known; did you mean {}?", printable(given), near);
    return fmt::format("{} is none of: {}", printable(given), fmt::join(words, ", "));
}

// The innermost subcommand that the command line named, and how to write it.
CLI::App* innermost(CLI::App& app, std::string& path) {
    auto* at = &app;
    path = at->get_name();
    while (!at->get_subcommands().empty()) {
        at = at->get_subcommands().front();
        path += " " + at->get_name();
    }
    return at;
}

std::vector<std::string> words_of(const CLI::App& app) {
    std::vector<std::string> words;
    for (auto* sub : app.get_subcommands([](const CLI::App*) { return true; }))
        words.push_back(sub->get_name());
    return words;
}

std::vector<std::string> options_of(const CLI::App& app) {
    std::vector<std::string> words;
    for (auto* at = &app; at != nullptr; at = at->get_parent())
        for (auto* option : at->get_options())
            for (auto& name : option->get_lnames())
                words.push_back("--" + name);
    return words;
}

Error explain_extra(const CLI::App& command, const std::string& extra) {
    bool is_option = extra.size() > 1 && extra.front() == '-';
    auto words = is_option ? options_of(command) : words_of(command);
    std::vector<std::string_view> candidates(words.begin(), words.end());
    auto shown = printable(extra);
    auto near = nearest(extra.substr(0, extra.find('=')), candidates);
    if (!near.empty()) return {fmt::format("{} is not known", shown), fmt::format("did you mean {}?", near)};
    if (is_option) return {fmt::format("there is no option {}", shown), ""};
    if (words.empty()) return {fmt::format("{} is one argument too many", shown), ""};
    return {fmt::format("there is no command {}", shown),
            fmt::format("commands: {}", fmt::join(words, ", "))};
}

int explain(CLI::App& app, Context& context, const CLI::ParseError& error) {
    std::string path;
    auto* command = innermost(app, path);
    Error said{error.what(), ""};
    auto extras = app.remaining(true);
    bool wants_command = command->get_require_subcommand_min() > 0;
    if (!extras.empty() && (wants_command || dynamic_cast<const CLI::ExtrasError*>(&error) != nullptr))
        said = explain_extra(*command, extras.front());
    else if (wants_command && command->get_subcommands().empty())
        said = {"say what to do", fmt::format("one of: {}", fmt::join(words_of(*command), ", "))};
    std::ranges::replace(said.what, '\n', ' ');
    context.err << path << ": " << said.text() << "; see " << path << " --help\n";
    return wrong_usage;
}

CLI::Option* offer(Context& context, CLI::Option& option, std::vector<std::string> words) {
    option.description(fmt::format("{}: {}", option.get_description(), fmt::join(words, ", ")));
    option.check([words](const std::string& given) { return refuse_word(words, given); }, "");
    context.words[&option] = std::move(words);
    return &option;
}

int run_chosen(Context& context, std::string_view path) {
    try {
        int code = context.run();
        // Output that did not reach its file must not look like success.
        if (!context.out.flush() && !nobody_reads(context))
            return complain(context, path, {"cannot write the output", "is the disk full?"});
        return code;
    } catch (const std::exception& error) {
        return complain(context, path, {fmt::format("stopped: {}", printable(error.what())), ""});
    }
}
}  // namespace

CLI::App& add_command(CLI::App& parent, std::string_view name, std::string_view about,
                      std::string_view examples) {
    auto* command = parent.add_subcommand(std::string(name), std::string(about));
    std::string footer;
    while (!examples.empty()) {
        auto line = examples.substr(0, examples.find('\n'));
        examples.remove_prefix(std::min(examples.size(), line.size() + 1));
        footer += fmt::format("{}\n  {}", footer.empty() ? "Examples:" : "", line);
    }
    command->footer(footer);
    return *command;
}

void on_run(CLI::App& command, Context& context, std::function<int()> action) {
    command.callback([&command, &context, action = std::move(action)] {
        if (command.get_subcommands().empty()) context.run = action;  // else that one is what was asked for
    });
}

CLI::Option* add_choice(CLI::App& command, Context& context, const std::string& names, std::string& into,
                        std::vector<std::string> words, const std::string& help) {
    return offer(context, *command.add_option(names, into, help), std::move(words));
}

CLI::Option* add_choice(CLI::App& command, Context& context, const std::string& names,
                        std::vector<std::string>& into, std::vector<std::string> words,
                        const std::string& help) {
    return offer(context, *command.add_option(names, into, help), std::move(words));
}

int complain(Context& context, std::string_view command, const Error& error) {
    context.err << "gantry " << command << ": " << error.text() << '\n' << std::flush;
    return failed;
}

int misuse(Context& context, std::string_view command, const Error& error) {
    context.err << "gantry " << command << ": " << error.text() << "; see gantry " << command << " --help\n"
                << std::flush;
    return wrong_usage;
}

bool nobody_reads(const Context& context) {
    if (context.out_fd < 0) return false;
    pollfd out{context.out_fd, 0, 0};  // errors are told without asking
    return ::poll(&out, 1, 0) == 1 && (out.revents & (POLLERR | POLLHUP)) != 0;
}

std::optional<bool> confirmed(Context& context, std::string_view question) {
    if (context.in_fd < 0 || ::isatty(context.in_fd) == 0) return {};
    context.out << std::flush;
    context.err << question << " [y/N] " << std::flush;
    std::string answer;
    std::getline(context.in, answer);
    return answer == "y" || answer == "Y" || answer == "yes";
}

std::vector<std::string> make_names() {
    std::vector<std::string> names;
    for (auto* plugin : plugins())
        names.emplace_back(plugin->name);
    return names;
}

void build(CLI::App& app, Context& context) {
    app.name("gantry");
    app.description(std::string(summary));
    app.get_formatter()->column_width(34);
    app.set_help_flag("-h,--help", "Show this help and exit");
    app.set_version_flag("--version", "gantry " GANTRY_VERSION, "Show the version and exit");
    add_choice(app, context, "--log-level", context.log_level, log_levels, "How much to log on stderr")
        ->type_name("LEVEL");
    app.fallthrough();  // --log-level may stand before or after the subcommand
    app.require_subcommand(1);
    app.footer(
        "Every command has its own --help with examples. Exit codes: 0 done, 1 failed, 2 wrong usage.");
    for (auto add : all_commands())
        add(app, context);
}

int run(std::vector<std::string> arguments, Context& context) {
    CLI::App app;
    build(app, context);
    if (arguments.empty()) {
        context.err << app.help();
        return wrong_usage;
    }
    std::string path;
    try {
        std::ranges::reverse(arguments);  // as CLI11 wants them
        app.parse(std::move(arguments));
    } catch (const CLI::CallForVersion& version) {
        context.out << version.what() << '\n' << std::flush;
        return done;
    } catch (const CLI::CallForHelp&) {
        context.out << app.help() << std::flush;
        return done;
    } catch (const CLI::ParseError& error) {
        return explain(app, context, error);
    }
    log::start(level_of(context.log_level));
    innermost(app, path);
    return run_chosen(context, path.substr(path.find(' ') + 1));
}

}  // namespace gantry::cli
