#include "bench/load/outcome.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace gantry::bench {

void print_figure(std::string_view name, double value, std::string_view unit) {
    fmt::print("{{\"name\":\"{}\",\"value\":{:.6g},\"unit\":\"{}\"}}\n", name, value, unit);
    std::fflush(stdout);
}

double quantile(std::vector<double>& values, double share) {
    std::ranges::sort(values);
    auto rank = std::ceil(share * static_cast<double>(values.size()));
    auto index = static_cast<std::size_t>(std::max(rank, 1.0)) - 1;
    return values[std::min(index, values.size() - 1)];
}

}  // namespace gantry::bench
