#include <algorithm>
#include <charconv>
#include <iterator>
#include <stdexcept>

#include <fmt/format.h>

#include "base/bytes.hpp"
#include "base/text.hpp"
#include "reader/plugin.hpp"

namespace gantry {

static std::optional<double> as_double(std::string_view text) {
    double number = 0;
    auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
    if (error != std::errc{} || end != text.data() + text.size()) return {};
    return number;
}

// An empty choice stands for the reader's own value; there is nothing to write for it.
static std::vector<std::string_view> named_choices(const SettingRow& row) {
    std::vector<std::string_view> out;
    std::ranges::copy_if(row.choices, std::back_inserter(out),
                         [](std::string_view choice) { return !choice.empty(); });
    return out;
}

static Result<void> check_value(const SettingRow& row, std::string_view value) {
    auto range = [&](double number) -> Result<void> {
        if (row.min <= row.max && (number < row.min || number > row.max))
            return fail(
                fmt::format("{} = {} is outside {:g} to {:g}", row.name, printable(value), row.min, row.max));
        return {};
    };
    switch (row.kind) {
        case SettingRow::Kind::text:
            if (row.min <= row.max && static_cast<double>(value.size()) > row.max)
                return fail(fmt::format("{} = \"{}\" has {} characters, at most {:g} are allowed", row.name,
                                        printable(value), value.size(), row.max));
            return {};
        case SettingRow::Kind::number: {
            auto number = as_double(value);
            if (!number) return fail(fmt::format("{} = \"{}\" is no number", row.name, printable(value)));
            return range(*number);
        }
        case SettingRow::Kind::boolean:
            if (value == "true" || value == "false") return {};
            return fail(fmt::format("{} = \"{}\" is neither true nor false", row.name, printable(value)));
        case SettingRow::Kind::duration: {
            auto duration = parse_duration(value);
            if (!duration)
                return fail(fmt::format("{} = \"{}\" is no duration", row.name, printable(value)),
                            "write it like \"500ms\", \"2s\" or \"1h\"");
            return range(static_cast<double>(duration->count()) / 1e6);
        }
        case SettingRow::Kind::choice:
            if (std::ranges::find(row.choices, value) != row.choices.end()) return {};
            return fail(fmt::format("{} = \"{}\" is none of: {}", row.name, printable(value),
                                    fmt::join(named_choices(row), ", ")));
        case SettingRow::Kind::hex:
            if (from_hex(value)) return {};
            return fail(fmt::format("{} = \"{}\" is not hex", row.name, printable(value)),
                        "write whole bytes, two digits each, like \"3034\"");
    }
    return {};
}

Result<Settings> Settings::make(std::span<const SettingRow> rows,
                                std::span<const std::pair<std::string, std::string>> given) {
    Settings settings;
    for (auto& row : rows)
        settings.values_.emplace_back(row.name, row.fallback);
    for (auto& [name, value] : given) {
        auto row = std::ranges::find(rows, name, &SettingRow::name);
        if (row == rows.end()) {
            std::vector<std::string_view> names;
            for (auto& each : rows)
                names.push_back(each.name);
            auto near = nearest(name, names);
            return fail(fmt::format("there is no setting \"{}\"", printable(name)),
                        near.empty() ? fmt::format("settings: {}", fmt::join(names, ", "))
                                     : fmt::format("did you mean \"{}\"?", near));
        }
        if (auto fine = check_value(*row, value); !fine) return tl::unexpected(fine.error());
        settings.values_[static_cast<std::size_t>(row - rows.begin())].second = value;
    }
    return settings;
}

std::string_view Settings::text(std::string_view name) const {
    for (auto& [each, value] : values_)
        if (each == name) return value;
    throw std::logic_error(fmt::format("no setting {}", name));  // a slip in our own code
}

double Settings::number(std::string_view name) const {
    return as_double(text(name)).value_or(0);
}

bool Settings::boolean(std::string_view name) const {
    return text(name) == "true";
}

std::chrono::microseconds Settings::duration(std::string_view name) const {
    return parse_duration(text(name)).value_or(std::chrono::microseconds{0});
}

}  // namespace gantry
