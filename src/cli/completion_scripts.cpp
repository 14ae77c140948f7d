#include <fmt/format.h>

#include "cli/completion.hpp"

namespace gantry::cli {

namespace {
// Inside '…' of bash and zsh.
std::string shell_quoted(std::string_view text) {
    std::string out = "'";
    for (char c : text)
        out += c == '\'' ? std::string("'\\''") : std::string(1, c);
    return out + "'";
}

std::string fish_quoted(std::string_view text) {
    std::string out = "'";
    for (char c : text)
        out += c == '\'' || c == '\\' ? std::string("\\") + c : std::string(1, c);
    return out + "'";
}

std::string joined(const std::vector<std::string>& words, std::string_view separator = " ") {
    return fmt::format("{}", fmt::join(words, separator));
}

template <class Each>
void for_each_node(const CompletionNode& node, const Each& each) {
    each(node);
    for (auto& child : node.children)
        for_each_node(child, each);
}

// 'gantry epc'|'gantry epc decode': every path below the root.
std::string all_paths(const CompletionNode& root, std::string_view separator) {
    std::vector<std::string> paths;
    for_each_node(root, [&](const CompletionNode& node) {
        if (&node != &root) paths.push_back(shell_quoted(node.path));
    });
    return joined(paths, separator);
}

std::string option_cases(const CompletionNode& node, const CompletionOption& option) {
    std::vector<std::string> cases;
    for (auto& name : option.names)
        cases.push_back(shell_quoted(node.path + " " + name));
    return joined(cases, "|");
}

// "{cases}) {what offers its values}; return ;;" for every option that takes a value. `words` writes what
// offers its words.
template <class Words>
std::string value_cases(const CompletionNode& root, std::string_view opening, std::string_view files,
                        const Words& words) {
    std::string out;
    for_each_node(root, [&](const CompletionNode& node) {
        for (auto& option : node.options)
            if (option.takes_value)
                out += fmt::format("        {}{}) {}; return ;;\n", opening, option_cases(node, option),
                                   !option.words.empty() ? words(joined(option.words))
                                   : option.takes_files  ? std::string(files)
                                                         : std::string(":"));
    });
    return out;
}

// Where the words before the cursor lead: the loop's end in bash and zsh.
std::string path_case(const CompletionNode& root, std::string_view opening, std::string_view word) {
    return fmt::format(
        "        case \"$at {0}\" in\n            {1}{2}) at=\"$at {0}\" ;;\n        esac\n    done\n", word,
        opening, all_paths(root, "|"));
}

std::vector<std::string> option_names(const CompletionNode& node) {
    std::vector<std::string> names;
    for (auto& option : node.options)
        names.insert(names.end(), option.names.begin(), option.names.end());
    return names;
}

std::vector<std::string> plain_words(const CompletionNode& node) {
    auto words = node.words;
    for (auto& child : node.children)
        words.push_back(child.name());
    return words;
}

// name:description for zsh's _describe, where a colon in the name must be escaped.
std::string described(std::string_view name, std::string_view help) {
    return shell_quoted(fmt::format("{}:{}", name, help));
}
}  // namespace

std::string bash_completion(const CompletionNode& root) {
    std::string out =
        "# bash completion for gantry, made by `gantry completion bash`\n"
        "_gantry_files() {\n"
        "    compopt -o filenames 2>/dev/null\n"
        "    COMPREPLY+=($(compgen -f -- \"$cur\"))\n"
        "}\n"
        "_gantry() {\n"
        "    COMPREPLY=()\n"
        "    local cur=${COMP_WORDS[COMP_CWORD]} prev=${COMP_WORDS[COMP_CWORD-1]} at=gantry words='' "
        "options='' asks='' files='' "
        "i\n"
        "    # bash cuts --name=value at the equals sign\n"
        "    if [ \"$cur\" = = ]; then cur=''\n"
        "    elif [ \"$prev\" = = ]; then prev=${COMP_WORDS[COMP_CWORD-2]}; fi\n"
        "    for ((i = 1; i < COMP_CWORD; i++)); do\n";
    out += path_case(root, "", "${COMP_WORDS[i]}");
    out += "    case \"$at $prev\" in\n";
    out += value_cases(root, "", "_gantry_files", [](const std::string& words) {
        return fmt::format("COMPREPLY=($(compgen -W {} -- \"$cur\"))", shell_quoted(words));
    });
    out += "    esac\n    case \"$at\" in\n";
    for_each_node(root, [&](const CompletionNode& node) {
        out += fmt::format("        {}) words={} options={}{}{} ;;\n", shell_quoted(node.path),
                           shell_quoted(joined(plain_words(node))), shell_quoted(joined(option_names(node))),
                           node.asks ? " asks=1" : "", node.takes_files ? " files=1" : "");
    });
    out +=
        "    esac\n"
        "    case \"$cur\" in\n"
        "        -*) COMPREPLY=($(compgen -W \"$options\" -- \"$cur\")) ;;\n"
        "        *)  if [ -n \"$asks\" ]; then\n"
        "                words=$(\"${COMP_WORDS[0]}\" completion words bash -- "
        "\"${COMP_LINE:0:COMP_POINT}\" 2>/dev/null)\n"
        "                compopt -o nospace -o nosort 2>/dev/null\n"
        "            fi\n"
        "            COMPREPLY=($(compgen -W \"$words\" -- \"$cur\"))\n"
        "            [ -z \"$files\" ] || _gantry_files\n"
        "            # a space after a whole word, none after a field's equals sign\n"
        "            [ -z \"$asks\" ] || for i in \"${!COMPREPLY[@]}\"; do\n"
        "                [[ ${COMPREPLY[i]} == *= ]] || COMPREPLY[i]+=' '\n"
        "            done ;;\n"
        "    esac\n"
        "}\n"
        "complete -F _gantry gantry\n";
    return out;
}

std::string zsh_completion(const CompletionNode& root) {
    std::string out =
        "#compdef gantry\n"
        "# zsh completion for gantry, made by `gantry completion zsh`\n"
        "_gantry() {\n"
        "    local at=gantry i files=0 asks=0\n"
        "    local -a commands options values fields\n"
        "    for ((i = 2; i < CURRENT; i++)); do\n";
    out += path_case(root, "(", "${words[i]}");
    out += "    case \"$at ${words[CURRENT-1]}\" in\n";
    out += value_cases(root, "(", "_files", [](const std::string& words) { return "compadd -- " + words; });
    out += "    esac\n    case \"$at\" in\n";
    for_each_node(root, [&](const CompletionNode& node) {
        out += fmt::format("        ({})\n            commands=(", shell_quoted(node.path));
        for (auto& child : node.children)
            out += "\n                " + described(child.name(), child.help);
        out += ")\n            options=(";
        for (auto& option : node.options)
            for (auto& name : option.names)
                out += "\n                " + described(name, option.help);
        out += fmt::format(")\n            values=({})\n            files={} asks={} ;;\n",
                           joined(node.words), node.takes_files ? 1 : 0, node.asks ? 1 : 0);
    });
    out +=
        "    esac\n"
        "    if [[ ${words[CURRENT]} == -* ]]; then\n"
        "        _describe option options\n"
        "        return\n"
        "    fi\n"
        "    (( $#commands )) && _describe command commands\n"
        "    if (( asks )); then\n"
        "        values=(${(f)\"$(${words[1]} completion words zsh -- \"${(@Q)words[2,CURRENT]}\" "
        "2>/dev/null)\"})\n"
        "        fields=(${(M)values:#*=})\n"
        "        values=(${values:#*=})\n"
        "        (( $#fields )) && compadd -S '' -- $fields\n"
        "    fi\n"
        "    (( $#values )) && compadd -- $values\n"
        "    (( files )) && _files\n"
        "}\n"
        "# Sourced, or loaded from fpath?\n"
        "if [[ ${funcstack[1]} == _gantry ]]; then _gantry \"$@\"; else compdef _gantry gantry; fi\n";
    return out;
}

std::string fish_completion(const CompletionNode& root) {
    std::string out =
        "# fish completion for gantry, made by `gantry completion fish`\n"
        "function __gantry_at\n"
        "    set -l at gantry\n"
        "    for word in (commandline -opc)[2..-1]\n"
        "        switch \"$at $word\"\n";
    out += fmt::format("            case {}\n", all_paths(root, " "));
    out +=
        "                set at \"$at $word\"\n"
        "        end\n"
        "    end\n"
        "    test \"$at\" = \"$argv[1]\"\n"
        "end\n";
    for_each_node(root, [&](const CompletionNode& node) {
        auto begin = fmt::format("complete -c gantry -n '__gantry_at \"{}\"'", node.path);
        if (!node.takes_files) out += begin + " -f\n";
        for (auto& child : node.children)
            out += fmt::format("{} -a {} -d {}\n", begin, child.name(), fish_quoted(child.help));
        if (node.asks)
            out += begin +
                   " -a '(set -l line (commandline -opc); set -l last (commandline -ct); "
                   "$line[1] completion words fish -- $line[2..-1] \"$last\" 2>/dev/null)'\n";
        if (!node.words.empty()) out += fmt::format("{} -a {}\n", begin, fish_quoted(joined(node.words)));
        for (auto& option : node.options) {
            out += begin;
            for (auto& name : option.names)
                out += name.starts_with("--") ? " -l " + name.substr(2) : " -s " + name.substr(1);
            if (option.takes_value && option.words.empty()) out += option.takes_files ? " -r -F" : " -x";
            if (!option.words.empty()) out += fmt::format(" -x -a {}", fish_quoted(joined(option.words)));
            out += fmt::format(" -d {}\n", fish_quoted(option.help));
        }
    });
    return out;
}

}  // namespace gantry::cli
