// What is known of readers and listeners, and the jobs of readers.
#include <algorithm>

#include <fmt/format.h>

#include "base/text.hpp"
#include "gateway/gateway.hpp"

namespace gantry::gateway {

std::vector<ListenerStatus> Gateway::listeners() {
    std::lock_guard lock(mutex_);
    std::vector<ListenerStatus> out;
    for (auto& port : ports_) {
        auto unnamed = std::ranges::count_if(port->unnamed, [](auto& each) {
            auto alive = each.lock();
            return alive && !alive->identified() && !alive->over();
        });
        out.push_back({std::string(port->sections.front()->address.scheme->name), port->local,
                       port->connections, static_cast<std::size_t>(unnamed), port->refused, port->displaced});
    }
    for (auto& port : notify_ports_)
        out.push_back({fmt::format("{} notifications", port->readers.front()->config->address.plugin->name),
                       port->local, port->connections, 0, port->refused, 0});
    return out;
}

ReaderStatus Gateway::status_of(RosterEntry& entry) {
    ReaderStatus status;
    status.name = entry.name;
    status.make = entry.config->address.plugin->name;
    status.address = entry.config->address.text;
    status.connected = entry.connected.load(std::memory_order_relaxed);
    status.reading = entry.reading.load(std::memory_order_relaxed);
    status.reads = entry.reads.load(std::memory_order_relaxed);
    auto last_read = entry.last_read_us.load(std::memory_order_relaxed);
    auto since = entry.since_us.load(std::memory_order_relaxed);
    if (last_read != 0) status.last_read = from_us(last_read);
    if (since != 0) status.since = from_us(since);
    auto now = link::read_clocks().wall;
    auto ago = [&](Wall time) { return approximate(now - time) + " ago"; };
    if (!status.since)
        status.state = "never connected";
    else if (!status.connected)
        status.state = fmt::format("disconnected {}", ago(*status.since));
    else
        status.state = fmt::format(
            "connected, {}{}", status.reading ? "" : "stopped, ",
            status.last_read ? "last read " + ago(*status.last_read) : std::string("nothing read yet"));
    return status;
}

std::vector<ReaderStatus> Gateway::readers() {
    std::vector<ReaderStatus> out;
    for (std::size_t i = 0; i < roster_.size(); ++i)
        out.push_back(status_of(roster_.at(static_cast<std::uint32_t>(i))));
    auto trouble = stats().trouble;
    // The rest is known to the loops.
    for (auto& state : loops_)
        state->loop->run_and_wait([&] {
            auto now = link::read_clocks().steady;
            for (auto& [index, reader] : dialled_) {
                if (reader->loop != state.get() || !reader->dialler || out[index].connected) continue;
                out[index].state = reader->dialler->state(now);
            }
            for (auto& [id, session] : state->sessions) {
                if (!session->identified() || session->over() || !session->was_up()) continue;
                auto index = session->reader()->index;
                if (index >= out.size()) continue;  // came after we looked
                auto& status = out[index];
                status.peer = session->peer();
                status.model = session->described().model;
                status.firmware = session->described().firmware;
                status.detail = session->described().detail;
                status.fault = session->last_fault();
                // A reader that waits for its acknowledgement is held, too, though its driver has room for
                // more.
                status.stalled = session->stalled() || !trouble.empty();
                status.counters = session->driver().counters();
                if (status.stalled && status.connected)
                    status.state = "connected, held: " + (trouble.empty() ? "the store is slow" : trouble);
            }
        });
    return out;
}

const Plugin* Gateway::make_of(std::string_view reader) {
    auto* entry = roster_.find(reader);
    return entry == nullptr ? nullptr : entry->config->address.plugin;
}

Result<JobId> Gateway::submit(std::string_view reader, Job job, std::chrono::milliseconds timeout,
                              bool waits) {
    auto* entry = roster_.find(reader);
    if (entry == nullptr)
        return fail(fmt::format("there is no reader \"{}\"", printable(reader)), "see `gantry reader list`");
    auto now = link::read_clocks();
    constexpr std::chrono::milliseconds moment = 1s;
    auto id = jobs_.submit({entry->index, entry->name}, std::move(job), timeout, now, waits);
    if (id) jobs_.wait_stored(*id, now.steady + (waits ? timeout : std::min(timeout, moment)));
    return id;
}

std::optional<JobStatus> Gateway::wait_for(JobId job) {
    return jobs_.wait(job);
}

Result<JobResult> Gateway::run(std::string_view reader, Job job, std::chrono::milliseconds timeout) {
    auto id = submit(reader, std::move(job), timeout);
    if (!id) return tl::unexpected(id.error());
    auto ended = wait_for(*id);
    auto status = ended ? result_status(ended->state) : std::nullopt;
    if (!status) return JobResult{JobResult::Status::unknown, "the gateway is stopping", {}};
    return JobResult{*status, std::move(ended->text), std::move(ended->values)};
}

void Gateway::store(const journal::JobRow& row) {
    writer_->store_job(row);
}

bool Gateway::reading(std::uint32_t reader) const {
    return roster_.at(reader).reading.load();
}

void Gateway::set_reading(std::uint32_t reader, bool reading) {
    roster_.at(reader).reading = reading;
}

void Gateway::keep_reading(std::uint32_t reader, bool reading) {
    writer_->store_reading(roster_.at(reader).name, reading);
}

void Gateway::wake_at(Steady when) {
    loops_.front()->loop->post([this, when] {
        if (when >= jobs_due_ || !job_timer_) return;
        jobs_due_ = when;
        job_timer_->at(when, [this] {
            jobs_due_ = Steady::max();
            jobs_.time_passed(link::read_clocks());
        });
    });
}

}  // namespace gantry::gateway
