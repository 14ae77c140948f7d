#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>

#include "base/time.hpp"

namespace gantry::gateway {

// A reader that is refused dials again every few seconds, for ever. Of each one, by listener and name, the
// log hears at most once a minute.
class Refusals {
public:
    static constexpr auto quiet = 60s;
    static constexpr std::size_t max_names = 1000;  // strangers' names must not fill the memory

    // Nothing: it was said less than a minute ago. Else say it, and how many times it was not said before.
    std::optional<std::uint64_t> count(std::string_view listener, std::string_view name, Steady now);

private:
    struct Entry {
        Steady said{};
        std::uint64_t unsaid = 0;
    };
    std::unordered_map<std::string, Entry> entries_;
};

}  // namespace gantry::gateway
