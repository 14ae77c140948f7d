#pragma once
#include <string>
#include <vector>

#include "cli/cli.hpp"

// Shell completion from the tree of subcommands itself, so that it cannot fall behind it.
namespace gantry::cli {

struct CompletionOption {
    std::vector<std::string> names;  // "-p", "--protocol"
    std::string help;
    bool takes_value = false;
    std::vector<std::string> words;  // of the value
    bool takes_files = false;        // the value is a file's or directory's name
};

struct CompletionNode {
    std::string path;  // "gantry epc decode"
    std::string help;
    std::vector<CompletionOption> options;  // those of the commands above it among them
    std::vector<std::string> words;         // of its positionals
    bool takes_files = false;
    bool asks = false;  // its positionals are asked for each time, of `gantry completion words`
    std::vector<CompletionNode> children;

    std::string name() const { return path.substr(path.rfind(' ') + 1); }
};

CompletionNode completion_tree(const CLI::App& app, const Context& context);

// The words that may stand last on a command line that is not finished: `words` without the program's name.
// Asks the running gateway, or looks at --address.
std::vector<std::string> words_for(const CompletionNode& root, const std::vector<std::string>& words);
// What bash wants: it takes all up to the last = or : of `word` for words of their own.
std::vector<std::string> without_prefix(std::vector<std::string> found, std::string_view word);
// A command line as bash has it, up to the cursor, as words.
std::vector<std::string> split_line(std::string_view line);

std::string bash_completion(const CompletionNode& root);
std::string zsh_completion(const CompletionNode& root);
std::string fish_completion(const CompletionNode& root);

}  // namespace gantry::cli
