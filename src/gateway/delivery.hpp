#pragma once
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "journal/journal.hpp"

namespace gantry::gateway {

// What became of events at a sink, on its way into the store: all of it in one commit.
struct Delivery {
    std::string sink;
    std::optional<journal::Seq> cursor = {};
    std::vector<journal::DeadLetter> letters = {};
    std::vector<journal::Seq> letters_gone = {};  // taken after all, or thrown away
    // On the writer's thread once it is on disk; may be empty.
    std::function<void()> stored = {};

    bool empty() const { return !cursor && letters.empty() && letters_gone.empty(); }
};

}  // namespace gantry::gateway
