#pragma once
#include <atomic>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <unordered_map>

#include "gateway/roster.hpp"
#include "gateway/side_link.hpp"
#include "gateway/writer.hpp"
#include "link/link.hpp"
#include "reader/driver.hpp"

namespace gantry::gateway {

class Session;

// What a session needs of the gateway. Called on the session's loop.
class SessionHost {
public:
    virtual ~SessionHost() = default;
    // Who dialled in says its name. The section it falls under, or nullptr and why not.
    virtual RosterEntry* admit(Session& session, std::string_view name, std::string& why) = 0;
    // It was not admitted and is closed: said in the log, in one place for all sessions.
    virtual void refused(Session& session, std::string_view name, std::string_view why) = 0;
    // The session wants to be its reader's. When the one before has ended and all it took is on disk,
    // take_over() is called on the session.
    virtual void claim(Session& session) = 0;
    // Its driver has been admitted and takes jobs.
    virtual void ready(Session& session) = 0;
    // The session is over: its last item is with the writer (or it never had a reader).
    virtual void ended(Session& session) = 0;
};

// One connection of one reader: a link, a driver, and the way of its reports to the writer; and perhaps a
// second link, on which the reader dials in with notifications. Lives on its loop.
class Session : public std::enable_shared_from_this<Session> {
public:
    // `reader`: known from the start where we dialled it; nullptr: it says who it is.
    Session(SessionId id, link::Loop& loop, Writer::Channel& channel, SessionHost& host,
            std::unique_ptr<Driver> driver, RosterEntry* reader = nullptr);

    void start(link::Socket socket);  // of a reader that dialled in
    void open(link::Socket socket);   // to a reader that we dialled: the driver starts when it is admitted
    // The reader has dialled in with notifications; `gone` is called when that link is.
    void notified(link::Socket socket, std::function<void()> gone);
    void close(std::string_view reason);
    // Asked for by claim(), on the loop; `waited`: for an older link of its reader to be over.
    void take_over(bool waited);
    void answered(const Answer& answer);
    void retry();  // the channel may have room again
    // The store has taken nothing for long, or does again. A reader that keeps its data until it is told
    // waits; of the others what the channel has no room for is counted, and told by an overflow event.
    void store_is_away(bool away);

    // Runs a job on the reader; `done` is called once, on the loop. `link_broke`: the link is gone, and the
    // result is none of the reader's.
    using JobDone = std::function<void(JobResult, bool link_broke)>;
    void run(const JobOrder& order, const Job& job, JobDone done);
    void cancel(JobId job);

    SessionId id() const { return id_; }
    // These may be asked from any thread.
    RosterEntry* reader() const { return reader_; }
    bool identified() const { return reader() != nullptr; }
    bool over() const { return over_; }
    bool was_up() const { return was_up_; }  // the writer has heard of it
    link::Loop& loop() { return loop_; }
    const Driver& driver() const { return *driver_; }
    const Described& described() const { return described_; }
    struct Fault {
        std::string text;
        Wall at{};
    };
    const std::optional<Fault>& last_fault() const { return last_fault_; }  // of this connection
    const std::string& peer() const { return peer_; }
    const std::string& peer_host() const { return peer_host_; }
    bool stalled() const { return driver_->stalled() || !held_.empty(); }
    bool holds() const { return !held_.empty(); }
    const std::string& close_reason() const { return close_reason_; }

private:
    void begin(link::Socket socket);
    void tell_up();
    void push_up(Now at);
    void after_turn();
    void wake();
    void take_signals();
    void identify(const std::string& raw_name);
    void forward_reports();
    void closed(std::string_view reason);
    bool push(Item& item);
    void finish_when_drained();
    bool lets_go() const { return store_is_away_ && kept_ <= answered_; }
    void let_go(Ticket up_to);
    void count_lost(const Report& report);
    void tell_lost();

    const SessionId id_;
    link::Loop& loop_;
    Writer::Channel& channel_;
    SessionHost& host_;
    std::unique_ptr<Driver> driver_;
    link::Socket socket_;  // until the link is started
    std::shared_ptr<link::Link> link_;
    SideLink side_;
    std::string peer_, peer_host_;
    // We dialled it: that somebody takes the connection says nothing yet, it is there when it has answered.
    const bool dialled_;
    std::atomic<RosterEntry*> reader_ = nullptr;
    std::atomic<bool> was_up_ = false;
    bool up_ = false;                 // reader_up is with the writer, reader_down is not
    bool refused_ = false;            // not admitted
    bool closed_ = false;             // the link is gone
    std::atomic<bool> over_ = false;  // and the last item is with the writer
    std::string close_reason_;
    std::deque<Item> held_;  // reports the channel had no room for; bounded by the driver's open tickets
    void tell_faults(const Report& report);
    bool store_is_away_ = false;
    Ticket newest_ = 0;    // report
    Ticket kept_ = 0;      // the newest one that its reader keeps until it is told
    Ticket answered_ = 0;  // up to here the driver was told, by the writer or because nothing is kept
    bool telling_ = false;
    std::uint64_t lost_ = 0;  // not yet told by an event
    Wall lost_since_{};

    Described described_;
    std::optional<Fault> last_fault_;
    std::unordered_map<std::string, Steady> faults_logged_;  // by text
    std::unordered_map<JobId, JobDone> jobs_;
};

}  // namespace gantry::gateway
