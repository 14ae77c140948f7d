#include <thread>

#include "server.hpp"
#include "testkit/peer.hpp"

namespace gantry::sinks::postgres::tests {
namespace {

// Takes connections and says nothing.
class Silent {
public:
    Silent() : fd_(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
        sockaddr_in address{};
        address.sin_family = AF_INET;
        address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        socklen_t size = sizeof address;
        if (::bind(fd_, reinterpret_cast<const sockaddr*>(&address), size) != 0 || listen(fd_, 8) != 0 ||
            getsockname(fd_, reinterpret_cast<sockaddr*>(&address), &size) != 0)
            throw std::runtime_error("no socket");
        port = ntohs(address.sin_port);
    }
    ~Silent() { ::close(fd_); }
    Silent(const Silent&) = delete;
    Silent& operator=(const Silent&) = delete;
    std::uint16_t port = 0;

private:
    int fd_;
};

TEST(PostgresTrouble, AWrongPasswordIsSaidPlainlyAndNotShown) {
    Server server;
    server.start();
    testkit::LentEvents events(3);
    auto wrong = sink_of(server, {{"password", "opensesame"}});
    auto outcome = wrong->deliver(events.items(), patience(20s));
    expect_all_kept(outcome, "password authentication failed for user \"gantry\"");
    expect_all_kept(outcome, fmt::format("127.0.0.1:{}", server.port));
    expect_all_kept(outcome, "password_file");
    EXPECT_EQ(outcome.trouble.find("opensesame"), std::string::npos);
    EXPECT_EQ(outcome.trouble.find('\n'), std::string::npos);
    EXPECT_FALSE(wrong->connected());
    expect_all_kept(sink_of(server, {{"password", ""}})->deliver(events.items(), patience(20s)),
                    "set password_file");
    EXPECT_EQ(server.log().find("opensesame"), std::string::npos);
}

TEST(PostgresTrouble, ADatabaseThatIsNotThereIsSaid) {
    Server server;
    server.start();
    auto sink = make_sink(fmt::format("postgres://postgres@127.0.0.1:{}/nowhere", server.port));
    ASSERT_TRUE(sink);
    expect_all_kept((*sink)->deliver(testkit::LentEvents(1).items(), patience(20s)),
                    "\"nowhere\" does not exist");
}

TEST(PostgresTrouble, ANameWithoutAnAddressIsSaid) {
    auto sink = make_sink("postgres://gantry@no-such-host.invalid/rfid", {{"sslmode", "disable"}});
    ASSERT_TRUE(sink);
    log::Capture log;
    expect_all_kept((*sink)->deliver(testkit::LentEvents(1).items(), patience(20s)), "no-such-host.invalid");
    EXPECT_NE(log.take().find("in the clear"), std::string::npos) << "and that nothing is encrypted, once";
    (*sink)->deliver({}, patience(20s));
    EXPECT_EQ(log.take().find("in the clear"), std::string::npos);
}

TEST(PostgresTrouble, AServerThatSaysNothingIsGivenUp) {
    Silent silent;
    auto sink = make_sink(fmt::format("postgres://gantry@localhost:{}/rfid", silent.port));
    ASSERT_TRUE(sink);
    expect_all_kept((*sink)->deliver(testkit::LentEvents(1).items(), patience(200ms)), "");
    std::stop_source stop;
    std::jthread stopper([&] { stop.request_stop(); });
    expect_all_kept(
        (*sink)->deliver(testkit::LentEvents(1).items(),
                         {.until = std::chrono::steady_clock::now() + 10min, .stop = stop.get_token()}),
        "");
}

TEST(PostgresTrouble, ASecondServerIsTakenWhenTheFirstIsSilentOrAway) {
    Silent silent;
    Server server;
    server.start();
    for (auto port : {silent.port, unused_port()}) {
        auto sink = make_sink(
            fmt::format("postgresql://gantry@127.0.0.1:{},localhost:{}/postgres", port, server.port));
        ASSERT_TRUE(sink);
        testkit::LentEvents events(3);
        expect_all_accepted((*sink)->deliver(events.items(), patience(3s)));
    }
}

TEST(PostgresTrouble, AStandbyTakesNothingAndIsSaid) {
    Server server;
    server.start();
    server.kill();
    testkit::write_file(server.data() + "/standby.signal", "");
    server.start_as_standby();
    auto sink = make_sink(server.url("postgres"));
    ASSERT_TRUE(sink);
    expect_all_kept((*sink)->deliver(testkit::LentEvents(1).items(), patience(20s)), "standby");
}

TEST(PostgresTrouble, ALockedTableKeepsTheBatchAndTheConnection) {
    Server server;
    server.start();
    auto sink = sink_of(server, {{"lock_timeout", "100ms"}});
    expect_all_accepted(sink->deliver({}, patience(20s)));
    server.sql("BEGIN; LOCK TABLE gantry.events");
    testkit::LentEvents events(3);
    expect_all_kept(sink->deliver(events.items(), patience(20s)), "lock timeout");
    EXPECT_TRUE(sink->connected());
    server.sql("COMMIT");
    expect_all_accepted(sink->deliver(events.items(), patience(20s)));
}

TEST(PostgresTrouble, PatienceEndsAStatementHereAndThere) {
    Server server;
    server.start();
    auto sink = sink_of(server, {{"lock_timeout", "600s"}});
    expect_all_accepted(sink->deliver({}, patience(20s)));
    server.sql("BEGIN; LOCK TABLE gantry.events");
    testkit::LentEvents events(3);
    auto outcome = sink->deliver(events.items(), patience(200ms));
    expect_all_kept(outcome, "");
    EXPECT_FALSE(outcome.trouble.empty());
    EXPECT_TRUE(eventually([&] { return !server.waits(); })) << "the server does not go on by itself";
    server.sql("COMMIT");
    expect_all_accepted(sink->deliver(events.items(), patience(20s)));
    EXPECT_EQ(server.value("SELECT count(*) FROM gantry.events"), "3");
}

TEST(PostgresTrouble, AStopEndsAStatement) {
    Server server;
    server.start();
    auto sink = sink_of(server, {{"lock_timeout", "600s"}});
    expect_all_accepted(sink->deliver({}, patience(20s)));
    server.sql("BEGIN; LOCK TABLE gantry.events");
    std::stop_source stop;
    std::jthread stopper([&] {
        eventually([&] { return server.waits(); });
        stop.request_stop();
    });
    testkit::LentEvents events(3);
    expect_all_kept(sink->deliver(events.items(), {.until = std::chrono::steady_clock::now() + 10min,
                                                   .stop = stop.get_token()}),
                    "the gateway ends");
}

TEST(PostgresTrouble, ASessionThatAnAdministratorEndsIsMadeAnew) {
    Server server;
    server.start();
    auto sink = sink_of(server, {{"lock_timeout", "600s"}});
    testkit::LentEvents events(3);
    expect_all_accepted(sink->deliver({}, patience(20s)));
    server.sql("BEGIN; LOCK TABLE gantry.events");
    std::jthread administrator([&] {
        eventually([&] { return server.waits(); });
        server.sql("SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE usename = 'gantry'; COMMIT");
    });
    expect_all_kept(sink->deliver(events.items(), patience(60s)), "administrator");
    EXPECT_FALSE(sink->connected());
    administrator.join();
    expect_all_accepted(sink->deliver(events.items(), patience(20s)));
    EXPECT_EQ(server.value("SELECT count(*) FROM gantry.events"), "3");
}

TEST(PostgresTrouble, AnIdleSinkSeesThatTheServerIsGone) {
    Server server;
    server.start();
    auto sink = sink_of(server);
    expect_all_accepted(sink->deliver({}, patience(20s)));
    sink->idle(patience(1s));
    EXPECT_TRUE(sink->connected());
    server.kill();
    EXPECT_TRUE(eventually([&] {
        sink->idle(patience(1s));
        return !sink->connected();
    }));
}

TEST(PostgresTrouble, AConfirmationIsSafeWhateverTheServersDefaultIs) {
    Server server({"synchronous_commit=off"});
    server.start();
    server.sql("ALTER ROLE gantry SET synchronous_commit = local");
    auto sink = sink_of(server);
    expect_all_accepted(sink->deliver({}, patience(20s)));
    EXPECT_NE(server.log().find("fsync = off"), std::string::npos) << "it is told what nobody can help";
    server.sql(R"(CREATE TABLE seen(setting text); GRANT INSERT ON seen TO gantry;
        CREATE FUNCTION note() RETURNS trigger LANGUAGE plpgsql AS
            $$ BEGIN INSERT INTO seen VALUES(current_setting('synchronous_commit')); RETURN NULL; END $$;
        CREATE TRIGGER note AFTER INSERT ON gantry.events FOR EACH STATEMENT EXECUTE FUNCTION note())");
    expect_all_accepted(sink->deliver(testkit::LentEvents(1).items(), patience(20s)));
    EXPECT_EQ(server.value("SELECT string_agg(setting, ' ') FROM seen"), "on");
}

// A certificate authority and a server's certificate for `name`, made by openssl.
void make_certificates(const std::string& dir, const std::string& name) {
    auto run = [&](const std::string& command) {
        testkit::Process openssl({"/bin/sh", "-c", "cd " + dir + " && openssl " + command});
        ASSERT_EQ(openssl.wait(), 0) << command;
    };
    run("req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -days 2 -keyout ca.key -out ca.pem "
        "-subj /CN=ca");
    run("req -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -keyout server.key -out server.csr -subj "
        "/CN=server");
    testkit::write_file(dir + "/names", "subjectAltName=" + name);
    run("x509 -req -in server.csr -CA ca.pem -CAkey ca.key -days 2 -extfile names -out server.pem");
}

TEST(PostgresTls, TheServerMustBeTheRightOneUnlessToldOtherwise) {
    testkit::TempDir other;
    make_certificates(other.path(), "DNS:localhost");
    Server server({"ssl=on", "ssl_cert_file=../server.pem", "ssl_key_file=../server.key"});
    make_certificates(server.dir(), "DNS:localhost");
    give_to_postgres(server.dir());
    testkit::write_file(server.data() + "/pg_hba.conf",
                        "host all postgres 127.0.0.1/32 trust\nhostssl all all 127.0.0.1/32 scram-sha-256\n");
    server.start();
    testkit::LentEvents events(3);
    auto deliver = [&](const std::string& host, Given given) {
        auto sink =
            make_sink(fmt::format("postgres://gantry@{}:{}/postgres", host, server.port), std::move(given));
        if (!sink) throw std::runtime_error(sink.error().text());
        return (*sink)->deliver(events.items(), patience(20s));
    };
    auto ca = server.dir() + "/ca.pem";
    expect_all_accepted(deliver("localhost", {{"sslmode", "verify-full"}, {"tls_ca", ca}}));
    expect_all_accepted(deliver("localhost", {}));  // loopback: encrypted where the server can
    expect_all_kept(deliver("localhost", {{"sslmode", "verify-full"}, {"tls_ca", other.path() + "/ca.pem"}}),
                    "certificate verify failed");
    expect_all_kept(deliver("localhost", {{"sslmode", "verify-full"}}), "certificate verify failed");
    expect_all_kept(deliver("127.0.0.1", {{"sslmode", "verify-full"}, {"tls_ca", ca}}), "does not match");
    expect_all_accepted(deliver("127.0.0.1", {{"sslmode", "verify-ca"}, {"tls_ca", ca}}));
    expect_all_accepted(deliver("127.0.0.1", {{"tls_insecure", "true"}}));
    expect_all_kept(deliver("localhost", {{"sslmode", "disable"}}), "no encryption");
}

}  // namespace
}  // namespace gantry::sinks::postgres::tests
