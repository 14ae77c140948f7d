#pragma once
#include <gtest/gtest.h>

#include <fstream>
#include <sstream>

#include <fmt/format.h>

#include "field/scene.hpp"

namespace gantry::field::test {

inline const Steady start = Steady{} + 100h;

inline constexpr std::array<std::string_view, 2> makes = {"acme", "umbrella"};

inline Scenario parsed(std::string_view toml) {
    auto scenario = parse_scenario(toml, "scene.toml", makes);
    if (!scenario) {
        ADD_FAILURE() << scenario.error().text();
        return {};
    }
    return *scenario;
}

inline std::string example(std::string_view name) {
    std::ifstream file(fmt::format("{}/examples/scenarios/{}.toml", GANTRY_SOURCE_DIR, name));
    std::ostringstream text;
    text << file.rdbuf();
    return text.str();
}

// One antenna, and so many still tags two metres before it, as well turned as can be.
inline Scenario bench(std::uint32_t tags, std::string_view of_reader = "", std::string_view of_tags = "") {
    return parsed(fmt::format(R"(
[scenario]
name = "bench"
[[reader]]
name = "one"
{}
[[reader.antenna]]
position = [0, 0, 1]
towards = [2, 0, 1]
[[tags]]
name = "tags"
count = {}
position = [2, 0, 1]
spacing = [0, 0, 0]
jitter = 0.3
axis = [0, 1, 0]
{})",
                              of_reader, tags, of_tags));
}

inline std::vector<AirSighting> heard(Air& air, Steady from, Steady to, Carrier carrier = {}) {
    std::vector<AirSighting> out;
    air.inventory(carrier, from, to, out);
    return out;
}

}  // namespace gantry::field::test
