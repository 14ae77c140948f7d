#include "server.hpp"

namespace gantry::sinks::postgres::tests {
namespace {

Result<Target> target(const std::string& url, const Given& given = {}) {
    auto settings = Settings::make(kind.settings, given);
    if (!settings) return tl::unexpected(settings.error());
    return make_target({.name = "db", .gateway_id = "suite", .url = url, .settings = *settings, .batch = 10});
}

void expect_refused(const Result<Target>& made, std::string_view why) {
    ASSERT_FALSE(made) << why;
    EXPECT_NE(made.error().text().find(why), std::string::npos) << made.error().text();
    EXPECT_EQ(made.error().text().find("hunter2"), std::string::npos) << made.error().text();
}

TEST(PostgresTarget, AUrlNamesUserHostsPortsAndDatabase) {
    auto one = target("postgres://gantry@db.example/rfid");
    ASSERT_TRUE(one) << one.error().text();
    ASSERT_EQ(one->hosts.size(), 1u);
    EXPECT_EQ(one->hosts[0].shown(), "db.example:5432");
    EXPECT_EQ(one->hosts[0].sslmode, "verify-full");
    auto two = target("postgresql://gantry@db-1.example:6000,[::1]:6001/rfid");
    ASSERT_TRUE(two) << two.error().text();
    ASSERT_EQ(two->hosts.size(), 2u);
    EXPECT_EQ(two->hosts[0].shown(), "db-1.example:6000");
    EXPECT_EQ(two->hosts[1].shown(), "[::1]:6001");
    EXPECT_EQ(two->hosts[1].sslmode, "prefer");
    auto socket = target("postgres://%2Frun%2Fpostgresql/rfid");
    ASSERT_TRUE(socket) << socket.error().text();
    EXPECT_TRUE(socket->hosts[0].is_directory());
    auto local = target("postgres:///rfid");
    ASSERT_TRUE(local) << local.error().text();
    EXPECT_TRUE(local->hosts[0].is_directory());
}

TEST(PostgresTarget, WhatAUrlMustNotSayIsRefusedAndASecretNotRepeated) {
    expect_refused(target("postgres://gantry:hunter2@db.example/rfid"), "password_file");
    expect_refused(target("postgres://gantry@db.example/rfid?password=hunter2"), "password_file");
    expect_refused(target("postgres://gantry@db.example/rfid?PASSWORD=hunter2"), "");
    expect_refused(target("postgres://gantry@db.example:hunter2/rfid"), "");
    expect_refused(target("postgres://gantry@db.example/rfid?sslmode=disable"), "the url sets sslmode");
    expect_refused(target("postgres://gantry@db.example"), "no database");
    expect_refused(target("postgres://gantry@db.example:1,other.example:2,third.example/rfid?port=1,2"),
                   "ports");
    expect_refused(target("mysql://gantry@db.example/rfid"), "none of a PostgreSQL server");
    expect_refused(target("db.example"), "none of a PostgreSQL server");
}

TEST(PostgresTarget, NamesOfTablesAreCheckedBeforeTheyAreQuoted) {
    auto url = "postgres://gantry@db.example/rfid";
    for (auto* name : {"", "1st", "a b", "a.b", "x\"; DROP TABLE y;--", "\xC3\xA4",
                       "a23456789012345678901234567890123456789012345678x"})
        expect_refused(target(url, {{"table", name}}),
                       name[0] == 'a' && name[1] == '2' ? "at most" : "is no name");
    expect_refused(target(url, {{"schema", "pg_catalog"}}), "belongs to PostgreSQL");
    expect_refused(target(url, {{"table", "present_tags"}}), "another meaning");
    EXPECT_TRUE(target(url, {{"table", "Events_2"}, {"schema", "_x"}}));
}

TEST(PostgresTarget, TlsSettingsThatContradictOrCannotBeReadAreRefused) {
    auto url = "postgres://gantry@db.example/rfid";
    expect_refused(target(url, {{"tls_insecure", "true"}, {"sslmode", "verify-full"}}), "contradict");
    expect_refused(target(url, {{"tls_ca", "/nowhere/ca.pem"}}), "cannot read /nowhere/ca.pem");
    expect_refused(target(url, {{"tls_cert", "/dev/null"}}), "go together");
    expect_refused(target(url, {{"sslmode", "prefer"}}), "is none of");
    auto insecure = target(url, {{"tls_insecure", "true"}});
    ASSERT_TRUE(insecure);
    EXPECT_NE(insecure->warning.find("db.example"), std::string::npos);
    auto local = target("postgres://gantry@127.0.0.1/rfid", {{"sslmode", "disable"}});
    ASSERT_TRUE(local);
    EXPECT_EQ(local->warning, "") << "nobody listens on loopback";
    auto name = target("postgres://gantry@127.example.com/rfid", {{"sslmode", "disable"}});
    ASSERT_TRUE(name);
    EXPECT_NE(name->warning.find("127.example.com"), std::string::npos) << "a name that looks like it";
}

TEST(PostgresTarget, TextsAreQuotedForEverySetting) {
    EXPECT_EQ(quoted_name("a\"b"), "\"a\"\"b\"");
    EXPECT_EQ(quoted_text("it's a \\"), "E'it''s a \\\\'");
}

TEST(PostgresTarget, TheSampleNamesSettingsThatThereAre) {
    std::string sample(kind.sample_toml);
    for (auto& row : kind.settings)
        if (row.name != "tls_insecure") {
            EXPECT_NE(sample.find(std::string(row.name)), std::string::npos) << row.name;
        }
}

}  // namespace
}  // namespace gantry::sinks::postgres::tests
