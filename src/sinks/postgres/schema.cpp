#include "sinks/postgres/schema.hpp"

#include <algorithm>
#include <array>
#include <charconv>

#include <fmt/format.h>

#include "base/text.hpp"
#include "sinks/postgres/rows.hpp"

namespace gantry::sinks::postgres {

namespace {

constexpr std::array event_steps = {
    Migration{1,
              [](const Names& names) {
                  return fmt::format(R"(
CREATE TABLE {0}(
    "schema" smallint NOT NULL, "id" text NOT NULL, "seq" bigint NOT NULL, "type" text NOT NULL,
    "time" timestamptz NOT NULL, "reader" text, "antenna" text, "zone" text, "technology" text, "tag" text,
    "epc" text, "gs1" text, "link" text, "pc" text, "xpc" text, "rssi_dbm" double precision, "reads" bigint,
    "first_seen" timestamptz, "last_seen" timestamptz, "reader_time" timestamptz,
    "from" text, "to" text, "reason" text, "code" bigint, "text" text, "bytes" text, "input" bigint,
    "state" boolean, "scope" text, "count" bigint, "since" timestamptz, "by" text,
    "possible_repeat" boolean, "data" jsonb, "exact" bytea,
    PRIMARY KEY("id", "time"));
CREATE INDEX ON {0}("time");
COMMENT ON COLUMN {0}."exact" IS
    'the event as JSON, where a text of it has the character U+0000, which its column shows as U+2400')",
                                     names.events());
              }},
};

constexpr std::array presence_steps = {
    Migration{1,
              [](const Names& names) {
                  return fmt::format(R"(
CREATE TABLE {0}(
    gateway text NOT NULL, place text NOT NULL, tag text NOT NULL, present boolean NOT NULL,
    epoch bigint NOT NULL, seq bigint NOT NULL, technology text, epc text, zone text, reader text,
    antenna text, first_seen timestamptz, last_seen timestamptz, reads bigint, rssi_dbm double precision,
    updated timestamptz NOT NULL DEFAULT now(),
    PRIMARY KEY(gateway, place, tag)) WITH (fillfactor = 70);
COMMENT ON TABLE {0} IS
    'the last that is known of each tag at each place; who is gone is remembered for thirty days';
CREATE VIEW {1} AS SELECT gateway, tag, technology, epc, zone, reader, antenna, first_seen, last_seen, reads,
    rssi_dbm FROM {0} WHERE present)",
                                     names.tag_presence(), names.present_tags());
              }},
    Migration{2,
              [](const Names& names) {
                  return fmt::format(R"(
ALTER TABLE {0} ADD COLUMN pc text, ADD COLUMN xpc text;
CREATE OR REPLACE VIEW {1} AS SELECT gateway, tag, technology, epc, zone, reader, antenna, first_seen, last_seen,
    reads, rssi_dbm, pc, xpc FROM {0} WHERE present)",
                                     names.tag_presence(), names.present_tags());
              }},
};

// "GNTR": whoever changes tables of ours in this database has this lock.
constexpr std::string_view take_lock = "SELECT pg_advisory_xact_lock(1196315730)";

tl::unexpected<Failure> refuse(std::string what) {
    return tl::unexpected(Failure{std::move(what)});
}

// The version of each; 0 where there is none yet.
Answer<std::vector<int>> read_versions(Session& session, const Names& names, std::span<const Kept> all,
                                       const sink::Patience& patience) {
    std::vector<int> versions;
    std::array table = {names.versions()};
    auto there = session.ask("SELECT to_regclass($1)::text", table, patience);
    if (!there) return tl::unexpected(there.error());
    bool any = there->at(0).at(0).has_value();
    for (auto& kept : all) {
        std::array key = {kept.name};
        std::array relation = {kept.relation};
        Answer<Rows> found = Rows{};
        if (any)
            found = session.ask(fmt::format("SELECT version FROM {} WHERE name = $1", names.versions()), key,
                                patience);
        if (!found) return tl::unexpected(found.error());
        int version = 0;
        if (!found->empty()) {
            auto& text = found->at(0).at(0).value();
            std::from_chars(text.data(), text.data() + text.size(), version);
        } else {
            auto foreign = session.ask("SELECT to_regclass($1)::text", relation, patience);
            if (!foreign) return tl::unexpected(foreign.error());
            if (foreign->at(0).at(0))
                return refuse(
                    fmt::format("there is a {} already, which Gantry did not make; name another "
                                "schema or table",
                                kept.relation));
        }
        if (version > kept.steps.back().version)
            return refuse(
                fmt::format("{} has version {}, this program knows versions up to {}; use the newer "
                            "gantry that made it, or name another table",
                            kept.relation, version, kept.steps.back().version));
        versions.push_back(version);
    }
    return versions;
}

bool is_current(std::span<const int> versions, std::span<const Kept> all) {
    for (std::size_t i = 0; i < all.size(); ++i)
        if (versions[i] < all[i].steps.back().version) return false;
    return true;
}

// CREATE SCHEMA IF NOT EXISTS asks for the right to create one even if it is there.
Answer<void> make_schema(Session& session, const Names& names, const sink::Patience& patience) {
    std::array name = {names.schema};
    auto there = session.ask("SELECT 1 FROM pg_namespace WHERE nspname = $1", name, patience);
    if (!there) return tl::unexpected(there.error());
    if (!there->empty()) return {};
    auto made = session.run("CREATE SCHEMA " + quoted_name(names.schema), patience);
    if (made) return {};
    auto failure = made.error();
    if (failure.sqlstate == "42501")
        failure.text += fmt::format("; let somebody who may run CREATE SCHEMA {} AUTHORIZATION our user",
                                    quoted_name(names.schema));
    return tl::unexpected(std::move(failure));
}

Answer<void> take_steps(Session& session, const Names& names, std::span<const Kept> all,
                        const sink::Patience& patience) {
    if (auto locked = session.run(std::string(take_lock), patience); !locked)
        return tl::unexpected(locked.error());
    if (auto made = make_schema(session, names, patience); !made) return made;
    auto made =
        session.run(fmt::format("CREATE TABLE IF NOT EXISTS {}(name text PRIMARY KEY, version integer "
                                "NOT NULL, since timestamptz NOT NULL DEFAULT now())",
                                names.versions()),
                    patience);
    if (!made) return tl::unexpected(made.error());
    auto versions = read_versions(session, names, all, patience);  // another gateway may have been faster
    if (!versions) return tl::unexpected(versions.error());
    for (std::size_t i = 0; i < all.size(); ++i)
        for (auto& step : all[i].steps) {
            if (step.version <= versions->at(i)) continue;
            auto sql = fmt::format(
                "{};\nINSERT INTO {} VALUES({}, {}) ON CONFLICT (name) DO UPDATE SET "
                "version = excluded.version, since = excluded.since",
                step.sql(names), names.versions(), quoted_text(all[i].name), step.version);
            if (auto done = session.run(sql, patience); !done) {
                auto failure = done.error();
                failure.text = fmt::format("{} could not be brought to version {}, it is as it was: {}",
                                           all[i].relation, step.version, failure.text);
                return tl::unexpected(std::move(failure));
            }
        }
    return session.commit(patience);
}

std::string column_list() {
    std::string out;
    for (auto& column : columns())
        out += (out.empty() ? "" : ", ") + quoted_name(column.name);
    return out;
}

}  // namespace

std::string quoted_name(std::string_view name) {
    std::string out = "\"";
    for (char c : name)
        out += c == '"' ? std::string("\"\"") : std::string(1, c);
    return out + '"';
}

// E'…' is read the same with and without standard_conforming_strings.
std::string quoted_text(std::string_view text) {
    std::string out = "E'";
    for (char c : text) {
        if (c == '\0') continue;
        if (c == '\'' || c == '\\') out += c;
        out += c;
    }
    return out + '\'';
}

Result<void> check_name(std::string_view setting, std::string_view name) {
    constexpr std::size_t longest = 48;
    auto letter = [](char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_'; };
    auto fine = [&](char c) { return letter(c) || (c >= '0' && c <= '9'); };
    if (name.empty() || name.size() > longest || !letter(name.front()) || !std::ranges::all_of(name, fine))
        return fail(fmt::format("{} = \"{}\" is no name for one", setting, printable(name)),
                    fmt::format("letters, digits and _, no digit in front, at most {}", longest));
    if (setting == "schema" && (name.starts_with("pg_") || name == "information_schema"))
        return fail(fmt::format("schema = \"{}\" belongs to PostgreSQL", name));
    for (std::string_view ours : {"gantry_versions", "tag_presence", "present_tags"})
        if (setting == "table" && name == ours)
            return fail(fmt::format("table = \"{}\" has another meaning here", name));
    return {};
}

Kept kept_events(const Names& names) {
    return {"events " + names.table, names.events(), event_steps};
}
Kept kept_presence(const Names& names) {
    return {"present_tags", names.tag_presence(), presence_steps};
}

Answer<void> migrate(Session& session, const Names& names, std::span<const Kept> all,
                     const sink::Patience& patience) {
    auto versions = read_versions(session, names, all, patience);
    if (!versions) return tl::unexpected(versions.error());
    if (is_current(*versions, all)) return {};
    if (auto begun = session.run("BEGIN", patience); !begun) return tl::unexpected(begun.error());
    auto done = take_steps(session, names, all, patience);
    if (!done && session.connected()) (void)session.run("ROLLBACK", patience);
    return done;
}

std::string create_staging() {
    std::string out = "CREATE TEMPORARY TABLE gantry_staging(";
    for (auto& column : columns())
        out += fmt::format("{} {}, ", quoted_name(column.name), column.type);
    return out + "epoch bigint) ON COMMIT DELETE ROWS";
}

std::string copy_into_staging() {
    return fmt::format("COPY pg_temp.gantry_staging({}, epoch) FROM STDIN (FORMAT binary)", column_list());
}

// The key is named: a row that another unique index of somebody's refuses is not silently dropped.
std::string insert_events(const Names& names) {
    auto list = column_list();
    return fmt::format(
        "INSERT INTO {}({}) SELECT {} FROM pg_temp.gantry_staging ON CONFLICT (\"id\", \"time\") DO NOTHING",
        names.events(), list, list);
}

// Of each tag at each place the newest event counts, whenever it comes. A reader without a zone is a place of
// its own.
std::string update_presence(const Names& names, std::string_view gateway) {
    constexpr std::string_view values =
        "technology, epc, zone, reader, antenna, first_seen, last_seen, reads, rssi_dbm, pc, xpc";
    constexpr std::string_view changes =
        "present = excluded.present, epoch = excluded.epoch, seq = excluded.seq, technology = "
        "excluded.technology, epc = excluded.epc, zone = excluded.zone, reader = excluded.reader, antenna = "
        "excluded.antenna, first_seen = excluded.first_seen, last_seen = excluded.last_seen, reads = "
        "excluded.reads, rssi_dbm = excluded.rssi_dbm, pc = excluded.pc, xpc = excluded.xpc, updated = "
        "excluded.updated";
    return fmt::format(R"(INSERT INTO {0} AS known(gateway, place, tag, present, epoch, seq, {1})
SELECT DISTINCT ON (place, tag) {2}, place, tag, type NOT IN ('tag.lost', 'tag.purged'), epoch, seq, {1}
FROM (SELECT *, CASE WHEN zone IS NOT NULL THEN 'zone ' || zone
                     WHEN reader IS NOT NULL THEN 'reader ' || reader ELSE '' END AS place
      FROM pg_temp.gantry_staging
      WHERE tag IS NOT NULL AND type IN
            ('tag.new', 'tag.glimpsed', 'tag.observed', 'tag.moved', 'tag.lost', 'tag.purged')) AS told
ORDER BY place, tag, epoch DESC, seq DESC
ON CONFLICT (gateway, place, tag) DO UPDATE SET {3}
WHERE (known.epoch, known.seq) < (excluded.epoch, excluded.seq))",
                       names.tag_presence(), values, quoted_text(gateway), changes);
}

std::string forget_gone_tags(const Names& names, std::string_view gateway) {
    return fmt::format(
        "DELETE FROM {} WHERE gateway = {} AND NOT present AND updated < now() - interval '30 days'",
        names.tag_presence(), quoted_text(gateway));
}

}  // namespace gantry::sinks::postgres
