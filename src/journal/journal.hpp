#pragma once
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.hpp"
#include "event/event.hpp"
#include "journal/dead_letter.hpp"
#include "journal/job_row.hpp"
#include "reader/observation.hpp"

// The journal is the truth: what it has committed survives the process and the power. One SQLite file (WAL,
// synchronous FULL), one writing thread. Public are the views `events` and `present_tags`; everything behind
// them may change with a migration.
namespace gantry::journal {

using Seq = std::uint64_t;
using ReadPointId = std::uint32_t;

enum class OnFull : std::uint8_t { hold_readers, drop_oldest };

struct Options {
    std::filesystem::path path;  // .../gantry.db; made with mode 0600
    std::chrono::microseconds keep = std::chrono::days{30};
    std::uint64_t max_size = 8ull << 30;  // bytes of the database file
    OnFull on_full = OnFull::hold_readers;
    // The sinks there are. What every one of their cursors has passed may go when space is short; a cursor of
    // any other name holds nothing back.
    std::vector<std::string> sinks = {};
};

// A row of presence as it is stored. Zone and readers by name: numbers are the process's own.
struct PresenceRow {
    std::uint64_t id = 0;
    event::TagId tag;
    event::Technology technology{};
    std::uint8_t state = 0;  // presence::State
    std::string zone_key;    // the host's key of the zone, also for readers without one
    std::string zone;        // as events show it; may be empty
    std::string reader, antenna;
    std::uint16_t antenna_number = 0;
    std::uint16_t pc = 0;  // this and the next as in Event
    std::uint32_t xpc = 0;
    event::Rssi rssi;
    std::uint64_t reads = 0;
    Wall first_seen{}, last_seen{};
    bool first_is_new = true;
    std::vector<std::string> readers;  // all that saw it in this life
};

// One tag.read on its way to a batch: fixed size, tag ids and names by number. Reads with bank data go in as
// events.
struct Read {
    Seq seq = 0;
    Wall time{};
    ReadPointId read_point = 0;
    bool possible_repeat = false;
    Observation observation;
};

// One commit: all of it or nothing. Order between events and reads is that of seq; together they must have
// every number from last_seq() + 1 to next_seq - 1 once, each list in rising order. Times outside 1970 to
// 9999 are stored as the nearest time inside.
struct Batch {
    Wall time{};  // of the commit; stored with it
    Seq next_seq = 1;
    std::vector<event::Event>
        events;  // epc, gs1 and link are filled from the tag when read back: leave them empty
    std::vector<Read> reads;
    std::vector<PresenceRow> presence;                 // insert or replace by id
    std::vector<std::uint64_t> presence_deleted;       // by id
    std::vector<std::pair<std::string, Bytes>> marks;  // reader name, Report::mark
    std::vector<std::pair<std::string, Seq>> cursors;  // sink name, everything up to here is delivered
    std::vector<DeadLetter> dead_letters;              // insert or replace by sink and seq
    std::vector<std::pair<std::string, Seq>> dead_letters_deleted;  // sink name, seq of the event
    std::vector<JobRow> jobs;                                       // insert or replace by id, in this order
    std::vector<std::pair<std::string, bool>> reading;  // reader name, is it to read (Job StopReading)

    Seq take_seq() { return next_seq++; }
    bool empty() const;
    void clear();  // keeps next_seq and the memory
};

struct StoreError {
    enum class Kind : std::uint8_t {
        full,     // the disk or max_size: nothing is damaged, try again when there is space
        io,       // reading or writing failed: reopen() before anything else
        corrupt,  // the file is damaged
        foreign,  // the file is another program's
        other,
    };
    Kind kind = Kind::other;
    Error error;
};
template <class T>
using StoreResult = tl::expected<T, StoreError>;

// What retention did in one slice.
struct Retained {
    std::uint64_t deleted = 0;       // events deleted because of age, or delivered and space was short
    std::uint64_t dropped = 0;       // events deleted that no rule but drop_oldest allowed: now untold()
    Wall dropped_since{};            // time of the oldest dropped
    std::uint64_t dead_letters = 0;  // deleted because there were too many
    bool more = false;               // call again soon
};

// The scope of the overflow events that tell what drop_oldest has deleted.
inline constexpr std::string_view store_scope = "store";

// Jobs that have ended are deleted by age as events are, and beyond this number. The newest one stays.
inline constexpr std::uint64_t max_jobs = 10'000;

// What drop_oldest has deleted and no stored event tells: stored with the deletion itself. The commit of an
// overflow event of store_scope takes that event's count off; when such an event is dropped in its turn, what
// it told is untold again. So what is stored, told and untold is at any time all there was, but for what went
// because of age or because every sink has it.
struct Untold {
    std::uint64_t count = 0;
    Wall since{};  // time of the oldest; only with a count
};

// The writing end. Used by one thread at a time.
class Journal {
public:
    static StoreResult<std::unique_ptr<Journal>> open(const Options& options);
    ~Journal();

    // Identity. The id is made once (or set by the configuration) and kept.
    std::string gateway_id() const;
    StoreResult<void> set_gateway_id(std::string_view id);
    // Of events to come: "<gateway id>:" or "<gateway id>:<epoch>:".
    std::string id_prefix() const;
    // Events to come get ids that begin with `epoch`, which must be higher than any that was used before, and
    // numbers from `next_seq` or from where they are, whichever is more. Those stored keep their ids.
    StoreResult<void> raise_epoch(std::uint64_t epoch, Seq next_seq);

    Seq last_seq() const;      // the next event's number less one; 0: none yet
    Wall last_commit() const;  // its time; the epoch: none yet

    // The number of a reader, antenna and zone as events show them; stored with the next commit.
    ReadPointId read_point(std::string_view reader, std::string_view antenna, std::string_view zone);

    // Writes the batch in one transaction and syncs it. On success the batch is cleared. On failure nothing
    // of it is stored as far as anyone can see, and the batch is untouched: after `full` call again later,
    // after `io` reopen() first. reopen() finds out whether the failed commit did reach the disk after all,
    // so that a batch is never stored twice (it compares seq) and never lost.
    StoreResult<void> commit(Batch& batch);
    StoreResult<void> reopen();

    // Writes into each table where it grows, and takes it back. An error: because of damage nothing could be
    // stored. Whatever else is in the way is for commit() to find.
    StoreResult<void> try_to_append();

    // State for a restart.
    StoreResult<void> load_presence(const std::function<void(const PresenceRow&)>& each);
    std::uint64_t max_presence_id() const;
    // Empty: none. An error: there is or may be one, and what it says cannot be known.
    StoreResult<Bytes> mark(std::string_view reader) const;
    std::optional<Seq> cursor(std::string_view sink) const;
    std::vector<std::string> sinks_with_cursor() const;
    // Oldest first. A job whose row is damaged comes as one of unknown end, without a time: the row goes by
    // age only when it is stored again with one.
    StoreResult<void> load_jobs(const std::function<void(JobRow)>& each);
    StoreResult<std::vector<std::string>> stopped_readers();  // Batch::reading was false, last

    // Deletes what is too old or, when the file nears max_size, what the rules of Options allow; in small
    // slices. Never deletes past a cursor unless on_full is drop_oldest and nothing else helps.
    StoreResult<Retained> retain(Wall now);
    Untold untold() const;

    struct Size {
        std::uint64_t bytes = 0;       // in use, without free pages
        std::uint64_t file_bytes = 0;  // database and WAL on disk
    };
    Size size() const;

    // Gives some free pages back to the file system, in a transaction of its own. True: there are more. An
    // error of a store that older programs made: it can only shrink as a whole (compact_store()).
    StoreResult<bool> compact();

    // As check_store(): the problems, one a line; empty when all is well.
    std::string check() const;

private:
    struct Impl;
    explicit Journal(std::unique_ptr<Impl> impl);
    std::unique_ptr<Impl> impl_;
};

// What a query wants. Empty members do not restrict.
struct Filter {
    Seq after = 0;  // seq > after
    Seq up_to = 0;  // seq <= up_to; 0: no bound
    std::vector<event::Type> types;
    std::string reader, zone;          // exact, or a pattern with *
    std::string tag;                   // hex prefix, upper case
    std::optional<Wall> since, until;  // time in [since, until)
    bool newest_first = false;
    // Without it a query ends with an error at what is not as it was stored. With it, it is told what that
    // is, each once, and the events that cannot be known are left out. What SQLite cannot read is an error
    // still.
    std::function<void(const std::string& what)> on_damage = {};
};

struct PresentTag {
    event::TagId tag;
    event::Technology technology{};
    std::string epc, zone, reader, antenna;
    Wall first_seen{}, last_seen{};
    std::uint64_t reads = 0;
    std::uint16_t pc = 0;  // this and the next as in Event
    std::uint32_t xpc = 0;
    event::Rssi rssi;
};

// What stands before the number in an event's id. One prefix for all events, unless the store was restored or
// the gateway's id was changed: then older events keep theirs.
class IdPrefixes {
public:
    IdPrefixes() = default;
    IdPrefixes(std::string newest, std::vector<std::pair<Seq, std::string>> earlier)
        : newest_(std::move(newest)), earlier_(std::move(earlier)) {}
    const std::string& of(Seq seq) const;
    const std::string& newest() const { return newest_; }

private:
    std::string newest_;
    std::vector<std::pair<Seq, std::string>> earlier_;  // up to this number; rising
};

// A reading end with a connection of its own: any thread or process, while the gateway writes. It goes
// straight to the tables behind the views and so is the fast way.
class Reader {
public:
    static StoreResult<std::unique_ptr<Reader>> open(const std::filesystem::path& path);
    ~Reader();

    StoreResult<IdPrefixes> id_prefixes() const;
    std::string id_prefix() const;  // of the newest events
    StoreResult<Seq> last_seq() const;
    // Changes whenever somebody committed: cheap to poll.
    StoreResult<std::uint64_t> version() const;
    // Calls `each` in order of seq with complete events (epc, gs1 and link filled) until it returns false.
    StoreResult<void> query(const Filter& filter, const std::function<bool(const event::Event&)>& each) const;
    // The newest `count` that match, oldest of them first.
    StoreResult<std::vector<event::Event>> newest(const Filter& filter, std::size_t count) const;
    StoreResult<void> present_tags(const std::function<bool(const PresentTag&)>& each) const;
    // Of one sink, in order of seq, from the first after `after`. A damaged row is left out, and an error
    // says so once all others were given.
    StoreResult<void> dead_letters(std::string_view sink, Seq after,
                                   const std::function<bool(const DeadLetter&)>& each) const;
    StoreResult<std::uint64_t> count_dead_letters(std::string_view sink) const;
    StoreResult<std::optional<Seq>> cursor(std::string_view sink) const;

private:
    struct Impl;
    explicit Reader(std::unique_ptr<Impl> impl);
    std::unique_ptr<Impl> impl_;
};

}  // namespace gantry::journal
