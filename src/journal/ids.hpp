#pragma once
#include "journal/stored.hpp"

// Which ids events have: those of the store's state, but for events from before a restore or a change of the
// gateway's id.
namespace gantry::journal {

StoreResult<IdPrefixes> read_id_prefixes(Database& db);
// Where numbers were left out when a restore went on behind those of the store it replaced.
StoreResult<std::vector<EarlierIds>> read_earlier_ids(Database& db);

}  // namespace gantry::journal
