// The gateway in one process with virtual readers over real TCP.
#include "gateway/gateway.hpp"

#include <map>
#include <thread>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "base/log.hpp"
#include "link/device_host.hpp"
#include "protocols/registry.hpp"
#include "testkit/eventually.hpp"
#include "testkit/ledger.hpp"
#include "testkit/temp_dir.hpp"
#include "wire/layout.hpp"

namespace gantry::gateway {
namespace {

using testkit::eventually;

Config config_for(const std::string& directory, std::string_view more = "") {
    auto config = parse_config(fmt::format(R"([gateway]
id = "test"
data_dir = "{}"
[events]
tag_read = true
[presence]
lose_after = "300ms"
[[reader]]
name = "r-*"
address = "silion-listen://127.0.0.1:0"
zone = "hall"
from = ["127.0.0.0/8"]
{})",
                                           directory, more),
                               "test.toml");
    EXPECT_TRUE(config) << (config ? "" : config.error().text());
    return config ? *config : Config{};
}

std::uint64_t number(Device& device, std::string_view name) {
    auto state = device.state();
    const auto* value = wire::find(state, name);
    return value == nullptr ? 0 : static_cast<std::uint64_t>(wire::as_number(*value).value_or(0));
}

// One virtual reader whose every read is numbered.
struct Reader {
    testkit::NumberingAir air;
    std::unique_ptr<link::DeviceHost> host;

    Reader(link::Loop& loop, std::uint32_t id, const link::Endpoint& gateway, std::string name,
           double rate = 200, std::string redial = "100ms")
        : air(id, rate) {
        const auto* plugin = find_plugin("silion");
        const std::vector<std::pair<std::string, std::string>> given = {{"generation", "2"},
                                                                        {"batch", "50ms"},
                                                                        {"buffer", "1000000"},
                                                                        {"ack_wait", "5s"},
                                                                        {"redial", std::move(redial)}};
        DeviceOptions options;
        options.name = std::move(name);
        options.seed = id;
        options.settings = *Settings::make(plugin->device_settings, given);
        host = link::DeviceHost::dial(loop, plugin->make_device(options, air), gateway);
    }
    std::uint64_t acknowledged() {
        std::uint64_t count = 0;
        host->with_device([&](Device& device, Now) { count = number(device, "reads_acked"); });
        return count;
    }
    bool drain() {
        air.stop();
        return eventually([&] { return acknowledged() == air.generated(); });
    }
};

std::vector<event::Event> events_of(const std::string& directory, std::vector<event::Type> types) {
    std::vector<event::Event> out;
    journal::Filter filter;
    filter.types = std::move(types);
    auto store = journal::Reader::open(directory + "/gantry.db");
    if (!store) {
        ADD_FAILURE() << store.error().error.text();
        return out;
    }
    auto read = (*store)->query(filter, [&](const event::Event& event) {
        out.push_back(event);
        return true;
    });
    EXPECT_TRUE(read);
    return out;
}

TEST(Gateway, StoresEveryReadOfManyReadersOnceAndInOrder) {
    testkit::TempDir dir;
    auto gateway = Gateway::start(config_for(dir.path()));
    ASSERT_TRUE(gateway) << gateway.error().text();
    auto place = (*gateway)->listeners().front().local;
    link::Loop loop("readers");
    std::vector<std::unique_ptr<Reader>> readers;
    for (std::uint32_t i = 1; i <= 20; ++i)
        readers.push_back(std::make_unique<Reader>(loop, i, place, fmt::format("r-{}", i)));
    for (auto& reader : readers)
        EXPECT_TRUE(eventually([&] { return reader->acknowledged() > 50; }));
    for (auto& reader : readers)
        reader->air.stop();  // all at once: nobody's last reads wait behind what others still make
    std::vector<testkit::Claim> claims;
    for (std::uint32_t i = 1; i <= 20; ++i) {
        EXPECT_TRUE(readers[i - 1]->drain());
        claims.push_back({i, readers[i - 1]->acknowledged(), readers[i - 1]->air.generated()});
    }
    readers.clear();
    (*gateway)->stop();
    auto ledger = testkit::check_ledger(dir.path() + "/gantry.db", claims);
    EXPECT_EQ(ledger.lost + ledger.doubled + ledger.invented + ledger.marked + ledger.seq_gaps, 0u)
        << ledger.text();
    EXPECT_GT(ledger.stored, 1000u);
    EXPECT_EQ(events_of(dir.path(), {event::Type::reader_connected}).size(), 20u);
    EXPECT_EQ(events_of(dir.path(), {event::Type::reader_disconnected}).size(), 20u);
    std::map<std::string, Wall> connected;
    for (auto& event : events_of(dir.path(), {event::Type::reader_connected}))
        connected[event.reader] = event.time;
    for (auto& event : events_of(dir.path(), {event::Type::tag_read}))
        ASSERT_LE(connected[event.reader], event.time) << event.reader;
}

TEST(Gateway, APulledCableLosesAndDoublesNothing) {
    testkit::TempDir dir;
    auto gateway = Gateway::start(config_for(dir.path()));
    ASSERT_TRUE(gateway) << gateway.error().text();
    link::Loop loop("readers");
    Reader reader(loop, 1, (*gateway)->listeners().front().local, "r-1", 1000);
    for (int cut = 0; cut < 5; ++cut) {
        auto before = reader.acknowledged();
        ASSERT_TRUE(eventually([&] { return reader.acknowledged() > before; }));
        reader.host->cut();
    }
    EXPECT_TRUE(reader.drain());
    std::vector<testkit::Claim> claims{{1, reader.acknowledged(), reader.air.generated()}};
    reader.host.reset();
    (*gateway)->stop();
    auto ledger = testkit::check_ledger(dir.path() + "/gantry.db", claims);
    EXPECT_EQ(ledger.lost + ledger.doubled + ledger.invented, 0u) << ledger.text();
}

TEST(Gateway, TheNewestConnectionOfANameWinsAndTheirReadsStayApart) {
    testkit::TempDir dir;
    log::Capture logged;
    auto gateway = Gateway::start(config_for(dir.path()));
    ASSERT_TRUE(gateway) << gateway.error().text();
    auto place = (*gateway)->listeners().front().local;
    link::Loop loop("readers");
    // Their turns must be longer than a slow machine needs for a link and an acknowledgement.
    Reader first(loop, 1, place, "r-same", 200, "300ms");
    ASSERT_TRUE(eventually([&] { return first.acknowledged() > 0; }));
    Reader second(loop, 2, place, "r-same", 200, "300ms");
    // Both dial again for ever, so both get their turn; that is a mistake of the site, and it must be said.
    ASSERT_TRUE(eventually([&] { return second.acknowledged() > 0; }));
    first.air.stop();
    second.air.stop();
    EXPECT_TRUE(eventually(
        [&] {
            return second.acknowledged() == second.air.generated() &&
                   first.acknowledged() == first.air.generated();
        },
        60s));
    std::vector<testkit::Claim> claims{{1, first.acknowledged(), first.air.generated()},
                                       {2, second.acknowledged(), second.air.generated()}};
    first.host.reset();
    second.host.reset();
    (*gateway)->stop();
    auto ledger = testkit::check_ledger(dir.path() + "/gantry.db", claims);
    // A frame whose acknowledgement the other one's connection cut off may be counted twice, never lost.
    EXPECT_EQ(ledger.lost + ledger.invented, 0u) << ledger.text();
    EXPECT_NE(logged.take().find("takes the place of the one from"), std::string::npos);
}

TEST(Gateway, NamesThatNoSectionHasAreRefused) {
    testkit::TempDir dir;
    log::Capture logged;
    auto gateway = Gateway::start(config_for(dir.path()));
    ASSERT_TRUE(gateway) << gateway.error().text();
    link::Loop loop("readers");
    Reader stranger(loop, 1, (*gateway)->listeners().front().local, "stranger");
    EXPECT_TRUE(eventually([&] { return (*gateway)->listeners().front().refused > 2; })) << "it dials again";
    EXPECT_EQ(stranger.acknowledged(), 0u);
    EXPECT_TRUE((*gateway)->readers().empty());
    stranger.host.reset();
    (*gateway)->stop();
    auto log = logged.take();
    EXPECT_NE(log.find("\"stranger\" and is refused: no [[reader]] section"), std::string::npos);
    EXPECT_EQ(log.find("is refused"), log.rfind("is refused")) << "once a minute is enough: " << log;
    EXPECT_EQ(log.find("left without a name: refused"), std::string::npos) << log;
}

TEST(Gateway, RunsJobsOnReadersAndSaysWhyNot) {
    testkit::TempDir dir;
    auto gateway = Gateway::start(
        config_for(dir.path(), "[[reader]]\nname = \"away\"\naddress = \"silion-listen://127.0.0.1:0\"\n"));
    ASSERT_TRUE(gateway) << gateway.error().text();
    link::Loop loop("readers");
    Reader reader(loop, 1, (*gateway)->listeners().front().local, "r-1");
    ASSERT_TRUE(eventually([&] { return reader.acknowledged() > 0; }));
    SetOutputs job;
    job.changes.push_back({1, true, 0});
    auto set = (*gateway)->run("r-1", job, 60s);
    ASSERT_TRUE(set);
    EXPECT_EQ(set->status, JobResult::Status::done) << set->text;
    auto inputs = (*gateway)->run("r-1", GetInputs{}, 60s);
    ASSERT_TRUE(inputs);
    EXPECT_EQ(inputs->status, JobResult::Status::done) << inputs->text;
    EXPECT_NE(wire::find(inputs->values, "inputs"), nullptr);
    EXPECT_FALSE((*gateway)->run("nobody", GetInputs{}, 1s));
    auto away = (*gateway)->run("away", GetInputs{}, 1s);
    ASSERT_TRUE(away);
    EXPECT_EQ(away->status, JobResult::Status::cancelled);
}

TEST(Gateway, PresenceGoesOnAfterARestartWithoutASecondNew) {
    testkit::TempDir dir;
    auto config = config_for(dir.path());
    config.presence.lose_after = 1h;
    auto tags = [&](event::Type type) { return events_of(dir.path(), {type}).size(); };
    link::Loop loop("readers");
    {
        auto gateway = Gateway::start(config);
        ASSERT_TRUE(gateway) << gateway.error().text();
        Reader reader(loop, 1, (*gateway)->listeners().front().local, "r-1", 20);
        ASSERT_TRUE(eventually([&] { return reader.acknowledged() > 5; }));
    }
    auto before = tags(event::Type::tag_new);
    ASSERT_GT(before, 0u);
    auto gateway = Gateway::start(config);
    ASSERT_TRUE(gateway) << gateway.error().text();
    // The same numbered tags again, from 1.
    Reader reader(loop, 1, (*gateway)->listeners().front().local, "r-1", 20);
    ASSERT_TRUE(eventually([&] { return reader.acknowledged() > 5; }));
    reader.air.stop();
    reader.host.reset();
    (*gateway)->stop();
    std::map<std::string, int> news;
    for (auto& event : events_of(dir.path(), {event::Type::tag_new}))
        ++news[to_hex(event.tag.view())];
    for (auto& [tag, count] : news)
        EXPECT_EQ(count, 1) << tag;
    EXPECT_EQ(tags(event::Type::tag_lost), 0u);
}

TEST(Gateway, TwoGatewaysInOneDirectoryAreOneTooMany) {
    testkit::TempDir dir;
    auto first = Gateway::start(config_for(dir.path()));
    ASSERT_TRUE(first) << first.error().text();
    auto second = Gateway::start(config_for(dir.path()));
    ASSERT_FALSE(second);
    EXPECT_NE(second.error().what.find("another gateway is running in"), std::string::npos);
}

}  // namespace
}  // namespace gantry::gateway
