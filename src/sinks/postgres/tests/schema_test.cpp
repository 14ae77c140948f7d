#include <thread>

#include <fmt/format.h>

#include "server.hpp"
#include "sinks/postgres/rows.hpp"

namespace gantry::sinks::postgres::tests {
namespace {

const Names usual{"gantry", "events"};

// As the gantry user, like the sink.
Session session_of(const Server& server) {
    Session session;
    Parameters parameters = {{"hostaddr", "127.0.0.1"},
                             {"port", std::to_string(server.port)},
                             {"user", "gantry"},
                             {"dbname", "postgres"},
                             {"password", "se'cret"}};
    auto done = session.connect(parameters, patience(20s));
    if (!done) throw std::runtime_error(done.error().text);
    return session;
}

constexpr std::array later_steps = {
    Migration{1,
              [](const Names& names) {
                  return "CREATE TABLE " + names.events() + "(n integer); INSERT INTO " + names.events() +
                         " VALUES(1)";
              }},
    Migration{2, [](const Names& names) { return "UPDATE " + names.events() + " SET n = n + 10"; }},
    Migration{
        3, [](const Names& names) { return "ALTER TABLE " + names.events() + " ADD m integer DEFAULT 7"; }},
};
Kept kept(std::span<const Migration> steps) {
    return {"events", usual.events(), steps};
}

TEST(PostgresSchema, TheTableHasEveryColumnThatIsWritten) {
    std::string made;
    for (auto& step : kept_events(usual).steps)
        made += step.sql(usual);
    for (auto& column : columns())
        EXPECT_NE(made.find(fmt::format("{} {}", quoted_name(column.name), column.type)), std::string::npos)
            << column.name;
}

TEST(PostgresSchema, AnOlderTableIsBroughtToTheNewVersionWithItsRows) {
    Server server;
    server.start();
    auto session = session_of(server);
    std::array old = {kept(std::span(later_steps).first(1))}, now = {kept(later_steps)};
    ASSERT_TRUE(migrate(session, usual, old, patience(20s)));
    server.sql("INSERT INTO gantry.events VALUES(2)");
    ASSERT_TRUE(migrate(session, usual, now, patience(20s)));
    ASSERT_TRUE(migrate(session, usual, now, patience(20s))) << "and nothing is done twice";
    EXPECT_EQ(server.value("SELECT string_agg(n || ' ' || m, ', ' ORDER BY n) FROM gantry.events"),
              "11 7, 12 7");
    EXPECT_EQ(server.value("SELECT version FROM gantry.gantry_versions"), "3");
}

TEST(PostgresSchema, AStepThatFailsLeavesAllAsItWas) {
    Server server;
    server.start();
    auto session = session_of(server);
    std::array old = {kept(std::span(later_steps).first(1))};
    ASSERT_TRUE(migrate(session, usual, old, patience(20s)));
    std::array broken = {later_steps[0], later_steps[1],
                         Migration{3, [](const Names&) { return std::string("DELETE FROM nowhere"); }}};
    std::array wanted = {kept(broken)};
    auto done = migrate(session, usual, wanted, patience(20s));
    ASSERT_FALSE(done);
    EXPECT_NE(done.error().text.find("it is as it was"), std::string::npos) << done.error().text;
    EXPECT_EQ(server.value("SELECT n FROM gantry.events"), "1");
    EXPECT_EQ(server.value("SELECT version FROM gantry.gantry_versions"), "1");
    EXPECT_TRUE(session.run("SELECT 1", patience(20s))) << "the session is of use";
}

TEST(PostgresSchema, ANewerTableIsRefused) {
    Server server;
    server.start();
    expect_all_accepted(sink_of(server)->deliver({}, patience(20s)));
    server.sql("UPDATE gantry.gantry_versions SET version = 1000");
    auto sink = sink_of(server);
    testkit::LentEvents events(2);
    expect_all_kept(sink->deliver(events.items(), patience(20s)),
                    "has version 1000, this program knows versions up to");
    EXPECT_FALSE(sink->connected());
    server.sql("UPDATE gantry.gantry_versions SET version = 1");
    expect_all_accepted(sink->deliver(events.items(), patience(20s)));
}

TEST(PostgresSchema, ATableOfSomebodyElseIsRefusedAndNotTouched) {
    Server server;
    server.start();
    server.sql("CREATE SCHEMA gantry AUTHORIZATION gantry; CREATE TABLE gantry.events(theirs text)");
    expect_all_kept(sink_of(server)->deliver(testkit::LentEvents(2).items(), patience(20s)),
                    "which Gantry did not make");
    EXPECT_EQ(server.value("SELECT to_regclass('gantry.gantry_versions')"), "NULL")
        << "nothing is left behind";
}

TEST(PostgresSchema, SeveralGatewaysMayMakeTheTablesAtOnce) {
    Server server;
    server.start();
    server.sql("BEGIN; SELECT pg_advisory_xact_lock(1196315730)");
    constexpr int gateways = 4;
    std::vector<std::unique_ptr<sink::Sink>> sinks;
    std::vector<std::thread> threads;
    std::vector<sink::Outcome> outcomes(gateways);
    for (int i = 0; i < gateways; ++i)
        sinks.push_back(sink_of(server, {{"present_tags", "true"}, {"lock_timeout", "60s"}}));
    for (std::size_t i = 0; i < sinks.size(); ++i)
        threads.emplace_back([&, i] {
            testkit::LentEvents events(10, 1 + 10 * i);
            outcomes[i] = sinks[i]->deliver(events.items(), patience(60s));
        });
    EXPECT_TRUE(eventually([&] { return server.waits(gateways); })) << "all want to make the tables";
    server.sql("COMMIT");
    for (auto& thread : threads)
        thread.join();
    for (auto& outcome : outcomes)
        expect_all_accepted(outcome);
    EXPECT_EQ(server.value("SELECT count(*) FROM gantry.events"), "40");
}

TEST(PostgresSchema, EveryUniqueIndexHasTheTimeSoThatAHypertableCanBeMade) {
    Server server;
    server.start();
    auto sink = sink_of(server);
    expect_all_accepted(sink->deliver({}, patience(20s)));
    EXPECT_EQ(
        server.value(
            "SELECT count(*) FROM pg_index i WHERE indrelid = 'gantry.events'::regclass AND indisunique "
            "AND NOT EXISTS(SELECT 1 FROM pg_attribute a WHERE a.attrelid = i.indrelid AND "
            "a.attnum = ANY(i.indkey) AND attname = 'time')"),
        "0");
    // PostgreSQL's own partitions by time ask for the same, and the sink writes into them.
    server.sql(
        "ALTER TABLE gantry.events RENAME TO plain;"
        "CREATE TABLE gantry.events(LIKE gantry.plain INCLUDING ALL) PARTITION BY RANGE (time);"
        "CREATE TABLE gantry.part PARTITION OF gantry.events DEFAULT;"
        "ALTER TABLE gantry.events OWNER TO gantry; ALTER TABLE gantry.part OWNER TO gantry");
    testkit::LentEvents events(10);
    expect_all_accepted(sink->deliver(events.items(), patience(20s)));
    expect_all_accepted(sink->deliver(events.items(), patience(20s)));
    EXPECT_EQ(server.value("SELECT count(*) FROM gantry.part"), "10");
}

TEST(PostgresSchema, ColumnsOfTheirsAndWordsOfSqlAsNamesDoNoHarm) {
    Server server;
    server.start();
    auto sink = sink_of(server, {{"schema", "Order"}, {"table", "select"}});
    testkit::LentEvents events(3), more(3, 4);
    expect_all_accepted(sink->deliver(events.items(), patience(20s)));
    server.sql(
        R"(ALTER TABLE "Order"."select" ADD day date GENERATED ALWAYS AS ((time AT TIME ZONE 'UTC')::date) STORED,
                  ADD note text DEFAULT 'x')");
    expect_all_accepted(sink->deliver(more.items(), patience(20s)));
    EXPECT_EQ(server.value(R"(SELECT count(day) FROM "Order"."select")"), "6");
}

TEST(PostgresSchema, TwoTablesInOneSchemaHaveVersionsOfTheirOwn) {
    Server server;
    server.start();
    for (auto* table : {"one", "two"})
        expect_all_accepted(
            sink_of(server, {{"table", table}})->deliver(testkit::LentEvents(3).items(), patience(20s)));
    EXPECT_EQ(server.value("SELECT string_agg(name, ', ' ORDER BY name) FROM gantry.gantry_versions"),
              "events one, events two");
}

TEST(PostgresSchema, WhoMayMakeNoSchemaIsToldWhatToDo) {
    Server server;
    server.start();
    server.sql("REVOKE CREATE ON DATABASE postgres FROM gantry");
    auto sink = sink_of(server);
    testkit::LentEvents events(2);
    expect_all_kept(sink->deliver(events.items(), patience(20s)), "CREATE SCHEMA \"gantry\" AUTHORIZATION");
    server.sql("CREATE SCHEMA gantry AUTHORIZATION gantry");
    expect_all_accepted(sink->deliver(events.items(), patience(20s)));
}

}  // namespace
}  // namespace gantry::sinks::postgres::tests
