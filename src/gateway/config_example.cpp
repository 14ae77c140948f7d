#include <algorithm>

#include <fmt/format.h>

#include "base/text.hpp"
#include "gateway/config_makes.hpp"
#include "protocols/registry.hpp"
#include "sinks/registry.hpp"

namespace gantry::gateway {

namespace {
constexpr std::string_view preface =
    "# gantry.toml: every section and key. What is commented out has no fixed default or shows another "
    "choice.\n"
    "# Durations: \"250us\", \"500ms\", \"2s\", \"5min\", \"1h\", \"30d\". Sizes: \"512MiB\", \"8GiB\".\n"
    "# `gantry config check` tells what is wrong with a file, and where.\n";

std::string written(const ConfigRow& row, std::string_view value) {
    switch (row.kind) {
        case ConfigRow::Kind::boolean:
        case ConfigRow::Kind::count:
            return fmt::format("{} = {}", row.key, value);
        case ConfigRow::Kind::texts:
            return fmt::format("{} = [\"{}\"]", row.key, value);
        default:
            return fmt::format("{} = \"{}\"", row.key, value);
    }
}

std::string choices_note(std::span<const std::string_view> choices) {
    return choices.empty() ? std::string() : fmt::format(" One of: {}.", fmt::join(choices, ", "));
}

// `active`: keys with a fallback stand as they are; else the whole section is a comment.
void append_section(std::string& out, const ConfigSection& section, bool active) {
    out += fmt::format("\n# {}\n", section.help);
    out += active ? "" : "# ";
    out += section.repeated ? fmt::format("[[{}]]\n", section.path) : fmt::format("[{}]\n", section.path);
    for (auto& row : section.rows) {
        bool shown = active && !row.fallback.empty();
        out += fmt::format("#{}{}{}\n", active ? " " : "   ", row.help, choices_note(row.choices));
        out += fmt::format("{}{}\n", shown ? "" : "# ", written(row, shown ? row.fallback : row.sample));
    }
}

// What all of them share is told once, above the samples.
void append_keys(std::string& out, std::string_view path) {
    auto& section = config_section(path);
    out += fmt::format("# [[{}]]: {}\n", path, section.help);
    for (auto& row : section.rows)
        out += fmt::format("#   {:<9} {}{}{}{}\n", row.key, row.help, choices_note(row.choices),
                           row.fallback.empty() ? "" : fmt::format(" Default {}.", row.fallback),
                           row.required ? " Required." : "");
}

void append_readers(std::string& out, Makes makes) {
    out += "\n";
    append_keys(out, "reader");
    append_keys(out, "reader.antenna");
    for (auto* make : makes) {
        out += fmt::format("\n# ---- {} ({}) ----\n", make->title, make->name);
        out += make->sample_toml;
        if (!out.ends_with('\n')) out += '\n';
    }
}

// As comments: an example that runs as it is must not deliver to somebody.
void append_sinks(std::string& out, Kinds kinds) {
    out += "\n";
    append_keys(out, "sink");
    for (auto* kind : kinds) {
        out += fmt::format("\n# ---- {} ({}) ----\n", kind->title, kind->name);
        for (std::string_view rest = kind->sample_toml; !rest.empty();) {
            auto line = rest.substr(0, rest.find('\n'));
            rest.remove_prefix(std::min(line.size() + 1, rest.size()));
            out += fmt::format("{}{}\n", line.empty() || line.starts_with('#') ? "" : "# ", line);
        }
    }
}
}  // namespace

Result<std::string> config_example(std::string_view name, Makes makes, Kinds kinds) {
    if (!name.empty()) {
        std::vector<std::string_view> names;
        for (auto* each : makes) {
            if (each->name == name) return std::string(each->sample_toml);
            names.push_back(each->name);
        }
        for (auto* each : kinds) {
            if (each->name == name) return std::string(each->sample_toml);
            names.push_back(each->name);
        }
        auto near = nearest(name, names);
        return fail(fmt::format("there is no make \"{}\"{}", printable(name),
                                kinds.empty() ? "" : ", and no kind of sink"),
                    near.empty()
                        ? fmt::format("{}: {}", kinds.empty() ? "makes" : "there are", fmt::join(names, ", "))
                        : fmt::format("did you mean {}?", near));
    }
    std::string out(preface);
    for (auto& section : config_sections()) {
        if (section.path == "reader")
            append_readers(out, makes);
        else if (section.path == "sink")
            append_sinks(out, kinds);
        else if (section.path != "reader.antenna")
            append_section(out, section, !section.repeated);
    }
    return out;
}

std::vector<std::string_view> sink_kind_names() {
    std::vector<std::string_view> names;
    for (auto* kind : sink_kinds())
        names.push_back(kind->name);
    return names;
}

Result<std::string> config_example(std::string_view name) {
    return config_example(name, plugins(), sink_kinds());
}

}  // namespace gantry::gateway
