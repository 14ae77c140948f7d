#pragma once
#include <deque>

#include "protocols/harting/records.hpp"

// The data buffer of a virtual reader: first in, first out; a host clears what it has read (section 8).
namespace gantry::harting {

class DataBuffer {
public:
    explicit DataBuffer(std::size_t capacity) : capacity_(capacity) {}

    struct Set {
        TagRecord record;
        bool is_event = false;
    };
    bool add(Set set);  // false: it was full, and the set is lost
    void overflow();    // a set is lost
    // On request: a host that is about to clear what it read before must still hear of it.
    void overflow_and_tell();
    void told();  // a host has just heard that it overflowed
    std::size_t size() const { return sets_.size(); }
    std::size_t capacity() const { return capacity_; }
    std::size_t first_place() const { return first_; }  // in the table
    const Set& operator[](std::size_t index) const { return sets_[index]; }
    bool overflowed() const { return overflowed_; }  // since the last clear()

    void clear(std::size_t sets);   // a host has them
    void forget(std::size_t sets);  // the same without being told
    void initialize();              // [0x33]
    void power_down();

    // Where all the sets that were ever read have gone. `sent`: those that a host was given at least once.
    struct Tally {
        std::uint64_t stored = 0, sent = 0, cleared = 0, overflowed = 0, initialized = 0, lost_at_reset = 0;
        std::uint64_t unasked = 0;  // of the cleared: notified without acknowledgement
    };
    const Tally& tally() const { return tally_; }
    void was_sent(std::size_t sets);  // the first ones

private:
    std::size_t capacity_, first_ = 0;
    std::deque<Set> sets_;
    std::size_t sent_ = 0;  // of those at the front
    bool overflowed_ = false;
    bool to_tell_ = false;
    Tally tally_;
};

struct Setup;

// The data of a [0x22] reply: the first sets, at most `most`, and not more than fit into `room` bytes.
// Returns how many. `apart`: only sets of one kind, tags or events.
std::size_t append_sets(const DataBuffer& buffer, std::size_t most, bool apart, std::size_t room,
                        const Setup& setup, ByteView mac, Bytes& out);

}  // namespace gantry::harting
