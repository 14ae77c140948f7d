#pragma once
#include <cstdint>
#include <optional>
#include <string>

#include "base/time.hpp"

namespace gantry::journal {

// A job of a reader as it is stored: what somebody asked for and what became of it. No passwords, no results.
struct JobRow {
    std::uint64_t id = 0;
    std::string reader, op, detail, state, text;
    Wall created{}, deadline{};
    std::optional<Wall> ended;
};

}  // namespace gantry::journal
