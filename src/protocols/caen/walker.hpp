#pragma once
#include <cstdint>
#include <optional>
#include <vector>

#include "base/bytes.hpp"
#include "reader/observation.hpp"
#include "wire/error.hpp"

namespace gantry::caen {

// What a walk over tag reports found.
struct Walked {
    std::uint32_t tags = 0;
    std::uint32_t unusable = 0;           // their id is empty, too long, or not all there; not appended
    std::optional<std::uint16_t> result;  // the ResultCode, if one came
    std::optional<wire::Fault> fault;     // what came before it is delivered all the same
};

// The hot path: one pass over the pairs of RawReadIDs, InventoryTag and notification replies (sections 6, 7
// and 9), no allocation but the growth of what the caller owns. A tag starts at each TagID and takes the
// source, read point, time, type and TagIDLen that came last (revision 4 pads ids to 12 bytes, of which
// TagIDLen count); what follows it (RSSI, TID, XPC, PC) is its own. Keeps
// its state between calls, so that the pairs of a framed stream may come in pieces of whole pairs.
class TagWalker {
public:
    // Of tags whose type is not said: compact replies, RawReadIDs and notifications.
    explicit TagWalker(event::Technology technology = event::Technology::unknown) : fallback_(technology) {}
    void set_technology(event::Technology technology) { fallback_ = technology; }
    void restart();  // a new message: what came last is forgotten

    // `pairs`: after the header. `base`: their offset in the frame, for the fault. TIDs go into `data`. What
    // belongs to the last tag of the call before is given to it if `out` is still as that call left it.
    // `events`, if not null, gets the EventType of each observation (0: none).
    Walked walk(ByteView pairs, std::size_t base, std::vector<Observation>& out, Bytes& data,
                std::vector<std::uint8_t>* events = nullptr);

private:
    static constexpr std::size_t not_said = SIZE_MAX;

    event::Technology fallback_;
    event::Technology type_ = event::Technology::unknown;
    bool has_type_ = false;
    std::uint16_t antenna_ = Observation::no_antenna;
    std::int64_t time_us_ = 0;
    std::size_t said_size_ = not_said;  // TagIDLen: of the ids that follow
    std::size_t open_ = 0;  // size of `out` when the last call ended in a tag: its last one may go on
};

// "Ant2" is 2; anything else no_antenna.
std::uint16_t antenna_number(std::string_view read_point);

}  // namespace gantry::caen
