// What may stand next where that depends on what there is: readers, commands, fields, values.
#include <algorithm>

#include <fmt/format.h>

#include "cli/completion.hpp"
#include "cli/remote.hpp"
#include "cli/target.hpp"

namespace gantry::cli {

namespace {
namespace json = boost::json;
constexpr auto patience = 2s;  // nobody waits longer for the tab key
constexpr auto to_reader = wire::Direction::to_reader;

// An unfinished command line, taken apart.
struct Line {
    const CompletionNode* node = nullptr;
    std::vector<std::string> positionals;  // before the last word
    std::string last;
    Target target;
};

const CompletionOption* find_option(const CompletionNode& node, std::string_view name) {
    for (auto& option : node.options)
        if (std::ranges::find(option.names, name) != option.names.end()) return &option;
    return nullptr;
}

void take_option(Target& target, std::string_view name, const std::string& value) {
    if (name == "--address") target.address = value;
    if (name == "--data-dir") target.place.data_dir = value;
    if (name == "--config" || name == "-c") target.place.config = value;
    if (name == "--set") target.settings.push_back(value);
}

Line take_apart(const CompletionNode& root, const std::vector<std::string>& words) {
    Line line;
    line.node = &root;
    line.target.timeout = patience;
    for (std::size_t i = 0; i + 1 < words.size(); ++i) {
        auto& word = words[i];
        if (word.starts_with('-') && word.size() > 1) {
            auto equals = word.find('=');
            auto name = word.substr(0, equals);
            if (equals != std::string::npos) {
                take_option(line.target, name, word.substr(equals + 1));
                continue;
            }
            const auto* option = find_option(*line.node, name);
            if (option != nullptr && option->takes_value && i + 2 < words.size())
                take_option(line.target, name, words[++i]);
            continue;
        }
        auto child = std::ranges::find(line.node->children, word, &CompletionNode::name);
        if (child != line.node->children.end())
            line.node = &*child;
        else
            line.positionals.push_back(word);
    }
    if (!words.empty()) line.last = words.back();
    return line;
}

// Of the members `key` of the objects in the list `list`.
std::vector<std::string> listed(const Place& place, std::string_view path, std::string_view list,
                                std::string_view key) {
    std::vector<std::string> out;
    auto answer = ask(place, "GET", path, nullptr, patience);
    const auto* object = answer ? answer->if_object() : nullptr;
    const auto* all = object != nullptr ? object->if_contains(list) : nullptr;
    if (all == nullptr || !all->is_array()) return out;
    for (auto& each : all->get_array()) {
        const auto* members = each.if_object();
        const auto* value = members != nullptr ? members->if_contains(key) : nullptr;
        if (value == nullptr) continue;
        const auto* text = value->if_string();
        out.push_back(text != nullptr ? std::string(*text) : json::serialize(*value));
    }
    return out;
}

std::vector<std::string> owned(std::span<const std::string_view> names) {
    return {names.begin(), names.end()};
}

std::vector<std::string> commands_of(const Plugin& make) {
    return owned(make.codec().names(to_reader));
}

std::vector<std::string> parameters_of(const Plugin& make) {
    std::vector<std::string> out;
    for (auto& row : make.parameters)
        out.emplace_back(row.name);
    return out;
}

// "Field=" for each field that is not there yet; after the equals sign its values.
std::vector<std::string> fields_of(const Line& line, const Plugin& make, std::size_t command) {
    auto& codec = make.codec();
    auto& name = line.positionals[command];
    std::vector<std::string> out;
    if (auto equals = line.last.find('='); equals != std::string::npos) {
        auto field = line.last.substr(0, equals);
        for (auto value : codec.value_names(name, field, to_reader))
            out.push_back(fmt::format("{}={}", field, value));
        return out;
    }
    for (auto field : codec.field_names(name, to_reader)) {
        auto typed = std::string(field) + "=";
        auto is_it = [&](const std::string& word) { return word.starts_with(typed); };
        if (std::none_of(line.positionals.begin() + static_cast<std::ptrdiff_t>(command) + 1,
                         line.positionals.end(), is_it))
            out.push_back(std::move(typed));
    }
    return out;
}

std::vector<std::string> values_of_parameter(const Plugin& make, std::string_view name) {
    std::vector<std::string> out;
    for (auto& row : make.parameters)
        if (row.name == name && row.enumeration != nullptr)
            for (auto& each : row.enumeration->rows)
                out.emplace_back(each.name);
    return out;
}

// The words after the reader's name; `at` is the first of them.
std::vector<std::string> after_reader(const Line& line, std::size_t at) {
    auto make = make_of(line.target);
    if (!make) return {};
    auto& path = line.node->path;
    // With an address the reader's name may stand there all the same.
    if (line.target.direct() && !line.positionals.empty()) {
        auto firsts = path == "gantry reader exec" ? commands_of(**make) : parameters_of(**make);
        if (std::ranges::find(firsts, line.positionals.front()) == firsts.end()) at = 1;
    }
    auto count = line.positionals.size() - at;
    if (path == "gantry reader exec") return count == 0 ? commands_of(**make) : fields_of(line, **make, at);
    bool sets = path == "gantry reader config set";
    if (count == 0 && (sets || path == "gantry reader config get")) return parameters_of(**make);
    if (count == 1 && sets) return values_of_parameter(**make, line.positionals[at]);
    return {};
}
}  // namespace

std::vector<std::string> words_for(const CompletionNode& root, const std::vector<std::string>& words) {
    auto line = take_apart(root, words);
    if (!line.node->asks) return {};
    std::vector<std::string> found;
    if (line.node->path.starts_with("gantry job "))
        found = listed(line.target.place, "/api/v1/jobs", "jobs", "id");
    else if (line.target.direct())
        found = after_reader(line, 0);
    else if (line.positionals.empty())
        found = listed(line.target.place, "/api/v1/readers", "readers", "name");
    else {
        line.target.reader = line.positionals.front();
        found = after_reader(line, 1);
    }
    std::erase_if(found, [&](const std::string& word) { return !word.starts_with(line.last); });
    return found;
}

std::vector<std::string> without_prefix(std::vector<std::string> found, std::string_view word) {
    auto cut = word.find_last_of("=:");
    if (cut == std::string_view::npos) return found;
    for (auto& each : found)
        each.erase(0, cut + 1);
    return found;
}

std::vector<std::string> split_line(std::string_view line) {
    std::vector<std::string> words;
    std::string word;
    char quote = 0;
    bool inside = false;  // of a word
    for (std::size_t i = 0; i < line.size(); ++i) {
        char c = line[i];
        if (quote == 0 && (c == ' ' || c == '\t')) {
            if (inside) words.push_back(std::exchange(word, {}));
            inside = false;
            continue;
        }
        inside = true;
        if (c == '\\' && quote != '\'' && i + 1 < line.size())
            word += line[++i];
        else if (c == quote)
            quote = 0;
        else if (quote == 0 && (c == '"' || c == '\''))
            quote = c;
        else
            word += c;
    }
    words.push_back(word);  // the one under the cursor, which may be empty
    return words;
}

}  // namespace gantry::cli
