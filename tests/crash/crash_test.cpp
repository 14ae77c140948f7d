// Promise P1: a read that was acknowledged is in the journal, once, whatever is killed when. Virtual readers
// number every read; the gateway is killed at random instants under load; then the books are compared.
#include <csignal>
#include <filesystem>
#include <memory>
#include <random>
#include <thread>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "link/device_host.hpp"
#include "protocols/registry.hpp"
#include "testkit/eventually.hpp"
#include "testkit/ledger.hpp"
#include "testkit/process.hpp"
#include "testkit/temp_dir.hpp"
#include "wire/layout.hpp"

namespace gantry {
namespace {

using testkit::Process;

constexpr int kills = 22;
constexpr std::uint32_t reader_count = 12;
constexpr double reads_per_second = 400;

std::uint64_t number(const wire::Fields& fields, std::string_view name) {
    const auto* value = wire::find(fields, name);
    return value == nullptr ? 0 : static_cast<std::uint64_t>(wire::as_number(*value).value_or(0));
}

// A gateway of its own in a directory of its own, that comes back at the same port.
class Site {
public:
    explicit Site(std::vector<std::string> environment) : environment_(std::move(environment)) {
        configure(0);
    }

    std::string data() const { return dir_.path() + "/data"; }
    std::string store() const { return data() + "/gantry.db"; }
    std::uint16_t port() const { return port_; }

    void start() {
        process_ = std::make_unique<Process>(
            std::vector<std::string>{GANTRY_BINARY, "run", "-c", dir_.path() + "/gantry.toml"}, environment_,
            dir_.path() + "/log");
        auto line = process_->wait_for_line("listening on ");
        ASSERT_FALSE(line.empty()) << "the gateway did not start";
        if (port_ == 0) configure(static_cast<std::uint16_t>(std::stoi(line.substr(line.rfind(':') + 1))));
        ASSERT_FALSE(process_->wait_for_line("ready").empty());
    }
    void kill() {
        process_->signal(SIGKILL);
        process_->wait();
    }
    int stop() {
        process_->signal(SIGTERM);
        return process_->wait();
    }

private:
    void configure(std::uint16_t port) {
        port_ = port;
        testkit::write_file(dir_.path() + "/gantry.toml", fmt::format(R"([gateway]
id = "crash"
data_dir = "{}"
[[reader]]
name = "r-*"
address = "silion-listen://127.0.0.1:{}"
[events]
tag_read = true
)",
                                                                      data(), port));
    }

    std::vector<std::string> environment_;
    testkit::TempDir dir_;
    std::uint16_t port_ = 0;
    std::unique_ptr<Process> process_;
};

// Virtual readers that ask for acknowledgement, keep what is not acknowledged, and dial again.
class Fleet {
public:
    explicit Fleet(std::uint16_t port) : loop_("fleet") {
        const auto* plugin = find_plugin("silion");
        const std::vector<std::pair<std::string, std::string>> given = {
            {"generation", "2"}, {"batch", "50ms"}, {"buffer", "1000000"}, {"redial", "100ms"}};
        auto settings = Settings::make(plugin->device_settings, given);
        if (!settings) {
            ADD_FAILURE() << settings.error().text();
            return;
        }
        for (std::uint32_t i = 1; i <= reader_count; ++i) {
            airs_.push_back(std::make_unique<testkit::NumberingAir>(i, reads_per_second));
            DeviceOptions options;
            options.name = fmt::format("r-{}", i);
            options.seed = i;
            options.settings = *settings;
            hosts_.push_back(link::DeviceHost::dial(loop_, plugin->make_device(options, *airs_.back()),
                                                    {"127.0.0.1", port}));
        }
    }

    std::vector<testkit::Claim> claims() {
        std::vector<testkit::Claim> out;
        for (std::uint32_t i = 0; i < hosts_.size(); ++i)
            hosts_[i]->with_device([&](Device& device, Now) {
                out.push_back({i + 1, number(device.state(), "reads_acked"), airs_[i]->generated()});
            });
        return out;
    }

    // No more reads pass; true when all that were made are acknowledged.
    bool drain() {
        for (auto& air : airs_)
            air->stop();
        return testkit::eventually(
            [&] {
                for (auto& claim : claims())
                    if (claim.acknowledged != claim.generated) return false;
                return true;
            },
            200s);
    }

private:
    link::Loop loop_;
    std::vector<std::unique_ptr<testkit::NumberingAir>> airs_;
    std::vector<std::unique_ptr<link::DeviceHost>> hosts_;
};

std::uint64_t acknowledged_in(const std::vector<testkit::Claim>& claims) {
    std::uint64_t count = 0;
    for (auto& claim : claims)
        count += claim.acknowledged;
    return count;
}

void kill_often(Site& site, Fleet& fleet) {
    static std::mt19937 random(20261122);  // a repeated test goes on to other instants
    for (int i = 0; i < kills; ++i) {
        // Every instant must be possible, so this one waits for a time and not for a condition.
        std::this_thread::sleep_for(
            std::chrono::milliseconds(std::uniform_int_distribution(20, 400)(random)));
        site.kill();
        site.start();
        if (testing::Test::HasFatalFailure()) return;
        // Under load means that the readers are back: wait until something more was acknowledged.
        auto before = acknowledged_in(fleet.claims());
        ASSERT_TRUE(testkit::eventually([&] { return acknowledged_in(fleet.claims()) > before; }))
            << "the readers did not come back";
    }
}

// From the start to a clean stop; `claims` is what the readers know when all that they made is acknowledged.
void run_and_kill(Site& site, std::vector<testkit::Claim>& claims) {
    site.start();
    if (testing::Test::HasFatalFailure()) return;
    Fleet fleet(site.port());
    kill_often(site, fleet);
    if (testing::Test::HasFatalFailure()) return;
    ASSERT_TRUE(fleet.drain());
    claims = fleet.claims();
    EXPECT_EQ(site.stop(), 0);
}

TEST(Crash, KilledAgainAndAgainNothingAcknowledgedIsLostOrDoubled) {
    Site site({"GANTRY_FAILPOINT=slow_commit"});
    std::vector<testkit::Claim> claims;
    run_and_kill(site, claims);
    if (HasFatalFailure()) return;
    auto ledger = testkit::check_ledger(site.store(), claims);
    auto acknowledged = acknowledged_in(claims);
    RecordProperty("ledger", ledger.text());
    EXPECT_EQ(ledger.lost, 0u) << ledger.text();
    EXPECT_EQ(ledger.doubled, 0u) << ledger.text();
    EXPECT_EQ(ledger.invented, 0u) << ledger.text();
    EXPECT_EQ(ledger.marked, 0u) << ledger.text();
    EXPECT_EQ(ledger.seq_gaps, 0u) << ledger.text();
    EXPECT_EQ(ledger.stored, acknowledged);
    EXPECT_GT(acknowledged, 10'000u);
}

// The same proof, with the same slow disk, must bite: with acknowledgements sent before the commit it has to
// find losses.
TEST(Crash, AcknowledgingBeforeTheCommitIsFoundOut) {
    Site site({"GANTRY_FAILPOINT=slow_commit,ack_before_commit"});
    std::vector<testkit::Claim> claims;
    run_and_kill(site, claims);
    if (HasFatalFailure()) return;
    auto ledger = testkit::check_ledger(site.store(), claims);
    EXPECT_GT(ledger.lost, 0u) << ledger.text();
}

}  // namespace
}  // namespace gantry
