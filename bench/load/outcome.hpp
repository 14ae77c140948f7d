#pragma once
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace gantry::bench {

// A measurement that cannot be believed: a lost read, a program that did not start. What and where, for
// people.
struct Failure : std::runtime_error {
    using std::runtime_error::runtime_error;
};

// One figure as a JSON line on stdout; tools/bench.py gathers the lines of many runs.
void print_figure(std::string_view name, double value, std::string_view unit);

// The value that `share` (0 to 1) of all lie at or below; sorts `values`, which must not be empty.
double quantile(std::vector<double>& values, double share);

}  // namespace gantry::bench
