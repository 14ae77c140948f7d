#include "bench/sinks/duel.hpp"

#include <algorithm>
#include <functional>

#include <fmt/format.h>

#include "bench/load/outcome.hpp"
#include "bench/sinks/bare_client.hpp"
#include "bench/tag_frame.hpp"
#include "event/event_json.hpp"
#include "sinks/registry.hpp"

namespace gantry::bench {

namespace {
using Clock = std::chrono::steady_clock;
constexpr auto longest_delivery = 30s;
constexpr std::uint32_t population = 20'000;  // tags that are read again and again

class NoReaders final : public sink::Host {
public:
    std::vector<sink::ReaderState> readers() override { return {}; }
    void request(std::string_view, std::string, std::function<void(std::string)> answer) override {
        answer(R"({"status":"error","error":"a benchmark has no readers"})");
    }
};

// Batch after batch of events that no server has seen before.
class Events {
public:
    Events(std::string_view gateway, std::size_t batch)
        : prefix_(fmt::format("{}:", gateway)),
          events_(batch),
          ids_(batch),
          payloads_(batch),
          items_(batch) {}

    std::span<const sink::Item> next() {
        for (std::size_t i = 0; i < events_.size(); ++i) {
            auto& event = events_[i];
            event.seq = ++last_;
            event.type = event::Type::tag_read;
            event.technology = event::Technology::epc_gen2;
            event.time = from_us(1'795'000'000'000'000 + static_cast<std::int64_t>(last_));
            event.first_seen = event.last_seen = event.time;
            event.reader = "dock-1";
            event.antenna = "Ant1";
            event.zone = "dock";
            event.tag = tag_of(static_cast<std::uint32_t>(last_ * 7919 % population));
            event.epc = fmt::format("urn:epc:id:sgtin:0614141.812345.{}", last_ % population);
            event.rssi = -528;
            event.reads = 1;
            ids_[i] = fmt::format("{}{}", prefix_, last_);
            payloads_[i].clear();
            event::append_json(payloads_[i], event, prefix_);
            items_[i] = {&event, ids_[i], payloads_[i]};
        }
        return items_;
    }

private:
    std::string prefix_;
    std::uint64_t last_ = 0;
    std::vector<event::Event> events_;
    std::vector<std::string> ids_, payloads_;
    std::vector<sink::Item> items_;
};

std::unique_ptr<sink::Sink> make_sink(const DuelOptions& options, sink::Host& host) {
    const auto* kind = find_sink_kind(options.kind);
    if (kind == nullptr) throw Failure(fmt::format("there is no kind of sink called {}", options.kind));
    auto settings = Settings::make(kind->settings, options.settings);
    if (!settings) throw Failure(settings.error().text());
    auto made = kind->make({.name = "bench",
                            .gateway_id = "bench",
                            .url = kind->schemes.empty() ? "" : options.place,
                            .settings = *settings,
                            .batch = options.batch},
                           host);
    if (!made) throw Failure(made.error().text());
    return std::move(*made);
}

void deliver(sink::Sink& sink, std::span<const sink::Item> batch) {
    auto outcome = sink.deliver(batch, {.until = Clock::now() + longest_delivery, .stop = {}});
    if (std::ranges::count(outcome.fates, sink::Fate::accepted) != std::ranges::ssize(batch))
        throw Failure(fmt::format("not all of a batch was accepted: {}{}", outcome.trouble,
                                  outcome.reasons.empty() ? "" : outcome.reasons[0].text));
}

using Deliver = std::function<void(std::span<const sink::Item>)>;

double rate(Events& events, std::chrono::milliseconds time, const Deliver& deliver) {
    Clock::duration spent{};
    std::size_t delivered = 0;
    do {
        auto batch = events.next();
        auto start = Clock::now();
        deliver(batch);
        spent += Clock::now() - start;
        delivered += batch.size();
    } while (spent < time);
    return static_cast<double>(delivered) / std::chrono::duration<double>(spent).count();
}
}  // namespace

std::unique_ptr<BareClient> bare_client(const std::string& kind, const std::string& place) {
    using Make = std::unique_ptr<BareClient> (*)(const std::string&);
    for (auto& [name, make] : {std::pair<std::string_view, Make>{"jsonl", bare_jsonl},
                               {"kafka", bare_kafka},
                               {"mqtt", bare_mqtt},
                               {"nats", bare_nats},
                               {"postgres", bare_postgres},
                               {"webhook", bare_webhook}})
        if (name == kind) return make(place);
    throw Failure(fmt::format("there is no bare client for {}", kind));
}

void measure_sink(const DuelOptions& options) {
    NoReaders host;
    auto sink = make_sink(options, host);
    Events ours("bench", options.batch), theirs("bare", options.batch);
    deliver(*sink, ours.next());  // connected, and what it makes at the server is there
    auto bare = bare_client(options.kind, options.place);
    bare->deliver(theirs.next());
    auto by_sink = [&](auto batch) { deliver(*sink, batch); };
    auto by_bare = [&](auto batch) { bare->deliver(batch); };
    for (unsigned turn = 0; turn < options.turns; ++turn) {
        double sink_rate = 0, bare_rate = 0;
        if (turn % 2 == 0) bare_rate = rate(theirs, options.time, by_bare);
        sink_rate = rate(ours, options.time, by_sink);
        if (turn % 2 != 0) bare_rate = rate(theirs, options.time, by_bare);
        print_figure(fmt::format("sink_{}_events_per_s", options.kind), sink_rate, "events/s");
        print_figure(fmt::format("raw_{}_events_per_s", options.kind), bare_rate, "events/s");
    }
}

}  // namespace gantry::bench
