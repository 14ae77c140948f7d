#include "testkit/sink_suite.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "base/bytes.hpp"
#include "event/event_json.hpp"
#include "testkit/eventually.hpp"

namespace gantry::testkit {

using sink::Fate;
using namespace std::chrono_literals;

void QuietHost::request(std::string_view, std::string, std::function<void(std::string)> answer) {
    answer(R"({"status":"error","error":"this host has no readers"})");
}

LentEvents::LentEvents(std::size_t count, std::uint64_t first_seq) {
    constexpr std::string_view prefix = "suite:";
    events_.resize(count);
    for (std::size_t i = 0; i < count; ++i) {
        auto& event = events_[i];
        event.seq = first_seq + i;
        event.type = i % 3 == 0 ? event::Type::tag_new : event::Type::tag_observed;
        event.technology = event::Technology::epc_gen2;
        event.time = from_us(1'795'000'000'000'000 + static_cast<std::int64_t>(event.seq));
        event.reader = "dock-1";
        event.antenna = "Ant0";
        event.zone = "dock";
        Bytes tag = {0x30, 0x74, 0x25, 0x7B, 0xF7, 0x19, 0x4E, 0x40, 0, 0, 0, 0};
        for (std::size_t at = 0; at < 4; ++at)
            tag[8 + at] = static_cast<std::uint8_t>(event.seq >> (24 - 8 * at));
        event.tag = event::TagId(tag);
        event.epc = "urn:epc:id:sgtin:0614141.812345." + std::to_string(event.seq);
        event.rssi = -528;
        event.reads = 1;
        event.first_seen = event.last_seen = event.time;
        ids_.push_back(std::string(prefix) + std::to_string(event.seq));
        event::append_json(payloads_.emplace_back(), event, prefix);
    }
    for (std::size_t i = 0; i < count; ++i)
        items_.push_back({&events_[i], ids_[i], payloads_[i]});
}

std::vector<std::string> LentEvents::ids() const {
    return ids_;
}

sink::Patience patience(std::chrono::milliseconds time) {
    return {.until = std::chrono::steady_clock::now() + time, .stop = {}};
}

namespace {
constexpr auto long_enough = 20s;

// What the gateway does: lends what is not settled until all is.
void deliver_all(sink::Sink& sink, std::span<const sink::Item> items) {
    std::vector<sink::Item> left(items.begin(), items.end());
    auto end = std::chrono::steady_clock::now() + 60s;
    while (!left.empty()) {
        ASSERT_LT(std::chrono::steady_clock::now(), end) << left.size() << " items are still kept";
        auto outcome = sink.deliver(left, patience(long_enough));
        ASSERT_EQ(outcome.fates.size(), left.size());
        std::vector<sink::Item> kept;
        for (std::size_t i = 0; i < left.size(); ++i) {
            ASSERT_NE(outcome.fates[i], Fate::rejected) << left[i].id;
            if (outcome.fates[i] == Fate::kept) kept.push_back(left[i]);
        }
        if (!kept.empty()) {
            EXPECT_FALSE(outcome.trouble.empty()) << "kept without a reason";
        }
        left = std::move(kept);
    }
}

std::vector<std::string> without_doubles(const std::vector<std::string>& ids) {
    std::set<std::string> seen;
    std::vector<std::string> out;
    for (auto& id : ids)
        if (seen.insert(id).second) out.push_back(id);
    return out;
}

// The destination may show what it confirmed a moment later.
void expect_holds(Destination& destination, const std::vector<std::string>& wanted) {
    std::vector<std::string> held;
    eventually([&] { return (held = without_doubles(destination.ids())).size() >= wanted.size(); });
    EXPECT_EQ(held, wanted);
}

}  // namespace

void check_empty_batch(Destination& destination) {
    destination.start();
    auto sink = destination.make_sink();
    EXPECT_FALSE(sink->connected());
    auto outcome = sink->deliver({}, patience(long_enough));
    EXPECT_TRUE(outcome.fates.empty());
    EXPECT_EQ(outcome.trouble, "");
    EXPECT_TRUE(sink->connected()) << "an empty batch connects";
    sink->idle(patience(long_enough));
    EXPECT_TRUE(destination.ids().empty()) << "and delivers nothing";
}

void check_order_and_ids(Destination& destination) {
    destination.start();
    auto sink = destination.make_sink();
    LentEvents first(300), second(200, 301), one(1, 501);
    for (auto* events : {&first, &second, &one}) {
        auto outcome = sink->deliver(events->items(), patience(long_enough));
        EXPECT_EQ(outcome.trouble, "");
        EXPECT_EQ(std::ranges::count(outcome.fates, Fate::accepted),
                  static_cast<std::ptrdiff_t>(events->items().size()));
    }
    auto wanted = LentEvents(501).ids();
    eventually([&] { return destination.ids().size() >= wanted.size(); });
    EXPECT_EQ(destination.ids(), wanted) << "every one once, in order";
}

void check_partial_refusal(Destination& destination) {
    destination.start();
    LentEvents events(20);
    std::vector<std::string> refused = {events.ids()[0], events.ids()[7], events.ids()[19]};
    for (auto& id : refused)
        if (!destination.refuse(id)) GTEST_SKIP() << "this destination takes anything";
    auto sink = destination.make_sink();
    std::vector<sink::Item> left(events.items().begin(), events.items().end());
    std::vector<std::string> rejected;
    for (int turn = 0; turn < 50 && !left.empty(); ++turn) {
        auto outcome = sink->deliver(left, patience(long_enough));
        ASSERT_EQ(outcome.fates.size(), left.size());
        std::vector<sink::Item> kept;
        for (std::size_t i = 0; i < left.size(); ++i) {
            if (outcome.fates[i] == Fate::rejected) rejected.emplace_back(left[i].id);
            if (outcome.fates[i] == Fate::kept) kept.push_back(left[i]);
        }
        ASSERT_EQ(outcome.reasons.size(),
                  static_cast<std::size_t>(std::ranges::count(outcome.fates, Fate::rejected)));
        for (auto& reason : outcome.reasons) {
            EXPECT_EQ(outcome.fates.at(reason.item), Fate::rejected);
            EXPECT_FALSE(reason.text.empty());
        }
        left = std::move(kept);
    }
    EXPECT_TRUE(left.empty());
    EXPECT_EQ(rejected, refused);
    std::vector<std::string> wanted;
    for (auto& id : events.ids())
        if (std::ranges::find(refused, id) == refused.end()) wanted.push_back(id);
    expect_holds(destination, wanted);
}

void check_destination_gone_and_back(Destination& destination) {
    auto sink = destination.make_sink();
    LentEvents before(50), during(50, 51), after(50, 101);
    auto outcome = sink->deliver(before.items(), patience(2s));
    EXPECT_EQ(std::ranges::count(outcome.fates, Fate::kept), 50) << "it is not there yet";
    EXPECT_FALSE(outcome.trouble.empty());
    EXPECT_FALSE(sink->connected());
    destination.start();
    deliver_all(*sink, before.items());
    destination.kill();
    outcome = sink->deliver(during.items(), patience(2s));
    EXPECT_EQ(std::ranges::count(outcome.fates, Fate::rejected), 0)
        << "a dead server refuses nothing for good";
    EXPECT_EQ(std::ranges::count(outcome.fates, Fate::accepted), 0);
    EXPECT_FALSE(outcome.trouble.empty());
    destination.start();
    deliver_all(*sink, during.items());
    deliver_all(*sink, after.items());
    expect_holds(destination, LentEvents(150).ids());
}

void check_killed_in_between(Destination& destination) {
    destination.start();
    auto sink = destination.make_sink();
    std::vector<std::string> wanted;
    for (std::uint64_t batch = 0; batch < 12; ++batch) {
        if (batch % 4 == 2) destination.kill();
        LentEvents events(100, 1 + batch * 100);
        std::vector<sink::Item> left(events.items().begin(), events.items().end());
        if (batch % 4 == 2) {
            auto outcome = sink->deliver(left, patience(1s));
            std::erase_if(left, [&, i = std::size_t{0}](const sink::Item&) mutable {
                return outcome.fates[i++] == Fate::accepted;
            });
            destination.start();
        }
        deliver_all(*sink, left);
        std::ranges::move(events.ids(), std::back_inserter(wanted));
    }
    expect_holds(destination, wanted);
}

void check_doubles_after_a_crash(Destination& destination) {
    destination.start();
    LentEvents events(100);
    deliver_all(*destination.make_sink(), events.items());
    deliver_all(*destination.make_sink(), events.items());  // the mark of the first was lost
    expect_holds(destination, events.ids());
    auto wanted = destination.idempotent() ? 100u : 200u;
    eventually([&] { return destination.ids().size() >= wanted; });
    EXPECT_EQ(destination.ids().size(), wanted);
}

void check_hostile_text(Destination& destination) {
    destination.start();
    auto sink = destination.make_sink();
    std::vector<std::string> hostile = {"'; DROP TABLE gantry_events;--",
                                        "<script>alert(1)</script>",
                                        "../../etc/passwd",
                                        "a/b/#/+/$SYS",
                                        "x.*.>",
                                        "line\nbreak\r\n",
                                        "\x1b[31mred",
                                        "\xE2\x80\xAE"
                                        "right to left",
                                        "nul\\u0000",
                                        "${jndi:ldap://x}",
                                        "\"quoted\\",
                                        std::string(255, 'n'),
                                        std::string("nul\0inside", 10),
                                        "\t,;\"csv"};
    std::vector<event::Event> list(hostile.size());
    std::vector<std::string> ids, payloads;
    for (std::size_t i = 0; i < hostile.size(); ++i) {
        auto& event = list[i];
        event.seq = i + 1;
        event.type = event::Type::reader_fault;
        event.time = from_us(1'795'000'000'000'000);
        event.reader = event.zone = event.antenna = event.text = hostile[i];
        event.epc = hostile[i];
        event.bytes = Bytes(hostile[i].begin(), hostile[i].end());
        ids.push_back("suite:" + std::to_string(event.seq));
        event::append_json(payloads.emplace_back(), event, "suite:");
    }
    std::vector<sink::Item> items;
    for (std::size_t i = 0; i < list.size(); ++i)
        items.push_back({&list[i], ids[i], payloads[i]});
    deliver_all(*sink, items);
    auto sorted = [](std::vector<std::string> all) {
        std::ranges::sort(all);
        return all;
    };
    // Names may be part of where an event goes, and so of the order in which it is read back.
    std::vector<std::string> held;
    eventually([&] { return (held = sorted(without_doubles(destination.ids()))).size() >= ids.size(); });
    EXPECT_EQ(held, sorted(ids));
}

void check_patience(Destination& destination) {
    auto sink = destination.make_sink();  // nobody is there
    LentEvents events(10);
    auto start = std::chrono::steady_clock::now();
    auto outcome = sink->deliver(events.items(), patience(300ms));
    EXPECT_EQ(std::ranges::count(outcome.fates, Fate::kept), 10);
    std::stop_source stop;
    stop.request_stop();
    outcome = sink->deliver(events.items(), {.until = start + 10min, .stop = stop.get_token()});
    EXPECT_EQ(std::ranges::count(outcome.fates, Fate::kept), 10);
    EXPECT_LT(std::chrono::steady_clock::now() - start, 1min) << "it waited for what was not to come";
}

}  // namespace gantry::testkit
