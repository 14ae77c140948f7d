#include "cli/parameter_session.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "base/text.hpp"
#include "cli/job_text.hpp"

namespace gantry::cli {

namespace json = boost::json;

tl::expected<json::object, Ended> ParameterSession::run(json::object request) {
    auto job = jobs_.run(std::move(request));
    if (!job) return tl::unexpected(Ended{complain(context_, verb_, job.error())});
    if (job->at("status").get_string() == "done" && !job->contains("interrupted")) return std::move(*job);
    auto target = options_.target;
    target.json = false;  // these commands have JSON of their own
    return tl::unexpected(Ended{conclude(context_, target, *job, verb_)});
}

tl::expected<ParameterValues, Ended> ParameterSession::get(bool permanent) {
    json::object request;
    request["op"] = "config.get";
    request["permanent"] = permanent;
    auto job = run(std::move(request));
    if (!job) return tl::unexpected(job.error());
    return values_of(*job);
}

Result<void> ParameterSession::set(const ParameterRow& row, const std::string& typed) {
    json::object request;
    request["op"] = "config.set";
    request["parameter"] = std::string(row.name);
    request["value"] = typed;
    request["permanent"] = options_.permanent;
    auto job = jobs_.run(std::move(request));
    if (!job) return tl::unexpected(job.error());
    interrupted_ = interrupted_ || job->contains("interrupted");
    std::string status(job->at("status").get_string());
    if (status == "done" && !interrupted_) return {};
    const auto* text = job->if_contains("text");
    return fail(fmt::format("{}: {}", row.name, status), text != nullptr ? plain(*text) : "");
}

tl::expected<void, Ended> ParameterSession::restart() {
    json::object request;
    request["op"] = "restart";
    auto job = run(std::move(request));
    if (!job) return tl::unexpected(job.error());
    return {};
}

const json::value* find(const ParameterValues& values, std::string_view name) {
    for (auto& [key, value] : values)
        if (key == name) return &value;
    return nullptr;
}

bool differs(const Plugin& make, const FileParameter& wanted, const ParameterValues& values) {
    const auto* value = find(values, wanted.row->name);
    if (value == nullptr) return true;
    const auto* text = value->if_string();
    auto typed = text != nullptr ? std::string(*text) : json::serialize(*value);
    auto now = shown_parameter(make, *wanted.row, typed);
    return now ? *now != wanted.shown : typed != wanted.typed;
}

std::string text_of(const FileParameter& wanted) {
    if (const auto* text = wanted.shown.get<std::string>()) return printable(*text);
    if (const auto* number = wanted.shown.get<std::int64_t>()) return fmt::format("{}", *number);
    if (const auto* raw = wanted.shown.get<Bytes>()) return to_hex(*raw);
    return printable(wanted.typed);
}

std::string names_of(const std::vector<const FileParameter*>& parameters) {
    std::vector<std::string_view> names;
    for (const auto* each : parameters)
        names.push_back(each->row->name);
    return fmt::format("{}", fmt::join(names, ", "));
}

}  // namespace gantry::cli
