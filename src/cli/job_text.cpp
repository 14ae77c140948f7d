#include "cli/job_text.hpp"

#include <algorithm>
#include <ostream>

#include <fmt/format.h>

#include "api/json_text.hpp"
#include "base/text.hpp"

namespace gantry::cli {

namespace json = boost::json;

std::string plain(const json::value& value) {
    if (const auto* text = value.if_string()) return printable(*text);
    return api::json_text(value);
}

std::vector<std::pair<std::string, json::value>> values_of(const json::object& job) {
    std::vector<std::pair<std::string, json::value>> out;
    const auto* values = job.if_contains("values");
    if (values == nullptr) return out;
    if (const auto* object = values->if_object())
        for (auto& member : *object)
            out.emplace_back(std::string(member.key()), member.value());
    if (const auto* pairs = values->if_array())
        for (auto& each : *pairs) {
            const auto* pair = each.if_array();
            if (pair != nullptr && pair->size() == 2 && pair->front().is_string())
                out.emplace_back(std::string(pair->front().get_string()), pair->back());
        }
    return out;
}

void print_values(std::ostream& out, const json::object& job,
                  const std::function<std::string_view(std::string_view name)>& unit_of) {
    auto values = values_of(job);
    std::size_t width = 0;
    for (auto& [name, value] : values)
        width = std::max(width, printable(name).size());
    for (auto& [name, value] : values) {
        // A name that stands for a number has no unit.
        auto unit = value.is_number() ? unit_of(name) : std::string_view{};
        out << fmt::format("{:<{}}  {}{}{}\n", printable(name), width, plain(value), unit.empty() ? "" : " ",
                           unit);
    }
}

int conclude(Context& context, const Target& target, const json::object& job, std::string_view verb) {
    auto& status = job.at("status").get_string();
    bool taken_back = job.contains("interrupted");
    int code = taken_back ? stopped_by_user : status == "done" ? done : failed;
    if (target.json) {
        context.out << api::json_text(job) << '\n';
        return code;
    }
    if (code == done) return done;
    context.out << std::flush;
    const auto* text = job.if_contains("text");
    std::string why = text != nullptr ? plain(*text) : "";
    if (status == "done") why = "it was done before it could be taken back";
    complain(context, verb, {fmt::format("{}: {}", target.shown(), std::string_view(status)), why});
    return code;
}

}  // namespace gantry::cli
