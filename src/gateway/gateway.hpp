#pragma once
#include <atomic>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <unordered_map>
#include <vector>

#include "gateway/config.hpp"
#include "gateway/data_lock.hpp"
#include "gateway/dialler.hpp"
#include "gateway/jobs.hpp"
#include "gateway/refusals.hpp"
#include "gateway/session.hpp"
#include "gateway/sink_runner.hpp"

namespace gantry::gateway {

// What is known of a reader right now.
struct ReaderStatus {
    std::string name, make, address;  // address: of the section, as configured
    bool connected = false;
    std::string state;  // for people: "connected, last read 4 min ago"
    std::string peer;   // empty: not connected
    std::string model, firmware, detail;
    bool stalled = false;  // waits for the store
    bool reading = true;   // false: somebody stopped it
    std::uint64_t reads = 0;
    std::optional<Wall> last_read, since;
    Counters counters{};                       // of this connection
    std::optional<Session::Fault> fault = {};  // the last of this connection
};

struct ListenerStatus {
    std::string scheme;
    link::Endpoint local;
    std::size_t connections = 0, unnamed = 0;
    std::uint64_t refused = 0, displaced = 0;
};

// The composition root: configuration in, links, drivers, presence, journal running. Knows no make by name.
class Gateway : public SessionHost, private JobHost {
public:
    static Result<std::unique_ptr<Gateway>> start(Config config);
    ~Gateway() override;
    // Nobody dials in any more, every link ends, and with it every job that somebody waits for.
    void close_links();
    void stop();  // closes the links, stores what was taken, ends

    const Config& config() const { return config_; }
    const std::string& id() const { return writer_->gateway_id(); }
    std::vector<ListenerStatus> listeners();
    std::vector<ReaderStatus> readers();
    Writer::Stats stats() const { return writer_->stats(); }
    // Gives free pages of the store back to the file system, beside everything else; see Compaction.
    void compact_store() { writer_->compact(); }
    Compaction compaction() const { return writer_->compaction(); }
    // Directories with stores that were damaged, or that a restore has replaced.
    const std::vector<std::string>& stores_set_aside() const { return set_aside_; }
    Wall started() const { return started_; }

    // The make of a reader that is known; nullptr: there is none of that name.
    const Plugin* make_of(std::string_view reader);
    // Jobs, on any thread. A reader that is away has until the deadline to come back. When submit() returns
    // the job is on disk, unless the store takes nothing: then it took as long as the timeout or, where
    // nobody `waits` for the end of the job, a moment.
    Result<JobId> submit(std::string_view reader, Job job, std::chrono::milliseconds timeout,
                         bool waits = true);
    std::optional<JobStatus> wait_for(JobId job);  // its end; not on a loop's thread
    Jobs& jobs() { return jobs_; }
    // Destinations, in the order of the configuration; nullptr: there is none of that name. They live as long
    // as the gateway runs.
    const std::vector<std::unique_ptr<SinkRunner>>& sinks() const { return sinks_; }
    SinkRunner* find_sink(std::string_view name);
    // What answers requests that come in over a sink with `commands`: operation, JSON body, and whom to tell.
    using Requests = std::function<void(std::string_view, std::string, std::function<void(std::string)>)>;
    void serve_requests(Requests requests);  // nullptr: nobody does, from now on
    bool cancel(JobId job) { return jobs_.cancel(job, link::read_clocks()); }
    // submit() and wait_for() in one.
    Result<JobResult> run(std::string_view reader, Job job, std::chrono::milliseconds timeout);

private:
    // All readers that dial in at one address.
    struct Port {
        std::vector<const ReaderConfig*> sections;
        std::unique_ptr<link::Listener> listener;
        link::Endpoint local;                         // of the listener; goes on when it is closed
        std::vector<std::weak_ptr<Session>> unnamed;  // oldest first; on the accepting loop
        std::size_t connections = 0;
        std::uint64_t refused = 0, displaced = 0;
    };
    struct LoopState {
        std::unique_ptr<link::Loop> loop;
        Writer::Channel* channel = nullptr;
        std::unordered_map<SessionId, std::shared_ptr<Session>> sessions;  // on the loop
    };
    // Where readers that we dialled dial in with notifications.
    struct NotifyPort {
        std::vector<RosterEntry*> readers;
        std::unique_ptr<link::Listener> listener;
        link::Endpoint local;
        std::atomic<std::size_t> connections{0};
        std::atomic<std::uint64_t> refused{0};
        Refusals refusals;  // on the accepting loop
    };
    // A reader whose link we open: all but the constants on its loop.
    struct Dialled {
        const ReaderConfig* section = nullptr;
        RosterEntry* entry = nullptr;
        LoopState* loop = nullptr;
        NotifyPort* notify = nullptr;  // nullptr: no notifications wanted
        std::unique_ptr<Dialler> dialler;
        std::optional<Steady> opened;
    };
    struct DestinationHost final : sink::Host {
        explicit DestinationHost(Gateway& of) : gateway(of) {}
        std::vector<sink::ReaderState> readers() override;
        void request(std::string_view operation, std::string body,
                     std::function<void(std::string)> answer) override;
        Gateway& gateway;
    };
    struct Owner {  // of a reader: at most one session, and at most one that waits for it to end
        std::shared_ptr<Session> session, waiting;
    };

    explicit Gateway(Config config);
    Result<void> open_store();
    Result<void> open_sinks();
    void start_loops();
    void know_readers();
    void close_listeners();

    // gateway_links.cpp
    Result<void> listen();
    Result<void> listen_at(Port& port);
    void accepted(Port& port, link::Socket socket);
    Result<void> listen_for_notifications();
    void notified(NotifyPort& port, link::Socket socket);
    void dial();
    void opened(Dialled& reader, link::Socket socket);
    void link_ended(Session& session);

    void take_answers(LoopState& loop, std::vector<Answer> answers);
    void tell_sessions(bool store_is_away);
    void released(std::uint32_t reader, SessionId session);
    LoopState& loop_of(Session& session);
    ReaderStatus status_of(RosterEntry& entry);

    RosterEntry* admit(Session& session, std::string_view name, std::string& why) override;
    void refused(Session& session, std::string_view name, std::string_view why) override;
    void claim(Session& session) override;
    void ready(Session& session) override;
    void ended(Session& session) override;

    void store(const journal::JobRow& row) override;
    bool reading(std::uint32_t reader) const override;
    void set_reading(std::uint32_t reader, bool reading) override;
    void keep_reading(std::uint32_t reader, bool reading) override;
    void wake_at(Steady when) override;

    Config config_;
    Wall started_{};
    DataLock lock_;
    std::vector<std::string> set_aside_;  // fixed once started
    Roster roster_;
    Jobs jobs_{*this};
    std::unique_ptr<Writer> writer_;
    DestinationHost destination_host_{*this};
    std::vector<std::optional<journal::Seq>> sink_cursors_;  // as stored at the start
    journal::Seq first_last_seq_ = 0;                        // of the journal, at the start
    std::vector<std::unique_ptr<SinkRunner>> sinks_;         // fixed once started
    std::vector<std::unique_ptr<LoopState>> loops_;
    std::vector<std::unique_ptr<Port>> ports_;
    std::vector<std::unique_ptr<NotifyPort>> notify_ports_;
    std::unordered_map<std::uint32_t, std::unique_ptr<Dialled>> dialled_;  // by reader; fixed once started
    std::unique_ptr<link::Timer> job_timer_;                               // on the first loop
    Steady jobs_due_ = Steady::max();                                      // the same
    std::set<std::string, std::less<>> stopped_readers_;                   // by somebody, before this start
    std::mutex requests_mutex_;
    Requests requests_;
    std::mutex mutex_;  // of what follows
    std::unordered_map<std::uint32_t, Owner> owners_;
    std::unordered_map<SessionId, Port*> port_of_;
    Refusals refusals_;
    SessionId next_session_ = 1;
    std::size_t next_loop_ = 0;
    bool stopping_ = false;
    bool stopped_ = false;  // only stop()
};

}  // namespace gantry::gateway
