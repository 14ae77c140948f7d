#include <algorithm>
#include <set>
#include <thread>

#include "base/log.hpp"
#include "testkit/eventually.hpp"
#include "testkit/fault_proxy.hpp"
#include "web_server.hpp"

namespace gantry::sinks::webhook {
namespace {

using testkit::eventually;
using testkit::FaultProxy;
using testkit::Faults;
using testkit::LentEvents;
using testkit::patience;

// A server and a sink that is connected to it.
struct WebhookAnswers : ::testing::Test {
    WebServer server;
    std::unique_ptr<sink::Sink> sink;
    LentEvents events{20};

    WebhookAnswers() {
        server.start();
        sink = make_webhook(server.url());
    }
    sink::Outcome deliver(std::chrono::milliseconds time = 20s) {
        return sink->deliver(events.items(), patience(time));
    }
};

TEST_F(WebhookAnswers, WhatIsNoneOfTheKnownOnesIsKeptAndSaid) {
    struct Case {
        int status;
        std::string_view text;
    };
    for (auto each :
         {Case{401, "another token"}, Case{403, "another token"}, Case{404, "is the path in url right?"},
          Case{405, "is the path"}, Case{408, "Timeout"}, Case{409, "Conflict"},
          Case{429, "Too Many Requests"}, Case{500, "Internal Server Error"}, Case{502, "Bad Gateway"},
          Case{503, "Service Unavailable"}, Case{304, "304"}, Case{451, "451"}, Case{599, "599"}}) {
        server.behave({{"status", each.status}});
        auto outcome = deliver();
        expect_kept(outcome, 20, std::string(each.text));
        EXPECT_NE(outcome.trouble.find(server.url() + " answered " + std::to_string(each.status)),
                  std::string::npos)
            << outcome.trouble;
        EXPECT_FALSE(outcome.retry_after);
    }
    for (int status : {200, 201, 202, 204, 299}) {
        server.behave({{"status", status}});
        expect_accepted(deliver(), 20);
    }
}

TEST_F(WebhookAnswers, RetryAfterIsObeyedInSecondsAndAsADate) {
    server.behave({{"status", 429}, {"headers", {{"Retry-After", "7"}}}});
    EXPECT_EQ(deliver().retry_after, 7s);
    server.behave(
        {{"status", 503},
         {"headers",
          {{"Date", "Sat, 21 Nov 2026 23:04:00 GMT"}, {"Retry-After", "Sat, 21 Nov 2026 23:06:30 GMT"}}}});
    EXPECT_EQ(deliver().retry_after, 150s) << "by the server's own clock";
    server.behave({{"status", 500}, {"headers", {{"retry-after", "120"}}}});
    EXPECT_EQ(deliver().retry_after, 120s);
    server.behave({{"status", 200}, {"headers", {{"Retry-After", "120"}}}});
    auto outcome = deliver();
    expect_accepted(outcome, 20);
    EXPECT_FALSE(outcome.retry_after);
}

TEST_F(WebhookAnswers, ARefusalIsolatesWhatIsRefused) {
    for (int status : {400, 422}) {
        auto fresh = LentEvents(1000, 1 + static_cast<std::uint64_t>(status) * 10'000);
        auto ids = fresh.ids();
        json::array bad = {json::string(ids[0]), json::string(ids[500]), json::string(ids[999])};
        server.behave(
            {{"refuse", bad}, {"refuse_status", status}, {"body", "{\"error\":\"unknown\n reader\"}"}});
        auto before = server.requests().size(), held = server.ids().size();
        auto outcome = sink->deliver(fresh.items(), patience(20s));
        EXPECT_EQ(outcome.trouble, "");
        ASSERT_EQ(outcome.reasons.size(), 3u);
        std::vector<std::string> wanted;
        for (std::size_t i = 0; i < ids.size(); ++i) {
            bool refused = i == 0 || i == 500 || i == 999;
            EXPECT_EQ(outcome.fates[i], refused ? sink::Fate::rejected : sink::Fate::accepted) << i;
            if (!refused) wanted.push_back(ids[i]);
        }
        EXPECT_EQ(outcome.reasons[1].item, 500u);
        EXPECT_NE(outcome.reasons[1].text.find("answered " + std::to_string(status)), std::string::npos);
        EXPECT_NE(outcome.reasons[1].text.find(": {\"error\":\"unknown  reader\"}"), std::string::npos)
            << "what the receiver said, on one line: " << outcome.reasons[1].text;
        auto all = server.ids();
        EXPECT_EQ(std::vector(all.begin() + static_cast<std::ptrdiff_t>(held), all.end()), wanted)
            << "in order, once";
        EXPECT_LE(server.requests().size() - before, 55u) << "found by halving";
    }
}

TEST_F(WebhookAnswers, AllOfThemRefusedIsAllOfThemRejected) {
    server.behave({{"status", 400}});
    auto outcome = deliver();
    EXPECT_EQ(outcome.fates, std::vector(20, sink::Fate::rejected));
    EXPECT_EQ(outcome.reasons.size(), 20u);
    EXPECT_EQ(outcome.trouble, "");
}

TEST_F(WebhookAnswers, TroubleAmidARefusalKeepsTheRest) {
    json::array bad = {json::string(events.ids()[3])};
    server.behave({{"refuse", bad}});
    // The receiver fails as soon as it has taken the first half of the first half.
    std::jthread meanwhile([&] {
        eventually([&] { return !server.ids().empty(); });
        server.behave({{"status", 503}});
    });
    auto outcome = deliver();
    meanwhile.join();
    std::vector<std::string> accepted;
    bool behind_kept = false;
    for (std::size_t i = 0; i < 20; ++i) {
        if (outcome.fates[i] == sink::Fate::accepted) accepted.push_back(events.ids()[i]);
        behind_kept = behind_kept || outcome.fates[i] == sink::Fate::kept;
        EXPECT_TRUE(!behind_kept || outcome.fates[i] == sink::Fate::kept) << "nothing overtakes what is kept";
    }
    EXPECT_EQ(server.ids(), accepted);
    EXPECT_EQ(outcome.trouble.empty(), !behind_kept);
}

TEST_F(WebhookAnswers, TooLargeIsHalvedAndLearned) {
    server.behave({{"max_body", 40'000}});
    LentEvents many(1000), more(1000, 1001);
    expect_accepted(sink->deliver(many.items(), patience(20s)), 1000);
    auto first = server.requests();
    EXPECT_GT(std::ranges::count_if(first, [](auto& each) { return each.at("status") == 413; }), 1);
    expect_accepted(sink->deliver(more.items(), patience(20s)), 1000);
    auto all = server.requests();
    auto refused = std::count_if(all.begin() + static_cast<std::ptrdiff_t>(first.size()), all.end(),
                                 [](auto& each) { return each.at("status") == 413; });
    EXPECT_LE(refused, 3) << "what it takes at once is known by now";
    EXPECT_EQ(server.ids(), LentEvents(2000).ids());
}

TEST_F(WebhookAnswers, OneThatIsTooLargeByItselfIsRejected) {
    server.behave({{"max_body", 2000}});
    LentEvents normal(20);
    std::vector<sink::Item> items(normal.items().begin(), normal.items().end());
    std::string large(items[7].payload);
    large.insert(large.size() - 1, R"(,"data":{"user":")" + std::string(5000, 'F') + "\"}");
    items[7].payload = large;
    auto outcome = sink->deliver(items, patience(20s));
    ASSERT_EQ(outcome.reasons.size(), 1u);
    EXPECT_EQ(outcome.reasons[0].item, 7u);
    EXPECT_NE(outcome.reasons[0].text.find("413"), std::string::npos);
    auto wanted = normal.ids();
    wanted.erase(wanted.begin() + 7);
    EXPECT_EQ(server.ids(), wanted);
}

TEST_F(WebhookAnswers, AServerThatResetsWhatIsTooLargeGetsLess) {
    server.behave({{"max_body", 150'000}, {"too_large", "reset"}});
    LentEvents many(1000);
    std::size_t done = 0;
    for (int turn = 0; turn < 10 && done < 1000; ++turn) {
        auto outcome = sink->deliver(many.items().subspan(done), patience(20s));
        EXPECT_EQ(std::ranges::count(outcome.fates, sink::Fate::rejected), 0);
        done += static_cast<std::size_t>(std::ranges::count(outcome.fates, sink::Fate::accepted));
    }
    EXPECT_EQ(done, 1000u);
    EXPECT_EQ(server.ids(), many.ids());
}

TEST_F(WebhookAnswers, RedirectsAreNotFollowedButSaid) {
    for (int status : {301, 302, 303, 307, 308}) {
        server.behave(
            {{"status", status}, {"headers", {{"Location", "https://erp.example.com/new?key=hush"}}}});
        auto outcome = deliver();
        expect_kept(outcome, 20,
                    "it says to go to https://erp.example.com/new: if that is right, put it into url");
        EXPECT_EQ(outcome.trouble.find("hush"), std::string::npos) << outcome.trouble;
    }
    EXPECT_EQ(server.requests().size(), 5u);
}

TEST_F(WebhookAnswers, RedirectsToTheSameHostCanBeFollowed) {
    WebServer other;
    other.start();
    sink = make_webhook(server.url(), {{"follow_redirects", "true"}});
    server.behave({{"status", 307}, {"headers", {{"Location", other.url()}}}});
    expect_accepted(deliver(), 20);
    EXPECT_EQ(other.ids(), events.ids());
    EXPECT_EQ(header(other.requests()[0], "Idempotency-Key"),
              header(server.requests()[0], "Idempotency-Key"));
    server.behave({{"status", 302}, {"headers", {{"Location", other.url()}}}});
    expect_kept(deliver(), 20, "302");
    server.behave({{"status", 308}, {"headers", {{"Location", "/round/and/round"}}}});
    auto before = server.requests().size();
    expect_kept(deliver(), 20, "308");
    EXPECT_EQ(server.requests().size(), before + 6) << "five hops, no more";
    auto name = "http://localhost:" + std::to_string(other.port()) + "/";
    server.behave({{"status", 307}, {"headers", {{"Location", name}}}});
    expect_kept(deliver(), 20, "go to " + name);
    EXPECT_EQ(other.requests().size(), 1u) << "that is another host";
}

TEST_F(WebhookAnswers, ABadAnswerKeepsTheBatchAndTheNextOneIsFine) {
    for (auto* mode : {"garbage", "drop", "cut", "headers"}) {
        server.behave({{"mode", mode}});
        auto outcome = deliver();
        expect_kept(outcome, 20, server.url() + ": ");
        EXPECT_FALSE(sink->connected());
        EXPECT_TRUE(server.ids().empty()) << mode;
    }
    server.behave({});
    expect_accepted(deliver(), 20);
    EXPECT_TRUE(sink->connected());
    EXPECT_EQ(server.ids(), events.ids());
}

TEST_F(WebhookAnswers, NoAnswerIsWaitedForAsLongAsPatienceLasts) {
    for (auto* mode : {"never", "endless", "dribble"}) {
        server.behave({{"mode", mode}});
        expect_kept(deliver(200ms), 20, "did not answer in time");
        EXPECT_FALSE(sink->connected());
    }
    server.behave({});
    expect_accepted(deliver(), 20);
}

TEST_F(WebhookAnswers, AStopEndsTheWaitAtOnce) {
    server.behave({{"mode", "never"}});
    std::stop_source stop;
    std::jthread stopper([&] {
        eventually([&] { return !server.requests().empty(); });
        stop.request_stop();
    });
    auto outcome = sink->deliver(events.items(),
                                 {.until = std::chrono::steady_clock::now() + 1h, .stop = stop.get_token()});
    expect_kept(outcome, 20, "the gateway ended");
}

TEST_F(WebhookAnswers, ABodyThatNobodyWantsIsNotReadToItsEnd) {
    server.behave({{"mode", "long"}});
    expect_accepted(deliver(), 20);
    expect_accepted(deliver(), 20);
    EXPECT_EQ(server.requests()[1].at("connection"), 2) << "the first connection was given up";
}

TEST_F(WebhookAnswers, OneConnectionIsUsedForAll) {
    expect_accepted(sink->deliver({}, patience(20s)), 0);
    for (int i = 0; i < 5; ++i)
        expect_accepted(deliver(), 20);
    server.behave({{"status", 500}, {"body", "trouble"}});
    expect_kept(deliver(), 20, "500");
    for (auto& each : server.requests())
        EXPECT_EQ(each.at("connection"), 1);
}

TEST_F(WebhookAnswers, AServerThatClosesAfterEachReplyGetsAll) {
    server.behave({{"mode", "close"}});
    for (int i = 0; i < 10; ++i)
        expect_accepted(deliver(), 20);
    std::set<std::int64_t> connections;
    for (auto& each : server.requests())
        connections.insert(each.at("connection").as_int64());
    EXPECT_EQ(connections.size(), 10u);
}

TEST_F(WebhookAnswers, WhatAPeerSaysIsMadePrintableAndShort) {
    server.behave({{"status", 500},
                   {"reason", "Oh \x1b[31mno"},
                   {"body", "<script>\x1b[2J" + std::string(5000, 'z') + "the end"}});
    auto outcome = deliver();
    expect_kept(outcome, 20, "500 Oh \\x1B[31mno: <script>\\x1B[2Jzzz");
    EXPECT_EQ(outcome.trouble.find('\x1b'), std::string::npos);
    EXPECT_LT(outcome.trouble.size(), 500u);
}

// Between sink and server a network that does what networks do.
struct WebhookNetwork : WebhookAnswers {
    FaultProxy proxy{server.port()};

    WebhookNetwork() { sink = make_webhook("http://127.0.0.1:" + std::to_string(proxy.port()) + "/"); }
};

TEST_F(WebhookNetwork, ACutAnywhereInTheAnswerLosesNothing) {
    server.behave({{"headers", {{"X-Some", "header"}}}, {"body", "taken"}});
    expect_accepted(deliver(), 20);
    auto answer = proxy.passed().to_client;
    ASSERT_GT(answer, 50u);
    for (std::uint64_t place = 0; place <= answer; ++place) {
        proxy.end_all(Faults::Ending::close);
        proxy.set({}, {.cut_after = place,
                       .ending = place % 2 == 0 ? Faults::Ending::close : Faults::Ending::reset});
        auto outcome = deliver();
        for (auto fate : outcome.fates)
            ASSERT_NE(fate, sink::Fate::rejected) << place;
        // Where the cut is a reset the end of a whole answer may be lost with it.
        if (place < answer) {
            ASSERT_EQ(outcome.fates, std::vector(20, sink::Fate::kept)) << place;
        }
    }
    proxy.set({});
    expect_accepted(deliver(), 20);
}

TEST_F(WebhookNetwork, ACutAnywhereInTheRequestLosesNothing) {
    expect_accepted(deliver(), 20);
    auto request = proxy.passed().to_target;
    for (std::uint64_t place = 0; place < request; place += 97) {
        proxy.end_all(Faults::Ending::close);
        proxy.set(
            {.cut_after = place, .ending = place % 2 == 0 ? Faults::Ending::close : Faults::Ending::reset},
            {});
        auto outcome = deliver();
        ASSERT_EQ(outcome.fates, std::vector(20, sink::Fate::kept)) << place;
    }
    EXPECT_EQ(server.ids().size(), 20u);
    proxy.set({});
    expect_accepted(deliver(), 20);
}

TEST_F(WebhookNetwork, AHalfOpenConnectionIsFoundOutAndLeft) {
    expect_accepted(deliver(), 20);
    proxy.end_all(Faults::Ending::half_open);
    expect_kept(deliver(200ms), 20, "did not answer in time");
    expect_accepted(deliver(), 20);
    EXPECT_EQ(proxy.accepted(), 2u);
}

TEST_F(WebhookNetwork, AConnectionThatWasClosedMeanwhileIsReplacedWithinOneCall) {
    for (auto how : {Faults::Ending::close, Faults::Ending::reset}) {
        expect_accepted(deliver(), 20);
        proxy.end_all(how);
        expect_accepted(deliver(), 20);
    }
}

TEST_F(WebhookNetwork, SlowAndChoppedIsStillRight) {
    proxy.set({.delay = 20ms, .segment = 1000}, {.delay = 20ms, .segment = 1});
    expect_accepted(deliver(), 20);
    EXPECT_EQ(server.ids(), events.ids());
}

TEST_F(WebhookNetwork, ALineThatStallsAndGoesOnIsWaitedFor) {
    proxy.set({.stall_after = 500, .stall_for = 100ms}, {.stall_after = 5, .stall_for = 100ms});
    expect_accepted(deliver(), 20);
    EXPECT_EQ(server.ids(), events.ids());
}

TEST_F(WebhookNetwork, RefusedAndBackAgain) {
    proxy.refuse(true);
    expect_kept(deliver(), 20, "Connection refused");
    proxy.refuse(false);
    expect_accepted(deliver(), 20);
}

}  // namespace
}  // namespace gantry::sinks::webhook
