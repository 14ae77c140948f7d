#include "api/handlers.hpp"

#include <charconv>

#include <fmt/format.h>
#include <boost/json.hpp>

#include "api/answers.hpp"
#include "api/job_json.hpp"
#include "api/sinks_api.hpp"
#include "base/text.hpp"

namespace gantry::api {

namespace json = boost::json;

namespace {
json::object reader_json(const gateway::ReaderStatus& reader) {
    json::object out;
    out["name"] = reader.name;
    out["make"] = reader.make;
    out["address"] = reader.address;
    out["connected"] = reader.connected;
    out["state"] = reader.state;
    auto add = [&](std::string_view key, const std::string& value) {
        if (!value.empty()) out[key] = value;
    };
    add("peer", reader.peer);
    add("model", reader.model);
    add("firmware", reader.firmware);
    add("detail", reader.detail);
    if (reader.stalled) out["stalled"] = true;
    if (!reader.reading) out["stopped"] = true;
    out["reads"] = reader.reads;
    if (reader.since) out["since"] = to_rfc3339(*reader.since);
    if (reader.fault) {
        out["fault"] = reader.fault->text;
        out["fault_time"] = to_rfc3339(reader.fault->at);
    }
    if (reader.last_read) out["last_read"] = to_rfc3339(*reader.last_read);
    return out;
}

http::Response readers(gateway::Gateway& gateway) {
    json::array list;
    for (auto& reader : gateway.readers())
        list.push_back(reader_json(reader));
    json::object body;
    body["readers"] = std::move(list);
    return answer(200, body);
}

// For completion: what config.get, config.set and exec take.
void add_names(json::object& body, const Plugin& make) {
    json::array parameters, commands;
    for (auto& row : make.parameters)
        parameters.emplace_back(json::string_view(row.name.data(), row.name.size()));
    for (auto name : make.codec().names(wire::Direction::to_reader))
        commands.emplace_back(json::string_view(name.data(), name.size()));
    body["parameters"] = std::move(parameters);
    body["commands"] = std::move(commands);
}

http::Response one_reader(gateway::Gateway& gateway, std::string_view name) {
    for (auto& reader : gateway.readers()) {
        if (reader.name != name) continue;
        auto body = reader_json(reader);
        json::object counters;
        for (std::size_t i = 0; i < count_size; ++i)
            counters[gantry::to_text(static_cast<Count>(i))] = reader.counters[i];
        body["counters"] = std::move(counters);
        if (const auto* make = gateway.make_of(name)) add_names(body, *make);
        return answer(200, body);
    }
    return problem(404, fmt::format("there is no reader \"{}\"", printable(name)),
                   "see `gantry reader list`");
}

http::Response status(gateway::Gateway& gateway) {
    auto stats = gateway.stats();
    json::object body;
    body["id"] = gateway.id();
    body["version"] = GANTRY_VERSION;
    body["started"] = to_rfc3339(gateway.started());
    body["reads"] = stats.reads;
    body["events"] = stats.events;
    body["commits"] = stats.commits;
    body["last_seq"] = stats.last_seq;
    body["tags_present"] = stats.present;
    body["store_bytes"] = stats.size.bytes;
    body["store_file_bytes"] = stats.size.file_bytes;
    if (!stats.trouble.empty()) body["store_trouble"] = stats.trouble;
    if (auto& aside = gateway.stores_set_aside(); !aside.empty())
        body["stores_set_aside"] = json::array(aside.begin(), aside.end());
    json::array listeners;
    for (auto& listener : gateway.listeners()) {
        json::object each;
        each["scheme"] = listener.scheme;
        each["address"] = link::to_text(listener.local);
        each["connections"] = listener.connections;
        each["unnamed"] = listener.unnamed;
        each["refused"] = listener.refused;
        each["displaced"] = listener.displaced;
        listeners.push_back(std::move(each));
    }
    body["listeners"] = std::move(listeners);
    return answer(200, body);
}

// /api/v1/store and /api/v1/store/compact
http::Response store(gateway::Gateway& gateway, const http::Request& request, bool compacts) {
    if (request.method != (compacts ? "POST" : "GET"))
        return problem(405, compacts ? "a compaction is begun with POST" : "this can only be read");
    if (compacts) gateway.compact_store();
    auto stats = gateway.stats();
    auto compaction = gateway.compaction();
    json::object body;
    body["bytes"] = stats.size.bytes;
    body["file_bytes"] = stats.size.file_bytes;
    if (!stats.trouble.empty()) body["trouble"] = stats.trouble;
    if (compaction.number != 0) {
        json::object each;
        each["number"] = compaction.number;
        each["running"] = compaction.running;
        if (compaction.bytes_before != 0) {
            each["bytes_before"] = compaction.bytes_before;
            each["bytes_after"] = compaction.bytes_after;
        }
        if (compaction.error) {
            each["error"] = compaction.error->what;
            if (!compaction.error->hint.empty()) each["hint"] = compaction.error->hint;
        }
        body["compaction"] = std::move(each);
    }
    return answer(compacts ? 202 : 200, body);
}

constexpr std::size_t most_jobs = 10'000;

std::optional<std::int64_t> whole_member(const json::object& object, std::string_view key) {
    const auto* value = object.if_contains(key);
    if (value == nullptr || !value->is_number()) return {};
    boost::system::error_code error;
    auto number = value->to_number<std::int64_t>(error);
    if (error) return {};
    return number;
}

std::optional<std::uint64_t> number_of(std::string_view text) {
    std::uint64_t number = 0;
    auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
    if (error != std::errc{} || end != text.data() + text.size()) return {};
    return number;
}

http::Response no_job(std::string_view id) {
    return problem(404, fmt::format("there is no job {}", printable(id)),
                   "the newest are at /api/v1/jobs; older ones are forgotten");
}

http::Response start_job(gateway::Gateway& gateway, Waiters& waiters, const http::Request& request) {
    boost::system::error_code error;
    auto parsed = json::parse(request.body, error);
    const auto* object = error ? nullptr : parsed.if_object();
    if (object == nullptr)
        return problem(400, "the body is no JSON object", "{\"reader\":\"gate-1\",\"op\":\"gpio.get\"}");
    const auto* reader = object->if_contains("reader");
    if (reader == nullptr || !reader->is_string()) return problem(400, "a job needs \"reader\"");
    auto timeout = std::chrono::milliseconds{10'000};
    if (object->contains("timeout_ms")) {
        auto given = whole_member(*object, "timeout_ms");
        if (!given || *given < 1 || *given > 3'600'000)
            return problem(400, "\"timeout_ms\" must be 1 to 3600000");
        timeout = std::chrono::milliseconds{*given};
    }
    const auto* wait = object->if_contains("wait");
    if (wait != nullptr && !wait->is_bool()) return problem(400, "\"wait\" must be true or false");

    std::string name(reader->get_string());
    const auto* make = gateway.make_of(name);
    if (make == nullptr)
        return problem(404, fmt::format("there is no reader \"{}\"", printable(name)),
                       "see `gantry reader list`");
    auto job = job_from_json(*object, *make);
    if (!job) return problem(400, job.error().what, job.error().hint);
    bool waits = wait == nullptr || wait->get_bool();
    std::optional<Waiters::Place> place;
    if (waits && !place.emplace(waiters).taken())
        return problem(503, fmt::format("{} requests wait for the end of their jobs already", Waiters::most),
                       "add \"wait\":false, and ask for the job at /api/v1/jobs/ID");
    auto id = gateway.submit(name, std::move(*job), timeout, waits);
    if (!id) return problem(503, id.error().what, id.error().hint);
    auto status = waits ? gateway.wait_for(*id) : gateway.jobs().find(*id);
    if (!status) return no_job(std::to_string(*id));
    auto response = answer(waits ? 200 : 202, job_to_json(*status));
    response.headers.emplace_back("Location", fmt::format("/api/v1/jobs/{}", *id));
    return response;
}

http::Response list_jobs(gateway::Gateway& gateway, const http::Request& request) {
    std::uint64_t count = 100;
    if (auto limit = request.parameter("limit")) {
        auto given = number_of(*limit);
        if (!given || *given < 1 || *given > most_jobs)
            return problem(400, fmt::format("limit must be 1 to {}", most_jobs));
        count = *given;
    }
    json::array list;
    for (auto& job : gateway.jobs().list(request.parameter("reader").value_or(""), count))
        list.push_back(job_to_json(job, Values::hidden));
    json::object body;
    body["jobs"] = std::move(list);
    return answer(200, body);
}

// /api/v1/jobs/ID and /api/v1/jobs/ID/cancel
http::Response one_job(gateway::Gateway& gateway, const http::Request& request, std::string_view rest) {
    constexpr std::string_view cancel = "/cancel";
    bool cancels = rest.ends_with(cancel);
    if (cancels) rest.remove_suffix(cancel.size());
    auto id = number_of(rest);
    if (!id || !gateway.jobs().find(*id)) return no_job(rest);
    if (request.method != (cancels ? "POST" : "GET"))
        return cancels ? problem(405, "a job is cancelled with POST") : problem(405, "use GET");
    if (cancels) gateway.cancel(*id);
    auto job = gateway.jobs().find(*id);
    return job ? answer(200, job_to_json(*job)) : no_job(rest);
}

http::Response jobs(gateway::Gateway& gateway, Waiters& waiters, const http::Request& request) {
    if (request.method == "POST") return start_job(gateway, waiters, request);
    if (request.method == "GET") return list_jobs(gateway, request);
    return problem(405, "jobs are started with POST and listed with GET");
}
}  // namespace

http::Response handle(gateway::Gateway& gateway, Waiters& waiters, const http::Request& request) {
    constexpr std::string_view one = "/api/v1/readers/", a_job = "/api/v1/jobs/";
    bool get = request.method == "GET";
    if (request.path == "/healthz") return answer(200, json::object{{"status", "ok"}});
    if (request.path == "/api/v1/jobs") return jobs(gateway, waiters, request);
    if (request.path.starts_with(a_job))
        return one_job(gateway, request, std::string_view(request.path).substr(a_job.size()));
    bool compacts = request.path == "/api/v1/store/compact";
    if (compacts || request.path == "/api/v1/store") return store(gateway, request, compacts);
    if (request.path == "/api/v1/sinks" || request.path.starts_with("/api/v1/sinks/"))
        return sinks(gateway, request);
    bool known = request.path == "/api/v1/readers" || request.path == "/api/v1/status" ||
                 request.path.starts_with(one);
    if (!known) return problem(404, "there is nothing here", "the interface begins at /api/v1/");
    if (!get) return problem(405, "this can only be read", "use GET");
    if (request.path == "/api/v1/status") return status(gateway);
    if (request.path == "/api/v1/readers") return readers(gateway);
    return one_reader(gateway, std::string_view(request.path).substr(one.size()));
}

}  // namespace gantry::api
