// Three servers that keep each event three times, one of which is killed under load.
#include <array>
#include <thread>

#include "nats_server.hpp"

namespace gantry::sinks::nats::tests {

using sink::Fate;
using testkit::LentEvents;
using testkit::patience;

namespace {
class Cluster {
public:
    Cluster() {
        std::string routes;
        for (auto& port : route_ports_) {
            port = free_port();
            routes += fmt::format("nats://127.0.0.1:{}, ", port);
        }
        for (std::size_t i = 0; i < 3; ++i)
            nodes_[i] = std::make_unique<NatsServer>(fmt::format(
                "server_name: n{}\ncluster {{ name: c, listen: \"127.0.0.1:{}\", routes: [ {} ] }}\n", i,
                route_ports_[i], routes.substr(0, routes.size() - 2)));
        for (auto& each : nodes_)
            each->launch();
    }
    NatsServer& node(std::size_t index) { return *nodes_[index]; }
    std::string others() const {
        return fmt::format("127.0.0.1:{}, 127.0.0.1:{}", nodes_[1]->port(), nodes_[2]->port());
    }

private:
    std::array<std::uint16_t, 3> route_ports_{};
    std::array<std::unique_ptr<NatsServer>, 3> nodes_;
};
}  // namespace

TEST(NatsCluster, ANodeThatIsKilledUnderLoadLosesNothingAndDoublesNothing) {
    Cluster cluster;
    // What the runner does: what is kept is lent again, before all that is behind it.
    auto sink = make(url_of(cluster.node(0).port()), {{"servers", cluster.others()}, {"replicas", "3"}});
    ASSERT_TRUE(eventually([&] { return sink->deliver({}, patience(5s)).trouble.empty(); }, 60s));
    constexpr std::uint64_t batches = 30, size = 100;
    std::size_t kept_in_all = 0;
    for (std::uint64_t batch = 0; batch < batches; ++batch) {
        LentEvents events(size, 1 + batch * size);
        std::vector<sink::Item> left(events.items().begin(), events.items().end());
        std::jthread killer;
        if (batch == 10)
            killer = std::jthread([&] { cluster.node(0).kill(); });  // the one that we are connected to
        if (batch == 20) cluster.node(0).launch();
        auto end = std::chrono::steady_clock::now() + 60s;
        while (!left.empty()) {
            ASSERT_LT(std::chrono::steady_clock::now(), end) << "batch " << batch;
            auto outcome = sink->deliver(left, patience(2s));
            ASSERT_EQ(count(outcome, Fate::rejected), 0u);
            kept_in_all += count(outcome, Fate::kept);
            std::erase_if(left, [&, i = std::size_t{0}](const sink::Item&) mutable {
                return outcome.fates[i++] == Fate::accepted;
            });
        }
    }
    Client client(cluster.node(1).port());
    EXPECT_EQ(client.stream("GANTRY").value().replicas, 3);
    StreamReader reader;
    std::vector<std::string> ids;
    eventually([&] { return (ids = reader.ids(client)).size() >= batches * size; });
    EXPECT_EQ(ids.size(), batches * size)
        << "no event is there twice; kept and lent again were " << kept_in_all;
    EXPECT_EQ(std::set(ids.begin(), ids.end()).size(), batches * size) << "and none is missing";
}

}  // namespace gantry::sinks::nats::tests
