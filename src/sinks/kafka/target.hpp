#pragma once
#include <cstdint>
#include <string>

#include "sink/sink.hpp"
#include "sinks/kafka/producer.hpp"

namespace gantry::sinks::kafka {

enum class Key : std::uint8_t { tag, reader };

// Where a section's events go and how that is reached, checked.
struct Target {
    std::string brokers;  // "a:9092,b:9092"
    std::string topic;
    Key key{};
    std::size_t max_message = 0;
    Words words;          // what every producer is made with
    std::string warning;  // said once in the log; empty: nothing to say
};
Result<Target> make_target(const sink::Options& options);

}  // namespace gantry::sinks::kafka
