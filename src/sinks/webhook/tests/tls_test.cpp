#include "testkit/fault_proxy.hpp"
#include "web_server.hpp"

namespace gantry::sinks::webhook {
namespace {

using testkit::FaultProxy;
using testkit::Faults;
using testkit::LentEvents;
using testkit::patience;

// A CA, and what it vouches for.
class Certificates {
public:
    Certificates() {
        run({"req", "-x509", "-subj", "/CN=Test CA", "-keyout", file("ca.key"), "-out", file("ca.pem")});
        issue("server", "IP:127.0.0.1");
        issue("elsewhere", "DNS:other.example.com");
        issue("client", "DNS:gantry");
    }
    std::string file(const std::string& name) const { return dir_.path() + '/' + name; }

private:
    void issue(const std::string& name, const std::string& whose) {
        run({"req", "-x509", "-subj", "/CN=" + name, "-addext", "subjectAltName=" + whose, "-addext",
             "basicConstraints=critical,CA:FALSE", "-CA", file("ca.pem"), "-CAkey", file("ca.key"), "-keyout",
             file(name + ".key"), "-out", file(name + ".pem")});
    }
    void run(std::vector<std::string> words) {
        words.insert(words.begin(), "/usr/bin/openssl");
        for (auto* more :
             {"-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-days", "2"})
            words.emplace_back(more);
        EXPECT_EQ(testkit::Process(words).wait(), 0) << words[1];
    }

    testkit::TempDir dir_;
};

struct WebhookTls : ::testing::Test {
    Certificates certificates;
    LentEvents events{20};

    std::string file(const std::string& name) const { return certificates.file(name); }
    sink::Outcome deliver(const WebServer& server, const Given& given) {
        return make_webhook(server.url(), given)->deliver(events.items(), patience(20s));
    }
};

TEST_F(WebhookTls, AServerOfATrustedCaIsBelieved) {
    WebServer server({file("server.pem"), file("server.key")});
    server.start();
    expect_accepted(deliver(server, {{"tls_ca", file("ca.pem")}}), 20);
    EXPECT_EQ(server.ids(), events.ids());
}

TEST_F(WebhookTls, AnyOtherIsNot) {
    WebServer unknown({file("server.pem"), file("server.key")});
    unknown.start();
    expect_kept(deliver(unknown, {}), 20, "name the CA's file as tls_ca");
    WebServer elsewhere({file("elsewhere.pem"), file("elsewhere.key")});
    elsewhere.start();
    expect_kept(deliver(elsewhere, {{"tls_ca", file("ca.pem")}}), 20, "127.0.0.1");
    EXPECT_TRUE(unknown.requests().empty() && elsewhere.requests().empty());
    expect_accepted(deliver(unknown, {{"tls_insecure", "true"}}), 20);
    expect_accepted(deliver(elsewhere, {{"tls_insecure", "true"}}), 20);
}

TEST_F(WebhookTls, AServerThatAsksWhoWeAreIsTold) {
    WebServer server({file("server.pem"), file("server.key"), file("ca.pem")});
    server.start();
    auto outcome = deliver(server, {{"tls_ca", file("ca.pem")}});
    EXPECT_EQ(outcome.fates, std::vector(20, sink::Fate::kept));
    expect_accepted(deliver(server, {{"tls_ca", file("ca.pem")},
                                     {"tls_cert", file("client.pem")},
                                     {"tls_key", file("client.key")}}),
                    20);
}

TEST_F(WebhookTls, AKillLosesNothingAndTheConnectionIsMadeAnew) {
    WebServer server({file("server.pem"), file("server.key")});
    server.start();
    auto sink = make_webhook(server.url(), {{"tls_ca", file("ca.pem")}});
    for (int round = 0; round < 3; ++round) {
        expect_accepted(sink->deliver(events.items(), patience(20s)), 20);
        server.kill();
        auto outcome = sink->deliver(events.items(), patience(20s));
        EXPECT_EQ(outcome.fates, std::vector(20, sink::Fate::kept));
        server.start();
    }
    expect_accepted(sink->deliver(events.items(), patience(20s)), 20);
    EXPECT_EQ(server.ids().size(), 80u);
}

TEST_F(WebhookTls, AFlippedBitIsNeverABatchTaken) {
    WebServer server({file("server.pem"), file("server.key")});
    server.start();
    FaultProxy proxy(server.port());
    auto sink =
        make_webhook("https://127.0.0.1:" + std::to_string(proxy.port()) + "/", {{"tls_ca", file("ca.pem")}});
    expect_accepted(sink->deliver({}, patience(20s)), 0);
    auto handshake = proxy.passed().to_target;
    for (std::uint64_t place : {handshake + 6, handshake + 500, handshake + 5000}) {
        proxy.set({.flip_at = place}, {});
        EXPECT_EQ(sink->deliver(events.items(), patience(20s)).fates, std::vector(20, sink::Fate::kept))
            << place;
        proxy.set({});
        expect_accepted(sink->deliver({}, patience(20s)), 0);
    }
    EXPECT_TRUE(server.ids().empty());
    expect_accepted(sink->deliver(events.items(), patience(20s)), 20);
}

}  // namespace
}  // namespace gantry::sinks::webhook
