#include "nats_server.hpp"

namespace gantry::sinks::nats::tests {

GANTRY_SINK_SUITE(Nats, NatsDestination)

}  // namespace gantry::sinks::nats::tests
