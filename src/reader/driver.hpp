#pragma once
#include <array>
#include <string>
#include <variant>
#include <vector>

#include "reader/job.hpp"
#include "reader/observation.hpp"
#include "reader/party.hpp"

namespace gantry {

// Numbers a driver's reports, from 1, growing by one.
using Ticket = std::uint64_t;

// Things a reader says beside tags. They become events as they are.
struct FaultNotice {
    std::int64_t code = 0;
    std::string text;  // printable
    Bytes bytes;       // the frame it is about, if that must be kept
};
struct InputNotice {
    std::uint16_t input = 0;  // from 1
    bool state = false;
};
struct OverflowNotice {
    std::string scope;                        // what overflowed: "reader buffer"
    std::optional<std::uint64_t> count = {};  // what was lost; nothing: the reader does not say
};
struct ClockNotice {
    std::chrono::microseconds by{};  // the reader's clock minus where it should be
};
using Notice = std::variant<FaultNotice, InputNotice, OverflowNotice, ClockNotice>;

// One unit of safety: stored whole and in one commit; then the host calls committed(ticket), and only then
// does the driver acknowledge, clear or answer. Every report has a ticket, whether or not the reader waits
// for one: open tickets are the back-pressure.
struct Report {
    Ticket ticket = 0;
    Now received{};
    std::vector<Observation> observations;
    Bytes data;                    // bank data the observations point into
    std::vector<Notice> notices;   // after the observations, in order
    bool possible_repeat = false;  // a crash left open whether these reads are already stored
    // What the driver wants to know again at its next start for this reader (say, a digest of the frame),
    // stored in the same commit. Nothing: leave what is stored. A report that will be acknowledged has one.
    std::optional<Bytes> mark;
};

// Things the host must know that are not stored.
struct Identified {    // who is at the other end; a driver whose reader dials in says this before any report
    std::string name;  // as the reader sent it: hostile, up to 255 bytes, may be empty
};
struct Described {  // for people, whenever it changes; printable
    std::string model, firmware, detail;
};
struct JobEnded {
    JobId job = 0;
    JobResult result;
};
using Signal = std::variant<Identified, Described, JobEnded>;

// One counter per reason, so that every refusal shows.
enum class Count : std::uint8_t {
    frames,        // good frames received
    bytes,         // bytes received
    reads,         // tag reads reported, repeats not counted
    acknowledged,  // acknowledgements sent
    repeats,       // frames recognised as repeats
    bad_checksum,
    bad_length,
    malformed,  // framed well, but the data inside do not parse
    unknown_code,
    skipped_bytes,  // thrown away while looking for the next frame
    resyncs,
    timeouts,    // answers that did not come
    departures,  // tags that a reader told as lost or purged: not reads
    count_
};
inline constexpr std::size_t count_size = static_cast<std::size_t>(Count::count_);
std::string_view to_text(Count count);
using Counters = std::array<std::uint64_t, count_size>;

// What the host gives a driver when the link comes up.
struct Known {
    Bytes mark;                   // the last Report::mark stored for this reader; empty: none
    bool mark_from_disk = false;  // the process was restarted since it was stored
    // There is or may be one, but the store is damaged there: what was stored last is not known.
    bool mark_unreadable = false;
    bool reading = true;  // false: somebody stopped the reader (StopReading)
};

// A job as the host gives it to a driver.
struct JobOrder {
    JobId id = 0;
    Steady deadline{};
    // It was sent once over a link that broke before the answer: what changes something is looked at first
    // (read back) and done only where that shows that it was not done.
    bool again = false;
};

// The gateway's end of a dialog with one reader.
class Driver : public Party {
public:
    // A driver whose reader dials in is made before anyone knows who that is. After it has signalled
    // Identified, the host either closes the link or calls this; until then no report is taken. Other drivers
    // get it before start().
    virtual void admitted(const Known& known, Now now) = 0;
    virtual void committed(Ticket ticket, Now now) = 0;  // this and all earlier reports are on disk
    virtual void run(const JobOrder& order, const Job& job, Now now) = 0;
    virtual void cancel(JobId id, Now now) = 0;
    // Ends every job under way with `unknown` or `cancelled`: the link is gone.
    virtual void link_lost(Now now) = 0;

    // The end of a second link on which the reader dials in with notifications; nullptr: this make or these
    // settings have none. What it says comes out of reports() and signals() here. One at a time: it is told
    // link_lost() before it is started again.
    virtual SideParty* notifications() { return nullptr; }

    // True while the driver wants no tag input because its tickets are open: it is stalled, not silent.
    virtual bool stalled() const = 0;
    // Why finished() is true, for people; empty when nothing is to be added to the reason of the link.
    virtual std::string_view finish_reason() const = 0;

    std::vector<Report>& reports() { return reports_; }  // the host drains both after every call
    std::vector<Signal>& signals() { return signals_; }
    const Counters& counters() const { return counters_; }

protected:
    void count(Count which, std::uint64_t by = 1) { counters_[static_cast<std::size_t>(which)] += by; }
    std::vector<Report> reports_;
    std::vector<Signal> signals_;

private:
    Counters counters_{};
};

}  // namespace gantry
