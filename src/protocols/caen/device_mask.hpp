#pragma once
#include <optional>

#include "reader/air.hpp"

namespace gantry::caen {

// Which tags are meant: those whose memory has these bits there (section 7). Without a bank bits count from
// the start of the id, which every kind of tag has; with one from the start of that bank, in Gen2 tags only.
struct TagMask {
    std::optional<Bank> bank;
    std::uint32_t first_bit = 0, bits = 0;
    Bytes bytes;  // at least `bits` of them

    bool matches(Air& air, const AirAccess& tag, event::Technology technology) const;
};

}  // namespace gantry::caen
