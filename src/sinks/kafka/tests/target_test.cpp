#include "cluster.hpp"
#include "sinks/kafka/verdict.hpp"

namespace gantry::sinks::kafka::tests {
namespace {

Result<Target> target(const std::string& url, const Given& given = {}) {
    auto settings = Settings::make(kind.settings, given);
    if (!settings) return tl::unexpected(settings.error());
    return make_target({.name = "k", .gateway_id = "suite", .url = url, .settings = *settings, .batch = 10});
}
std::string word(const Result<Target>& made, const std::string& name) {
    if (!made) return made.error().text();
    for (auto& [each, value] : made->words)
        if (each == name) return value;
    return {};
}

void expect_refused(const Result<Target>& made, std::string_view why) {
    ASSERT_FALSE(made) << why;
    EXPECT_NE(made.error().text().find(why), std::string::npos) << made.error().text();
    EXPECT_EQ(made.error().text().find("hunter2"), std::string::npos) << made.error().text();
}

TEST(KafkaTarget, AUrlNamesBrokers) {
    EXPECT_EQ(word(target("kafka://a.example"), "bootstrap.servers"), "a.example:9092");
    EXPECT_EQ(word(target("kafkas://a.example,b.example:1234/"), "bootstrap.servers"),
              "a.example:9093,b.example:1234");
    EXPECT_EQ(word(target("kafka://[::1]:19092,127.0.0.1"), "bootstrap.servers"),
              "[::1]:19092,127.0.0.1:9092");
    for (auto* url : {"kafka://", "kafka://a:b", "kafka://a:", "kafka://:9092", "kafka://a,,b", "kafka://a b",
                      "a:9092", "http://a:9092", "kafka:/a"})
        expect_refused(target(url), "kafkas://");
    expect_refused(target("kafka://u:hunter2@a:9092"), "password_file");
    expect_refused(target("kafka://a:9092/topic"), "says more than brokers");
    expect_refused(target("kafka://a:9092?sasl.password=hunter2"), "says more than brokers");
}

TEST(KafkaTarget, TopicsAreCheckedAsKafkaDoes) {
    for (auto* topic : {"", ".", "..", "a b", "a/b", "a\nb", "\xC3\xA4"})
        expect_refused(target("kafka://a", {{"topic", topic}}), "is no name");
    EXPECT_TRUE(target("kafka://a", {{"topic", "rfid.site-7_Events"}}));
}

TEST(KafkaTarget, SecuritySettingsBecomeWordsOfLibrdkafkaOrAreRefused) {
    Given login = {{"sasl", "scram-sha-512"}, {"user", "u"}, {"password", "hunter2"}};
    EXPECT_EQ(word(target("kafka://127.0.0.1"), "security.protocol"), "plaintext");
    EXPECT_EQ(word(target("kafkas://a"), "security.protocol"), "ssl");
    EXPECT_EQ(word(target("kafka://127.0.0.1", login), "security.protocol"), "sasl_plaintext");
    EXPECT_EQ(word(target("kafkas://a", login), "security.protocol"), "sasl_ssl");
    EXPECT_EQ(word(target("kafkas://a", login), "sasl.mechanism"), "SCRAM-SHA-512");
    EXPECT_EQ(word(target("kafkas://a", {{"tls_insecure", "true"}}), "enable.ssl.certificate.verification"),
              "false");
    EXPECT_EQ(word(target("kafkas://a"), "enable.ssl.certificate.verification"), "")
        << "librdkafka's default: true";
    expect_refused(target("kafkas://a", {{"sasl", "plain"}}), "go together");
    expect_refused(target("kafkas://a", {{"user", "u"}}), "go together");
    expect_refused(target("kafkas://a", {{"password", "hunter2"}}), "go together");
    expect_refused(target("kafkas://a", {{"sasl", "plain"}, {"user", "u"}}), "password_file");
    expect_refused(target("kafkas://a", {{"sasl", "gssapi"}}), "is none of");
    expect_refused(target("kafka://a", {{"tls_ca", "/dev/null"}}), "kafkas://");
    expect_refused(target("kafka://a", {{"tls_insecure", "true"}}), "kafkas://");
    expect_refused(target("kafkas://a", {{"tls_ca", "/nowhere/ca.pem"}}), "cannot read /nowhere/ca.pem");
    expect_refused(target("kafkas://a", {{"tls_cert", "/dev/null"}}), "go together");
}

TEST(KafkaTarget, WhatGoesInTheClearIsSaid) {
    auto clear = target("kafka://a.example", {{"sasl", "plain"}, {"user", "u"}, {"password", "hunter2"}});
    ASSERT_TRUE(clear);
    EXPECT_EQ(clear->warning,
              "events and the password go to a.example:9092 in the clear: kafkas:// is with TLS");
    for (auto* quiet : {"kafka://localhost", "kafka://127.0.0.1,[::1]", "kafkas://a.example"}) {
        auto made = target(quiet);
        ASSERT_TRUE(made) << quiet;
        EXPECT_EQ(made->warning, "") << quiet;
    }
}

// librdkafka itself reads the words only when a producer is made.
TEST(KafkaTarget, EveryLoginIsOneThatLibrdkafkaKnows) {
    for (auto* sasl : {"plain", "scram-sha-256", "scram-sha-512"})
        for (auto* url : {"kafka://127.0.0.1:1", "kafkas://127.0.0.1:1"}) {
            auto made = target(url, {{"sasl", sasl}, {"user", "u"}, {"password", "hunter2"}});
            ASSERT_TRUE(made) << sasl;
            auto producer = Producer::make(made->words, "t");
            EXPECT_TRUE(producer) << producer.error().text();
        }
}

TEST(KafkaTarget, OnlyErrorsAboutAMessageBlameIt) {
    for (auto* name : {"MSG_SIZE_TOO_LARGE", "INVALID_RECORD", "INVALID_TIMESTAMP"})
        EXPECT_TRUE(blames_the_message(name)) << name;
    for (auto* name : {"", "_MSG_TIMED_OUT", "_PURGE_INFLIGHT", "_FATAL", "NOT_LEADER_FOR_PARTITION",
                       "TOPIC_AUTHORIZATION_FAILED", "OUT_OF_ORDER_SEQUENCE_NUMBER", "INVALID_MSG"})
        EXPECT_FALSE(blames_the_message(name)) << name;
}

TEST(KafkaTarget, TheSampleNamesSettingsThatThereAre) {
    std::string sample(kind.sample_toml);
    for (auto& row : kind.settings)
        if (row.name != "tls_insecure") {
            EXPECT_NE(sample.find(std::string(row.name)), std::string::npos) << row.name;
        }
}

// --- nobody there, or the wrong one ---

TEST(KafkaTrouble, NobodyThereIsSaid) {
    auto sink = make_sink("kafka://127.0.0.1:1");
    ASSERT_TRUE(sink);
    testkit::LentEvents events(2);
    expect_all_kept((*sink)->deliver(events.items(), patience(3s)), "Connection refused");
}

TEST(KafkaTls, TheBrokerMustBeTheRightOneUnlessToldOtherwise) {
    testkit::TempDir dir;
    auto run = [&](const std::string& command) {
        testkit::Process openssl({"/bin/sh", "-c", "cd " + dir.path() + " && openssl " + command});
        ASSERT_EQ(openssl.wait(), 0) << command;
    };
    for (std::string name : {"server", "other"})
        run("req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -days 2 -keyout " + name +
            ".key -out " + name + ".pem -subj /CN=" + name + " -addext subjectAltName=DNS:localhost");
    testkit::LentEvents events(2);
    auto trouble = [&](const std::string& host, const Given& given, const sink::Patience& wait) {
        // It serves one connection after the other, so there is one for each sink.
        testkit::Process server({"/usr/bin/openssl", "s_server", "-accept", "127.0.0.1:0", "-www", "-cert",
                                 dir.path() + "/server.pem", "-key", dir.path() + "/server.key"});
        auto line = server.wait_for_line("ACCEPT ");
        auto port = line.substr(line.rfind(':') + 1);
        auto sink = make_sink("kafkas://" + host + ":" + port, given);
        if (!sink) return sink.error().text();
        auto outcome = (*sink)->deliver(events.items(), wait);
        expect_all_kept(outcome, "");
        return outcome.trouble;
    };
    log::Capture log;
    auto verify = [](const std::string& text) { return text.find("verif") != std::string::npos; };
    auto other = trouble("localhost", {{"tls_ca", dir.path() + "/other.pem"}}, patience(10min));
    EXPECT_TRUE(verify(other)) << other;
    auto system = trouble("localhost", {}, patience(10min));
    EXPECT_TRUE(verify(system)) << system;
    auto name = trouble("127.0.0.1", {{"tls_ca", dir.path() + "/server.pem"}}, patience(10min));
    EXPECT_TRUE(verify(name)) << name;
    EXPECT_EQ(log.take(), "");
    // It is no broker, so there is no answer; but TLS is there.
    auto right = trouble("localhost", {{"tls_ca", dir.path() + "/server.pem"}}, patience(3s));
    EXPECT_FALSE(verify(right)) << right;
    auto any = trouble("127.0.0.1", {{"tls_insecure", "true"}}, patience(3s));
    EXPECT_FALSE(verify(any)) << any;
    EXPECT_NE(log.take().find("tls_insecure"), std::string::npos);
}

}  // namespace
}  // namespace gantry::sinks::kafka::tests
