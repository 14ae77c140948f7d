// What other clients see of the sink at a real broker.
#include <boost/json.hpp>

#include "base/log.hpp"
#include "mosquitto_server.hpp"
#include "testkit/certificates.hpp"
#include "testkit/fault_proxy.hpp"

namespace gantry::sinks::mqtt::tests {

using sink::Fate;
using testkit::LentEvents;
using testkit::patience;

// A gateway with readers whose state the test sets.
class SomeHost : public sink::Host {
public:
    std::vector<sink::ReaderState> readers() override {
        std::lock_guard lock(mutex_);
        return readers_;
    }
    void set(std::vector<sink::ReaderState> readers) {
        std::lock_guard lock(mutex_);
        readers_ = std::move(readers);
    }
    void request(std::string_view operation, std::string body,
                 std::function<void(std::string)> answer) override {
        std::thread([=, operation = std::string(operation)] {
            answer(R"({"status":"ok","data":{"operation":")" + operation + R"(","body":)" + body + "}}");
        }).detach();
    }

private:
    std::mutex mutex_;
    std::vector<sink::ReaderState> readers_;
};

static const sink::ReaderState dock{.name = "dock-1", .make = "caen", .connected = true, .text = "connected"};

class MqttBroker : public testing::Test {
protected:
    MosquittoServer server;
    Listener listener{server.port()};
    SomeHost host;
    void SetUp() override {
        server.start();
        listener.start();
    }
    // What the runner does while nothing is to be delivered.
    template <class Condition>
    bool idle_until(sink::Sink& sink, Condition condition) {
        return eventually([&] {
            sink.idle(patience(1s));
            return condition();
        });
    }
    bool heard(const std::string& topic, const std::string& payload) {
        for (auto& each : listener.all())
            if (each.topic == topic && each.payload == payload) return true;
        return false;
    }
};

TEST_F(MqttBroker, EventsGoToTheTopicOfTheirReader) {
    auto sink = make(url_of(server.port()), {}, host);
    LentEvents events(1);
    event::Event of_gateway = *events.items()[0].event;
    of_gateway.reader.clear();
    event::Event hostile = of_gateway;
    hostile.reader = "a/#/+/$SYS";
    std::vector<sink::Item> items = {
        events.items()[0], {&of_gateway, "x:2", "{}"}, {&hostile, "x:3", R"({"a":1})"}};
    EXPECT_EQ(count(sink->deliver(items, patience(20s)), Fate::accepted), 3u);
    auto first = listener.wait_for("gantry/site-7/dock-1/events");
    EXPECT_EQ(first.payload, events.items()[0].payload);
    EXPECT_EQ(first.content_type, "application/json");
    EXPECT_FALSE(first.retained);
    EXPECT_EQ(listener.wait_for("gantry/site-7/bridge/events").payload, "{}");
    EXPECT_EQ(listener.wait_for("gantry/site-7/a%2F%23%2F%2B%2F%24SYS/events").payload, R"({"a":1})");
}

TEST_F(MqttBroker, ArraysHoldManyEvents) {
    auto sink =
        make(url_of(server.port()), {{"array", "true"}, {"array_size", "40"}, {"base", "plant/rfid"}}, host);
    LentEvents events(100);
    EXPECT_EQ(count(sink->deliver(events.items(), patience(20s)), Fate::accepted), 100u);
    std::vector<std::size_t> sizes;
    std::vector<std::string> ids;
    ASSERT_TRUE(eventually([&] {
        sizes.clear();
        ids.clear();
        for (auto& each : listener.all()) {
            if (each.topic != "plant/rfid/dock-1/events") continue;
            auto array = boost::json::parse(each.payload).as_array();
            sizes.push_back(array.size());
            for (auto& event : array)
                ids.emplace_back(event.at("id").as_string());
        }
        return ids.size() >= 100;
    }));
    EXPECT_EQ(sizes, (std::vector<std::size_t>{40, 40, 20}));
    EXPECT_EQ(ids, events.ids());
}

TEST_F(MqttBroker, StateIsRetainedAndSaysGoodbye) {
    for (auto* version : {"5", "3.1.1"}) {
        host.set({dock});
        auto sink = make(url_of(server.port()), {{"version", version}}, host);
        ASSERT_EQ(sink->deliver({}, patience(20s)).trouble, "");
        Listener late(server.port());
        late.start();
        late.wait_for("gantry/site-7/bridge/state", [](auto& each) { return each.payload == "online"; });
        auto status = late.wait_for("gantry/site-7/dock-1/status",
                                    [](auto& each) { return each.payload == status_payload(dock); });
        EXPECT_TRUE(status.retained);
        auto gone = dock;
        gone.connected = false;
        host.set({gone});
        EXPECT_TRUE(
            idle_until(*sink, [&] { return heard("gantry/site-7/dock-1/status", status_payload(gone)); }));
        sink.reset();
        EXPECT_EQ(
            late.wait_for("gantry/site-7/bridge/state", [](auto& each) { return each.payload == "offline"; })
                .payload,
            "offline");
    }
}

TEST_F(MqttBroker, ALostConnectionIsSeenByTheWillAndComesBack) {
    testkit::FaultProxy proxy(server.port());
    auto sink = make(url_of(proxy.port()), {}, host);
    ASSERT_EQ(sink->deliver({}, patience(20s)).trouble, "");
    listener.wait_for("gantry/site-7/bridge/state", [](auto& each) { return each.payload == "online"; });
    proxy.end_all(testkit::Faults::Ending::reset);
    listener.wait_for("gantry/site-7/bridge/state", [](auto& each) { return each.payload == "offline"; });
    LentEvents events(5);
    auto delivered = [&] { return count(sink->deliver(events.items(), patience(20s)), Fate::accepted) == 5; };
    EXPECT_TRUE(eventually(delivered));
    listener.wait_for("gantry/site-7/bridge/state", [](auto& each) { return each.payload == "online"; });
}

TEST_F(MqttBroker, WithoutEventsTheConnectionComesBackToo) {
    auto sink = make(url_of(server.port()), {}, host);
    sink->idle(patience(20s));
    EXPECT_TRUE(sink->connected()) << "people look at the state, whether or not there are events";
}

TEST_F(MqttBroker, ReadersThatAreNoMoreAndThoseOfAnEarlierGateway) {
    listener.publish("gantry/site-7/gate-3/status", status_payload(dock), true);
    listener.wait_for("gantry/site-7/gate-3/status");
    host.set({dock});
    auto sink = make(url_of(server.port()), {}, host);
    EXPECT_TRUE(idle_until(*sink, [&] {
        return listener.wait_for("gantry/site-7/gate-3/status").payload.find("not seen since") !=
               std::string::npos;
    })) << "it was left online";
    host.set({});
    EXPECT_TRUE(idle_until(*sink, [&] { return heard("gantry/site-7/dock-1/status", ""); }));
}

TEST_F(MqttBroker, HomeAssistantFindsReaders) {
    host.set({dock});
    auto sink = make(url_of(server.port()), {{"home_assistant", "true"}}, host);
    ASSERT_EQ(sink->deliver({}, patience(20s)).trouble, "");
    Listener late(server.port());
    late.start();
    auto sensor = late.wait_for("homeassistant/binary_sensor/gantry_site-7__dock-1/connection/config");
    EXPECT_TRUE(sensor.retained);
    EXPECT_EQ(boost::json::parse(sensor.payload).at("state_topic"), "gantry/site-7/dock-1/status");
    auto scanner = late.wait_for("homeassistant/tag/gantry_site-7__dock-1/config");
    EXPECT_EQ(boost::json::parse(scanner.payload).at("topic"), "gantry/site-7/dock-1/events");
}

TEST_F(MqttBroker, RequestsComeInAndAreAnswered) {
    for (auto* version : {"5", "3.1.1"}) {
        auto sink = make(url_of(server.port()), {{"version", version}, {"base", std::string("b") + version}},
                         host, true);
        auto base = std::string("b") + version;
        ASSERT_EQ(sink->deliver({}, patience(20s)).trouble, "");
        std::string answered;
        EXPECT_TRUE(idle_until(*sink, [&] {
            listener.publish(base + "/request/reader.list", R"({"id":"q1","n":1})");
            for (auto& each : listener.all())
                if (each.topic == base + "/response/reader.list") answered = each.payload;
            return !answered.empty();
        }));
        auto answer = boost::json::parse(answered).as_object();
        EXPECT_EQ(answer.at("id"), "q1");
        EXPECT_EQ(answer.at("data").at("operation"), "reader.list");
        EXPECT_EQ(answer.at("data").at("body").at("n"), 1);
    }
}

TEST_F(MqttBroker, AnswersGoToTheResponseTopicWithTheCorrelation) {
    auto sink = make(url_of(server.port()), {}, host, true);
    ASSERT_EQ(sink->deliver({}, patience(20s)).trouble, "");
    listener.publish("gantry/site-7/request/x", "{}", false, "me/answers", "c-1");
    auto found = [&] {
        auto all = listener.all();
        auto it = std::ranges::find(all, "me/answers", &Heard::topic);
        return it != all.end() && it->correlation == "c-1";
    };
    EXPECT_TRUE(idle_until(*sink, found));
}

TEST_F(MqttBroker, RetainedRequestsAreNotRun) {
    log::Capture capture;
    listener.publish("gantry/site-7/request/tag.kill", "{}", true);
    listener.wait_for("gantry/site-7/request/tag.kill");
    auto sink = make(url_of(server.port()), {}, host, true);
    std::string said;
    EXPECT_TRUE(idle_until(
        *sink, [&] { return (said += capture.take()).find("retained request") != std::string::npos; }));
    for (auto& each : listener.all())
        EXPECT_FALSE(each.topic.starts_with("gantry/site-7/response")) << each.payload;
}

TEST_F(MqttBroker, WithoutPermissionNoRequestIsHeard) {
    auto sink = make(url_of(server.port()), {}, host, false);
    ASSERT_EQ(sink->deliver({}, patience(20s)).trouble, "");
    listener.publish("gantry/site-7/request/tag.kill", "{}");
    listener.wait_for("gantry/site-7/request/tag.kill");
    LentEvents events(1);
    EXPECT_EQ(count(sink->deliver(events.items(), patience(20s)), Fate::accepted), 1u);
    sink->idle(patience(1s));
    listener.wait_for("gantry/site-7/dock-1/events");
    for (auto& each : listener.all())
        EXPECT_FALSE(each.topic.starts_with("gantry/site-7/response")) << each.payload;
}

TEST_F(MqttBroker, ABrokerThatStandsStillCostsPatienceAndNoEvent) {
    auto sink = make(url_of(server.port()), {}, host);
    ASSERT_EQ(sink->deliver({}, patience(20s)).trouble, "");
    server.pause();
    LentEvents events(50);
    auto start = std::chrono::steady_clock::now();
    EXPECT_EQ(count(sink->deliver(events.items(), patience(300ms)), Fate::kept), 50u);
    std::stop_source stop;
    std::jthread stopper([&] { stop.request_stop(); });
    auto outcome = sink->deliver(events.items(), {.until = start + 10min, .stop = stop.get_token()});
    EXPECT_EQ(count(outcome, Fate::kept), 50u);
    EXPECT_FALSE(outcome.trouble.empty());
    EXPECT_LT(std::chrono::steady_clock::now() - start, 1min);
    server.resume();
    EXPECT_TRUE(eventually(
        [&] { return count(sink->deliver(events.items(), patience(20s)), Fate::accepted) == 50; }));
}

TEST_F(MqttBroker, BytesMayComeOneByOneAndLate) {
    testkit::FaultProxy proxy(server.port());
    testkit::Faults out, back;
    out.segment = 1;
    back.delay = 5ms;
    back.segment = 1;
    proxy.set(out, back);
    auto sink = make(url_of(proxy.port()), {}, host);
    LentEvents events(20);
    EXPECT_EQ(count(sink->deliver(events.items(), patience(60s)), Fate::accepted), 20u);
}

TEST(MqttTls, WorksWithAnAuthorityOfOnesOwnAndNotWithout) {
    testkit::Certificates certificates;
    certificates.issue("broker", "IP:127.0.0.1,DNS:localhost");
    certificates.issue("other", "DNS:other.example");
    certificates.issue("client", "DNS:gateway");
    auto listen = [&](const std::string& name, const std::string& more) {
        return "allow_anonymous true\n" + fmt::format("cafile {}\ncertfile {}\nkeyfile {}\n{}",
                                                      certificates.ca(), certificates.file(name + ".pem"),
                                                      certificates.file(name + ".key"), more);
    };
    MosquittoServer broker(listen("broker", "")), other(listen("other", "")),
        strict(listen("broker", "require_certificate true\n"));
    for (auto* server : {&broker, &other, &strict})
        server->start();
    SomeHost host;
    LentEvents events(200);
    auto accepted = [&](const MosquittoServer& server, const Given& given,
                        std::string_view name = "127.0.0.1") {
        auto sink = make(fmt::format("mqtts://{}:{}", name, server.port()), given, host);
        auto outcome = sink->deliver(events.items(), patience(10s));
        return std::pair{count(outcome, Fate::accepted), outcome.trouble};
    };
    std::pair<std::string, std::string> ca = {"tls_ca", certificates.ca()}, old = {"version", "3.1.1"};
    EXPECT_EQ(accepted(broker, {ca}), std::pair(std::size_t{200}, std::string{}));
    EXPECT_EQ(accepted(broker, {ca, old}, "localhost"), std::pair(std::size_t{200}, std::string{}));
    auto [none, trouble] = accepted(broker, {});
    EXPECT_EQ(none, 0u) << "nobody vouches for it";
    EXPECT_NE(trouble.find("certificate verify failed"), std::string::npos) << trouble;
    std::tie(none, trouble) = accepted(other, {ca});
    EXPECT_EQ(none, 0u) << "the certificate is another's";
    EXPECT_NE(trouble.find("TLS failed"), std::string::npos) << trouble;
    log::Capture capture;
    EXPECT_EQ(accepted(other, {{"tls_insecure", "true"}}).first, 200u);
    EXPECT_NE(capture.take().find("tls_insecure"), std::string::npos);
    EXPECT_EQ(accepted(strict, {ca}).first, 0u);
    setenv("SSL_CERT_FILE", certificates.ca().c_str(), 1);  // where the system's authorities are
    EXPECT_EQ(accepted(broker, {}).first, 200u);
    unsetenv("SSL_CERT_FILE");
    EXPECT_EQ(accepted(strict, {ca,
                                {"tls_cert", certificates.file("client.pem")},
                                {"tls_key", certificates.file("client.key")}})
                  .first,
              200u);
}

TEST(MqttKind, SettingsThatContradictEachOther) {
    SomeHost host;
    auto refused = [&](const std::string& url, const Given& given) {
        auto made = try_make(url, given, host);
        return made ? std::string{} : made.error().text();
    };
    EXPECT_EQ(refused("mqtt://localhost", {}), "");
    EXPECT_NE(refused("mqtt://joe:pw@host", {}).find("password_file"), std::string::npos);
    EXPECT_NE(refused("mqtt://h", {{"base", "a/#"}}).find("a/#"), std::string::npos);
    EXPECT_NE(refused("mqtt://h", {{"tls_ca", "/etc/passwd"}}).find("mqtts://"), std::string::npos);
    EXPECT_NE(refused("mqtts://h", {{"tls_ca", "/no/such/file"}}).find("cannot be read"), std::string::npos);
    EXPECT_NE(refused("mqtts://h", {{"tls_cert", "/etc/passwd"}}).find("tls_key"), std::string::npos);
    EXPECT_NE(refused("mqtt://h", {{"password", "s3cret"}}).find("user"), std::string::npos);
    EXPECT_NE(refused("mqtt://h", {{"home_assistant", "true"}, {"array", "true"}}).find("array"),
              std::string::npos);
    EXPECT_NE(refused("mqtt://h", {{"home_assistant", "true"}, {"status", "false"}}).find("status"),
              std::string::npos);
    EXPECT_NE(refused("mqtt://h", {{"client_id", "a\nb"}}).find("client_id"), std::string::npos);
    EXPECT_NE(refused("mqtt://h", {{"version", "4"}}).find("3.1.1"), std::string::npos);
}

TEST(MqttKind, APlainConnectionBeyondThisMachineIsWarnedOfOnce) {
    SomeHost host;
    log::Capture capture;
    make("mqtt://broker.example", {{"user", "u"}, {"password", "p"}}, host);
    auto said = capture.take();
    EXPECT_NE(said.find("unencrypted"), std::string::npos) << said;
    EXPECT_NE(said.find("the password"), std::string::npos) << said;
    make("mqtt://127.0.0.1", {}, host);
    EXPECT_EQ(capture.take(), "");
}

TEST(MqttKind, NobodyThere) {
    SomeHost host;
    auto sink = make(url_of(free_port()), {}, host);
    LentEvents events(2);
    auto outcome = sink->deliver(events.items(), patience(20s));
    EXPECT_EQ(count(outcome, Fate::kept), 2u);
    EXPECT_NE(outcome.trouble.find("refused"), std::string::npos) << outcome.trouble;
    sink = make("mqtt://no-such-host.invalid", {}, host);
    outcome = sink->deliver(events.items(), patience(20s));
    EXPECT_EQ(count(outcome, Fate::kept), 2u);
    EXPECT_NE(outcome.trouble.find("no-such-host.invalid"), std::string::npos) << outcome.trouble;
}

}  // namespace gantry::sinks::mqtt::tests
