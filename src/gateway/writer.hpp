#pragma once
#include <atomic>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <unordered_map>
#include <vector>

#include "gateway/config.hpp"
#include "gateway/delivery.hpp"
#include "gateway/ring.hpp"
#include "gateway/roster.hpp"
#include "gateway/settled_clock.hpp"
#include "journal/journal.hpp"
#include "presence/presence.hpp"
#include "reader/driver.hpp"

namespace gantry::gateway {

using SessionId = std::uint64_t;

// What a loop hands to the writer, in order.
struct Item {
    enum class Kind : std::uint8_t {
        ask_known,  // what is known of the reader? For one that has not said a word yet
        reader_up,
        reader_down,
        report,
        lost,  // what the reader sent found no room; not answered
    } kind = Kind::report;
    std::uint32_t reader = 0;  // index in the roster
    SessionId session = 0;
    Report report;           // Kind::report
    std::string reason;      // Kind::reader_down
    Now at{};                // all but Kind::report
    std::uint64_t lost = 0;  // Kind::lost: reads
    Wall lost_since{};
};

// What the writer answers, once the item is on disk.
struct Answer {
    Item::Kind kind = Item::Kind::report;
    std::uint32_t reader = 0;
    SessionId session = 0;
    Ticket ticket = 0;  // Kind::report: this and all earlier ones of the session
    Known known;        // Kind::ask_known, reader_up
};

// How giving free pages of the store back to the file system goes, or went last.
struct Compaction {
    std::uint64_t number = 0;  // counts from 1; 0: there was none
    bool running = false;
    std::uint64_t bytes_before = 0, bytes_after = 0;  // of the store's files; 0: no slice is done yet
    std::optional<Error> error = {};                  // why it ended too early
};

// The single thread that owns presence and every write to the store. Loops push items into their channels;
// each turn of the writer takes all there is, runs it through presence, commits it as one batch, and answers.
class Writer {
public:
    struct Options {
        bool tag_read = false;
        presence::Rules rules;
        std::vector<ZoneConfig> zones;
        std::chrono::microseconds group_window = 2ms;  // how long the first of a batch waits for company
        // These rows of jobs are on disk; on the writer's thread.
        std::function<void(const std::vector<JobId>&)> jobs_stored = {};
        std::function<void()> committed = {};  // there are new events on disk; on the writer's thread
        // The store has taken nothing for so long (true), or takes data again (false); on the writer's
        // thread.
        std::chrono::microseconds patience = 5s;
        std::function<void(bool)> store_is_away = {};
    };

    Writer(std::unique_ptr<journal::Journal> journal, Roster& roster, Options options);
    ~Writer();

    // One channel a loop. `answer` is called on the writer's thread. Before start() only.
    class Channel {
    public:
        Channel(Writer& writer, std::function<void(std::vector<Answer>)> answer);
        // The loop's thread. False: full; the item is untouched, try again when an answer comes.
        bool push(Item& item);

    private:
        friend class Writer;
        Writer& writer_;
        Ring<Item> ring_;
        std::function<void(std::vector<Answer>)> answer_;
        std::vector<Answer> pending_;
        Steady taken_up_to_{};  // received time of the newest item taken
    };
    Channel& add_channel(std::function<void(std::vector<Answer>)> answer);

    // Any thread: stored with the next commit, in order.
    void store_job(journal::JobRow row);
    void store_reading(std::string reader, bool reading);
    void store_delivery(Delivery delivery);

    // Puts presence back from the store, then starts the thread.
    Result<void> start(Now now);
    // Takes what is in the channels, commits it and ends. What cannot be committed is not answered.
    void stop();

    struct Stats {
        std::uint64_t events = 0, reads = 0, commits = 0;
        std::uint64_t last_seq = 0;
        std::size_t present = 0;
        journal::Journal::Size size{};
        std::string trouble;  // why nothing can be stored right now; empty: all is well
    };
    Stats stats() const;
    const std::string& gateway_id() const { return gateway_id_; }

    // Any thread. Begins a compaction, which goes on in slices between commits; one that runs already goes
    // on.
    void compact();
    Compaction compaction() const;

private:
    struct Slot {  // one antenna of one reader
        bool known = false;
        presence::ZoneIndex zone = 0;
        journal::ReadPointId read_point = 0;
    };
    struct ReaderState {
        RosterEntry* entry = nullptr;
        presence::ReaderIndex presence = 0;
        std::vector<Slot> slots;  // by antenna number; the last one for "not said"
        Known known;
        bool known_read = false;
    };
    struct Zone {
        std::string key, name;  // key: unique; name: as events show it, may be empty
    };
    struct SeenReader {  // a reader as presence knows it: also one that is known only from the store
        std::string name;
        std::vector<std::pair<std::uint16_t, std::string>> antennas;  // number and name
    };

    void run();
    void take_turns();
    bool gather();
    bool gather_jobs();
    void take_deliveries();
    bool nothing_waits() const;
    void wake();
    void take(Channel& channel, Item& item);
    void take_report(Channel& channel, ReaderState& state, Item& item);
    void take_observation(ReaderState& state, const Report& report, const Observation& seen);
    void take_notice(ReaderState& state, Now at, const Notice& notice);
    void take_transitions();
    void advance_presence(Now now);
    bool commit(Now now);
    struct Hold {  // of one commit
        bool held = false, long_held = false;
        std::set<std::string> said;  // in the log: each cause once, however they take turns
        bool made_room = false;
        Steady since{};

        bool is_new(const std::string& text) { return said.size() < 16 && said.insert(text).second; }
    };
    bool wait_for_store(const journal::StoreError& error, Hold& hold);
    void say_that_it_is_away(Hold& hold);
    void store_deliveries();
    void set_trouble(std::string trouble);
    bool make_room(Hold& hold);
    void answer_all();
    void housekeeping(Now now);
    void log_retained(const journal::Retained& retained, Steady now);
    void say_dropped(Steady now);
    void tell_dropped(Wall now);
    void compact_slice();
    void read_mark(ReaderState& state);
    void store_presence(std::uint64_t id);
    void sleep_until(std::optional<Steady> deadline);
    void publish();
    Now presence_time(Now now) const { return {now.steady - stalled_for_, now.wall}; }

    ReaderState& reader(std::uint32_t index);
    Slot& slot(ReaderState& state, std::uint16_t antenna);
    presence::ZoneIndex zone(std::string_view key, std::string_view name);
    presence::ReaderIndex seen_reader(std::string_view name);
    std::string_view antenna_name(presence::ReaderIndex reader, std::uint16_t antenna) const;
    void name_antenna(presence::ReaderIndex reader, std::uint16_t antenna, std::string_view name);
    void restore(const journal::PresenceRow& row, Now now);
    event::Event& add_event(event::Type type, Wall time);

    std::unique_ptr<journal::Journal> journal_;
    Roster& roster_;
    Options options_;
    std::string gateway_id_;
    presence::Presence presence_;
    std::vector<std::unique_ptr<Channel>> channels_;
    std::vector<ReaderState> readers_;
    std::vector<SeenReader> seen_readers_;  // by presence's number
    std::unordered_map<std::string, presence::ReaderIndex> seen_by_name_;
    std::vector<Zone> zones_;  // by presence's number
    std::unordered_map<std::string, presence::ZoneIndex> zone_by_key_;
    journal::Batch batch_;
    std::vector<presence::Transition> transitions_;
    presence::Presence::Changes changes_;
    std::vector<std::uint64_t> stale_;
    std::vector<presence::ReaderIndex> seen_by_;
    std::vector<std::pair<std::uint32_t, Bytes>> new_marks_;
    std::optional<std::size_t> overflow_at_;  // of batch_.events: the one that tells what was dropped
    Steady::duration stalled_for_{};  // the store could not take anything: time that presence does not count
    Steady next_housekeeping_{};
    std::optional<SettledClock> age_clock_;  // from start() on
    std::size_t first_channel_ = 0;          // of the next round
    // What happens every second is said once a minute.
    std::string retain_error_said_;
    Steady retain_error_again_{}, dropped_again_{};
    std::uint64_t dropped_unsaid_ = 0;
    Wall dropped_since_{};
    std::uint64_t reads_ = 0, events_ = 0, commits_ = 0;

    std::mutex jobs_mutex_;
    std::vector<journal::JobRow> jobs_;                  // not yet in the batch
    std::vector<std::pair<std::string, bool>> reading_;  // the same
    std::vector<Delivery> deliveries_;                   // the same
    std::atomic<bool> jobs_wait_{false};                 // there is something in these three
    std::vector<std::function<void()>> to_tell_;         // once the batch is stored

    std::thread thread_;
    std::atomic<bool> stopping_{false};
    std::atomic<bool> asleep_{false};
    std::mutex sleep_mutex_;
    std::condition_variable wake_;
    mutable std::mutex stats_mutex_;
    Stats stats_;
    Compaction compaction_;                // by stats_mutex_
    std::atomic<bool> compacting_{false};  // slices are left to do
};

}  // namespace gantry::gateway
