#include "mosquitto_server.hpp"

namespace gantry::sinks::mqtt::tests {

namespace {
struct Version5 : MosquittoDestination {
    Version5() : MosquittoDestination({}, "allow_anonymous true\nmax_packet_size 4000\n") { refuses_ = true; }
};
// MQTT 3.1.1 has no refusals: a broker that gets too much ends the connection.
struct Version311 : MosquittoDestination {
    Version311()
        : MosquittoDestination({{"version", "3.1.1"}}, "allow_anonymous true\nmax_packet_size 4000\n") {
        refuses_ = true;
    }
};
struct Arrays : MosquittoDestination {
    Arrays()
        : MosquittoDestination({{"array", "true"}, {"array_size", "7"}},
                               "allow_anonymous true\nmax_packet_size 8000\n") {
        refuses_ = true;
    }
};
}  // namespace

GANTRY_SINK_SUITE(Mqtt5, Version5)
GANTRY_SINK_SUITE(Mqtt311, Version311)
GANTRY_SINK_SUITE(MqttArrays, Arrays)

}  // namespace gantry::sinks::mqtt::tests
