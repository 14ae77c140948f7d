#include "cluster.hpp"

namespace gantry::sinks::kafka::tests {
namespace {

// One partition, so that there is one order.
class KafkaDestination : public testkit::Destination {
public:
    KafkaDestination() {
        cluster_.order("topic gantry.events 1");
        cluster_.order("down");
    }
    void start() override { cluster_.order("up"); }
    void kill() override { cluster_.order("down"); }
    std::unique_ptr<sink::Sink> make_sink() override { return sink_of(cluster_); }
    std::vector<std::string> ids() override { return ids_of(cluster_.held()); }

private:
    Cluster cluster_;
};

GANTRY_SINK_SUITE(Kafka, KafkaDestination)

}  // namespace
}  // namespace gantry::sinks::kafka::tests
