#include "sinks/nats/nats_sink.hpp"

#include <algorithm>

#include <fmt/format.h>

namespace gantry::sinks::nats {

using sink::Fate;
using std::chrono::milliseconds;
using std::chrono::steady_clock;

static constexpr milliseconds tick = 50ms;  // how often a wait looks at its patience
static constexpr auto attempt_time = 60s;
static constexpr int most_left_behind = 8;
static constexpr std::size_t most_servers = 64;

NatsSink::NatsSink(Plan plan)
    : plan_(std::move(plan)), subjects_(plan_.prefix, plan_.gateway_id), configured_(plan_.access.servers) {}

bool NatsSink::connect(const sink::Patience& patience, std::string& trouble) {
    if (connected()) return true;
    connection_.reset();
    auto now = steady_clock::now();
    if (attempt_ && now >= attempt_end_ && left_behind_ < most_left_behind) {
        attempt_.reset();
        ++left_behind_;
    }
    if (!attempt_) {
        attempt_.emplace([access = plan_.access] { return Connection::open(access); });
        attempt_end_ = now + attempt_time;
    }
    auto opened = attempt_->wait(patience);
    if (!opened) {
        trouble = fmt::format("{}: {}", plan_.access.servers.front().text(),
                              patience.stop.stop_requested() ? "stopped while connecting" : "no answer yet");
        return false;
    }
    attempt_.reset();
    left_behind_ = 0;
    if (!*opened) {
        trouble = (*opened).error().text();
        return false;
    }
    connection_ = std::move(**opened);
    remember_servers();
    return true;
}

// The one that was there last is tried first. A cluster names its members; if all that were configured are
// away, one of those may be there.
void NatsSink::remember_servers() {
    auto known = connection_->servers();
    std::vector<sink::ServerAddress> servers;
    auto add = [&](const sink::ServerAddress& server) {
        bool is_new = std::ranges::find(servers, server.text(), &sink::ServerAddress::text) == servers.end();
        if (is_new && servers.size() < most_servers) servers.push_back(server);
    };
    add(known.front());
    std::ranges::for_each(configured_, add);
    std::ranges::for_each(known, add);
    plan_.access.servers = std::move(servers);
}

sink::Outcome NatsSink::deliver(std::span<const sink::Item> batch, const sink::Patience& patience) {
    std::string trouble;
    if (!connect(patience, trouble)) return sink::Outcome::kept(batch.size(), trouble);
    sink::Outcome outcome{.fates = std::vector(batch.size(), Fate::kept)};
    std::vector<std::string> refusals(batch.size());
    std::size_t next = 0;
    auto now = steady_clock::now();
    // What is handed over late would be lost to an answer that comes after the call.
    auto last_call = now + (patience.until - now) / 4 * 3;
    for (;; now = steady_clock::now()) {
        if (trouble.empty() && next < batch.size() && now >= last_call) trouble = "the server is too slow";
        for (; trouble.empty() && next < batch.size() && connection_->in_flight() < plan_.window; ++next) {
            auto& item = batch[next];
            auto handed = connection_->publish(subjects_.events(item.event->reader), item.id, item.payload,
                                               next, refusals[next]);
            if (handed == Connection::Handed::refused) outcome.fates[next] = Fate::rejected;
            if (handed == Connection::Handed::lost) trouble = connection_->trouble();
        }
        bool waiting = connection_->in_flight() > 0;
        for (auto& answer : connection_->answers(waiting ? tick : 0ms)) {
            if (answer.accepted) outcome.fates[answer.item] = Fate::accepted;
            if (answer.rejected) {
                outcome.fates[answer.item] = Fate::rejected;
                refusals[answer.item] = fmt::format("the server refused it: {}", answer.why);
            } else if (!answer.accepted && trouble.empty()) {
                trouble = fmt::format("the server does not take {}: {}", batch[answer.item].id, answer.why);
            }
        }
        if (!waiting && (next == batch.size() || !trouble.empty())) break;
        if (!connection_->alive() || connection_->forbidden()) {
            trouble = connection_->trouble();
            break;
        }
        if (patience.over(now)) {
            if (trouble.empty()) trouble = "the server did not confirm in time";
            break;
        }
    }
    // An answer that came after the last look would be taken for one to the next batch.
    if (!connection_->settled() || !connection_->alive()) connection_.reset();
    for (std::size_t item = 0; item < batch.size(); ++item)
        if (outcome.fates[item] == Fate::rejected)
            outcome.reasons.push_back({item, std::move(refusals[item])});
    if (std::ranges::find(outcome.fates, Fate::kept) != outcome.fates.end())
        outcome.trouble = fmt::format("{}: {}", plan_.access.servers.front().text(), trouble);
    return outcome;
}

void NatsSink::idle(const sink::Patience&) {
    if (connection_ && !connection_->alive()) connection_.reset();  // its threads take care of the rest
}

}  // namespace gantry::sinks::nats
