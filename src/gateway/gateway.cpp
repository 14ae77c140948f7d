#include "gateway/gateway.hpp"

#include <algorithm>
#include <thread>

#include <fmt/format.h>

#include "base/log.hpp"
#include "base/text.hpp"
#include "journal/upkeep.hpp"

namespace gantry::gateway {

Gateway::Gateway(Config config) : config_(std::move(config)) {}

Gateway::~Gateway() {
    stop();
}

Result<std::unique_ptr<Gateway>> Gateway::start(Config config) {
    std::unique_ptr<Gateway> gateway(new Gateway(std::move(config)));
    link::raise_file_limit();
    gateway->started_ = link::read_clocks().wall;
    if (auto opened = gateway->open_store(); !opened) return tl::unexpected(opened.error());
    gateway->start_loops();
    gateway->know_readers();
    if (auto sinks = gateway->open_sinks(); !sinks) return tl::unexpected(sinks.error());
    if (auto ran = gateway->writer_->start(link::read_clocks()); !ran) return tl::unexpected(ran.error());
    if (auto listening = gateway->listen(); !listening) return tl::unexpected(listening.error());
    if (auto listening = gateway->listen_for_notifications(); !listening)
        return tl::unexpected(listening.error());
    gateway->dial();
    for (auto& sink : gateway->sinks_)
        sink->start();
    return gateway;
}

void Gateway::start_loops() {
    auto cores = std::max(1u, std::thread::hardware_concurrency());
    for (unsigned i = 0; i < std::clamp(cores - 1, 1u, 4u); ++i) {
        auto state = std::make_unique<LoopState>();
        state->loop = std::make_unique<link::Loop>(fmt::format("gantry-link-{}", i));
        auto* raw = state.get();
        state->channel = &writer_->add_channel([this, raw](std::vector<Answer> answers) {
            raw->loop->post([this, raw, answers = std::move(answers)]() mutable {
                take_answers(*raw, std::move(answers));
            });
        });
        loops_.push_back(std::move(state));
    }
    auto& first = *loops_.front()->loop;
    first.run_and_wait([&] { job_timer_ = std::make_unique<link::Timer>(first); });
}

// Readers with a plain name are known, and shown, before they first connect.
void Gateway::know_readers() {
    for (auto& section : config_.readers) {
        if (section.name.find('*') != std::string::npos) continue;
        auto* entry = roster_.admit(section.name, section);
        if (entry == nullptr) continue;
        entry->reading = !stopped_readers_.contains(entry->name);
        if (section.address.scheme->kind == LinkKind::listen) continue;
        auto& dialled = dialled_[entry->index];
        dialled = std::make_unique<Dialled>();
        dialled->section = &section;
        dialled->entry = entry;
        dialled->loop = loops_[entry->index % loops_.size()].get();
    }
}

Result<void> Gateway::open_store() {
    auto lock = DataLock::take(config_.data_dir, "gantry run");
    if (!lock) return tl::unexpected(lock.error());
    lock_ = std::move(*lock);
    auto options = config_.store;
    options.path = config_.data_dir / "gantry.db";
    auto opened = journal::open_or_set_aside(options, link::read_clocks().wall);
    if (!opened) return tl::unexpected(opened.error().error);
    if (!opened->aside.empty())
        log::error("store",
                   "{}; it is set aside in {} and a new store begins: events that no sink had yet are in the "
                   "old one, "
                   "see `gantry store check --db {}`",
                   opened->damage, opened->aside.string(), (opened->aside / "gantry.db").string());
    for (auto& aside : journal::stores_set_aside(options.path))
        set_aside_.push_back(aside.string());
    auto* journal = &opened->journal;
    if (!config_.gateway_id.empty())
        if (auto set = (*journal)->set_gateway_id(config_.gateway_id); !set)
            return tl::unexpected(set.error().error);
    std::vector<journal::JobRow> jobs;
    auto loaded = (*journal)->load_jobs([&](journal::JobRow row) { jobs.push_back(std::move(row)); });
    if (!loaded) return tl::unexpected(loaded.error().error);
    auto stopped = (*journal)->stopped_readers();
    if (!stopped) return tl::unexpected(stopped.error().error);
    stopped_readers_.insert(stopped->begin(), stopped->end());
    Writer::Options writer_options;
    writer_options.jobs_stored = [this](const std::vector<JobId>& ids) {
        jobs_.stored(ids, link::read_clocks());
    };
    writer_options.committed = [this] {
        for (auto& sink : sinks_)
            sink->committed();
    };
    writer_options.store_is_away = [this](bool away) { tell_sessions(away); };
    writer_options.tag_read = config_.tag_read;
    writer_options.rules = config_.presence;
    writer_options.rules.glimpsed_events = config_.tag_glimpsed;
    writer_options.zones = config_.zones;
    for (auto& zone : writer_options.zones)
        zone.rules.glimpsed_events = config_.tag_glimpsed;
    for (auto& name : (*journal)->sinks_with_cursor()) {
        auto there = std::ranges::find(config_.sinks, name, &SinkConfig::name) != config_.sinks.end();
        if (!there)
            log::warn(
                "sink",
                "\"{}\" is no longer configured: events that it has not had are kept no longer for its sake",
                printable(name));
    }
    for (auto& sink : config_.sinks)
        sink_cursors_.push_back((*journal)->cursor(sink.name));
    first_last_seq_ = (*journal)->last_seq();
    writer_ = std::make_unique<Writer>(std::move(*journal), roster_, std::move(writer_options));
    jobs_.restore(std::move(jobs), link::read_clocks().wall);
    return {};
}

void Gateway::tell_sessions(bool store_is_away) {
    for (auto& state : loops_)
        state->loop->post([raw = state.get(), store_is_away] {
            std::vector<std::shared_ptr<Session>> all;
            for (auto& [id, session] : raw->sessions)
                all.push_back(session);
            for (auto& session : all)
                session->store_is_away(store_is_away);
        });
}

Gateway::LoopState& Gateway::loop_of(Session& session) {
    return **std::ranges::find_if(loops_, [&](auto& state) { return state->loop.get() == &session.loop(); });
}

RosterEntry* Gateway::admit(Session& session, std::string_view name, std::string& why) {
    std::lock_guard lock(mutex_);
    auto* port = port_of_.at(session.id());
    std::string given(name);
    const auto* section = port->sections.front()->address.scheme->anonymous
                              ? section_at(port->sections, session.peer_host(), given, why)
                              : section_for(port->sections, name, session.peer_host(), why);
    auto* entry = section != nullptr ? roster_.admit(given, *section) : nullptr;
    if (entry != nullptr && stopped_readers_.erase(entry->name) != 0) entry->reading = false;
    if (entry == nullptr) {
        ++port->refused;
        if (why.empty()) why = "a reader of that name belongs to another section of the configuration";
    }
    return entry;
}

void Gateway::refused(Session& session, std::string_view name, std::string_view why) {
    std::optional<std::uint64_t> unsaid;
    {
        std::lock_guard lock(mutex_);
        auto& listener = port_of_.at(session.id())->sections.front()->name;
        unsaid = refusals_.count(listener, name, link::read_clocks().steady);
    }
    if (!unsaid) return;
    auto more = *unsaid == 0 ? "" : fmt::format("; {} more times since this was last said", *unsaid);
    log::warn("readers", "{} calls itself \"{}\" and is refused: {}{}", session.peer(), name, why, more);
}

// The newest connection wins; the old one may be half-open. What it took must be on disk before the new one
// is told what was stored last, or a frame that comes again would be counted twice: so the new one waits.
void Gateway::claim(Session& session) {
    std::shared_ptr<Session> before, waited;
    {
        std::lock_guard lock(mutex_);
        auto& owner = owners_[session.reader()->index];
        before = owner.session;
        if (before)
            waited = std::exchange(owner.waiting, session.shared_from_this());
        else
            owner.session = session.shared_from_this();
    }
    if (!before) {
        session.take_over(false);
        return;
    }
    if (!before->over())
        log::warn("readers", "{}: a new connection from {} takes the place of the one from {}",
                  session.reader()->name, session.peer(), before->peer());
    for (auto& old : {before, waited})
        if (old) old->loop().post([old] { old->close("a newer connection took its place"); });
}

// Its driver knows where it stands and takes jobs.
void Gateway::ready(Session& session) {
    JobLine line;
    line.id = session.id();
    line.run = [this, self = session.shared_from_this()](const JobOrder& order,
                                                         std::shared_ptr<const Job> job) {
        self->loop().post([this, self, order, job = std::move(job)] {
            self->run(order, *job, [this, id = order.id](JobResult result, bool link_broke) {
                jobs_.ended(id, std::move(result), link_broke, link::read_clocks());
            });
        });
    };
    line.cancel = [self = session.shared_from_this()](JobId job) {
        self->loop().post([self, job] { self->cancel(job); });
    };
    jobs_.reader_up(session.reader()->index, std::move(line));
}

void Gateway::ended(Session& session) {
    auto self = session.shared_from_this();
    if (session.reader() != nullptr) {
        jobs_.reader_down(session.reader()->index, session.id());
        link_ended(session);
    }
    loop_of(session).sessions.erase(session.id());
    {
        std::lock_guard lock(mutex_);
        auto port = port_of_.find(session.id());
        if (port != port_of_.end()) {
            --port->second->connections;
            port_of_.erase(port);
        }
        if (session.reader() == nullptr) return;
        auto owner = owners_.find(session.reader()->index);
        if (owner != owners_.end() && owner->second.waiting == self) owner->second.waiting.reset();
    }
    // One that never went up leaves nothing to wait for; the others are released by the writer's answer.
    if (!session.was_up()) released(session.reader()->index, session.id());
}

// All that a session took is on disk: whoever waits for its reader may have it.
void Gateway::released(std::uint32_t reader, SessionId session) {
    std::shared_ptr<Session> next;
    {
        std::lock_guard lock(mutex_);
        auto owner = owners_.find(reader);
        if (owner == owners_.end() || !owner->second.session || owner->second.session->id() != session)
            return;
        owner->second.session = std::exchange(owner->second.waiting, nullptr);
        next = owner->second.session;
        if (!next) owners_.erase(owner);
    }
    if (next) next->loop().post([next] { next->take_over(true); });
}

void Gateway::take_answers(LoopState& loop, std::vector<Answer> answers) {
    for (auto& answer : answers) {
        if (answer.kind == Item::Kind::reader_down) {
            released(answer.reader, answer.session);
            continue;
        }
        auto found = loop.sessions.find(answer.session);
        if (found == loop.sessions.end()) continue;
        auto session = found->second;  // may end while it is told
        session->answered(answer);
    }
    // There is room again for whoever found the channel full.
    std::vector<std::shared_ptr<Session>> waiting;
    for (auto& [id, session] : loop.sessions)
        if (session->holds()) waiting.push_back(session);
    for (auto& session : waiting)
        session->retry();
}

void Gateway::close_links() {
    {
        std::lock_guard lock(mutex_);
        if (std::exchange(stopping_, true)) return;
    }
    close_listeners();
    jobs_.stop(link::read_clocks());
    for (auto& state : loops_)
        state->loop->run_and_wait([&] {
            for (auto& [index, reader] : dialled_)
                if (reader->loop == state.get()) reader->dialler.reset();
            std::vector<std::shared_ptr<Session>> all;
            for (auto& [id, session] : state->sessions)
                all.push_back(session);
            for (auto& session : all)
                session->close("the gateway stops");
        });
}

void Gateway::close_listeners() {
    if (loops_.empty()) return;
    loops_.front()->loop->run_and_wait([&] {
        for (auto& port : ports_)
            port->listener.reset();
        for (auto& port : notify_ports_)
            port->listener.reset();
    });
}

void Gateway::stop() {
    // Listeners first, then links; every session leaves its last word with the writer, which commits it and
    // ends.
    close_links();
    if (std::exchange(stopped_, true)) return;
    // What a session still holds goes to the writer as it makes room. A store that takes nothing must not
    // hold us.
    auto deadline = link::read_clocks().steady + 1500ms;
    for (bool left = true; left && link::read_clocks().steady < deadline;) {
        left = false;
        for (auto& state : loops_)
            state->loop->run_and_wait([&] { left = left || !state->sessions.empty(); });
        if (left) std::this_thread::sleep_for(2ms);
    }
    jobs_.stop(link::read_clocks(), true);
    for (auto& sink : sinks_)
        sink->ask_to_stop();  // all at once: one that is slow to notice does not add to the next
    for (auto& sink : sinks_)
        sink->stop();
    if (writer_) writer_->stop();
    for (auto& state : loops_)
        state->loop->stop();
    for (auto& state : loops_)
        state->sessions.clear();
    {
        std::lock_guard lock(mutex_);
        owners_.clear();
    }
    writer_.reset();
    lock_.release();
}

}  // namespace gantry::gateway
