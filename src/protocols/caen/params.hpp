#pragma once
#include <span>
#include <vector>

#include "protocols/caen/tables.hpp"
#include "wire/error.hpp"

namespace gantry::caen {

// A pair that was given, as far as its place among the parameters goes.
struct Given {
    std::uint16_t type;
    std::size_t offset;
};

// Are these the parameters that a command takes: none unknown, missing or doubled, in this order? `repeats`:
// all of them may come any number of times. `what`: the command, for the fault's text.
wire::Result<void> check_params(std::string_view what, std::span<const Param> params, bool repeats,
                                std::span<const Given> given);

// "SourceName?, TagIDLen, TagID…": what may be left out has a question mark, what repeats an ellipsis.
std::string params_text(std::span<const Param> params);

}  // namespace gantry::caen
