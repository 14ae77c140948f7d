// The gateway's destinations.
#include <algorithm>

#include <fmt/format.h>

#include "base/log.hpp"
#include "gateway/gateway.hpp"

namespace gantry::gateway {

Result<void> Gateway::open_sinks() {
    for (std::size_t i = 0; i < config_.sinks.size(); ++i) {
        auto& section = config_.sinks[i];
        auto made = section.kind->make({.name = section.name,
                                        .gateway_id = id(),
                                        .url = section.url,
                                        .settings = section.settings,
                                        .batch = section.batch,
                                        .commands = section.commands},
                                       destination_host_);
        if (!made)
            return fail(fmt::format("sink \"{}\": {}", section.name, made.error().what), made.error().hint);
        // Only a damaged store says so. Nobody knows what that sink has had.
        if (sink_cursors_[i] && *sink_cursors_[i] > first_last_seq_) {
            log::warn("sink",
                      "{}: its place in the store is beyond the newest event; it is given all events again, "
                      "from the oldest",
                      section.name);
            sink_cursors_[i] = 0;
            writer_->store_delivery({.sink = section.name, .cursor = 0});
        }
        // Where a new one begins is on disk no later than the first event behind it, or a crash would move
        // its "now" past that.
        if (!sink_cursors_[i])
            writer_->store_delivery(
                {.sink = section.name, .cursor = section.from_oldest ? 0 : first_last_seq_});
        SinkRunner::Start start{config_.data_dir / "gantry.db", id(), sink_cursors_[i], first_last_seq_};
        sinks_.push_back(std::make_unique<SinkRunner>(
            section, std::move(*made), std::move(start),
            [this](Delivery delivery) { writer_->store_delivery(std::move(delivery)); }));
    }
    return {};
}

SinkRunner* Gateway::find_sink(std::string_view name) {
    auto it = std::ranges::find_if(sinks_, [&](auto& sink) { return sink->name() == name; });
    return it == sinks_.end() ? nullptr : it->get();
}

void Gateway::serve_requests(Requests requests) {
    std::lock_guard lock(requests_mutex_);
    requests_ = std::move(requests);
}

std::vector<sink::ReaderState> Gateway::DestinationHost::readers() {
    std::vector<sink::ReaderState> out;
    for (auto& reader : gateway.readers())
        out.push_back({reader.name, reader.make, reader.connected, reader.state});
    return out;
}

void Gateway::DestinationHost::request(std::string_view operation, std::string body,
                                       std::function<void(std::string)> answer) {
    Requests requests;
    {
        std::lock_guard lock(gateway.requests_mutex_);
        requests = gateway.requests_;
    }
    if (requests) return requests(operation, std::move(body), std::move(answer));
    answer(R"({"status":"error","error":"the gateway takes no requests right now"})");
}

}  // namespace gantry::gateway
