#include "cli/parameter_file.hpp"

#include <algorithm>
#include <map>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "base/text.hpp"
#include "cli/input.hpp"
#include "cli/job_text.hpp"

namespace gantry::cli {

namespace json = boost::json;
using document::Node;

namespace {
// --- writing -----------------------------------------------------------------------------------------------

std::string toml_text(std::string_view text) {
    std::string out = "\"";
    for (char c : text) {
        auto code = static_cast<unsigned char>(c);
        if (code < 0x20 || code == 0x7F) {
            out += fmt::format("\\u{:04X}", code);
            continue;
        }
        if (c == '"' || c == '\\') out += '\\';
        out += c;
    }
    return out + "\"";
}

std::string key(std::string_view name) {
    auto is_bare = [](char c) {
        return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' ||
               c == '-';
    };
    return std::ranges::all_of(name, is_bare) && !name.empty() ? std::string(name) : toml_text(name);
}

std::string toml(const json::value& value) {
    if (const auto* text = value.if_string()) return toml_text(std::string_view(text->data(), text->size()));
    if (value.is_number() || value.is_bool()) return json::serialize(value);
    return toml_text(json::serialize(value));
}

std::string about(const ParameterRow& row) {
    constexpr std::size_t few = 6;
    std::vector<std::string_view> parts;
    if (!row.unit.empty()) parts.push_back(row.unit);
    if (!row.help.empty()) parts.push_back(row.help);
    std::string names;
    if (row.enumeration != nullptr && row.writable && row.enumeration->rows.size() <= few) {
        for (auto& each : row.enumeration->rows)
            names += fmt::format("{}{}", names.empty() ? "" : ", ", each.name);
        parts.push_back(names);
    }
    if (!row.writable) parts.emplace_back("read only");
    if (row.raw) parts.emplace_back("the bytes behind the others");
    if (row.needs_restart) parts.emplace_back("takes effect after a restart");
    return fmt::format("{}", fmt::join(parts, "; "));
}

std::string line_of(const ParameterRow& row, std::string_view name, const json::value& value) {
    constexpr std::size_t comment_column = 36;
    auto hidden = !row.writable || row.raw;
    auto text = fmt::format("{}{} = {}", hidden ? "# " : "", key(name), toml(value));
    return fmt::format("{:<{}}  # {}\n", text, comment_column, about(row));
}

// --- reading -----------------------------------------------------------------------------------------------

class FileReader {
public:
    FileReader(std::string shown, const Plugin& make) : shown_(std::move(shown)), make_(make) {}

    Result<std::vector<FileParameter>> read(std::string_view text) {
        auto root = document::parse_document(text);
        if (!root) {
            wrong(root.error().at, {root.error().what});
        } else {
            walk(*root->get<Node::Table>(), "");
        }
        if (!findings_.empty()) {
            std::ranges::stable_sort(findings_, {}, &Finding::first);
            std::string all;
            for (auto& [at, what] : findings_)
                all +=
                    fmt::format("{}{}:{}:{}: {}", all.empty() ? "" : "\n", shown_, at.line, at.column, what);
            return fail(std::move(all));
        }
        std::ranges::stable_sort(found_, {}, &FileParameter::at);
        return std::move(found_);
    }

private:
    using Finding = std::pair<document::Place, std::string>;
    static constexpr std::size_t most_findings = 20;

    void wrong(document::Place at, const Error& error) {
        if (findings_.size() < most_findings) findings_.emplace_back(at, error.text());
    }

    void walk(const Node::Table& table, const std::string& prefix) {
        for (auto& entry : table) {
            auto name = prefix + entry.key;
            if (const auto* inner = entry.value.get<Node::Table>())
                walk(*inner, name + ".");
            else
                take(entry, name);
        }
    }

    void take(const document::Entry& entry, const std::string& name) {
        if (auto known = check_parameter_name(make_, name); !known) return wrong(entry.at, known.error());
        const auto* row = find_parameter(make_, name);
        if (row == nullptr)
            return wrong(entry.at, {fmt::format("{} readers have no parameters", make_.name)});
        auto typed = typed_of(entry.value);
        if (!typed)
            return wrong(entry.value.at, {fmt::format("{} must be text, a number, true or false, not {}",
                                                      name, entry.value.kind())});
        if (auto [before, first] = places_.emplace(name, entry.at); !first)
            return wrong(entry.at,
                         {fmt::format("{} is there twice; first in line {}", name, before->second.line)});
        auto value = shown_parameter(make_, *row, *typed);
        if (!value) return wrong(entry.value.at, value.error());
        found_.push_back({row, std::move(*typed), std::move(*value), entry.value.at});
    }

    // As a person would type it for `config set`.
    static std::optional<std::string> typed_of(const Node& node) {
        if (const auto* text = node.get<std::string>()) return *text;
        if (const auto* number = node.get<std::int64_t>()) return fmt::format("{}", *number);
        if (const auto* number = node.get<double>()) return fmt::format("{}", *number);
        if (const auto* yes = node.get<bool>()) return *yes ? "1" : "0";
        return {};
    }

    std::string shown_;
    const Plugin& make_;
    std::vector<FileParameter> found_;
    std::map<std::string, document::Place> places_;
    std::vector<Finding> findings_;
};
}  // namespace

std::string parameters_to_toml(const Plugin& make, const ParameterValues& values,
                               const std::vector<std::string>& about_it) {
    std::string out;
    for (auto& line : about_it)
        out += "# " + line + "\n";
    // A table cannot be opened twice, and what is in none stands before all of them.
    std::vector<std::pair<std::string, std::string>> tables{{"", ""}};
    for (auto& row : make.parameters) {
        auto value =
            std::ranges::find(values, row.name, [](auto& each) { return std::string_view(each.first); });
        if (value == values.end()) continue;
        auto dot = row.name.rfind('.');
        auto table = dot == std::string_view::npos ? std::string_view{} : row.name.substr(0, dot);
        auto place =
            std::ranges::find(tables, table, [](auto& each) { return std::string_view(each.first); });
        if (place == tables.end()) place = tables.emplace(tables.end(), std::string(table), "");
        place->second +=
            line_of(row, dot == std::string_view::npos ? row.name : row.name.substr(dot + 1), value->second);
    }
    for (auto& [table, lines] : tables) {
        if (lines.empty()) continue;
        out += '\n';
        if (!table.empty()) {
            std::string header;
            for (std::string_view rest = table; !rest.empty();) {
                auto part = rest.substr(0, rest.find('.'));
                rest.remove_prefix(std::min(rest.size(), part.size() + 1));
                header += (header.empty() ? "" : ".") + key(part);
            }
            out += fmt::format("[{}]\n", header);
        }
        out += lines;
    }
    return out;
}

Result<std::vector<FileParameter>> read_parameters(Context& context, const std::string& file,
                                                   const Plugin& make) {
    auto input = Input::open(context, file);
    if (!input) return tl::unexpected(input.error());
    constexpr std::size_t most = 1 << 20;  // far more than all parameters of any make
    std::string text;
    for (bool end = false; !end && text.size() <= most;) {
        auto piece = input->next_piece();
        if (!piece) return tl::unexpected(piece.error());
        text += as_text(*piece);
        end = piece->empty();
    }
    auto shown = file == "-" ? std::string("stdin") : printable(file);
    if (text.size() > most) return fail(shown + " is longer than any file of parameters");
    return FileReader(shown, make).read(text);
}

}  // namespace gantry::cli
