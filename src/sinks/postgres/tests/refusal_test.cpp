#include "server.hpp"
#include "sinks/postgres/verdict.hpp"

// A row that the table does not take is rejected; whatever else goes wrong is no row's fault.
namespace gantry::sinks::postgres::tests {
namespace {

using sink::Fate;

struct TakenTable {
    Server server;
    std::unique_ptr<sink::Sink> sink;
    TakenTable() {
        server.start();
        sink = sink_of(server);
        expect_all_accepted(sink->deliver({}, patience(20s)));
    }
    // Delivers ten events; the numbers of those that were rejected, and their reasons.
    std::string rejected(std::vector<std::size_t>& numbers) {
        testkit::LentEvents events(10);
        auto outcome = sink->deliver(events.items(), patience(20s));
        EXPECT_EQ(count(outcome, Fate::kept), 0) << outcome.trouble;
        std::string reasons;
        for (auto& reason : outcome.reasons) {
            numbers.push_back(reason.item + 1);
            reasons += reason.text + "\n";
        }
        EXPECT_EQ(server.value("SELECT count(*) FROM gantry.events"),
                  std::to_string(10 - outcome.reasons.size()));
        return reasons;
    }
};

using Numbers = std::vector<std::size_t>;

TEST(PostgresRefusal, ACheckConstraintRefusesTheRowsItIsAbout) {
    TakenTable table;
    table.server.sql("ALTER TABLE gantry.events ADD CONSTRAINT luck CHECK (seq NOT IN (1, 5, 6, 10))");
    Numbers numbers;
    auto reasons = table.rejected(numbers);
    EXPECT_EQ(numbers, (Numbers{1, 5, 6, 10}));
    EXPECT_NE(reasons.find("\"luck\""), std::string::npos) << reasons;
    EXPECT_NE(reasons.find("23514"), std::string::npos) << reasons;
}

TEST(PostgresRefusal, AllRowsMayBeRefused) {
    TakenTable table;
    table.server.sql("ALTER TABLE gantry.events ADD CHECK (seq > 100)");
    Numbers numbers;
    table.rejected(numbers);
    EXPECT_EQ(numbers.size(), 10u);
}

TEST(PostgresRefusal, AUniqueIndexOfTheirsRefusesAndDropsNothing) {
    TakenTable table;
    table.server.sql("CREATE UNIQUE INDEX ON gantry.events((seq / 4))");
    Numbers numbers;
    auto reasons = table.rejected(numbers);
    EXPECT_EQ(numbers, (Numbers{2, 3, 5, 6, 7, 9, 10}));
    EXPECT_NE(reasons.find("23505"), std::string::npos) << reasons;
}

TEST(PostgresRefusal, AConstraintThatIsLookedAtWithTheCommitRefusesToo) {
    TakenTable table;
    table.server.sql(
        "CREATE TABLE known(seq bigint PRIMARY KEY); INSERT INTO known SELECT generate_series(1, 9);"
        "ALTER TABLE gantry.events ADD FOREIGN KEY(seq) REFERENCES known DEFERRABLE INITIALLY DEFERRED;"
        "GRANT SELECT ON known TO gantry");
    Numbers numbers;
    table.rejected(numbers);
    EXPECT_EQ(numbers, Numbers{10});
}

TEST(PostgresRefusal, ARowTooLongForAnIndexIsRefused) {
    TakenTable table;
    table.server.sql("CREATE INDEX ON gantry.events(text)");
    Lent lent;
    lent.add(event::Type::reader_fault).text = "short";
    auto& text = lent.add(event::Type::reader_fault).text;
    for (unsigned i = 0, noise = 1; i < 20'000; ++i, noise = noise * 1664525 + 1013904223)
        text += static_cast<char>('a' + (noise >> 24) % 26);  // does not compress
    auto outcome = table.sink->deliver(lent.items(), patience(20s));
    EXPECT_EQ(outcome.fates, (std::vector{Fate::accepted, Fate::rejected}));
}

TEST(PostgresRefusal, RowLevelSecurityRefusesRows) {
    TakenTable table;
    table.server.sql(
        "ALTER TABLE gantry.events ENABLE ROW LEVEL SECURITY, FORCE ROW LEVEL SECURITY;"
        "CREATE POLICY odd ON gantry.events FOR INSERT WITH CHECK (seq % 2 = 1);"
        "CREATE POLICY all_read ON gantry.events FOR SELECT USING (true)");
    Numbers numbers;
    table.rejected(numbers);
    EXPECT_EQ(numbers, (Numbers{2, 4, 6, 8, 10}));
}

TEST(PostgresRefusal, AMissingPrivilegeIsNoRowsFault) {
    TakenTable table;
    table.server.sql("ALTER TABLE gantry.events OWNER TO postgres");
    expect_all_kept(table.sink->deliver(testkit::LentEvents(3).items(), patience(20s)), "permission denied");
    table.server.sql("ALTER TABLE gantry.events OWNER TO gantry");
    expect_all_accepted(table.sink->deliver(testkit::LentEvents(3).items(), patience(20s)));
}

TEST(PostgresRefusal, ATableThatIsGoneIsNoRowsFault) {
    TakenTable table;
    table.server.sql("ALTER TABLE gantry.events RENAME TO elsewhere");
    expect_all_kept(table.sink->deliver(testkit::LentEvents(3).items(), patience(20s)), "does not exist");
    table.server.sql("ALTER TABLE gantry.elsewhere RENAME TO events");
    expect_all_accepted(table.sink->deliver(testkit::LentEvents(3).items(), patience(20s)));
}

// A trigger that fails as a server in need does, and then no more.
TEST(PostgresRefusal, ASerializationFailureKeepsTheBatchAndTheConnection) {
    TakenTable table;
    table.server.sql(R"(CREATE FUNCTION fail() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN
            RAISE 'could not serialize' USING ERRCODE = '40001'; END $$;
        CREATE TRIGGER fail BEFORE INSERT ON gantry.events FOR EACH ROW WHEN (NEW.seq = 2) EXECUTE FUNCTION fail())");
    testkit::LentEvents events(3);
    expect_all_kept(table.sink->deliver(events.items(), patience(20s)), "could not serialize");
    EXPECT_TRUE(table.sink->connected());
    EXPECT_EQ(table.server.value("SELECT count(*) FROM gantry.events"), "0");
    table.server.sql("DROP TRIGGER fail ON gantry.events");
    expect_all_accepted(table.sink->deliver(events.items(), patience(20s)));
}

TEST(PostgresRefusal, TheSqlstateSaysWhoIsToBlame) {
    auto blames = [](std::string sqlstate, std::string routine = {}) {
        return blames_a_row({"", std::move(sqlstate), std::move(routine)});
    };
    for (auto* of_a_row : {"22001", "22021", "22P05", "23502", "23505", "23514", "44000", "54000", "P0001",
                           "P0004", "21000", "GG001", "U1234", "99999"})
        EXPECT_TRUE(blames(of_a_row)) << of_a_row;
    for (auto* of_others :
         {"08006", "0A000", "25006", "28P01", "3D000", "40001", "40P01", "42P01", "42703", "42501",
          "42601", "53100", "53300", "55P03", "57014", "57P01", "58030", "XX001", "F0000", ""})
        EXPECT_FALSE(blames(of_others)) << of_others;
    EXPECT_TRUE(blames("42501", "ExecWithCheckOptions"));
}

}  // namespace
}  // namespace gantry::sinks::postgres::tests
