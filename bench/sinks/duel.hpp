#pragma once
#include <chrono>
#include <string>
#include <utility>
#include <vector>

namespace gantry::bench {

struct DuelOptions {
    std::string kind;                                           // of the sink
    std::string place;                                          // its url, or its directory
    std::vector<std::pair<std::string, std::string>> settings;  // its own
    std::size_t batch = 1000;
    unsigned turns = 5;
    std::chrono::milliseconds time{1000};  // of each side, each turn
};

// The sink and a bare client of its library in turn, at one server, with equal batches: prints
// sink_KIND_events_per_s and raw_KIND_events_per_s once a turn. Only the time within deliver() counts, on
// both sides. Throws Failure when not everything was confirmed.
void measure_sink(const DuelOptions& options);

}  // namespace gantry::bench
