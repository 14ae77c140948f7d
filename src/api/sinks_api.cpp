#include "api/sinks_api.hpp"

#include <charconv>

#include <fmt/format.h>
#include <boost/json.hpp>

#include "api/answers.hpp"
#include "base/text.hpp"

namespace gantry::api {

namespace json = boost::json;

namespace {
constexpr std::uint64_t most_letters = 1000;

json::object sink_json(const gateway::SinkStatus& status) {
    json::object out;
    out["name"] = status.name;
    out["type"] = status.kind;
    if (!status.url.empty()) out["url"] = status.url;
    out["state"] = status.state;
    out["connected"] = status.connected;
    out["cursor"] = status.cursor;
    out["behind"] = status.behind;
    out["lent_bytes"] = status.backlog_bytes;
    out["delivered"] = status.delivered;
    out["delivered_bytes"] = status.bytes;
    out["retried"] = status.retried;
    out["rejected"] = status.rejected;
    out["dead_letters"] = status.dead_letters;
    auto time = [&](std::string_view key, const std::optional<Wall>& value) {
        if (value) out[key] = to_rfc3339(*value);
    };
    time("oldest", status.oldest);
    time("last_delivery", status.last_delivery);
    if (!status.trouble.empty()) out["trouble"] = status.trouble;
    time("trouble_since", status.trouble_since);
    time("next_try", status.next_try);
    return out;
}

json::object letter_json(const journal::DeadLetter& letter) {
    json::object out;
    out["event"] = letter.seq;
    out["time"] = to_rfc3339(letter.time);
    out["tries"] = letter.tries;
    out["reason"] = letter.reason;
    boost::system::error_code error;
    auto content = json::parse(letter.event, error);
    if (!error) out["content"] = std::move(content);
    return out;
}

std::optional<std::uint64_t> whole(std::optional<std::string_view> text, std::uint64_t otherwise) {
    if (!text) return otherwise;
    std::uint64_t number = 0;
    auto [end, error] = std::from_chars(text->data(), text->data() + text->size(), number);
    if (error != std::errc{} || end != text->data() + text->size()) return {};
    return number;
}

http::Response dead_letters(gateway::Gateway& gateway, const gateway::SinkRunner& sink,
                            const http::Request& request) {
    auto after = whole(request.parameter("after"), 0), limit = whole(request.parameter("limit"), 100);
    if (!after || !limit || *limit < 1 || *limit > most_letters)
        return problem(400, fmt::format("after is the number of an event, limit 1 to {}", most_letters));
    auto store = journal::Reader::open(gateway.config().data_dir / "gantry.db");
    if (!store) return problem(503, store.error().error.what, store.error().error.hint);
    json::array list;
    bool more = false;
    auto read = (*store)->dead_letters(sink.name(), *after, [&](const journal::DeadLetter& letter) {
        more = list.size() == *limit;
        if (!more) list.push_back(letter_json(letter));
        return !more;
    });
    json::object body;
    body["dead_letters"] = std::move(list);
    if (more) body["more"] = true;
    if (!read) body["damage"] = read.error().error.text();
    return answer(200, body);
}

// The events that a request names; empty: all. Nothing: it names none.
std::optional<std::vector<journal::Seq>> named_events(const http::Request& request) {
    boost::system::error_code error;
    auto parsed = json::parse(request.body, error);
    const auto* object = error ? nullptr : parsed.if_object();
    if (object == nullptr) return {};
    const auto* all = object->if_contains("all");
    if (all != nullptr && all->is_bool() && all->get_bool()) return std::vector<journal::Seq>{};
    const auto* events = object->if_contains("events");
    const auto* list = events == nullptr ? nullptr : events->if_array();
    if (list == nullptr || list->empty()) return {};
    std::vector<journal::Seq> out;
    for (auto& each : *list) {
        if (!each.is_number()) return {};
        auto seq = each.to_number<std::uint64_t>(error);
        if (error || seq == 0) return {};
        out.push_back(seq);
    }
    return out;
}

http::Response accepted(const gateway::SinkRunner& sink) {
    return answer(202, sink_json(sink.status()));
}

// Of events that are named each must be a dead letter: a slip of the number would else look like a success.
http::Response act_on_letters(gateway::Gateway& gateway, gateway::SinkRunner& sink,
                              std::vector<journal::Seq> events, bool again) {
    auto store = journal::Reader::open(gateway.config().data_dir / "gantry.db");
    if (!store) return problem(503, store.error().error.what, store.error().error.hint);
    for (auto seq : events) {
        bool there = false;
        (void)(*store)->dead_letters(sink.name(), seq - 1, [&](const journal::DeadLetter& letter) {
            there = letter.seq == seq;
            return false;
        });
        if (!there)
            return problem(404, fmt::format("event {} is no dead letter of \"{}\"", seq, sink.name()),
                           "see `gantry sink show " + sink.name() + " --dead`");
    }
    auto count = (*store)->count_dead_letters(sink.name());
    auto letters = !events.empty() ? events.size() : count ? *count : 0;
    if (again)
        sink.offer_again(std::move(events));
    else
        sink.discard(std::move(events));
    auto body = sink_json(sink.status());
    body["letters"] = letters;
    return answer(202, body);
}

http::Response one_sink(gateway::Gateway& gateway, gateway::SinkRunner& sink, std::string_view verb,
                        const http::Request& request) {
    bool reads = verb.empty() || verb == "dead";
    bool acts = verb == "retry" || verb == "skip" || verb == "dead/retry" || verb == "dead/discard";
    if (!reads && !acts) return problem(404, "there is nothing here", "a sink has dead, retry and skip");
    if (request.method != (reads ? "GET" : "POST"))
        return reads ? problem(405, "this can only be read", "use GET")
                     : problem(405, "this is done with POST");
    if (verb.empty()) return answer(200, sink_json(sink.status()));
    if (verb == "dead") return dead_letters(gateway, sink, request);
    if (verb == "retry") {
        sink.retry();
        return accepted(sink);
    }
    if (verb == "skip") {
        auto skipped = sink.skip();
        if (!skipped) return problem(409, skipped.error().what, skipped.error().hint);
        return accepted(sink);
    }
    auto events = named_events(request);
    if (!events) return problem(400, "the body says which", R"({"events":[17,18]} or {"all":true})");
    return act_on_letters(gateway, sink, std::move(*events), verb == "dead/retry");
}
}  // namespace

http::Response sinks(gateway::Gateway& gateway, const http::Request& request) {
    constexpr std::string_view all = "/api/v1/sinks";
    std::string_view rest = std::string_view(request.path).substr(all.size());
    if (rest.empty()) {
        if (request.method != "GET") return problem(405, "this can only be read", "use GET");
        json::array list;
        for (auto& sink : gateway.sinks())
            list.push_back(sink_json(sink->status()));
        json::object body;
        body["sinks"] = std::move(list);
        return answer(200, body);
    }
    rest.remove_prefix(1);
    auto end = std::min(rest.find('/'), rest.size());
    auto name = rest.substr(0, end);
    auto* sink = gateway.find_sink(name);
    if (sink == nullptr)
        return problem(404, fmt::format("there is no sink \"{}\"", printable(name)),
                       "see `gantry sink list`");
    return one_sink(gateway, *sink, rest.substr(std::min(end + 1, rest.size())), request);
}

}  // namespace gantry::api
