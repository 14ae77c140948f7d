#pragma once
#include <optional>

#include "base/bytes.hpp"
#include "base/time.hpp"
#include "reader/digest.hpp"

namespace gantry::harting {

// Data sets that a reader sends again because we have not cleared them yet: those of the last [0x22] that are
// on disk, perhaps with new ones behind them. Sets with a time are told apart from new ones for sure;
// without, an equal set may be a new read, and is kept and marked as a possible repeat.
class Repeats {
public:
    // Of Report::mark: what was committed last, before this link.
    void know(ByteView mark, bool unreadable);
    // These sets were given to the host. Their mark goes into the report.
    Bytes took(ByteView sets, std::size_t count);
    // They are cleared in the reader: what comes next is new, also if it looks the same.
    void cleared() { last_.reset(); }
    // The reader was told to forget them. On this link it has heard that before it sends more.
    void answered() { answered_ = true; }
    void link_lost() { uncertain_ = true; }

    struct Judgement {
        std::size_t known_bytes = 0, known_sets = 0;  // at the front: on disk already
        bool possible = false;                        // it cannot be told: keep all, marked
    };
    // `sets`: the records of a reply; `timed`: they carry a time.
    Judgement judge(ByteView sets, std::size_t count, bool timed) const;

private:
    struct Last {
        Digest digest;  // of all bytes; its size says how many
        std::uint16_t count = 0;
    };
    std::optional<Last> last_;
    bool answered_ = false;
    bool uncertain_ =
        false;  // last_ comes from an earlier link: perhaps it was cleared, and nobody heard of it
    bool unreadable_ = false;  // what is on disk is not known
};

}  // namespace gantry::harting
