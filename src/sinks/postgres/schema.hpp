#pragma once
#include <span>
#include <string>
#include <string_view>

#include "sinks/postgres/session.hpp"

// Tables of ours in somebody's database: what they are called, and how they come to be what they are.
namespace gantry::sinks::postgres {

// Quoted for SQL.
std::string quoted_name(std::string_view name);
std::string quoted_text(std::string_view text);

// Of a schema or a table: letters, digits and _, at most 48, so that no name that is made of it is cut off.
Result<void> check_name(std::string_view setting, std::string_view name);

struct Names {
    std::string schema, table;  // as configured
    std::string events() const { return quoted_name(schema) + "." + quoted_name(table); }
    std::string tag_presence() const { return quoted_name(schema) + ".tag_presence"; }
    std::string present_tags() const { return quoted_name(schema) + ".present_tags"; }
    std::string versions() const { return quoted_name(schema) + ".gantry_versions"; }
};

// One step of one thing that we keep, from version - 1 to version. Once released a step is never changed.
struct Migration {
    int version;
    std::string (*sql)(const Names& names);
};
// Something with a version of its own, as a row of gantry_versions says.
struct Kept {
    std::string name;      // in gantry_versions
    std::string relation;  // without a version, nothing of this name may be there
    std::span<const Migration> steps;
};
Kept kept_events(const Names& names);
Kept kept_presence(const Names& names);  // tag_presence, and present_tags, the view of it

// Brings each to its last version, all in one transaction and under a lock, so that two gateways may do it
// at once. Refuses what a newer program, or somebody else, has made. Only looks if there is nothing to do.
Answer<void> migrate(Session& session, const Names& names, std::span<const Kept> all,
                     const sink::Patience& patience);

// The table of the session that a batch is copied into first, and what makes rows of the rest out of it.
std::string create_staging();
std::string copy_into_staging();
std::string insert_events(const Names& names);
std::string update_presence(const Names& names, std::string_view gateway);
// Tags that are gone are remembered for a while, so that an old event does not bring them back.
std::string forget_gone_tags(const Names& names, std::string_view gateway);

}  // namespace gantry::sinks::postgres
