#pragma once
#include <deque>
#include <optional>

#include "base/time.hpp"
#include "reader/digest.hpp"
#include "reader/driver.hpp"

namespace gantry::silion {

// Tells a repeat of a tag frame from a new one, and says what to acknowledge (docs/protocols/silion.md
// section 8). It sees only frames that ask for an acknowledgement, and the fact that others came.
class Repeats {
public:
    // `line`: a serial one, whose reader does not see that we come and go.
    explicit Repeats(std::chrono::microseconds ack_wait, bool line = false);

    void start(Steady now) { started_ = now; }
    // What was committed last for this reader, before this connection; `unreadable`: that is not known.
    void know(ByteView mark, bool unreadable = false);

    // Reading goes on after a hold that began at `held`. What lies in the socket by then was sent before any
    // acknowledgement of ours, however often the reader repeated it.
    void resumed(Steady held, Steady now);

    enum class Verdict : std::uint8_t {
        fresh,
        repeat,
        undecided,  // equal to what was committed last, but too late to say; or that is not known: keep it,
                    // marked
    };
    struct Judgement {
        Verdict verdict = Verdict::fresh;
        bool acknowledge = false;  // now: it is a repeat whose acknowledgement must have been lost
    };
    Judgement judge(const Digest& frame, Steady now);

    void took(const Digest& frame, Ticket ticket,
              Steady now);  // a frame that is no repeat went into a report
    // A tag frame without the wish for an acknowledgement, or a heartbeat, inputs or a fault: a reader that
    // waits sends none of these, so the last acknowledgement has arrived.
    void other_upload(bool tags);
    std::size_t committed(Ticket ticket, Steady now);  // returns the acknowledgements to send, in order

    // True once when the stored mark has to go: the acknowledgement has arrived, so an equal frame will be a
    // new one, on whatever connection.
    bool take_clear();
    bool clear_due() const { return clear_due_; }

private:
    struct Waiting {
        Digest frame;
        Ticket ticket;
        Steady arrived;     // last
        bool alone = true;  // nothing came since that a waiting reader would not send
    };
    struct Last {
        Digest frame;
        Steady arrived;  // last
        Steady acknowledged;
        bool alone = true;
    };

    void not_alone();

    std::chrono::microseconds earliest_, latest_;  // of a repeat, after the arrival before it
    std::chrono::microseconds at_start_;  // a repeat of what came before this connection comes by then
    Steady started_{};
    Steady earliest_answer_{};        // no acknowledgement went out before
    std::optional<Steady> piled_up_;  // a hold long enough to hold repeats ended then
    std::optional<Digest> known_;
    bool unreadable_ = false;      // something may be known, but not what
    bool first_tags_ = true;       // no tag frame yet on this connection
    std::deque<Waiting> waiting_;  // whose tickets are open
    std::optional<Last> last_;     // acknowledged last on this connection
    bool mark_stored_ = false;
    bool clear_due_ = false;
};

}  // namespace gantry::silion
