#pragma once
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "journal/journal.hpp"

// What is done with a whole store now and then. `path` is always that of gantry.db.
namespace gantry::journal {

// Called often with how much of the work is done; false ends it, and the error then says that it was stopped.
using Progress = std::function<bool(std::uint64_t done, std::uint64_t all)>;

// What a store holds, and what is wrong with it.
struct Checked {
    int version = 0;           // of its schema
    std::uint64_t bytes = 0;   // of the file
    std::string id_prefix;     // of events to come
    std::uint64_t events = 0;  // that are there, tag.read among them
    Seq last_seq = 0;
    std::uint64_t deleted = 0;  // numbers up to last_seq whose events retention has deleted
    std::uint64_t problem_count = 0;
    std::vector<std::string> problems;  // the first of them, one line each

    static constexpr std::size_t most_problems = 20;
    bool sound() const { return problem_count == 0; }
};

// Whether all is as it was stored: SQLite's pages, the checksum of every row, that what rows refer to is
// there, that no number is missing but for deleted events, and that the views are what they should be. Only
// reads, slice by slice, so that it may run beside the gateway for as long as it takes. An error: it could
// not be looked at at all; Kind::corrupt if because of damage.
StoreResult<Checked> check_store(const std::filesystem::path& path, const Progress& progress = {});

// Writes a copy of the store as it is at one moment, checks it and syncs it; only then it gets the name
// `backup`. One file, mode 0600. The gateway may run; its log is not emptied as long as the copying takes.
StoreResult<Checked> back_up(const std::filesystem::path& path, const std::filesystem::path& backup,
                             bool replace, const Progress& progress = {});

// Puts a store that was taken aside, or a backup, in the place of the store. Nobody else may use the store.
struct RestoreOptions {
    Wall now{};            // for an epoch, where those before are not known
    bool another = false;  // although the store in place is of a gateway with another id
};
struct Restored {
    Checked backup;  // as it was, brought to this program's version
    std::uint64_t epoch = 0;
    std::string id_prefix;        // of events to come
    Seq next_seq = 1;             // of the next event
    bool numbers_go_on = false;   // next_seq is higher than any number that was ever used
    std::filesystem::path aside;  // where the store before lies now; empty: there was none
};
StoreResult<Restored> restore(const std::filesystem::path& path, const std::filesystem::path& backup,
                              const RestoreOptions& options, const Progress& progress = {});
// Ends a restore that was cut off when it was decided already. Before anybody opens the store to write.
StoreResult<void> finish_restore(const std::filesystem::path& path);

// Opens the store; one that is damaged so that it cannot be used is set aside, whole, and a new one begun. An
// error of Kind::corrupt: too many have been set aside already.
struct Opened {
    std::unique_ptr<Journal> journal;
    std::filesystem::path aside;  // where the damaged store lies; empty: all was well
    std::string damage;           // what was wrong with it
};
StoreResult<Opened> open_or_set_aside(const Options& options, Wall now);
// Directories beside the store that hold what was set aside.
std::vector<std::filesystem::path> stores_set_aside(const std::filesystem::path& path);

// Gives all free pages back to the file system, with nobody else using the store. One that older programs
// made is written anew for it, which takes twice its room for a while.
struct Compacted {
    std::uint64_t bytes_before = 0, bytes_after = 0;
};
StoreResult<Compacted> compact_store(const std::filesystem::path& path, const Progress& progress = {});

// Brings the store to the schema of an older program. Nobody else may use it. What that program has no place
// for is listed; with any of it and without `lose` nothing is changed.
struct Downgraded {
    int from = 0, to = 0;
    std::vector<std::string> lost;  // "12 jobs"
    bool done = false;
};
StoreResult<Downgraded> downgrade_store(const std::filesystem::path& path, int to, bool lose);

}  // namespace gantry::journal
