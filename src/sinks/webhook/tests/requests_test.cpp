#include <cstdlib>
#include <fstream>
#include <regex>

#include "base/log.hpp"
#include "sink/shape.hpp"
#include "sinks/webhook/signature.hpp"
#include "web_server.hpp"

namespace gantry::sinks::webhook {
namespace {

using testkit::LentEvents;
using testkit::patience;
using testkit::write_file;

constexpr auto signing_secret = "0123456789abcdef0123456789abcdef";

TEST(WebhookRequests, ABatchIsAnArrayWithAKeyOfItsOwn) {
    WebServer server;
    server.start();
    auto sink = make_webhook(server.url() + "?site=7");
    LentEvents events(20), others(20, 2);
    for (auto* batch : {&events, &events, &others})
        expect_accepted(sink->deliver(batch->items(), patience(20s)), 20);
    expect_accepted(sink->deliver(events.items().first(1), patience(20s)), 1);
    auto requests = server.requests();
    ASSERT_EQ(requests.size(), 4u);
    EXPECT_EQ(requests[0].at("path"), "/hooks/rfid?site=7");
    EXPECT_EQ(header(requests[0], "Content-Type"), "application/json");
    EXPECT_EQ(header(requests[0], "User-Agent"), "gantry/" GANTRY_VERSION);
    EXPECT_EQ(header(requests[0], "Expect") + header(requests[0], "Authorization") +
                  header(requests[0], "Gantry-Signature") + header(requests[0], "Content-Encoding"),
              "");
    EXPECT_EQ(json::serialize(requests[0].at("first")),
              json::serialize(json::parse(events.items()[0].payload)));
    auto key = header(requests[0], "Idempotency-Key");
    EXPECT_TRUE(std::regex_match(key, std::regex("suite:1\\.\\.suite:20-[0-9a-f]{16}"))) << key;
    EXPECT_EQ(header(requests[1], "Idempotency-Key"), key) << "the same batch, the same key";
    EXPECT_NE(header(requests[2], "Idempotency-Key"), key);
    EXPECT_NE(header(requests[3], "Idempotency-Key"), key);
}

TEST(WebhookRequests, TheKeySaysWhichItemsAndNothingElse) {
    LentEvents events(5);
    auto all = events.items();
    std::vector<sink::Item> without_one(all.begin(), all.end());
    without_one.erase(without_one.begin() + 2);
    EXPECT_NE(idempotency_key(all), idempotency_key(without_one)) << "a filter came between first and last";
    auto changed = std::vector<sink::Item>(all.begin(), all.end());
    changed[1].payload = "{}";
    EXPECT_EQ(idempotency_key(all), idempotency_key(changed));
    changed[0].id = "bad\r\nX-Header: 1";
    EXPECT_TRUE(std::regex_match(idempotency_key(changed), std::regex("[0-9a-f]{64}")));
}

TEST(WebhookRequests, CloudEventsHaveTheirContentType) {
    WebServer server;
    server.start();
    auto sink = make_webhook(server.url());
    LentEvents events(2);
    std::vector<sink::Item> items(events.items().begin(), events.items().end());
    std::vector<std::string> payloads(2);
    for (std::size_t i = 0; i < 2; ++i) {
        sink::append_payload(payloads[i], *items[i].event, "suite:", sink::Shape::cloudevents);
        items[i].payload = payloads[i];
    }
    expect_accepted(sink->deliver(items, patience(20s)), 2);
    EXPECT_EQ(header(server.requests()[0], "Content-Type"),
              "application/cloudevents-batch+json; charset=utf-8");
    EXPECT_EQ(server.ids(), events.ids());
}

TEST(WebhookRequests, TheSignatureIsWhatTheReceiverComputes) {
    // RFC 4231 has keys and texts of its own; these figures are of `openssl dgst -sha256 -hmac`.
    EXPECT_EQ(signature("0123456789abcdef", 1'795'000'000, "[{}]"),
              "t=1795000000,v1=e0381b3509611552e7b9c26e8e087f128b76d0d464bc03b852197e2660b7b379");
    for (auto* gzip : {"false", "true"}) {
        WebServer server;
        server.start();
        server.behave({{"secret", signing_secret}});
        LentEvents events(300);
        auto signing = make_webhook(server.url(), {{"secret", signing_secret}, {"gzip", gzip}});
        expect_accepted(signing->deliver(events.items(), patience(20s)), 300);
        EXPECT_EQ(server.ids(), events.ids());
        auto wrong = make_webhook(server.url(), {{"secret", "another secret 0123456789"}, {"gzip", gzip}});
        expect_kept(wrong->deliver(events.items(), patience(20s)), 300, "401");
        expect_kept(make_webhook(server.url())->deliver(events.items(), patience(20s)), 300, "401");
    }
}

TEST(WebhookRequests, TheReadmeShowsTheCheckThatTheTestServerDoes) {
    auto text_of = [](const std::string& path) {
        std::ifstream file(std::string(GANTRY_SOURCE_DIR) + "/src/sinks/webhook/" + path);
        return std::string(std::istreambuf_iterator<char>(file), {});
    };
    auto server = text_of("tests/webhook_server.py");
    auto begin = server.find("def verify("), end = server.find("\n\n\n", begin);
    ASSERT_NE(begin, std::string::npos);
    EXPECT_NE(text_of("README.md").find(server.substr(begin, end - begin)), std::string::npos);
}

TEST(WebhookRequests, CompressedBodiesArriveWhole) {
    WebServer server;
    server.start();
    auto sink = make_webhook(server.url(), {{"gzip", "true"}});
    LentEvents events(1000);
    expect_accepted(sink->deliver(events.items(), patience(20s)), 1000);
    EXPECT_EQ(server.ids(), events.ids());
    auto request = server.requests().at(0);
    EXPECT_EQ(header(request, "Content-Encoding"), "gzip");
    std::size_t plain = 0;
    for (auto& item : events.items())
        plain += item.payload.size();
    EXPECT_LT(static_cast<std::size_t>(request.at("length").as_int64()), plain / 5);
}

TEST(WebhookRequests, AnEmptyBatchKnocksAndPostsNothing) {
    WebServer server;
    auto sink = make_webhook(server.url());
    auto outcome = sink->deliver({}, patience(20s));
    EXPECT_NE(outcome.trouble.find("Connection refused"), std::string::npos) << outcome.trouble;
    EXPECT_FALSE(sink->connected());
    server.start();
    expect_accepted(sink->deliver({}, patience(20s)), 0);
    EXPECT_TRUE(sink->connected());
    EXPECT_TRUE(server.requests().empty());
}

TEST(WebhookRequests, ABatchGoesInPartsThatFit) {
    WebServer server;
    server.start();
    auto sink = make_webhook(server.url(), {{"max_body", "10KiB"}});
    LentEvents events(100);
    expect_accepted(sink->deliver(events.items(), patience(20s)), 100);
    EXPECT_EQ(server.ids(), events.ids());
    EXPECT_GT(server.requests().size(), 3u);
    for (auto& each : server.requests())
        EXPECT_LE(each.at("length").as_int64(), 10 * 1024);
    auto tiny = make_webhook(server.url(), {{"max_body", "1B"}});
    LentEvents few(3, 101);
    expect_accepted(tiny->deliver(few.items(), patience(20s)), 3);
    EXPECT_EQ(server.ids().size(), 103u) << "one goes however large it is";
}

TEST(WebhookRequests, HeadersAndCredentialsAreSent) {
    WebServer server;
    server.start();
    LentEvents events(1);
    make_webhook(server.url(), {{"headers", "X-Site: 7\n\n  X-Team:  blue, green; red \n"},
                                {"secret_headers", "X-Api-Key: hush-hush"},
                                {"token", "abc.def-ghi"}})
        ->deliver(events.items(), patience(20s));
    make_webhook(server.url(), {{"user", "gantry"}, {"password", "pass word:1"}})
        ->deliver(events.items(), patience(20s));
    auto requests = server.requests();
    ASSERT_EQ(requests.size(), 2u);
    EXPECT_EQ(header(requests[0], "X-Site"), "7");
    EXPECT_EQ(header(requests[0], "X-Team"), "blue, green; red");
    EXPECT_EQ(header(requests[0], "X-Api-Key"), "hush-hush");
    EXPECT_EQ(header(requests[0], "Authorization"), "Bearer abc.def-ghi");
    EXPECT_EQ(header(requests[1], "Authorization"), "Basic Z2FudHJ5OnBhc3Mgd29yZDox");
}

TEST(WebhookRequests, AProxyIsUsedIfItIsASettingAndNeverElse) {
    WebServer server;
    server.start();
    auto address = "http://127.0.0.1:" + std::to_string(server.port());
    LentEvents events(1);
    auto proxied = make_webhook("http://erp.invalid/hook", {{"proxy", address}});
    expect_accepted(proxied->deliver(events.items(), patience(20s)), 1);
    EXPECT_EQ(server.requests()[0].at("path"), "http://erp.invalid/hook");
    ::setenv("http_proxy", "http://127.0.0.1:1", 1);
    ::setenv("all_proxy", "http://127.0.0.1:1", 1);
    expect_accepted(make_webhook(server.url())->deliver(events.items(), patience(20s)), 1);
    ::unsetenv("http_proxy");
    ::unsetenv("all_proxy");
}

TEST(WebhookRequests, ASecretThatTheReceiverRepeatsIsNotPassedOn) {
    WebServer server;
    server.start();
    log::Capture said;
    auto sink = make_webhook(server.url() + "?code=query-secret", {{"secret", signing_secret},
                                                                   {"secret_headers", "X-Api-Key: hush-hush"},
                                                                   {"user", "gantry"},
                                                                   {"password", "pass-word-1"}});
    server.behave({{"status", 500},
                   {"body", std::string("X-Api-Key: hush-hush pass-word-1 Basic Z2FudHJ5OnBhc3Mtd29yZC0x ") +
                                signing_secret}});
    auto outcome = sink->deliver(LentEvents(1).items(), patience(20s));
    expect_kept(outcome, 1, "X-Api-Key: [secret] [secret] Basic [secret] [secret]");
    for (auto* secret : {"hush", "pass-word", "Z2Fud", signing_secret, "query-secret"})
        EXPECT_EQ((outcome.trouble + said.take()).find(secret), std::string::npos) << secret;
}

TEST(WebhookRequests, ALineThatIsNotEncryptedIsSaidOnce) {
    auto warnings = [](const std::string& url, const Given& given = {}) {
        log::Capture said;
        make_webhook(url, given);
        return said.take();
    };
    EXPECT_NE(warnings("http://erp.example.com/hook?code=hush")
                  .find("warn sink erp: http://erp.example.com/hook is not encrypted"),
              std::string::npos);
    EXPECT_NE(warnings("http://127.0.0.1.example.com/"), "");
    for (auto* url :
         {"http://127.0.0.1:80/", "http://localhost/", "http://[::1]:8080/", "https://erp.example.com/"})
        EXPECT_EQ(warnings(url), "") << url;
    EXPECT_NE(warnings("https://erp.example.com", {{"tls_insecure", "true"}}).find("anybody can pass for"),
              std::string::npos);
}

TEST(WebhookRequests, WhatIsWrongWithTheSettingsIsSaid) {
    testkit::TempDir temp;
    auto file = temp.path() + "/file";
    write_file(file, "");
    struct Case {
        std::string url;
        Given given;
        std::string error;
    };
    const std::string good = "https://erp.example.com/";
    for (auto& each : std::vector<Case>{
             {"", {}, "no address"},
             {"https://", {}, "no address"},
             {"ftp://erp.example.com", {}, "neither https"},
             {"https://me:hush@erp.example.com/", {}, "password_file"},
             {"https://me@erp.example.com/", {}, "user name"},
             {std::string("https://erp.example.com/\0x", 26), {}, "no address"},
             {good, {{"token", "a\r\nX-Evil: 1"}}, "control character"},
             {good, {{"token", "a"}, {"user", "b"}, {"password", "c"}}, "both given"},
             {good, {{"user", "b"}}, "belong together"},
             {good, {{"password", "c"}}, "belong together"},
             {good, {{"user", "b:c"}, {"password", "c"}}, "colon"},
             {good, {{"secret", "short"}}, "openssl rand"},
             {good, {{"headers", "no header"}}, "headers: line 1 is no header"},
             {good, {{"headers", "X-A: 1\nX B: 2"}}, "line 2 is no header"},
             {good, {{"headers", "X-A:"}}, "line 1"},
             {good, {{"headers", "X-A: \x01"}}, "line 1"},
             {good, {{"headers", "content-length: 3"}}, "written by Gantry itself"},
             {good, {{"secret_headers", "hush"}}, "secret_headers: line 1"},
             {good, {{"secret_headers", "Authorization: Key x"}, {"token", "t"}}, "Authorization header"},
             {good, {{"max_body", "0B"}}, "max_body"},
             {good, {{"max_body", "2GiB"}}, "max_body"},
             {good, {{"max_body", "much"}}, "max_body"},
             {good, {{"proxy", "http://me:hush@proxy.example.com"}}, "proxy is no address"},
             {good, {{"tls_ca", "/not/there"}}, "tls_ca: cannot read /not/there"},
             {good, {{"tls_key", file}}, "tls_key without tls_cert"},
             {"http://127.0.0.1/", {{"tls_ca", file}}, "says nothing for http"},
         }) {
        auto made = try_make(each.url, each.given);
        ASSERT_FALSE(made) << each.error;
        EXPECT_NE(made.error().text().find(each.error), std::string::npos) << made.error().text();
        EXPECT_EQ(made.error().text().find("hush"), std::string::npos) << made.error().text();
    }
}

TEST(WebhookRequests, TheSampleShowsEverySetting) {
    for (auto& row : kind.settings) {
        auto key = std::string(row.name) + (row.secret ? "_file" : "") + " = ";
        bool shown = kind.sample_toml.find("\n" + key) != std::string_view::npos ||
                     kind.sample_toml.find("\n# " + key) != std::string_view::npos;
        EXPECT_TRUE(shown) << key;
    }
}

}  // namespace
}  // namespace gantry::sinks::webhook
