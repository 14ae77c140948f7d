#include "reader/parameter.hpp"

#include <algorithm>

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace gantry {

std::string near_or_all(std::string_view word, std::span<const std::string_view> names) {
    constexpr std::size_t few = 12;
    auto near = nearest(word, names);
    if (!near.empty()) return fmt::format("did you mean {}?", near);
    if (names.empty()) return {};
    auto shown = names.first(std::min(names.size(), few));
    return fmt::format("one of: {}{}", fmt::join(shown, ", "), shown.size() < names.size() ? ", …" : "");
}

const ParameterRow* find_parameter(const Plugin& make, std::string_view name) {
    for (auto& row : make.parameters)
        if (row.name == name) return &row;
    return nullptr;
}

Result<void> check_parameter_name(const Plugin& make, std::string_view name) {
    if (make.parameters.empty() || find_parameter(make, name) != nullptr) return {};
    std::vector<std::string_view> names;
    for (auto& row : make.parameters)
        names.push_back(row.name);
    return fail(fmt::format("{} readers have no parameter \"{}\"", make.name, printable(name)),
                near_or_all(name, names));
}

Result<wire::Value> typed_parameter(const Plugin& make, const ParameterRow& row, const std::string& typed) {
    if (!row.writable) return fail(fmt::format("{} can only be read", row.name));
    return shown_parameter(make, row, typed);
}

Result<wire::Value> shown_parameter(const Plugin& make, const ParameterRow& row, const std::string& typed) {
    std::vector<std::string_view> names;
    if (row.enumeration != nullptr)
        for (auto& each : row.enumeration->rows)
            names.push_back(each.name);
    auto number = wire::as_number(wire::Value(typed), row.enumeration);
    bool limited = row.min <= row.max;
    if (!number && !names.empty())
        return fail(fmt::format("{} cannot be \"{}\"", row.name, printable(typed)),
                    near_or_all(typed, names));
    if (number && limited && (*number < row.min || *number > row.max))
        return fail(fmt::format("{} = {} is outside {} to {}", row.name, *number, row.min, row.max));
    if (make.parse_parameter != nullptr) return make.parse_parameter(row, typed);
    if (!number || (!limited && names.empty())) return wire::Value(typed);
    const auto* named = row.enumeration != nullptr ? row.enumeration->find(*number) : nullptr;
    return named != nullptr ? wire::Value(std::string(named->name)) : wire::Value(*number);
}

}  // namespace gantry
