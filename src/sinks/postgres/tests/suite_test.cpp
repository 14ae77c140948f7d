#include "server.hpp"

namespace gantry::sinks::postgres::tests {
namespace {

class PostgresDestination : public testkit::Destination {
public:
    void start() override { server_.start(); }
    void kill() override { server_.kill(); }
    std::unique_ptr<sink::Sink> make_sink() override { return sink_of(server_, {{"present_tags", "true"}}); }
    std::vector<std::string> ids() override {
        std::vector<std::string> out;
        if (server_.value("SELECT to_regclass('gantry.events')") == "NULL") return out;
        for (auto& row : server_.sql("SELECT id FROM gantry.events ORDER BY ctid"))
            out.push_back(*row[0]);
        return out;
    }
    bool refuse(const std::string& id) override {
        make_sink()->deliver({}, patience(20s));
        server_.sql(R"(CREATE TABLE IF NOT EXISTS refused(id text);
            CREATE OR REPLACE FUNCTION refuse() RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER AS $$ BEGIN
                IF EXISTS(SELECT 1 FROM refused WHERE id = NEW.id) THEN RAISE 'nobody wants %', NEW.id; END IF;
                RETURN NEW; END $$;
            CREATE OR REPLACE TRIGGER refuse BEFORE INSERT ON gantry.events FOR EACH ROW EXECUTE FUNCTION refuse();
            INSERT INTO refused VALUES()" +
                    quoted_text(id) + ")");
        return true;
    }
    bool idempotent() const override { return true; }

private:
    Server server_;
};

GANTRY_SINK_SUITE(Postgres, PostgresDestination)

}  // namespace
}  // namespace gantry::sinks::postgres::tests
