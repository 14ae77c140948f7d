#pragma once
#include <chrono>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "base/time.hpp"
#include "sink/sink.hpp"
#include "sinks/mqtt/topics.hpp"

namespace gantry::sinks::mqtt {

// A retained message. An empty payload deletes what is retained there.
struct Retained {
    std::string topic, payload;
};

// {"availability":"online","reader":"dock-1","make":"caen","text":"connected, last read 4 min ago"}
std::string status_payload(const sink::ReaderState& reader);

// Home Assistant's discovery of one reader: a connectivity sensor and a tag scanner (its documents on the
// MQTT integrations "binary sensor" and "tag scanner").
std::vector<Retained> discovery(const Topics& topics, std::string_view prefix, std::string_view gateway_id,
                                const sink::ReaderState& reader);

// What the broker has been told of the readers, and so what it has to be told now.
class StatusBoard {
public:
    StatusBoard(const Topics& topics, std::string gateway_id, std::string discovery_prefix)
        : topics_(topics),
          gateway_id_(std::move(gateway_id)),
          discovery_prefix_(std::move(discovery_prefix)) {}

    void forget() { told_.clear(); }  // a new connection: tell all again
    // Calls `put` with what has changed until it returns false: then the rest is left for the next time.
    // A text alone is told again after half a minute.
    void update(const std::vector<sink::ReaderState>& readers, Steady now,
                const std::function<bool(const Retained&)>& put);
    // The broker still shows what a gateway before us said. Nothing, if it is a reader that we know.
    std::string correction(std::string_view topic, std::string_view payload) const;

private:
    struct Told {
        sink::ReaderState state;
        Steady at{};
    };
    bool tell(const sink::ReaderState& reader, bool gone,
              const std::function<bool(const Retained&)>& put) const;

    const Topics& topics_;
    std::string gateway_id_, discovery_prefix_;  // no prefix: no discovery
    std::map<std::string, Told> told_;           // by the topic of the status
    std::set<std::string> present_;              // of all readers that there are
};

}  // namespace gantry::sinks::mqtt
