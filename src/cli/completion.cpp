// gantry completion: what the shell should know.
#include "cli/completion.hpp"

#include <algorithm>
#include <ostream>

#include <CLI/CLI.hpp>

#include "cli/commands.hpp"

namespace gantry::cli {

namespace {
std::vector<std::string> words_of(const CLI::Option& option, const Context& context) {
    auto it = context.words.find(&option);
    return it == context.words.end() ? std::vector<std::string>{} : it->second;
}

// The text of --help; without the list of words that completion offers anyway.
std::string first_words(const CLI::Option& option, const Context& context) {
    auto text = option.get_description();
    if (context.words.contains(&option)) text = text.substr(0, text.find(':'));
    std::ranges::replace(text, '\n', ' ');
    return text;
}

bool names_a_file(const CLI::Option& option) {
    auto type = option.get_type_name();
    return type == "FILE" || type == "DIR" || option.get_name(true).starts_with("FILE");
}

CompletionNode walk(const CLI::App& app, const Context& context, const std::string& above,
                    const std::vector<CompletionOption>& inherited) {
    CompletionNode node;
    node.path = above + app.get_name();
    node.help = app.get_description();
    std::vector<CompletionOption> passed_on;
    for (auto* option : app.get_options()) {
        if (option->get_positional()) {
            auto words = words_of(*option, context);
            if (context.asked.contains(option)) {
                node.asks = true;
                continue;
            }
            node.takes_files = node.takes_files || names_a_file(*option);
            node.words.insert(node.words.end(), words.begin(), words.end());
            continue;
        }
        CompletionOption out;
        for (auto& name : option->get_snames())
            out.names.push_back("-" + name);
        for (auto& name : option->get_lnames())
            out.names.push_back("--" + name);
        out.help = first_words(*option, context);
        out.takes_value = option->get_items_expected_max() > 0;
        out.words = words_of(*option, context);
        out.takes_files = names_a_file(*option);
        if (out.takes_value) passed_on.push_back(out);  // --help and --version are each command's own
        node.options.push_back(std::move(out));
    }
    node.options.insert(node.options.end(), inherited.begin(), inherited.end());
    passed_on.insert(passed_on.end(), inherited.begin(), inherited.end());
    for (auto* sub : app.get_subcommands([](const CLI::App*) { return true; }))
        if (!sub->get_group().empty())  // else it is hidden
            node.children.push_back(walk(*sub, context, node.path + " ", passed_on));
    return node;
}

CompletionNode whole_tree(Context& context) {
    CLI::App app;
    Context own{context.in, context.out, context.err, {}};
    build(app, own);
    return completion_tree(app, own);
}

int print(Context& context, const std::string& shell) {
    if (shell.empty()) return misuse(context, "completion", {"say which shell", "bash, zsh or fish"});
    auto root = whole_tree(context);
    context.out << (shell == "bash"  ? bash_completion(root)
                    : shell == "zsh" ? zsh_completion(root)
                                     : fish_completion(root));
    return done;
}
// Bash hands over its line, the others their words.
int answer(Context& context, bool line, std::vector<std::string> words) {
    if (line) {
        words = split_line(words.empty() ? "" : words.front());
        if (!words.empty()) words.erase(words.begin());  // the program
    }
    auto found = words_for(whole_tree(context), words);
    if (line && !words.empty()) found = without_prefix(std::move(found), words.back());
    for (auto& each : found)
        context.out << each << '\n';
    return done;
}
}  // namespace

CompletionNode completion_tree(const CLI::App& app, const Context& context) {
    return walk(app, context, "", {});
}

void add_completion(CLI::App& app, Context& context) {
    auto& command =
        add_command(app, "completion", "A script that teaches your shell to complete gantry's commands",
                    "source <(gantry completion bash)\n"
                    "gantry completion bash > /etc/bash_completion.d/gantry\n"
                    "gantry completion zsh > \"${fpath[1]}/_gantry\"\n"
                    "gantry completion fish > ~/.config/fish/completions/gantry.fish");
    auto shell = std::make_shared<std::string>();
    add_choice(command, context, "SHELL", *shell, {"bash", "zsh", "fish"}, "Your shell");
    auto& asking = add_command(command, "words", "What may stand next on an unfinished command line",
                               "gantry completion words zsh -- reader exec dock-1 Get\n"
                               "gantry completion words bash -- 'gantry reader exec dock-1 Get'");
    asking.group("");  // for the scripts only
    struct Asked {
        std::string shell;
        std::vector<std::string> words;
    };
    auto asked = std::make_shared<Asked>();
    asking.add_option("SHELL", asked->shell)->required();
    asking.add_option("WORDS", asked->words);
    on_run(asking, context,
           [&context, asked] { return answer(context, asked->shell == "bash", asked->words); });
    on_run(command, context, [&context, shell] { return print(context, *shell); });
}

}  // namespace gantry::cli
