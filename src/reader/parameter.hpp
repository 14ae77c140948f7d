#pragma once
#include "reader/plugin.hpp"

// What a person types for a parameter, checked before anything is sent.
namespace gantry {

const ParameterRow* find_parameter(const Plugin& make, std::string_view name);
// Nothing if the make has it, or has no parameters at all: then its drivers answer `unsupported` themselves.
Result<void> check_parameter_name(const Plugin& make, std::string_view name);
// What GetParameter would show of `typed`; of typed_parameter() also whether it can be set.
Result<wire::Value> shown_parameter(const Plugin& make, const ParameterRow& row, const std::string& typed);
Result<wire::Value> typed_parameter(const Plugin& make, const ParameterRow& row, const std::string& typed);
// "did you mean Power?", or the first few that there are.
std::string near_or_all(std::string_view word, std::span<const std::string_view> names);

}  // namespace gantry
