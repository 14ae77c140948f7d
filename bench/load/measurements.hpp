#pragma once
#include <chrono>
#include <string>
#include <vector>

#include "bench/load/fleet.hpp"

// One run of one measurement each; prints its figures. Throws Failure when it cannot be believed.
namespace gantry::bench {

// Frames of 64 bytes on so many connections, one or ten a send: raw_loopback_frames_per_s.
void measure_loopback(std::uint32_t connections, unsigned frames_a_send, std::chrono::milliseconds time);
// The same readers as for the gateway, against a host that acknowledges and does nothing else.
void measure_bare_acknowledge(const Fleet::Shape& shape, std::chrono::milliseconds time);
// SQLite alone, a blob a batch of 1,000 records: raw_journal_records_per_s.
void measure_bare_store(std::chrono::milliseconds time);

struct PipelineOptions {
    std::string program;
    Fleet::Shape shape;
    bool tag_read = true;
    std::chrono::milliseconds time{2000};  // of each rate
    std::vector<double> rates = {0};       // reads a second; 0: as fast as it goes
};
// Readers, gateway, store: throughput, latency, processor time; then every acknowledged read is looked for in
// the store.
void measure_pipeline(const PipelineOptions& options);

// From the start of the process to `ready`, on an empty store.
void measure_ready(const std::string& program);
// Memory and processor time of a gateway whose readers send a heartbeat every ten seconds and nothing else;
// `counts` grow.
void measure_idle(const std::string& program, const std::vector<std::uint32_t>& counts,
                  std::chrono::milliseconds time);

}  // namespace gantry::bench
