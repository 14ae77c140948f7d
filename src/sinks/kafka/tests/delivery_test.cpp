#include <map>
#include <thread>

#include "cluster.hpp"
#include "sink/shape.hpp"

namespace gantry::sinks::kafka::tests {
namespace {

using sink::Fate;

// Numbers of the Kafka protocol.
constexpr int produce = 0;
constexpr int not_leader = 6, timed_out = 7, too_large = 10, not_enough_replicas = 19, not_allowed = 29,
              out_of_order = 45, unknown_producer = 59, invalid_record = 87;

struct KafkaOnePartition : testing::Test {
    Cluster cluster;
    std::unique_ptr<sink::Sink> sink;
    void SetUp() override {
        cluster.order("topic gantry.events 1");
        sink = sink_of(cluster);
    }
    void fail(std::vector<int> errors, int api = produce) {
        cluster.order(fmt::format("fail {} {}", api, fmt::join(errors, " ")));
    }
    std::vector<std::string> ids() const { return ids_of(cluster.held()); }
};

TEST(KafkaDelivery, KeyHeadersAndValueSayWhatTheEventSays) {
    Cluster cluster;
    cluster.order("topic gantry.events 1");
    std::vector<event::Event> events(3);
    events[0].type = event::Type::tag_observed;
    events[0].reader = "dock-1";
    events[0].tag = event::TagId(Bytes{0x30, 0x74});
    events[1].type = event::Type::reader_fault;
    events[1].reader = "dock-1";
    events[1].text = "nul\0and\nline";
    events[2].type = event::Type::overflow;
    std::vector<std::string> ids, payloads;
    std::vector<sink::Item> items;
    for (auto& event : events) {
        event.seq = ids.size() + 1;
        ids.push_back("suite:" + std::to_string(event.seq));
        sink::append_payload(payloads.emplace_back(), event,
                             "suite:", event.seq == 3 ? sink::Shape::cloudevents : sink::Shape::native);
    }
    for (std::size_t i = 0; i < events.size(); ++i)
        items.push_back({&events[i], ids[i], payloads[i]});
    expect_all_accepted(sink_of(cluster)->deliver(items, patience(20s)));
    expect_all_accepted(sink_of(cluster, {{"key", "reader"}})->deliver(items, patience(20s)));
    auto held = cluster.held();
    ASSERT_EQ(held.size(), 6u);
    for (std::size_t i = 0; i < held.size(); ++i) {
        EXPECT_EQ(held[i].value, payloads[i % 3]);
        EXPECT_EQ(held[i].id, ids[i % 3]);
        EXPECT_EQ(held[i].type, event::to_text(events[i % 3].type));
        EXPECT_EQ(held[i].schema, "1");
        EXPECT_EQ(held[i].content_type, i % 3 == 2 ? "application/cloudevents+json" : "application/json");
    }
    EXPECT_EQ(held[0].key, "3074");
    EXPECT_EQ(held[3].key, "dock-1");
    EXPECT_EQ(held[1].key, "dock-1");
    EXPECT_FALSE(held[2].has_key);
}

TEST(KafkaDelivery, ATagStaysInItsPartitionAndInOrder) {
    Cluster cluster(3);
    cluster.order("topic gantry.events 6");
    auto sink = sink_of(cluster);
    // Thirty tags take turns.
    std::vector<event::Event> events(600);
    std::vector<std::string> ids, payloads;
    std::vector<sink::Item> items;
    for (std::size_t i = 0; i < events.size(); ++i) {
        events[i].seq = i + 1;
        events[i].type = event::Type::tag_read;
        events[i].tag = event::TagId(Bytes{static_cast<std::uint8_t>(i % 30)});
        ids.push_back("suite:" + std::to_string(i + 1));
        event::append_json(payloads.emplace_back(), events[i], "suite:");
    }
    for (std::size_t i = 0; i < events.size(); ++i)
        items.push_back({&events[i], ids[i], payloads[i]});
    for (std::size_t at = 0; at < items.size(); at += 200)
        expect_all_accepted(sink->deliver(std::span(items).subspan(at, 200), patience(20s)));
    std::map<std::string, std::pair<int, int>> last;  // key: partition, number
    auto held = cluster.held("gantry.events", 6);
    ASSERT_EQ(held.size(), events.size());
    std::map<int, int> partitions;
    for (auto& each : held) {
        int number = std::stoi(each.id.substr(6));
        ++partitions[each.partition];
        auto [it, is_new] = last.try_emplace(each.key, each.partition, number);
        if (is_new) continue;
        EXPECT_EQ(it->second.first, each.partition) << each.key;
        EXPECT_EQ(it->second.second + 30, number) << each.key;
        it->second.second = number;
    }
    EXPECT_EQ(last.size(), 30u);
    EXPECT_GT(partitions.size(), 2u) << "and the tags are spread";
}

TEST_F(KafkaOnePartition, EveryCompressionArrives) {
    std::size_t total = 0;
    for (auto* compression : {"none", "gzip", "snappy", "lz4", "zstd"}) {
        testkit::LentEvents events(50, 1 + total);
        expect_all_accepted(
            sink_of(cluster, {{"compression", compression}})->deliver(events.items(), patience(20s)));
        total += 50;
    }
    EXPECT_EQ(ids(), testkit::LentEvents(total).ids());
}

TEST_F(KafkaOnePartition, ABatchBiggerThanARequestArrivesInOrder) {
    sink = sink_of(cluster, {{"max_message", "2000"}});  // four events a request, and five requests at once
    testkit::LentEvents events(1000);
    expect_all_accepted(sink->deliver(events.items(), patience(60s)));
    EXPECT_EQ(ids(), events.ids());
}

// --- refused messages ---

TEST_F(KafkaOnePartition, AnEventThatIsTooLongIsRejectedAndTheRestArrives) {
    sink = sink_of(cluster, {{"max_message", "1000"}});
    std::vector<event::Event> events(5);
    std::vector<std::string> all, payloads;
    std::vector<sink::Item> items;
    for (std::size_t i = 0; i < events.size(); ++i) {
        events[i].seq = i + 1;
        events[i].type = event::Type::reader_fault;
        events[i].text = std::string(i == 1 || i == 4 ? 2000 : 10, 'x');
        all.push_back("suite:" + std::to_string(i + 1));
        event::append_json(payloads.emplace_back(), events[i], "suite:");
    }
    for (std::size_t i = 0; i < events.size(); ++i)
        items.push_back({&events[i], all[i], payloads[i]});
    auto outcome = sink->deliver(items, patience(20s));
    EXPECT_EQ(outcome.fates,
              (std::vector{Fate::accepted, Fate::rejected, Fate::accepted, Fate::accepted, Fate::rejected}));
    ASSERT_EQ(outcome.reasons.size(), 2u);
    EXPECT_EQ(outcome.reasons[0].item, 1u);
    EXPECT_EQ(outcome.reasons[1].item, 4u);
    EXPECT_NE(outcome.reasons[0].text.find("MSG_SIZE_TOO_LARGE"), std::string::npos)
        << outcome.reasons[0].text;
    EXPECT_EQ(ids(), (std::vector<std::string>{"suite:1", "suite:3", "suite:4"}));
}

TEST_F(KafkaOnePartition, OfARefusedBatchOnlyTheMessageToBlameIsRejected) {
    testkit::LentEvents before(3), events(6, 4);
    expect_all_accepted(sink->deliver(before.items(), patience(20s)));
    fail({invalid_record, 0, 0, invalid_record, 0,
          invalid_record});  // the batch, then 1, 2, 3, 4, 5 by themselves
    auto outcome = sink->deliver(events.items(), patience(20s));
    EXPECT_EQ(outcome.trouble, "");
    EXPECT_EQ(outcome.fates, (std::vector{Fate::accepted, Fate::accepted, Fate::rejected, Fate::accepted,
                                          Fate::rejected, Fate::accepted}));
    ASSERT_EQ(outcome.reasons.size(), 2u);
    EXPECT_EQ(outcome.reasons[0].item, 2u);
    EXPECT_EQ(outcome.reasons[1].item, 4u);
    EXPECT_NE(outcome.reasons[0].text.find("INVALID_RECORD"), std::string::npos) << outcome.reasons[0].text;
    testkit::LentEvents after(3, 10);
    expect_all_accepted(sink->deliver(after.items(), patience(20s)));
    auto wanted = testkit::LentEvents(12).ids();
    std::erase_if(wanted, [](auto& id) { return id == "suite:6" || id == "suite:8"; });
    EXPECT_EQ(ids(), wanted);
}

TEST_F(KafkaOnePartition, ARefusedBatchThatCannotBeSentAloneYetIsKept) {
    testkit::LentEvents events(5), after(5, 6);
    expect_all_accepted(sink->deliver({}, patience(20s)));
    cluster.order(
        fmt::format("topic-error gantry.events {}", not_allowed));  // the producer that is there knows it
    fail({invalid_record});
    expect_all_kept(sink->deliver(events.items(), patience(3s)), "Topic authorization failed");
    cluster.order("topic-error gantry.events 0");
    expect_all_accepted(sink->deliver(events.items(), patience(20s)));
    expect_all_accepted(sink->deliver(after.items(), patience(20s)));
    EXPECT_EQ(ids(), testkit::LentEvents(10).ids());
}

TEST_F(KafkaOnePartition, ABatchThatIsTooLargeForTheTopicArrivesInSmallerOnes) {
    fail({too_large});
    testkit::LentEvents events(20);
    expect_all_accepted(sink->deliver(events.items(), patience(20s)));
    testkit::LentEvents more(20, 21);
    expect_all_accepted(sink->deliver(more.items(), patience(20s)));
    EXPECT_EQ(ids(), testkit::LentEvents(40).ids());
}

// --- what is nobody's fault ---

TEST_F(KafkaOnePartition, ErrorsThatPassAreTriedAgainInTheSameCall) {
    fail({not_leader, timed_out, not_enough_replicas});
    testkit::LentEvents events(20);
    expect_all_accepted(sink->deliver(events.items(), patience(60s)));
    EXPECT_EQ(ids(), events.ids());
}

TEST_F(KafkaOnePartition, ABrokenConnectionIsMadeAnewInTheSameCall) {
    fail({RD_KAFKA_RESP_ERR__TRANSPORT});
    testkit::LentEvents events(20);
    expect_all_accepted(sink->deliver(events.items(), patience(60s)));
    EXPECT_EQ(without_doubles(ids()), events.ids());
}

TEST_F(KafkaOnePartition, AMissingRightKeepsAllAndSaysSo) {
    fail({not_allowed});
    testkit::LentEvents events(20);
    expect_all_kept(sink->deliver(events.items(), patience(20s)), "authorization failed");
    expect_all_accepted(sink->deliver(events.items(), patience(20s)));
    EXPECT_EQ(ids(), events.ids());
}

TEST_F(KafkaOnePartition, AProducerThatCannotGoOnIsReplaced) {
    testkit::LentEvents first(10), second(10, 11);
    expect_all_accepted(sink->deliver(first.items(), patience(20s)));
    fail({out_of_order});  // librdkafka calls it fatal: it and the broker do not agree on what was sent
    expect_all_kept(sink->deliver(second.items(), patience(20s)), "OUT_OF_ORDER_SEQUENCE_NUMBER");
    expect_all_accepted(sink->deliver(second.items(), patience(20s)));
    EXPECT_EQ(ids(), testkit::LentEvents(20).ids());
}

TEST_F(KafkaOnePartition, AProducerThatTheClusterHasForgottenGoesOnByItself) {
    testkit::LentEvents first(10), second(10, 11);
    expect_all_accepted(sink->deliver(first.items(), patience(20s)));
    fail({unknown_producer});
    expect_all_accepted(sink->deliver(second.items(), patience(20s)));
    EXPECT_EQ(ids(), testkit::LentEvents(20).ids());
}

TEST_F(KafkaOnePartition, AnotherBrokerMayLead) {
    Cluster three(3);
    three.order("topic gantry.events 1");
    sink = sink_of(three);
    for (std::uint64_t broker = 1; broker <= 3; ++broker) {
        three.order(fmt::format("leader gantry.events 0 {}", broker));
        testkit::LentEvents events(20, 20 * broker - 19);
        expect_all_accepted(sink->deliver(events.items(), patience(60s)));
    }
    EXPECT_EQ(ids_of(three.held()), testkit::LentEvents(60).ids());
}

// --- patience ---

TEST_F(KafkaOnePartition, WhatWasKeptIsNeverSentBehindOurBack) {
    expect_all_accepted(sink->deliver({}, patience(20s)));
    cluster.order("down");
    testkit::LentEvents kept(100), other(1, 500);
    expect_all_kept(sink->deliver(kept.items(), patience(300ms)), cluster.brokers());
    EXPECT_FALSE(sink->connected());
    cluster.order("up");
    expect_all_accepted(sink->deliver(other.items(), patience(20s)));
    EXPECT_EQ(ids(), other.ids());
    expect_all_accepted(sink->deliver(kept.items(), patience(20s)));
    EXPECT_EQ(ids().size(), 101u);
}

TEST_F(KafkaOnePartition, AnAnswerThatComesTooLateDoesNotCountAndOrderHolds) {
    testkit::LentEvents first(10), second(10, 11);
    expect_all_accepted(sink->deliver({}, patience(20s)));
    cluster.order("rtt 3000");
    expect_all_kept(sink->deliver(first.items(), patience(200ms)), "no answer");
    cluster.order("rtt 0");
    expect_all_accepted(sink->deliver(first.items(), patience(20s)));
    expect_all_accepted(sink->deliver(second.items(), patience(20s)));
    EXPECT_EQ(without_doubles(ids()), testkit::LentEvents(20).ids());
}

TEST_F(KafkaOnePartition, AStopEndsTheWait) {
    expect_all_accepted(sink->deliver({}, patience(20s)));
    cluster.order("rtt 5000");
    std::stop_source stop;
    std::jthread stopper([&] { stop.request_stop(); });
    expect_all_kept(
        sink->deliver(testkit::LentEvents(10).items(),
                      {.until = std::chrono::steady_clock::now() + 10min, .stop = stop.get_token()}),
        "the gateway ends");
}

TEST(KafkaDelivery, APartitionThatIsAwayKeepsOnlyItsOwn) {
    Cluster cluster(2);
    cluster.order("topic gantry.events 2");
    cluster.order("leader gantry.events 0 1");
    cluster.order("leader gantry.events 1 2");
    auto sink = sink_of(cluster);
    testkit::LentEvents events(40);
    // Both brokers are connected before one goes away: else it is the connection that is waited for.
    auto first = events.items().first(10), rest = events.items().subspan(10);
    expect_all_accepted(sink->deliver(first, patience(20s)));
    cluster.order("down 2");
    auto outcome = sink->deliver(rest, patience(3s));
    auto accepted = count(outcome, Fate::accepted), kept = count(outcome, Fate::kept);
    EXPECT_GT(accepted, 0);
    EXPECT_GT(kept, 0);
    EXPECT_EQ(accepted + kept, 30);
    EXPECT_NE(outcome.trouble, "");
    cluster.order("up 2");
    std::vector<sink::Item> left;
    for (std::size_t i = 0; i < rest.size(); ++i)
        if (outcome.fates[i] == Fate::kept) left.push_back(rest[i]);
    expect_all_accepted(sink->deliver(left, patience(20s)));
    auto held = cluster.held("gantry.events", 2);
    EXPECT_EQ(without_doubles(ids_of(held)).size(), 40u);
    for (int partition : {0, 1}) {
        std::vector<int> numbers;
        for (auto& each : held)
            if (each.partition == partition) numbers.push_back(std::stoi(each.id.substr(6)));
        EXPECT_TRUE(std::ranges::is_sorted(numbers));
    }
}

TEST_F(KafkaOnePartition, WhatIsWrongWithATopicIsSaid) {
    cluster.order(fmt::format("topic-error gantry.events {}", not_allowed));
    testkit::LentEvents events(3);
    expect_all_kept(sink->deliver(events.items(), patience(3s)),
                    "gantry.events: Broker: Topic authorization failed");
    cluster.order("topic-error gantry.events 0");
    expect_all_accepted(sink->deliver(events.items(), patience(20s)));
}

TEST_F(KafkaOnePartition, AnIdleSinkSeesThatTheClusterIsAway) {
    expect_all_accepted(sink->deliver({}, patience(20s)));
    EXPECT_TRUE(sink->connected());
    cluster.order("down");
    EXPECT_TRUE(eventually([&] {
        sink->idle(patience(1s));
        return !sink->connected();
    }));
}

}  // namespace
}  // namespace gantry::sinks::kafka::tests
