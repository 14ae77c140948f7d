#include "sinks/mqtt/requests.hpp"

#include <optional>

#include <fmt/format.h>
#include <boost/json.hpp>

#include "base/log.hpp"
#include "base/text.hpp"

namespace gantry::sinks::mqtt {

namespace {
constexpr std::size_t most_under_way = 16, most_unsent = 64;
constexpr std::size_t largest_body = 64 * 1024, largest_echo = 256;

// What an answer repeats, so that whoever asked knows which it is: `"id":7,`, ready to be put into an object.
std::string echo(const boost::json::object& request) {
    std::string out;
    for (std::string_view name : {"id", "transaction"}) {
        auto* value = request.if_contains(name);
        if (value == nullptr || value->is_structured()) continue;
        auto text = boost::json::serialize(*value);
        if (text.size() <= largest_echo) out += fmt::format("\"{}\":{},", name, text);
    }
    return out;
}

std::string with_echo(std::string answer, const std::string& echoed) {
    if (answer.size() > 2 && answer.front() == '{') answer.insert(1, echoed);
    return answer;
}

std::string failure_json(std::string_view why) {
    std::string out = R"({"status":"error","error":)";
    append_json_string(out, why);
    return out + '}';
}

std::optional<boost::json::object> as_object(std::string_view body) {
    if (trimmed(body).empty()) return boost::json::object{};
    boost::json::error_code error;
    auto value = boost::json::parse(body, error);
    if (error || !value.is_object()) return {};
    return std::move(value.as_object());
}
}  // namespace

void Requests::take(const Incoming& message) {
    auto operation = topics_.operation(message.topic);
    if (!operation) return;
    if (message.retained) {  // it may be a year old
        log::warn("sink", "a retained request on {} is ignored: delete it at the broker",
                  printable(message.topic));
        return;
    }
    Answer answer{.topic = topics_.response(*operation), .payload = {}, .correlation = message.correlation};
    if (!message.response_topic.empty() && !topics_.is_reserved(message.response_topic))
        answer.topic = message.response_topic;
    std::string echoed;
    auto refuse = [&](std::string_view why) {
        std::lock_guard lock(box_->mutex);
        if (box_->answers.size() >= most_unsent) return;
        answer.payload = with_echo(failure_json(why), echoed);
        box_->answers.push_back(std::move(answer));
    };
    if (message.payload.size() > largest_body)
        return refuse(fmt::format("a request has {} bytes at most", largest_body));
    auto request = as_object(message.payload);
    if (!request) return refuse("a request is a JSON object");
    echoed = echo(*request);
    {
        std::lock_guard lock(box_->mutex);
        if (box_->under_way + box_->answers.size() < most_under_way)
            ++box_->under_way;
        else
            request.reset();
    }
    if (!request) return refuse("too many requests are under way; try again later");
    host_.request(*operation, trimmed(message.payload).empty() ? "{}" : message.payload,
                  [box = box_, answer = std::move(answer), echoed](std::string payload) mutable {
                      answer.payload = with_echo(std::move(payload), echoed);
                      std::lock_guard lock(box->mutex);
                      --box->under_way;
                      box->answers.push_back(std::move(answer));
                      box->changed.notify_all();
                  });
}

bool Requests::waiting() const {
    std::lock_guard lock(box_->mutex);
    return box_->under_way != 0;
}

void Requests::wait(std::chrono::milliseconds at_most) {
    std::unique_lock lock(box_->mutex);
    box_->changed.wait_for(lock, at_most, [&] { return !box_->answers.empty() || box_->under_way == 0; });
}

std::vector<Requests::Answer> Requests::take_answers() {
    std::lock_guard lock(box_->mutex);
    return std::exchange(box_->answers, {});
}

void Requests::put_back(std::vector<Answer> answers) {
    std::lock_guard lock(box_->mutex);
    box_->answers.insert(box_->answers.begin(), std::make_move_iterator(answers.begin()),
                         std::make_move_iterator(answers.end()));
}

}  // namespace gantry::sinks::mqtt
