#include "sinks/webhook/webhook.hpp"

#include <algorithm>
#include <utility>

#include <fmt/format.h>

#include "sink/shape.hpp"
#include "sinks/webhook/gzip.hpp"
#include "sinks/webhook/signature.hpp"

namespace gantry::sinks::webhook {

using sink::Item;
using sink::Outcome;

static constexpr int most_redirects = 5;
// A connection that breaks says only perhaps that a body was too large; below this we do not believe it.
static constexpr std::size_t surely_small = 64 * 1024;

static Wall wall_now() {
    return std::chrono::time_point_cast<std::chrono::microseconds>(std::chrono::system_clock::now());
}

Webhook::Webhook(WebhookOptions options)
    : options_(std::move(options)),
      where_(parse_url(options_.connection.url).value_or(Url{}).shown),
      transfer_(options_.connection),
      body_size_(options_.max_body) {}

namespace {
// Items to be sent at once.
struct Part {
    std::size_t begin = 0, size = 0;
    // It is the second half of a part that was refused for what is in it, and so many items were rejected
    // before the first half was sent. If the first half adds none, the fault is in here.
    std::optional<std::size_t> rejected_before = {};
};
}  // namespace

Outcome Webhook::deliver(std::span<const Item> batch, const sink::Patience& patience) {
    if (batch.empty()) return knock(patience);
    auto outcome = Outcome::kept(batch.size(), {});
    std::vector<Part> parts;  // the next one is the last
    for (std::size_t done = 0; done < batch.size();) {
        if (parts.empty()) parts.push_back({done, first_part(batch.subspan(done)), {}});
        auto part = parts.back();
        parts.pop_back();
        bool refused = part.size > 1 && part.rejected_before == outcome.reasons.size();
        Verdict verdict;
        if (!refused) {
            if (patience.over(std::chrono::steady_clock::now())) {
                outcome.trouble = fmt::format("{}: the time was over before all was sent", where_);
                return outcome;
            }
            verdict = send(batch.subspan(part.begin, part.size), patience);
        }
        bool too_large = verdict.fate == Verdict::Fate::too_large;
        refused = refused || verdict.fate == Verdict::Fate::refused;
        if ((refused || too_large) && part.size > 1) {
            auto half = part.size / 2;
            auto rejected = refused ? std::optional(outcome.reasons.size()) : std::nullopt;
            parts.push_back({part.begin + half, part.size - half, rejected});
            parts.push_back({part.begin, half, {}});
            continue;
        }
        if (refused || too_large) {
            outcome.reject(part.begin, verdict.text);
        } else if (verdict.fate == Verdict::Fate::kept) {
            outcome.trouble = verdict.text;
            outcome.retry_after = verdict.retry_after;
            return outcome;
        } else {
            std::fill_n(outcome.fates.begin() + static_cast<std::ptrdiff_t>(part.begin), part.size,
                        sink::Fate::accepted);
        }
        done = part.begin + part.size;
    }
    return outcome;
}

// Is somebody there? OPTIONS delivers nothing, and any answer to it will do.
Outcome Webhook::knock(const sink::Patience& patience) {
    auto answer = exchange({.method = "OPTIONS", .headers = options_.headers}, patience);
    connected_ = answer.end == Answer::End::answered;
    if (connected_) return {};
    return Outcome::kept(0, judge(answer, where_, options_.secrets, wall_now()).text);
}

// As many as fit; one goes however large it is, for the receiver to say.
std::size_t Webhook::first_part(std::span<const Item> items) const {
    std::size_t count = 0;
    for (std::size_t bytes = 2; count < items.size(); ++count) {
        bytes += items[count].payload.size() + 1;
        if (bytes > body_size_) break;
    }
    return std::max<std::size_t>(count, 1);
}

Verdict Webhook::send(std::span<const Item> items, const sink::Patience& patience) {
    body_.clear();
    for (auto& item : items) {
        body_ += body_.empty() ? '[' : ',';
        body_ += item.payload;
    }
    body_ += ']';
    auto size = body_.size();
    if (options_.gzip) body_ = gzipped(body_);
    Request request{.headers = options_.headers, .body = body_};
    auto add = [&](std::string_view name, std::string_view value) {
        request.headers.push_back(fmt::format("{}: {}", name, value));
    };
    bool cloud = sink::shape_of(items.front().payload) == sink::Shape::cloudevents;
    add("Content-Type", cloud ? "application/cloudevents-batch+json; charset=utf-8" : "application/json");
    if (options_.gzip) add("Content-Encoding", "gzip");
    add("Idempotency-Key", idempotency_key(items));
    auto now = wall_now();
    if (!options_.secret.empty())
        add("Gantry-Signature", signature(options_.secret, to_us(now) / 1'000'000, body_));
    request.headers.emplace_back("Expect:");  // not: it costs a second with servers that do not know it
    auto answer = exchange(std::move(request), patience);
    connected_ = answer.end == Answer::End::answered;
    auto verdict = judge(answer, where_, options_.secrets, wall_now());
    // What a receiver takes at once is found out: half of what was too large, and slowly more again.
    if (verdict.fate == Verdict::Fate::too_large && items.size() > 1)
        body_size_ = size / 2;
    else if (answer.broken && size > surely_small)
        body_size_ = std::max(size / 2, surely_small);
    else if (verdict.fate == Verdict::Fate::accepted)
        body_size_ = std::min(options_.max_body, body_size_ + body_size_ / 16 + 1);
    return verdict;
}

Answer Webhook::exchange(Request request, const sink::Patience& patience) {
    request.headers.emplace_back("User-Agent: gantry/" GANTRY_VERSION);
    auto answer = transfer_.exchange(request, patience);
    auto home = parse_url(options_.connection.url);
    for (int hop = 0; options_.follow_redirects && hop < most_redirects; ++hop) {
        // The others would make a GET of it.
        if (answer.end != Answer::End::answered || (answer.status != 307 && answer.status != 308)) break;
        auto to = parse_url(answer.redirect);
        if (!home || !to || to->has_password || to->host != home->host ||
            (home->scheme == "https" && to->scheme != "https"))
            break;
        request.url = answer.redirect;
        answer = transfer_.exchange(request, patience);
    }
    return answer;
}

}  // namespace gantry::sinks::webhook
