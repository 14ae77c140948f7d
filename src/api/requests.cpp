#include "api/requests.hpp"

#include <fmt/format.h>
#include <boost/json.hpp>

#include "api/json_text.hpp"
#include "base/text.hpp"

namespace gantry::api {

namespace json = boost::json;

namespace {
std::string error_answer(std::string_view text) {
    json::object out;
    out["status"] = "error";
    out["error"] = text;
    return json_text(out);
}

// The request as HTTP has it; an error: it is none.
Result<http::Request> as_http(std::string_view operation, const std::string& body) {
    boost::system::error_code error;
    auto parsed = body.empty() ? json::value(json::object()) : json::parse(body, error);
    auto* object = error ? nullptr : parsed.if_object();
    if (object == nullptr) return fail("the request is no JSON object");
    http::Request request;
    request.method = "GET";
    if (operation == "status" || operation == "readers" || operation == "jobs" || operation == "sinks") {
        request.path = fmt::format("/api/v1/{}", operation);
        return request;
    }
    if (operation == "reader") {
        const auto* name = object->if_contains("reader");
        if (name == nullptr || !name->is_string()) return fail("the request needs \"reader\"");
        request.path = fmt::format("/api/v1/readers/{}", std::string_view(name->get_string()));
        return request;
    }
    request.method = "POST";
    request.path = "/api/v1/jobs";
    (*object)["op"] = operation;
    request.body = json::serialize(*object);
    return request;
}
}  // namespace

std::string serve_request(gateway::Gateway& gateway, Waiters& waiters, std::string_view operation,
                          const std::string& body) {
    auto request = as_http(operation, body);
    if (!request) return error_answer(request.error().text());
    auto response = handle(gateway, waiters, *request);
    boost::system::error_code error;
    auto data = json::parse(response.body, error);
    if (response.status >= 300) {
        const auto* object = error ? nullptr : data.if_object();
        auto text = [&](std::string_view key) -> std::string {
            const auto* value = object == nullptr ? nullptr : object->if_contains(key);
            return value == nullptr || !value->is_string() ? "" : std::string(value->get_string());
        };
        auto detail = text("detail");
        return error_answer(detail.empty() ? text("title") : fmt::format("{}; {}", text("title"), detail));
    }
    json::object out;
    out["status"] = "ok";
    out["data"] = std::move(data);
    return json_text(out);
}

Requests::Requests(gateway::Gateway& gateway) : gateway_(gateway) {
    for (unsigned i = 0; i < threads; ++i)
        workers_.emplace_back([this] { run(); });
}

Requests::~Requests() {
    {
        std::lock_guard lock(mutex_);
        stopping_ = true;
    }
    wake_.notify_all();
    for (auto& worker : workers_)
        worker.join();
}

void Requests::take(std::string_view operation, std::string body, std::function<void(std::string)> answer) {
    {
        std::lock_guard lock(mutex_);
        if (!stopping_ && waiting_.size() < most_waiting) {
            waiting_.push_back({std::string(operation), std::move(body), std::move(answer)});
            wake_.notify_one();
            return;
        }
    }
    answer(error_answer("too many requests wait already; send it again later"));
}

void Requests::run() {
    for (;;) {
        Waiting next;
        bool refused = false;
        {
            std::unique_lock lock(mutex_);
            wake_.wait(lock, [this] { return stopping_ || !waiting_.empty(); });
            if (waiting_.empty()) return;
            next = std::move(waiting_.front());
            waiting_.pop_front();
            refused = stopping_;
        }
        next.answer(refused ? error_answer("the gateway stops")
                            : serve_request(gateway_, waiters_, next.operation, next.body));
    }
}

}  // namespace gantry::api
