#include "support.hpp"

// The driver against the virtual reader, joined in memory on virtual time.
namespace gantry::silion::test {

static TestAir::Tag numbered(std::chrono::microseconds beat = 50ms, std::uint16_t antenna = 1) {
    TestAir::Tag tag;
    tag.id = epc("E2000000000000000000000A");
    tag.antenna = antenna;
    tag.beat = beat;
    tag.numbered = true;
    return tag;
}

// Every sighting has an id of its own: what the reader believes to be acknowledged must be stored, once.
static void ledger_is_clean(const Site& site) {
    for (auto& [id, reads] : site.reads)
        ASSERT_EQ(reads, 1u) << to_hex(id);
    EXPECT_EQ(site.reads.size(), site.all_reads);
    EXPECT_GE(site.all_reads, static_cast<std::uint64_t>(site.state("reads_acked")));
    EXPECT_EQ(site.total(Count::reads), site.all_reads);
    auto waiting = site.state("reads_sent") - site.state("reads_acked");
    EXPECT_LE(site.all_reads, static_cast<std::uint64_t>(site.state("reads_acked") + waiting));
}

TEST(SilionPair, BothGenerationsDeliverEveryRead) {
    for (auto generation : {"1", "2"})
        for (auto acknowledge : {"true", "false"})
            for (auto crc : {"true", "false"}) {
                SCOPED_TRACE(testing::Message() << generation << " " << acknowledge << " " << crc);
                Site site(Given{{"generation", generation}, {"ack", acknowledge}, {"crc", crc}});
                site.air.tags = {numbered(), numbered(70ms, 2)};
                site.air.tags[1].id.data[0] = 0xE3;
                site.run_for(120s);
                site.air.tags.clear();
                site.run_for(30s);
                EXPECT_TRUE(site.reasons.empty());
                EXPECT_EQ(site.connections, 1u);
                EXPECT_EQ(site.all_reads, site.air.heard);
                EXPECT_EQ(site.total(Count::repeats), 0u);
                EXPECT_GT(site.air.heard, 1000u);
            }
}

TEST(SilionPair, BytesInAnyPiecesGiveTheSame) {
    Site whole, single;
    single.piece = 1;
    for (auto* site : {&whole, &single}) {
        site->air.tags = {numbered()};
        site->run_for(20s);
    }
    EXPECT_EQ(whole.reads, single.reads);
    EXPECT_GT(whole.all_reads, 0u);
}

TEST(SilionPair, AThousandLostAcknowledgementsCountNoReadTwice) {
    Site site(Given{{"batch", "500ms"}});
    site.air.tags = {numbered()};
    std::uint64_t lost = 0;
    site.drop = [&](ByteView, bool from_device) {
        if (from_device || lost >= 1000) return false;
        ++lost;
        return true;
    };
    site.run_for(2h);
    EXPECT_EQ(lost, 1000u);
    EXPECT_GE(site.total(Count::repeats), 999u);
    EXPECT_GE(site.total(Count::acknowledged), 1000u);
    EXPECT_TRUE(site.reasons.empty());
    site.drop = {};
    site.air.tags.clear();
    site.run_for(10min);
    ledger_is_clean(site);
    EXPECT_EQ(site.all_reads + static_cast<std::uint64_t>(site.state("dropped")), site.air.heard);
}

TEST(SilionPair, EveryOtherAcknowledgementLostLosesNothing) {
    Site site(Given{{"batch", "500ms"}, {"buffer", "100000"}});
    site.air.tags = {numbered()};
    unsigned number = 0;
    site.drop = [&](ByteView, bool from_device) { return !from_device && ++number % 2 == 1; };
    site.run_for(10min);
    site.drop = {};
    site.air.tags.clear();
    site.run_for(1min);
    ledger_is_clean(site);
    EXPECT_EQ(site.all_reads, site.air.heard);
    EXPECT_GT(site.total(Count::repeats), 10u);
}

TEST(SilionPair, ASlowStoreMakesRepeatsButNoDoubles) {
    for (auto commit_time : {100ms, 4900ms, 5000ms, 7000ms, 12'000ms}) {
        SCOPED_TRACE(commit_time.count());
        Site site(Given{{"buffer", "100000"}});
        site.commit_time = commit_time;
        site.air.tags = {numbered()};
        site.run_for(5min);
        site.air.tags.clear();
        site.run_for(20min);
        ledger_is_clean(site);
        EXPECT_EQ(site.all_reads, site.air.heard);
        EXPECT_TRUE(site.reasons.empty());
    }
}

TEST(SilionPair, CutLinksLoseAndDoubleNothing) {
    for (auto generation : {"1", "2"}) {
        Site site(Given{{"generation", generation}, {"batch", "700ms"}, {"buffer", "100000"}});
        site.air.tags = {numbered()};
        for (int i = 0; i < 200; ++i) {
            site.commit_time = i % 3 == 0 ? 300ms : 0ms;
            site.run_for(std::chrono::milliseconds{400 + i * 37 % 9000});
            site.disconnect();
        }
        site.air.tags.clear();
        site.run_for(2min);
        ledger_is_clean(site);
        EXPECT_EQ(site.all_reads, site.air.heard);
        EXPECT_GT(site.total(Count::repeats), 0u);
        EXPECT_GT(site.connections, 150u);
    }
}

TEST(SilionPair, NobodyAtHomeForAnHourFillsTheReadersBufferOnly) {
    Site site(Given{{"buffer", "1000"}});
    site.air.tags = {numbered(1000ms)};
    site.reachable = false;
    site.run_for(1h);
    EXPECT_EQ(site.state("buffered"), 1000);
    site.reachable = true;
    site.air.tags.clear();
    site.run_for(1min);
    EXPECT_EQ(site.all_reads, 1000u);
    EXPECT_EQ(site.all_reads + static_cast<std::uint64_t>(site.state("dropped")), site.air.heard);
}

TEST(SilionPair, ARestartIsSeenAndTheReaderComesBack) {
    for (auto generation : {"1", "2"}) {
        Site site(Given{{"generation", generation}});
        site.air.tags = {numbered()};
        site.run_for(10s);
        ASSERT_NE(site.driver, nullptr);
        site.driver->run({.id = 5, .deadline = site.now.steady + 10s}, RestartReader{}, site.now);
        site.run_for(30s);
        bool done = false;
        for (auto& signal : site.signals)
            if (auto* ended = std::get_if<JobEnded>(&signal))
                done = ended->job == 5 && ended->result.status == JobResult::Status::done;
        EXPECT_TRUE(done);
        EXPECT_EQ(site.connections, 2u);
        EXPECT_EQ(site.state("restarts"), 1);
        site.air.tags.clear();
        site.run_for(30s);
        ledger_is_clean(site);
    }
}

TEST(SilionPair, OutputsAreTimedAndTheLinkSurvivesTheSilence) {
    for (auto generation : {"1", "2"}) {
        Site site(Given{{"generation", generation}, {"heartbeat", "2s"}}, {{"heartbeat", "2s"}});
        site.run_for(10s);
        ASSERT_NE(site.driver, nullptr);
        SetOutputs set;
        set.changes.push_back({3, true, 30'000});
        site.driver->run({.id = 9, .deadline = site.now.steady + 60s}, set, site.now);
        site.run_for(20s);
        auto fields = site.device->state();
        EXPECT_EQ(wire::find(fields, "outputs")->get<std::string>()->at(2), '1');
        site.run_for(20s);
        fields = site.device->state();
        EXPECT_EQ(wire::find(fields, "outputs")->get<std::string>()->at(2), '0');
        ASSERT_TRUE(std::holds_alternative<JobEnded>(site.signals.back()));
        EXPECT_EQ(std::get<JobEnded>(site.signals.back()).result.status, JobResult::Status::done);
        EXPECT_TRUE(site.reasons.empty());
    }
}

TEST(SilionPair, AHalfOpenLinkIsFoundAndReplaced) {
    Site site(Given{{"buffer", "100000"}});
    site.air.tags = {numbered()};
    site.run_for(20s);
    ASSERT_TRUE(site.device->inject("half_open", site.now));
    site.run_for(40s);
    ASSERT_EQ(site.reasons.size(), 1u);
    EXPECT_EQ(site.reasons[0], "no frame for 30 s, three heartbeat periods");
    EXPECT_EQ(site.connections, 2u);
    site.air.tags.clear();
    site.run_for(30s);
    ledger_is_clean(site);
    EXPECT_EQ(site.all_reads, site.air.heard);
}

TEST(SilionPair, FaultsFromOutsideAreSurvived) {
    Site site(Given{{"buffer", "100000"}, {"batch", "500ms"}});
    site.air.tags = {numbered()};
    std::vector<std::string> faults = {"garbage",  "bad_crc", "drop",         "input 1=1",    "input 1=0",
                                       "error 11", "clear",   "half_open on", "half_open off"};
    for (int round = 0; round < 20; ++round)
        for (auto& fault : faults) {
            site.run_for(3s);
            ASSERT_TRUE(site.device->inject(fault, site.now));
        }
    site.air.tags.clear();
    site.run_for(3min);
    ledger_is_clean(site);
    EXPECT_EQ(site.all_reads, site.air.heard);
    EXPECT_GT(site.total(Count::bad_checksum), 0u);
    EXPECT_GT(site.total(Count::resyncs), 0u);
}

TEST(SilionPair, ADeviceThatIgnoresAcknowledgementsIsAnsweredEachTime) {
    Site site;
    site.air.tags = {numbered()};
    site.run_for(1s);
    ASSERT_TRUE(site.device->inject("stuck_ack on", site.now));
    site.run_for(1min);
    EXPECT_GE(site.total(Count::repeats), 10u);
    EXPECT_EQ(site.total(Count::acknowledged), site.total(Count::repeats) + 1);
    ASSERT_TRUE(site.device->inject("stuck_ack off", site.now));
    site.run_for(1min);
    site.air.tags.clear();
    site.run_for(20s);
    ledger_is_clean(site);
    EXPECT_EQ(site.all_reads, site.air.heard);
}

// A standing tag gives byte-equal batches: they are new ones, and all of them count.
TEST(SilionPair, EqualBatchesOfAStandingTagAllCount) {
    Site site;
    site.air.tags.push_back({epc("E20041453116003820703FB7"), 1, -400, 100ms});
    site.run_for(10min);
    site.air.tags.clear();
    site.run_for(10s);
    EXPECT_EQ(site.total(Count::repeats), 0u);
    EXPECT_EQ(site.all_reads, site.air.heard);
}

}  // namespace gantry::silion::test
