#pragma once
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "journal/sqlite.hpp"

namespace gantry::journal {

// How a step is taken back. Every step but the first should have a way.
struct WayBack {
    const char* loses = nullptr;   // SELECT of count and what: of which the version below holds nothing
    const char* forget = nullptr;  // takes it out of rows that stay; their checksums are then made anew
    const char* drop = nullptr;    // the tables and columns themselves; none: there is no way back
};

// One step of the schema: from version - 1 to version. Once released a step is never changed. What a version
// adds to a row goes into its checksum only where it is not empty: rows of older versions stay good.
struct Migration {
    int version;
    const char* sql;
    WayBack back = {};
};
std::span<const Migration> migrations();
int schema_version();  // what this program writes and reads

// Brings the tables to the last version of `all` and the views to what this program says they are; all of
// it in one transaction, so that a failure leaves the file as it was. Refuses files of a newer program or of
// another one.
StoreResult<void> migrate(Database& db, std::span<const Migration> all);
// For readers, which change nothing.
StoreResult<void> expect_current_schema(Database& db);
// The version of the schema in the file; 0 when it is empty. Refuses as migrate() does.
StoreResult<int> stored_version(Database& db, int known);

// An error of Kind::corrupt where the tables and columns are not those that the steps make: a flipped bit in
// what SQLite keeps of a table's definition, or in the version, shows in no page and no row.
StoreResult<void> expect_shape(Database& db, std::span<const Migration> steps);

// What the version `to` has no place for, as downgrade() would take it out. Only what there is some of.
struct Loss {
    std::uint64_t count = 0;
    std::string what;
};
StoreResult<std::vector<Loss>> losses(Database& db, std::span<const Migration> all, int to);
// Brings the tables of the last version of `all` back to those of version `to`, in one transaction. The views
// go: the program of that version makes its own.
StoreResult<void> downgrade(Database& db, std::span<const Migration> all, int to);

std::string events_view();
std::string present_tags_view();

}  // namespace gantry::journal
