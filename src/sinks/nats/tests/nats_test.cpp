// The sink at a real server: streams, rights, limits, faults.
#include <cstdlib>
#include <filesystem>
#include <set>
#include <thread>

#include "base/log.hpp"
#include "nats_server.hpp"
#include "sinks/nats/connection.hpp"
#include "testkit/certificates.hpp"
#include "testkit/fault_proxy.hpp"
#include "testkit/peer.hpp"

namespace gantry::sinks::nats::tests {

using sink::Fate;
using testkit::LentEvents;
using testkit::patience;

class NatsStream : public testing::Test {
protected:
    NatsServer server;
    std::optional<Client> client;
    void SetUp() override {
        server.start();
        client.emplace(server.port());
    }
    // The trouble that a batch meets, none of which is delivered.
    std::string trouble(const Given& given = {}) {
        LentEvents events(5);
        auto outcome = make(url_of(server.port()), given)->deliver(events.items(), patience(20s));
        EXPECT_EQ(count(outcome, Fate::kept), 5u);
        return outcome.trouble;
    }
};

TEST_F(NatsStream, IsMadeWithAWindowForDoubles) {
    auto sink = make(url_of(server.port()), {{"max_age", "2d"}});
    ASSERT_EQ(sink->deliver({}, patience(20s)).trouble, "");
    auto made = client->stream("GANTRY");
    ASSERT_TRUE(made);
    EXPECT_EQ(made->window, 1h);
    EXPECT_EQ(made->max_age, 48h);
    EXPECT_EQ(made->subjects, std::vector<std::string>{"gantry.>"});
    LentEvents events(1);
    event::Event of_gateway = *events.items()[0].event;
    of_gateway.reader.clear();
    event::Event hostile = of_gateway;
    hostile.reader = "x.*.> y";
    std::vector<sink::Item> items = {
        events.items()[0], {&of_gateway, "x:2", "{}"}, {&hostile, "x:3", R"({"a":1})"}};
    EXPECT_EQ(count(sink->deliver(items, patience(20s)), Fate::accepted), 3u);
    auto first = client->message("GANTRY", 1).value();
    EXPECT_EQ(first.subject, "gantry.site-7.dock-1.events");
    EXPECT_EQ(first.id, "suite:1");
    EXPECT_EQ(first.payload, events.items()[0].payload);
    EXPECT_EQ(client->message("GANTRY", 2).value().subject, "gantry.site-7.bridge.events");
    EXPECT_EQ(client->message("GANTRY", 3).value().subject, "gantry.site-7.x%2E%2A%2E%3E%20y.events");
}

TEST_F(NatsStream, ThatIsThereIsCheckedAndLeftAsItIs) {
    client->add("SHORT", "gantry.>",
                [](jsStreamConfig& config) { config.Duplicates = std::chrono::nanoseconds(2min).count(); });
    auto why = trouble({{"stream", "SHORT"}});
    EXPECT_NE(why.find("drops doubles for 2min only; nats stream edit SHORT --dupe-window=3600s"),
              std::string::npos)
        << why;
    EXPECT_EQ(client->stream("SHORT").value().window, 2min);
    why = trouble();
    EXPECT_NE(why.find("cannot be made"), std::string::npos) << why;
    EXPECT_NE(why.find("another stream takes these subjects"), std::string::npos) << why;
    client->add("OTHER", "other.>", [](jsStreamConfig&) {});
    why = trouble({{"stream", "OTHER"}});
    EXPECT_NE(why.find("does not take gantry.site-7.*.events"), std::string::npos) << why;
    EXPECT_EQ(client->stream("OTHER").value().last, 0u);
    client->add("SILENT", "silent.>", [](jsStreamConfig& config) { config.NoAck = true; });
    why = trouble({{"stream", "SILENT"}, {"prefix", "silent"}});
    EXPECT_NE(why.find("confirms nothing"), std::string::npos) << why;
    why = trouble({{"stream", "OTHER"}, {"prefix", "other"}, {"replicas", "3"}});
    EXPECT_NE(why.find("has 1 replicas, not 3"), std::string::npos) << why;
}

TEST_F(NatsStream, ThatIsFullKeepsTheEvents) {
    client->add("GANTRY", "gantry.>", [](jsStreamConfig& config) {
        config.MaxMsgs = 3;
        config.Discard = js_DiscardNew;
    });
    LentEvents events(5);
    auto sink = make(url_of(server.port()));
    auto outcome = sink->deliver(events.items(), patience(20s));
    EXPECT_EQ(outcome.fates,
              (std::vector{Fate::accepted, Fate::accepted, Fate::accepted, Fate::kept, Fate::kept}));
    EXPECT_NE(outcome.trouble.find("maximum messages exceeded"), std::string::npos) << outcome.trouble;
    EXPECT_TRUE(sink->connected());
}

TEST_F(NatsStream, ThatGoesAwayWhileWeAreConnectedKeepsTheEvents) {
    auto sink = make(url_of(server.port()));
    ASSERT_EQ(sink->deliver({}, patience(20s)).trouble, "");
    client->remove("GANTRY");
    LentEvents events(5);
    auto outcome = sink->deliver(events.items(), patience(20s));
    EXPECT_EQ(count(outcome, Fate::kept), 5u);
    EXPECT_NE(outcome.trouble.find("no stream"), std::string::npos) << outcome.trouble;
    client->add("ELSE", "gantry.>", [](jsStreamConfig&) {});
    outcome = sink->deliver(events.items(), patience(20s));
    EXPECT_EQ(count(outcome, Fate::kept), 5u) << "another stream is not ours";
    EXPECT_NE(outcome.trouble.find("expected stream does not match"), std::string::npos) << outcome.trouble;
}

TEST_F(NatsStream, AServerThatStandsStillCostsPatienceAndNoEvent) {
    auto sink = make(url_of(server.port()));
    ASSERT_EQ(sink->deliver({}, patience(20s)).trouble, "");
    server.pause();
    LentEvents events(500);
    auto start = std::chrono::steady_clock::now();
    EXPECT_EQ(count(sink->deliver(events.items(), patience(300ms)), Fate::kept), 500u);
    std::stop_source stop;
    std::jthread stopper([&] { stop.request_stop(); });
    auto outcome = sink->deliver(events.items(), {.until = start + 10min, .stop = stop.get_token()});
    EXPECT_EQ(count(outcome, Fate::kept), 500u);
    EXPECT_FALSE(outcome.trouble.empty());
    EXPECT_LT(std::chrono::steady_clock::now() - start, 1min);
    server.resume();
    EXPECT_TRUE(eventually(
        [&] { return count(sink->deliver(events.items(), patience(20s)), Fate::accepted) == 500; }));
    EXPECT_EQ(client->stream("GANTRY").value().last, 500u) << "what came twice is there once";
}

// Answers come on the library's own threads: one that comes between the last look and the end of a batch must
// not be there when the next batch, with other numbers, looks.
TEST_F(NatsStream, AConnectionWithAnAnswerThatNobodyTookIsNotSettled) {
    Access access;
    access.servers = {sink::parse_server(fmt::format("127.0.0.1:{}", server.port()), 4222).value()};
    access.name = "gantry";
    access.stream = {.name = "GANTRY",
                     .subjects = {"gantry.>"},
                     .wanted = "gantry.site-7.*.events",
                     .duplicate_window = 1h,
                     .max_age = 0s};
    auto connection = Connection::open(access).value();
    EXPECT_TRUE(connection->settled());
    std::string refusal;
    ASSERT_EQ(connection->publish("gantry.site-7.dock-1.events", "x:1", "{}", 99, refusal),
              Connection::Handed::sent);
    EXPECT_FALSE(connection->settled());
    ASSERT_TRUE(eventually([&] { return connection->in_flight() == 0; }));
    EXPECT_FALSE(connection->settled());
    auto answers = connection->answers(0ms);
    ASSERT_EQ(answers.size(), 1u);
    EXPECT_EQ(answers[0].item, 99u);
    EXPECT_TRUE(connection->settled());
}

TEST_F(NatsStream, PatienceThatEndsAmongTheAnswersMovesThemToNoOtherBatch) {
    auto sink = make(url_of(server.port()));
    ASSERT_EQ(sink->deliver({}, patience(20s)).trouble, "");
    std::vector<std::string> accepted;
    for (unsigned i = 0; i < 100; ++i) {
        LentEvents events(i % 2 == 0 ? 60 : 3, 1 + 100 * i);
        auto outcome = sink->deliver(events.items(), patience(std::chrono::milliseconds(i % 6)));
        for (std::size_t item = 0; item < outcome.fates.size(); ++item)
            if (outcome.fates[item] == Fate::accepted) accepted.emplace_back(events.items()[item].id);
    }
    auto last = client->stream("GANTRY").value().last;
    std::set<std::string> there;
    for (std::uint64_t seq = 1; seq <= last; ++seq)
        there.insert(client->message("GANTRY", seq).value().id);
    for (auto& id : accepted)
        EXPECT_TRUE(there.contains(id)) << id << " was accepted and is not there";
}

TEST_F(NatsStream, ALostConnectionIsMadeAgain) {
    testkit::FaultProxy proxy(server.port());
    // Not byte by byte to the client: libnats 3.4 does not see the end of the first line when CR and LF come
    // apart.
    testkit::Faults out, back;
    out.segment = 7;
    back.delay = 5ms;
    proxy.set(out, back);
    auto sink = make(url_of(proxy.port()));
    LentEvents first(50), second(50, 51);
    auto outcome = sink->deliver(first.items(), patience(30s));
    EXPECT_EQ(count(outcome, Fate::accepted), 50u) << outcome.trouble;
    proxy.end_all(testkit::Faults::Ending::reset);
    EXPECT_TRUE(eventually(
        [&] { return count(sink->deliver(second.items(), patience(20s)), Fate::accepted) == 50; }));
    EXPECT_EQ(client->stream("GANTRY").value().last, 100u);
}

TEST(NatsRights, UserPasswordAndToken) {
    NatsServer with_user("authorization { user: joe, password: right }\n");
    with_user.start("joe", "right");
    NatsServer with_token("authorization { token: tok3n }\n");
    with_token.launch();
    LentEvents events(3);
    log::Capture capture;
    auto deliver = [&](NatsServer& server, const Given& given) {
        return make(url_of(server.port()), given)->deliver(events.items(), patience(20s));
    };
    EXPECT_EQ(count(deliver(with_user, {{"user", "joe"}, {"password", "right"}}), Fate::accepted), 3u);
    auto outcome = deliver(with_user, {{"user", "joe"}, {"password", "s3cret"}});
    EXPECT_EQ(count(outcome, Fate::kept), 3u);
    EXPECT_NE(outcome.trouble.find("Authorization Violation"), std::string::npos) << outcome.trouble;
    EXPECT_NE(outcome.trouble.find("password_file"), std::string::npos) << outcome.trouble;
    EXPECT_EQ((outcome.trouble + capture.take()).find("s3cret"), std::string::npos);
    EXPECT_TRUE(eventually([&] {
        return count(deliver(with_token, {{"token", "tok3n"}}), Fate::accepted) == 3;
    }));
    EXPECT_EQ(count(deliver(with_token, {{"token", "wrong"}}), Fate::kept), 3u);
}

TEST(NatsRights, CredentialsOfAUser) {
    testkit::TempDir dir;
    testkit::Process maker({"/usr/bin/python3", "-B",
                            GANTRY_SOURCE_DIR "/src/sinks/nats/tests/make_credentials.py", dir.path()});
    ASSERT_EQ(maker.wait(), 0);
    NatsServer server("include \"operator.conf\"\n");
    std::filesystem::copy_file(dir.path() + "/operator.conf", server.dir() + "/operator.conf");
    server.launch();
    LentEvents events(3);
    auto sink = make(url_of(server.port()), {{"credentials", dir.path() + "/user.creds"}});
    EXPECT_TRUE(
        eventually([&] { return count(sink->deliver(events.items(), patience(20s)), Fate::accepted) == 3; }));
    auto outcome = make(url_of(server.port()))->deliver(events.items(), patience(20s));
    EXPECT_NE(outcome.trouble.find("Authorization Violation"), std::string::npos) << outcome.trouble;
}

TEST(NatsRights, SubjectsThatWeMayNotPublishToAreNamedAtOnce) {
    NatsServer server(
        "authorization { users: [ { user: joe, password: p, permissions: { publish: { allow: [\"$JS.>\"] } } "
        "} ] }\n");
    server.start("joe", "p");
    LentEvents events(3);
    auto start = std::chrono::steady_clock::now();
    auto outcome = make(url_of(server.port()), {{"user", "joe"}, {"password", "p"}})
                       ->deliver(events.items(), patience(10min));
    EXPECT_EQ(count(outcome, Fate::kept), 3u);
    EXPECT_NE(outcome.trouble.find("gantry.site-7.dock-1.events"), std::string::npos) << outcome.trouble;
    EXPECT_LT(std::chrono::steady_clock::now() - start, 5min)
        << "the server said it, so nobody waits for more";
}

TEST(NatsRights, AServerWithoutJetStream) {
    testkit::TempDir dir;
    auto port = free_port();
    testkit::Process process({"/usr/sbin/nats-server", "-a", "127.0.0.1", "-p", std::to_string(port)}, {},
                             dir.path() + "/log");
    LentEvents events(1);
    sink::Outcome outcome;
    EXPECT_TRUE(eventually([&] {
        outcome = make(url_of(port))->deliver(events.items(), patience(20s));
        return outcome.trouble.find("no JetStream") != std::string::npos;
    })) << outcome.trouble;
}

TEST(NatsRights, MessagesLargerThanTheServerTakesAreRejected) {
    NatsServer server("max_payload: 1000\n");
    server.start();
    LentEvents events(3);
    std::vector<sink::Item> items(events.items().begin(), events.items().end());
    std::string large(2000, 'x');
    items[1].payload = large;
    auto outcome = make(url_of(server.port()))->deliver(items, patience(20s));
    EXPECT_EQ(outcome.fates, (std::vector{Fate::accepted, Fate::rejected, Fate::accepted}));
    ASSERT_EQ(outcome.reasons.size(), 1u);
    EXPECT_EQ(outcome.reasons[0].item, 1u);
    EXPECT_NE(outcome.reasons[0].text.find("2000 bytes are more than the 1000"), std::string::npos)
        << outcome.reasons[0].text;
}

TEST(NatsTls, WorksWithAnAuthorityOfOnesOwnAndNotWithout) {
    testkit::Certificates certificates;
    certificates.issue("server", "IP:127.0.0.1,DNS:localhost");
    certificates.issue("other", "DNS:other.example");
    certificates.issue("client", "DNS:gateway");
    auto listen = [&](const std::string& name, const std::string& more) {
        return fmt::format("tls {{ cert_file: \"{}\", key_file: \"{}\", ca_file: \"{}\", {} }}\n",
                           certificates.file(name + ".pem"), certificates.file(name + ".key"),
                           certificates.ca(), more);
    };
    NatsServer server(listen("server", "")), other(listen("other", "")),
        strict(listen("server", "verify: true"));
    for (auto* each : {&server, &other, &strict})
        each->launch();
    LentEvents events(100);
    auto deliver = [&](const NatsServer& to, const Given& given, std::string_view name = "127.0.0.1") {
        return make(fmt::format("tls://{}:{}", name, to.port()), given)
            ->deliver(events.items(), patience(20s));
    };
    std::pair<std::string, std::string> ca = {"tls_ca", certificates.ca()};
    Given with_certificate = {
        ca, {"tls_cert", certificates.file("client.pem")}, {"tls_key", certificates.file("client.key")}};
    auto works = [&](const NatsServer& to, const Given& given, std::string_view name = "127.0.0.1") {
        sink::Outcome outcome;
        return eventually([&] { return count(outcome = deliver(to, given, name), Fate::accepted) == 100; })
                   ? std::string{}
                   : outcome.trouble;
    };
    log::Capture capture;
    EXPECT_EQ(works(server, {ca}), "");
    EXPECT_EQ(works(server, {ca}, "localhost"), "");
    EXPECT_EQ(works(strict, with_certificate), "");
    EXPECT_EQ(works(other, {{"tls_insecure", "true"}}), "");
    EXPECT_NE(capture.take().find("tls_insecure"), std::string::npos);
    auto outcome = deliver(server, {});
    EXPECT_EQ(count(outcome, Fate::kept), 100u) << "nobody vouches for it";
    EXPECT_NE(outcome.trouble.find("certificate"), std::string::npos) << outcome.trouble;
    outcome = deliver(other, {ca});
    EXPECT_EQ(count(outcome, Fate::kept), 100u) << "the certificate is another's";
    EXPECT_NE(outcome.trouble.find("mismatch"), std::string::npos) << outcome.trouble;
    EXPECT_EQ(count(deliver(strict, {ca}), Fate::kept), 100u) << "without our certificate";
    setenv("SSL_CERT_FILE", certificates.ca().c_str(), 1);  // where the system's authorities are
    EXPECT_EQ(count(deliver(server, {}), Fate::accepted), 100u);
    unsetenv("SSL_CERT_FILE");
}

// The library's handshake has no time-out of its own.
TEST(NatsTls, AHandshakeWithoutEndHoldsNobody) {
    int listener = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    ASSERT_EQ(bind(listener, reinterpret_cast<sockaddr*>(&address), size), 0);
    ASSERT_EQ(listen(listener, 1), 0);
    getsockname(listener, reinterpret_cast<sockaddr*>(&address), &size);
    std::optional<testkit::Peer> silent;
    std::jthread server([&] {
        silent.emplace(accept(listener, nullptr, nullptr));
        silent->send(
            "INFO "
            "{\"server_id\":\"x\",\"version\":\"2.9.10\",\"proto\":1,\"headers\":true,\"max_payload\":"
            "1000000,"
            "\"tls_required\":true}\r\n");
    });
    auto start = std::chrono::steady_clock::now();
    {
        auto sink = make(fmt::format("tls://127.0.0.1:{}", ntohs(address.sin_port)));
        LentEvents events(2);
        for (int i = 0; i < 3; ++i) {
            auto outcome = sink->deliver(events.items(), patience(100ms));
            EXPECT_EQ(count(outcome, Fate::kept), 2u);
            EXPECT_NE(outcome.trouble.find("no answer yet"), std::string::npos) << outcome.trouble;
        }
    }
    EXPECT_LT(std::chrono::steady_clock::now() - start, 30s);
    server.join();
    close(listener);
}

TEST(NatsKind, SettingsThatContradictEachOther) {
    auto refused = [&](const std::string& url, const Given& given) {
        auto made = try_make(url, given);
        return made ? std::string{} : made.error().text();
    };
    EXPECT_EQ(refused("nats://localhost", {{"servers", "localhost:4223, [::1]:4224"}}), "");
    EXPECT_NE(refused("nats://joe:pw@host", {}).find("password_file"), std::string::npos);
    EXPECT_NE(refused("nats://h", {{"prefix", "a.*"}}).find("a.*"), std::string::npos);
    EXPECT_NE(refused("nats://h", {{"stream", "a.b"}}).find("a.b"), std::string::npos);
    EXPECT_NE(refused("nats://h", {{"subjects", "other.>"}}).find("gantry.site-7.*.events"),
              std::string::npos);
    EXPECT_NE(refused("nats://h", {{"servers", "a,,b"}}).find("no server"), std::string::npos);
    EXPECT_NE(refused("nats://h", {{"duplicate_window", "2min"}}).find("duplicate_window"),
              std::string::npos);
    EXPECT_NE(refused("nats://h", {{"max_age", "30min"}}).find("max_age"), std::string::npos);
    EXPECT_NE(refused("nats://h", {{"token", "t"}, {"user", "u"}}).find("one of them"), std::string::npos);
    EXPECT_NE(refused("nats://h", {{"password", "p"}}).find("user"), std::string::npos);
    EXPECT_NE(refused("nats://h", {{"credentials", "/no/such/file"}}).find("cannot be read"),
              std::string::npos);
    EXPECT_NE(refused("nats://h", {{"tls_ca", "/etc/passwd"}}).find("tls://"), std::string::npos);
    EXPECT_NE(refused("tls://h", {{"tls_key", "/etc/passwd"}}).find("tls_cert"), std::string::npos);
}

TEST(NatsKind, APlainConnectionBeyondThisMachineIsWarnedOfOnce) {
    log::Capture capture;
    make("nats://localhost", {{"servers", "a.example, b.example"}, {"token", "t"}});
    auto said = capture.take();
    EXPECT_NE(said.find("a.example:4222 unencrypted"), std::string::npos) << said;
    EXPECT_EQ(said.find("b.example"), std::string::npos) << said;
}

}  // namespace gantry::sinks::nats::tests
