#include "gateway/session.hpp"

#include "base/log.hpp"
#include "base/text.hpp"

namespace gantry::gateway {

Session::Session(SessionId id, link::Loop& loop, Writer::Channel& channel, SessionHost& host,
                 std::unique_ptr<Driver> driver, RosterEntry* reader)
    : id_(id),
      loop_(loop),
      channel_(channel),
      host_(host),
      driver_(std::move(driver)),
      side_(loop, *driver_),
      dialled_(reader != nullptr),
      reader_(reader) {}

void Session::start(link::Socket socket) {
    peer_ = socket.peer();
    peer_host_ = socket.peer_host();
    begin(std::move(socket));
}

void Session::open(link::Socket socket) {
    peer_ = socket.peer();
    peer_host_ = socket.peer_host();
    socket_ = std::move(socket);
    host_.claim(*this);
}

void Session::begin(link::Socket socket) {
    auto self = shared_from_this();
    link::Link::Callbacks callbacks;
    callbacks.after_turn = [self] { self->after_turn(); };
    callbacks.closed = [self](std::string_view reason) { self->closed(reason); };
    link_ = link::Link::start(loop_, std::move(socket), *driver_, std::move(callbacks));
}

void Session::close(std::string_view reason) {
    if (closed_) return;
    if (link_) return link_->close(reason);
    if (!socket_) return;
    socket_ = {};
    closed(reason);
}

void Session::notified(link::Socket socket, std::function<void()> gone) {
    if (closed_ || !link_) return gone();
    log::info("readers", "{}: notifications come in from {}", reader()->name, socket.peer());
    auto self = shared_from_this();
    side_.start(
        std::move(socket),
        [self] {
            self->after_turn();
            // What came there may be for the first link to answer.
            if (self->link_) self->link_->wake();
        },
        [self, gone = std::move(gone)](std::string_view reason) {
            log::info("readers", "{}: the notification link ended: {}", self->reader()->name, reason);
            if (self->link_) self->link_->wake();
            gone();
        });
}

// The driver was changed from outside. Either link may have something to send.
void Session::wake() {
    if (link_) link_->wake();
    side_.wake();
}

void Session::after_turn() {
    tell_up();
    take_signals();
    forward_reports();
    if (identified() && link_) {
        auto now = link::read_clocks();
        reader()->last_input_us.store(to_us(now.wall) - std::chrono::duration_cast<std::chrono::microseconds>(
                                                            now.steady - link_->last_input())
                                                            .count(),
                                      std::memory_order_relaxed);
    }
}

void Session::take_signals() {
    auto signals = std::exchange(driver_->signals(), {});
    for (auto& signal : signals) {
        if (auto* who = std::get_if<Identified>(&signal)) {
            identify(who->name);
        } else if (auto* what = std::get_if<Described>(&signal)) {
            described_ = std::move(*what);
        } else if (auto* ended = std::get_if<JobEnded>(&signal)) {
            auto job = jobs_.extract(ended->job);
            // A driver that has given up its link ends its jobs before the link is gone.
            if (!job.empty()) job.mapped()(std::move(ended->result), closed_ || driver_->finished());
        }
    }
}

void Session::identify(const std::string& raw_name) {
    if (identified() || refused_ || closed_) return;
    std::string why;
    auto name = printable(raw_name);
    reader_ = host_.admit(*this, name, why);
    if (!identified()) {
        refused_ = true;
        host_.refused(*this, name, why);
        close("refused");
        return;
    }
    host_.claim(*this);
}

// The reader is there since it was heard, so what it said then does not come before; but never before an
// older link of it was gone.
void Session::take_over(bool waited) {
    if (closed_ || up_) return;  // gone before its turn came
    if (!dialled_) return push_up(waited || !link_ ? link::read_clocks() : link_->last_heard());
    Item item;
    item.kind = Item::Kind::ask_known;
    item.at = link::read_clocks();
    if (!push(item)) held_.push_back(std::move(item));
}

// Of a reader that we dialled: its first good frame.
void Session::tell_up() {
    if (!dialled_ || was_up_ || !link_) return;
    bool answered = driver_->counters()[static_cast<std::size_t>(Count::frames)] != 0;
    if (answered || !driver_->reports().empty()) push_up(link_->last_heard());
}

void Session::push_up(Now at) {
    Item item;
    item.kind = Item::Kind::reader_up;
    item.at = at;
    up_ = was_up_ = true;
    auto wall = to_us(item.at.wall);
    if (!push(item)) held_.push_back(std::move(item));
    reader()->since_us.store(wall, std::memory_order_relaxed);
    reader()->connected.store(true, std::memory_order_relaxed);
    log::info("readers", "{} connected from {}", reader()->name, peer_);
}

bool Session::push(Item& item) {
    item.reader = reader()->index;
    item.session = id_;
    return held_.empty() && channel_.push(item);
}

// Each becomes an event; the log has one of a kind in a minute.
void Session::tell_faults(const Report& report) {
    constexpr auto quiet = 1min;
    constexpr std::size_t most_texts = 32;  // a reader may put anything into its texts
    for (auto& notice : report.notices) {
        const auto* fault = std::get_if<FaultNotice>(&notice);
        if (fault == nullptr) continue;
        last_fault_ = Fault{fault->text, report.received.wall};
        auto now = report.received.steady;
        std::erase_if(faults_logged_, [&](auto& each) { return now - each.second >= quiet; });
        if (faults_logged_.size() >= most_texts) continue;
        if (faults_logged_.try_emplace(fault->text, now).second)
            log::warn("readers", "{}: {} (code {})", reader()->name, fault->text, fault->code);
    }
}

void Session::forward_reports() {
    auto& reports = driver_->reports();
    if (reports.empty()) return;
    for (auto& report : reports) {
        if (!identified()) break;
        tell_faults(report);
        if (!report.observations.empty()) {
            std::uint64_t reads = 0;
            for (auto& each : report.observations)
                reads += each.reads;
            reader()->reads.fetch_add(reads, std::memory_order_relaxed);
            reader()->last_read_us.store(to_us(report.received.wall), std::memory_order_relaxed);
        }
        newest_ = report.ticket;
        if (report.mark) kept_ = report.ticket;
        Item item;
        item.report = std::move(report);
        if (!lets_go()) {
            if (!push(item)) held_.push_back(std::move(item));
            continue;
        }
        if (!push(item)) count_lost(item.report);
        let_go(newest_);
    }
    reports.clear();
}

void Session::store_is_away(bool away) {
    store_is_away_ = away;
    if (!away) return tell_lost();
    if (lets_go() && newest_ > answered_) let_go(newest_);
}

// The driver must not wait for these: nobody keeps them for it. Not in the middle of its turn.
void Session::let_go(Ticket up_to) {
    answered_ = up_to;
    if (std::exchange(telling_, true)) return;
    loop_.post([self = shared_from_this()] {
        self->telling_ = false;
        if (self->closed_) return;
        self->driver_->committed(self->answered_, link::read_clocks());
        self->wake();
    });
}

void Session::count_lost(const Report& report) {
    if (lost_ == 0) {
        lost_since_ = report.received.wall;
        log::warn("readers",
                  "{}: the store takes nothing, memory is full, and the reader keeps nothing itself: what it "
                  "sends from now on is lost, and counted",
                  reader()->name);
    }
    lost_ += report.notices.size();
    for (auto& each : report.observations)
        lost_ += each.reads;
}

// In its place among the reports.
void Session::tell_lost() {
    if (lost_ == 0) return;
    log::warn("readers", "{}: {} reads were lost while the store took nothing", reader()->name, lost_);
    Item item;
    item.kind = Item::Kind::lost;
    item.at = link::read_clocks();
    item.lost = std::exchange(lost_, 0);
    item.lost_since = lost_since_;
    if (!push(item)) held_.push_back(std::move(item));
}

void Session::retry() {
    while (!held_.empty()) {
        if (!channel_.push(held_.front())) return;
        held_.pop_front();
    }
    if (closed_ && !over_) finish_when_drained();
}

void Session::answered(const Answer& answer) {
    if (closed_) return;
    auto now = link::read_clocks();
    if (answer.kind == Item::Kind::report) {
        if (answer.ticket <= answered_) return;
        answered_ = answer.ticket;
        driver_->committed(answer.ticket, now);
    } else if (answer.kind == (dialled_ ? Item::Kind::ask_known : Item::Kind::reader_up)) {
        auto known = answer.known;
        known.reading = reader()->reading.load(std::memory_order_relaxed);
        driver_->admitted(known, now);
        if (socket_) begin(std::move(socket_));
        host_.ready(*this);
    }
    wake();
}

void Session::closed(std::string_view reason) {
    tell_up();
    closed_ = true;
    bool had_begun = link_ != nullptr;
    side_.close("its first link ended");
    // The link keeps this session by its callbacks; let go of it when this call is over.
    loop_.post([link = std::move(link_)] {});
    // Drivers and links make their reasons printable; escaping them twice would garble them.
    bool given_up = driver_->finished() && !driver_->finish_reason().empty();
    close_reason_ = given_up ? driver_->finish_reason() : reason;
    if (had_begun) driver_->link_lost(link::read_clocks());
    // Who hangs up before we do may still have said enough to show what he is.
    if (!given_up && !identified() && !driver_->finish_reason().empty())
        close_reason_ += fmt::format("; {}", driver_->finish_reason());
    take_signals();
    forward_reports();
    if (identified()) tell_lost();
    for (auto& [id, done] : std::exchange(jobs_, {}))
        done({JobResult::Status::unknown, "the link to the reader broke", {}}, true);
    if (!identified()) {
        if (!refused_) log::info("readers", "{} left without a name: {}", peer_, close_reason_);
        over_ = true;
        host_.ended(*this);
        return;
    }
    finish_when_drained();
}

// The last thing the writer hears of a session is that it is over, after all its reports.
void Session::finish_when_drained() {
    if (over_) return;
    if (up_) {
        if (!held_.empty()) return;
        Item item;
        item.kind = Item::Kind::reader_down;
        item.reason = close_reason_;
        item.at = link::read_clocks();
        reader()->connected.store(false, std::memory_order_relaxed);
        reader()->since_us.store(to_us(item.at.wall), std::memory_order_relaxed);
        if (!push(item)) {
            held_.push_back(std::move(item));
            up_ = false;  // what is held ends with it
            return;
        }
        log::info("readers", "{} disconnected: {}", reader()->name, close_reason_);
    }
    over_ = true;
    host_.ended(*this);
}

void Session::run(const JobOrder& order, const Job& job, JobDone done) {
    if (closed_) return done({JobResult::Status::cancelled, "the reader is not connected", {}}, true);
    jobs_.emplace(order.id, std::move(done));
    driver_->run(order, job, link::read_clocks());
    wake();
}

void Session::cancel(JobId job) {
    if (closed_) return;
    driver_->cancel(job, link::read_clocks());
    wake();
}

}  // namespace gantry::gateway
