#pragma once
#include <functional>
#include <iosfwd>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.hpp"

namespace CLI {
class App;
class Option;
}  // namespace CLI

// One file a subcommand; CLI11 is heavy and stays in the .cpp files.
namespace gantry::cli {

// What every subcommand ends in.
inline constexpr int done = 0;
inline constexpr int failed = 1;             // one clear line on stderr said why
inline constexpr int wrong_usage = 2;        // the command line itself was wrong
inline constexpr int stopped_by_user = 130;  // Ctrl-C, as shells count: 128 and the signal's number

// What a subcommand works with: the process's own streams, or a test's.
struct Context {
    std::istream& in;
    std::ostream& out;
    std::ostream& err;
    std::function<int()> run;  // what the command line asks for; set while it is parsed
    // The words that an option or positional takes, for shell completion.
    std::map<const CLI::Option*, std::vector<std::string>> words = {};
    // Positionals whose words depend on what is there: the shell asks `gantry completion words` each time.
    std::set<const CLI::Option*> asked = {};
    std::string log_level = "info";
    int out_fd = -1;  // what `out` writes to, if it may be a pipe
    int in_fd = -1;   // what `in` reads from, if somebody may sit there
};

// Adds one subcommand with its options to `app`. Whatever the options are bound to must be owned by the
// function given to on_run().
using AddCommand = void (*)(CLI::App& app, Context& context);
std::span<const AddCommand> all_commands();  // in the order of `--help`

// Parses the arguments (without the program's name) and runs what they ask for. Returns the exit code.
int run(std::vector<std::string> arguments, Context& context);
// Builds the whole tree of subcommands into `app`.
void build(CLI::App& app, Context& context);

// For the files of the subcommands:

// `examples`: one a line, without indentation; shown at the end of --help.
CLI::App& add_command(CLI::App& parent, std::string_view name, std::string_view summary,
                      std::string_view examples);
// The command runs `action` when it was chosen.
void on_run(CLI::App& command, Context& context, std::function<int()> action);
// An option that takes one of `words`, or several; a slip is answered with the nearest of them.
CLI::Option* add_choice(CLI::App& command, Context& context, const std::string& names, std::string& into,
                        std::vector<std::string> words, const std::string& help);
CLI::Option* add_choice(CLI::App& command, Context& context, const std::string& names,
                        std::vector<std::string>& into, std::vector<std::string> words,
                        const std::string& help);
// "gantry decode: what; hint" on stderr.
int complain(Context& context, std::string_view command, const Error& error);
// The same for a slip on the command line that shows only when the command looks at it.
int misuse(Context& context, std::string_view command, const Error& error);
// Has whoever read our output through a pipe gone, as `| head` does? Then a stream ends, and that is no
// failure.
bool nobody_reads(const Context& context);
// Asks whoever sits at the terminal; nothing: nobody does.
std::optional<bool> confirmed(Context& context, std::string_view question);
// The names of all makes, for -p and the like.
std::vector<std::string> make_names();

}  // namespace gantry::cli
