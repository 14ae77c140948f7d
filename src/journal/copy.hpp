#pragma once
#include "journal/upkeep.hpp"

namespace gantry::journal {

// Makes the empty file `to` a copy of the database `from` as it is at one moment: one file, without a log.
// Refuses what is no store, or one of a newer program.
StoreResult<void> copy_database(const std::filesystem::path& from, const std::filesystem::path& to,
                                const Progress& progress);

}  // namespace gantry::journal
