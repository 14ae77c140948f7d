#pragma once
#include <optional>
#include <span>
#include <vector>

#include <boost/unordered/unordered_flat_map.hpp>

#include "presence/presence.hpp"

namespace gantry::presence {

using RecordIndex = std::uint32_t;  // in the pool
using SetIndex = std::uint32_t;

// Some readers of one zone, with the records that exactly these have seen. The set is frozen while none of
// its readers is online; its clock says for how long in all, so that a cut cable costs nothing per record.
// A record whose deadline was reckoned during a freeze is parked: that holds only until the set thaws.
struct ReaderSet {
    ZoneIndex zone = 0;
    std::vector<ReaderIndex> readers;  // ascending
    std::uint32_t online = 0;          // how many of them are
    Steady since{};                    // the set froze or thawed last
    Steady::duration frozen{};         // in all, without the freeze under way
    std::vector<RecordIndex> members;  // parked ones first
    std::uint32_t parked = 0;

    bool is_frozen() const { return online == 0; }
    Steady::duration frozen_until(Steady at) const {
        return frozen + (is_frozen() && at > since ? at - since : Steady::duration{});
    }
    bool has(ReaderIndex reader) const;
};

class ReaderSets {
public:
    ReaderIndex add_reader();
    std::size_t readers() const { return readers_.size(); }

    // The set of exactly these readers in this zone; they may come in any order and twice.
    SetIndex intern(ZoneIndex zone, std::span<const ReaderIndex> readers, Steady now);
    const ReaderSet& operator[](SetIndex set) const { return sets_[set]; }
    std::span<const ReaderSet> all() const { return sets_; }  // some without readers: unused

    // The sets that this froze or thawed; valid until the next call. A frozen set lies still, so a time
    // before it froze counts as that time.
    std::span<const SetIndex> online(ReaderIndex reader, Steady now);
    std::span<const SetIndex> offline(ReaderIndex reader, Steady now);

    // Membership. A record is in one set at most.
    void join(SetIndex set, RecordIndex record);
    void leave(SetIndex set, RecordIndex record);
    void park(SetIndex set, RecordIndex record);
    void unpark(SetIndex set, RecordIndex record);
    bool is_parked(SetIndex set, RecordIndex record) const { return place_[record] < sets_[set].parked; }

private:
    struct KeyHash {
        std::size_t operator()(const std::vector<std::uint32_t>& key) const noexcept;
    };
    struct Reader {
        bool online = false;
        std::vector<SetIndex> sets;
    };
    void swap(ReaderSet& set, std::size_t a, std::size_t b);
    void sweep();

    std::vector<Reader> readers_;
    std::vector<ReaderSet> sets_;
    std::vector<SetIndex> unused_;
    std::size_t sweep_at_ = 64;
    boost::unordered_flat_map<std::vector<std::uint32_t>, SetIndex, KeyHash> by_key_;  // zone, readers
    std::vector<std::uint32_t> key_;
    std::vector<std::uint32_t> place_;  // by record: where in its set's members
    std::vector<SetIndex> changed_;
};

}  // namespace gantry::presence
