#include "gateway/refusals.hpp"

#include <utility>

namespace gantry::gateway {

std::optional<std::uint64_t> Refusals::count(std::string_view listener, std::string_view name, Steady now) {
    auto key = std::string(listener).append(1, '\0').append(name);
    if (entries_.size() >= max_names && !entries_.contains(key)) {
        std::erase_if(entries_, [&](auto& each) { return now - each.second.said >= quiet; });
        if (entries_.size() >= max_names) key.clear();  // all further names share one place
    }
    auto [it, is_new] = entries_.try_emplace(std::move(key), Entry{now});
    auto& entry = it->second;
    if (is_new) return 0;
    if (now - entry.said < quiet) {
        ++entry.unsaid;
        return {};
    }
    entry.said = now;
    return std::exchange(entry.unsaid, 0);
}

}  // namespace gantry::gateway
