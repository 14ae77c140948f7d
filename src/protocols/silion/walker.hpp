#pragma once
#include <optional>
#include <vector>

#include "base/bytes.hpp"
#include "reader/observation.hpp"
#include "wire/error.hpp"

namespace gantry::silion {

// What a walk over the data of a tag frame found.
struct Walked {
    std::uint32_t records = 0;   // whole records
    std::uint32_t unusable = 0;  // of these: their id is empty or longer than a tag's id can be; not appended
    std::uint64_t reads = 0;     // behind the observations that were appended
    bool wide = false;           // the bank length had two bytes
    // The records do not end where the data end. What was whole is delivered all the same.
    std::optional<wire::Fault> fault;
};

// The hot path: one pass over the data segment of a TagUpload or TagFirstSeen, no allocation but the growth
// of what the caller owns. Appends an observation a record; bank data go into `bank`, where the observations
// point to. `base` is the offset of `data` in its frame, for the fault.
Walked walk_tags(ByteView data, std::size_t base, std::vector<Observation>& out, Bytes& bank);

}  // namespace gantry::silion
