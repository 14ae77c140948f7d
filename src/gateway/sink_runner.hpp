#pragma once
#include <atomic>
#include <condition_variable>
#include <deque>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <random>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "gateway/config.hpp"
#include "gateway/delivery.hpp"
#include "journal/journal.hpp"

namespace gantry::gateway {

// How a sink is right now.
struct SinkStatus {
    std::string name, kind, url;
    std::string state;  // for people: "up to date", "delivering, 1200 events behind"
    bool connected = false;
    journal::Seq cursor = 0;          // everything up to here is delivered, not wanted, or a dead letter
    std::uint64_t behind = 0;         // numbers of the journal after the cursor, wanted or not
    std::uint64_t backlog_bytes = 0;  // of the events that are lent right now
    std::optional<Wall> oldest;       // time of the oldest event that waits
    std::uint64_t delivered = 0, bytes = 0, retried = 0, rejected = 0;  // since the start; bytes of payload
    std::uint64_t dead_letters = 0;                                     // in the store
    std::string trouble;                                                // empty: none
    std::optional<Wall> trouble_since, next_try, last_delivery;
};

// One destination and its place in the journal, on a thread of its own: so no sink's trouble touches another.
// It lends events to the sink by cursor, waits longer after each failure, and leaves the cursor and the dead
// letters with the writer, who stores both in one commit.
class SinkRunner {
public:
    struct Start {
        std::filesystem::path store;
        std::string gateway_id;
        std::optional<journal::Seq> cursor;  // as stored; nothing: the sink is new
        journal::Seq last_seq = 0;           // of the journal right now
    };
    // Leaves deliveries with the writer; called on the runner's thread.
    using Store = std::function<void(Delivery)>;

    SinkRunner(const SinkConfig& config, std::unique_ptr<sink::Sink> sink, Start start, Store store);
    ~SinkRunner();
    void start();
    void ask_to_stop();
    void stop();  // ends the thread; what is known of deliveries is left with the writer

    // Any thread.
    const std::string& name() const { return config_.name; }
    SinkStatus status() const;
    void committed();  // there may be new events
    void retry();      // at once, whatever it waits for
    // What blocks gives way: the event at the front becomes a dead letter, a dead letter is no longer
    // offered, rows of the store that cannot be read are passed. An error: nothing blocks.
    Result<void> skip();
    // Dead letters by the numbers of their events; empty: all. Offered again, or thrown away.
    void offer_again(std::vector<journal::Seq> letters);
    void discard(std::vector<journal::Seq> letters);

private:
    struct Lent {
        event::Event event;
        std::string id, payload;
        std::uint64_t tries = 0;  // that it was refused
    };
    struct Orders {
        bool retry = false, skip = false;
        bool all_again = false, discard_all = false;
        std::set<journal::Seq> again, discard;
    };

    // What the trouble is about.
    enum class Blocker : std::uint8_t { none, line, letter, unreadable };

    void run(const std::stop_token& stop);
    void idle(Now now, const std::stop_token& stop);
    void take_orders(Now now);
    void skip_blocker(Now now);
    void skip_unreadable();
    void queue_letters(const Orders& orders);
    void discard_letters(const Orders& orders);
    bool refill(Now now);
    journal::StoreResult<bool> read_on(journal::Seq end);
    void offer_line(const std::stop_token& stop);
    void offer_letters(const std::stop_token& stop);
    sink::Outcome deliver(std::span<const sink::Item> items, const std::stop_token& stop);
    void bury(const Lent& lent, std::string reason, Wall now);
    void settle_trouble(const sink::Outcome& outcome, Blocker blocker, bool progress, Now now);
    void fail(std::string trouble, std::optional<std::chrono::milliseconds> at_least, bool progress, Now now);
    void recover(Now now);
    void nothing_waits(Now now);
    std::size_t allowance(Now now);
    void leave_progress(Now now, bool at_once);
    void count_letters();
    void publish(Now now);
    void rest(const std::stop_token& stop, Steady until, bool for_news);
    Result<void> open_store();

    const SinkConfig config_;
    const Start start_;
    const Store store_;
    std::unique_ptr<sink::Sink> sink_;
    std::unique_ptr<journal::Reader> reader_;
    journal::IdPrefixes prefixes_;

    // The runner's thread.
    std::deque<Lent> line_;             // lent and not settled, in order
    std::deque<journal::Seq> letters_;  // dead letters to offer again, rising
    Steady letters_at_{};               // not before; the line goes on meanwhile
    Blocker blocker_ = Blocker::none;
    journal::Seq scanned_ = 0;            // read up to here
    journal::Seq cursor_ = 0, left_ = 0;  // settled up to here; what the writer was told
    bool tell_cursor_ = false;            // the writer has not been told of any yet
    journal::Seq last_seq_ = 0;
    Delivery delivery_;  // to be left
    std::shared_ptr<std::atomic<std::uint64_t>> unstored_letters_;
    unsigned failures_ = 0;
    Steady not_before_{}, next_idle_{}, next_leave_{}, tokens_at_{}, complain_at_{};
    double tokens_ = 0;
    std::string said_trouble_;  // in the log, since all was well
    bool letters_changed_ = true;
    std::uint64_t unsaid_rejects_ = 0;
    Steady rejects_said_{};
    std::mt19937_64 dice_{std::random_device{}()};

    mutable std::mutex mutex_;
    std::condition_variable_any wake_;
    Orders orders_;
    bool has_orders_ = false, news_ = true;
    SinkStatus status_;

    std::jthread thread_;
};

}  // namespace gantry::gateway
