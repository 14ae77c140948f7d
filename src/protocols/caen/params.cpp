#include "protocols/caen/params.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "wire/cursor.hpp"

namespace gantry::caen {

using wire::Errc;
using wire::Fault;

static std::uint16_t code_of(const Param& param) {
    return static_cast<std::uint16_t>(param.attribute);
}

std::string params_text(std::span<const Param> params) {
    std::string text;
    for (auto& param : params)
        text += fmt::format("{}{}{}{}", text.empty() ? "" : ", ", row_of(param.attribute).name,
                            param.repeated ? "…" : "", param.optional ? "?" : "");
    return text.empty() ? "none" : text;
}

// The same attribute can stand in two places of a command, and the first of them may be optional (G2Read), so
// every place that a pair can have is followed. A place is an index in `params`: that many are behind us.
static std::vector<bool> start(std::size_t params) {
    std::vector<bool> places(params + 1);
    places[0] = true;
    return places;
}

static void pass_optional(std::span<const Param> params, std::vector<bool>& places, bool repeats) {
    for (std::size_t i = 0; i < params.size(); ++i)
        if (places[i] && params[i].optional) places[i + 1] = true;
    if (repeats && places[params.size()] && !places[0]) {
        places[0] = true;
        pass_optional(params, places, false);
    }
}

static std::vector<bool> step(std::span<const Param> params, const std::vector<bool>& places,
                              std::uint16_t type, bool repeats) {
    std::vector<bool> next(places.size());
    for (std::size_t i = 0; i < params.size(); ++i) {
        if (!places[i] || code_of(params[i]) != type) continue;
        next[i + 1] = true;
        // One that repeats may come again: then it is as if it were the first of them.
        if (params[i].repeated) next[i] = true;
    }
    pass_optional(params, next, repeats);
    return next;
}

static std::string_view name_of(std::uint16_t type) {
    const auto* row = find_attribute(type);
    return row != nullptr ? row->name : "AVP";
}

wire::Result<void> check_params(std::string_view what, std::span<const Param> params, bool repeats,
                                std::span<const Given> given) {
    auto refuse = [&](std::size_t offset, std::string_view field, std::string why) {
        return tl::unexpected(
            Fault{Errc::bad_value, offset, field,
                  fmt::format("{}; {} takes, in this order: {}", why, what, params_text(params))});
    };
    auto wanted = [&](std::uint16_t type) {
        return std::ranges::count_if(params, [&](auto& param) { return code_of(param) == type; });
    };
    for (auto& each : given)
        if (wanted(each.type) == 0)
            return refuse(each.offset, name_of(each.type), fmt::format("no parameter of {}", what));
    auto places = start(params.size());
    if (repeats) places[params.size()] = true;  // not at all
    pass_optional(params, places, repeats);
    std::size_t taken = 0;
    while (taken < given.size()) {
        auto next = step(params, places, given[taken].type, repeats);
        if (std::ranges::find(next, true) == next.end()) break;
        places = std::move(next);
        ++taken;
    }
    if (taken == given.size() && places[params.size()]) return {};
    // Which of the ways to be wrong is it?
    auto times = [&](std::uint16_t type) {
        return std::ranges::count_if(given, [&](auto& each) { return each.type == type; });
    };
    auto repeated = [&](std::uint16_t type) {
        return repeats || std::ranges::any_of(
                              params, [&](auto& param) { return code_of(param) == type && param.repeated; });
    };
    for (auto& each : given)
        if (!repeated(each.type) && times(each.type) > wanted(each.type))
            return refuse(each.offset, name_of(each.type),
                          fmt::format("given {} times, once too often", times(each.type)));
    for (auto& param : params) {
        auto needed = std::ranges::count_if(
            params, [&](auto& other) { return other.attribute == param.attribute && !other.optional; });
        if (times(code_of(param)) < needed)
            return refuse(given.empty() ? 0 : given.back().offset, row_of(param.attribute).name, "missing");
    }
    auto& culprit = given[std::min(taken, given.size() - 1)];
    return refuse(culprit.offset, name_of(culprit.type), "not in its place");
}

}  // namespace gantry::caen
