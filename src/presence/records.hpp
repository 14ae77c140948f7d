#pragma once
#include <bit>
#include <limits>
#include <memory>
#include <vector>

#include <boost/unordered/unordered_flat_map.hpp>
#include <boost/unordered/unordered_flat_set.hpp>

#include "presence/deadlines.hpp"
#include "presence/presence.hpp"
#include "presence/reader_sets.hpp"

namespace gantry::presence {

inline constexpr RecordIndex no_record = 0xFFFF'FFFF;

// A record with what its timers need. What a sighting touches lies in the first two cache lines: with
// 100,000 tags present, memory is most of what a sighting costs.
struct alignas(64) Slot {
    static constexpr auto never_observed = std::numeric_limits<std::int64_t>::min();

    Steady queued = never;  // its entry among the deadlines, at or before the true one; never: has no entry
    Steady since{};         // the running timer counts from here: the last sighting, or the loss
    Steady::duration frozen{};     // what the clock of its set said then
    RecordIndex next = no_record;  // the same tag in another zone
    SetIndex set = 0;
    bool changed = false;  // its id waits in the list of changes
    bool stored = false;   // the host has been told of it
    Record record;
    Steady first{};                                // the first sighting of this life
    std::int64_t observed_order = never_observed;  // grows with every tag.observed
    RecordIndex lost_before = no_record, lost_after = no_record;
};
static_assert(sizeof(Slot) == 192);

// All records, in slots that are used again, found by tag or by id. It knows no rules.
class Records {
public:
    Records();
    Records(const Records&) = delete;
    Records& operator=(const Records&) = delete;

    std::size_t size() const { return by_id_.size(); }
    Slot& operator[](RecordIndex at) { return chunks_[at / chunk_size][at % chunk_size]; }
    const Slot& operator[](RecordIndex at) const { return chunks_[at / chunk_size][at % chunk_size]; }

    RecordIndex first_of(const event::TagId& tag) const;  // then along Slot::next
    RecordIndex with_id(std::uint64_t id) const;
    RecordIndex add(const Record& record);  // its id, and its tag and zone, must be new
    void remove(RecordIndex at);            // not while it is in the line of the lost

    // Records in the order in which they were lost.
    void lost(RecordIndex at);
    void found(RecordIndex at);
    RecordIndex longest_lost() const { return lost_first_; }

    // A mark on each record, taken round the whole pool so that every marked one has its turn.
    void mark(RecordIndex at) { marks_[at / 64] |= std::uint64_t{1} << at % 64; }
    void unmark(RecordIndex at) { marks_[at / 64] &= ~(std::uint64_t{1} << at % 64); }
    template <class Wanted>
    void take_marked(std::size_t max, const Wanted& wanted);

    template <class Each>
    void for_each(const Each& each) {
        for (auto& [id, at] : by_id_)
            each(at);
    }

private:
    static constexpr std::size_t chunk_size = 512;
    // The set of first records is searched by tag: no tag is kept twice.
    struct Hash {
        using is_transparent = void;
        using is_avalanching = void;
        const Records* records;
        std::size_t operator()(const event::TagId& tag) const noexcept { return event::TagIdHash{}(tag); }
        std::size_t operator()(RecordIndex at) const noexcept { return (*this)((*records)[at].record.tag); }
    };
    struct Equal {
        using is_transparent = void;
        const Records* records;
        const event::TagId& tag(RecordIndex at) const { return (*records)[at].record.tag; }
        const event::TagId& tag(const event::TagId& id) const { return id; }
        template <class A, class B>
        bool operator()(const A& a, const B& b) const noexcept {
            return tag(a) == tag(b);
        }
    };

    std::vector<std::unique_ptr<Slot[]>> chunks_;
    std::vector<RecordIndex> unused_;
    boost::unordered_flat_set<RecordIndex, Hash, Equal> by_tag_;
    boost::unordered_flat_map<std::uint64_t, RecordIndex> by_id_;
    RecordIndex lost_first_ = no_record, lost_last_ = no_record;
    std::vector<std::uint64_t> marks_;
    std::size_t turn_ = 0;  // the mark to go on with
};

// Calls wanted(index) for up to `max` marked records, from where the last call stopped, and takes the mark of
// those for which it returns true.
template <class Wanted>
void Records::take_marked(std::size_t max, const Wanted& wanted) {
    auto from = turn_;
    for (std::size_t words = 0; words <= marks_.size() && !marks_.empty() && max > 0; ++words) {
        auto word = from / 64 % marks_.size();
        // The first word comes up twice: from the bit to go on with, and last of all up to it.
        auto left = marks_[word] & ~std::uint64_t{} << from % 64;
        if (words == marks_.size()) left = marks_[word] & ~(~std::uint64_t{} << turn_ % 64);
        for (; left != 0 && max > 0; left &= left - 1) {
            auto at = static_cast<RecordIndex>(word * 64) + static_cast<RecordIndex>(std::countr_zero(left));
            from = at + 1;
            if (!wanted(at)) continue;
            unmark(at);
            --max;
        }
        if (max > 0) from = (word + 1) * 64;
    }
    turn_ = from;
}

}  // namespace gantry::presence
