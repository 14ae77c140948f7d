#include <atomic>

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>
#include "link/device_host.hpp"

#include "link/serial.hpp"
#include "support.hpp"
#include "testkit/eventually.hpp"
#include "testkit/temp_dir.hpp"

// The driver against the virtual unit: in memory on virtual time, and over a pseudo-terminal.
namespace gantry::dagprog::test {

TEST(DagprogPair, SeesItsTagsInEveryFormThatAUnitMayInsistOn) {
    for (std::string family : {"iso15693", "icode1"})
        for (std::string stx : {"any", "yes", "no"})
            for (std::string separator : {"any", "tab", "none", "space"})
                for (std::string order : {"msb", "lsb"}) {
                    SCOPED_TRACE(family + " " + stx + " " + separator + " " + order);
                    Given settings = {
                        {"family", family}, {"stx", stx}, {"separator", separator}, {"byte_order", order}};
                    bool icode1 = family == "icode1";
                    Pair pair(settings, icode1 ? Given{{"mode", "as"}, {"byte_order", order}} : Given{});
                    pair.hf.put(icode1 ? icode_a : tag_a);
                    pair.run_for(10s);
                    EXPECT_GT(pair.reads(icode1 ? icode_a : tag_a), 5u);
                    EXPECT_EQ(pair.faults(), "");
                    auto form = separator == "any" ? "tab" : separator;
                    EXPECT_NE(pair.detail().find("values after " + form), std::string::npos) << pair.detail();
                    auto job = WriteTag{
                        .access = access_to(icode1 ? icode_a : tag_a), .offset = 5, .data = hex("00001234")};
                    auto done = pair.does(job);
                    EXPECT_EQ(done.status, Status::done) << done.text;
                    EXPECT_EQ(pair.block(icode1 ? icode_a : tag_a, 5), "00001234");
                }
}

TEST(DagprogPair, BytesInAnyPiecesGiveTheSame) {
    std::vector<std::uint64_t> reads;
    for (std::size_t piece : {0u, 1u, 3u, 7u}) {
        Pair pair;
        pair.link.piece = piece;
        pair.hf.put(tag_a);
        pair.run_for(10s);
        reads.push_back(pair.reads(tag_a));
        EXPECT_EQ(pair.driver.counters()[static_cast<std::size_t>(Count::skipped_bytes)], 0u);
    }
    for (auto each : reads)
        EXPECT_EQ(each, reads[0]);
    EXPECT_GT(reads[0], 20u);
}

TEST(DagprogPair, SleepingTagsAreSeenAgainAndAgain) {
    Pair pair(Given{}, {{"mode", "sr"}, {"reread", "1s"}});
    pair.run_for(8s);
    pair.hf.put(tag_a);
    pair.hf.put(tag_b);
    pair.run_for(20s);
    for (auto tag : {tag_a, tag_b}) {
        EXPECT_GT(pair.reads(tag), 8u);
        EXPECT_LT(pair.reads(tag), 25u);
    }
    EXPECT_EQ(pair.faults(), "");
}

TEST(DagprogPair, TwoTagsInFrontOfAUnitThatReadsForEverAreAFaultAndNoReads) {
    Pair pair;
    pair.run_for(8s);
    pair.hf.put(tag_a);
    pair.hf.put(tag_b);
    pair.run_for(5s);
    EXPECT_EQ(pair.reads(tag_a) + pair.reads(tag_b), 0u);
    EXPECT_NE(pair.faults().find("more than one may be in the field"), std::string::npos);
    pair.hf.take(tag_b);
    pair.run_for(2s);
    EXPECT_GT(pair.reads(tag_a), 0u);
}

TEST(DagprogPair, ComesBackFromEveryFault) {
    for (std::string fault :
         {"restart", "garbage", "truncate", "duplicate", "bad_crc", "write_error", "error 1", "error 2",
          "antenna broken", "slow on", "silent on", "stuck_ack on", "half_open on"}) {
        SCOPED_TRACE(fault);
        Pair pair(Given{}, {{"alive", "2s"}});
        pair.hf.put(tag_a);
        pair.run_for(6s);
        auto before = pair.reads(tag_a);
        EXPECT_GT(before, 0u);
        pair.inject(fault);
        pair.run_for(3s);
        auto space = fault.find(' ');
        if (fault.ends_with(" on")) pair.inject(fault.substr(0, space) + " off");
        if (fault == "antenna broken") pair.inject("antenna good");
        before = pair.reads(tag_a);
        bool unheard = fault == "silent on" || fault == "half_open on";
        pair.run_for(12s);
        // A unit that was not heard for long is left, and whoever dials it again finds it.
        if (unheard && pair.driver.finished())
            EXPECT_EQ(pair.driver.finish_reason(), "the unit answers no more");
        else
            EXPECT_GT(pair.reads(tag_a), before);
    }
}

TEST(DagprogPair, ARestartIsSeenAndTheUnitSetUpAgain) {
    Pair pair(Given{{"family", "icode1"}}, {{"first_block", "5"}});
    pair.hf.put(icode_a);
    pair.run_for(6s);
    EXPECT_EQ(pair.state("first_block"), "5");
    pair.inject("restart");
    pair.run_for(6s);
    EXPECT_EQ(pair.state("first_block"), "5");
    EXPECT_EQ(pair.state("mode"), "UR");
    EXPECT_NE(pair.faults().find("the unit restarted: DAGProg ICODE1"), std::string::npos);
}

TEST(DagprogPair, ChecksCrc8AtEitherEnd) {
    for (bool ours : {true, false}) {
        auto settings = ours ? Given{{"check_crc8", "true"}, {"crc8", "i-code"}} : Given{{"mode", "rc"}};
        Pair pair(Given{}, settings);
        pair.hf.put(tag_a, hex("0012341F"));
        pair.run_for(6s);
        auto good = pair.reads(tag_a);
        EXPECT_GT(good, 0u);
        pair.hf.take(tag_a);
        pair.hf.put(tag_b, hex("0012341E"));
        pair.run_for(3s);
        EXPECT_EQ(pair.reads(tag_b), 0u);
        EXPECT_GT(pair.driver.counters()[static_cast<std::size_t>(Count::bad_checksum)], 0u);
    }
}

RC_GTEST_PROP(DagprogPair, NoBytesOnTheLineDoHarm, (const std::vector<std::uint8_t>& noise, bool to_driver)) {
    Pair pair(Given{}, {{"separator", "tab"}});
    pair.hf.put(tag_a);
    pair.run_for(4s);
    if (to_driver)
        pair.driver.received(noise, pair.link.now());
    else
        pair.device.received(noise, pair.link.now());
    pair.collect();
    pair.device.inject("restart", pair.link.now());
    pair.run_for(8s);
    auto before = pair.reads(tag_a);
    pair.run_for(3s);
    RC_ASSERT(pair.driver.finished() || pair.reads(tag_a) > before);
}

TEST(DagprogPair, ALineOfTheSystemCarriesIt) {
    testkit::TempDir directory;
    auto path = directory.path() + "/ttyD0";
    Hf hf;
    hf.put(tag_a);
    link::Loop loop("dagprog");
    auto host = link::DeviceHost::pty(
        loop, std::make_unique<DagprogDevice>(DeviceOptions{"desk", 3, device_with()}, hf.air), path, 38400);
    ASSERT_TRUE(host) << host.error().text();
    auto settings =
        link::parse_serial(path, {{{"baud", std::to_string(link::baud_of(plugin.schemes[0].line))}}});
    ASSERT_TRUE(settings);
    EXPECT_EQ(settings->baud, 38400u);
    auto socket = link::open_serial(*settings);
    ASSERT_TRUE(socket) << socket.error().text();
    DagprogDriver driver({.settings = driver_with()});
    std::atomic<unsigned> reads = 0;
    std::atomic<int> job = -1;
    std::shared_ptr<link::Link> line;
    loop.run_and_wait([&] {
        driver.admitted({}, link::read_clocks());
        link::Link::Callbacks callbacks;
        callbacks.after_turn = [&] {
            for (auto& report : std::exchange(driver.reports(), {})) {
                reads += static_cast<unsigned>(report.observations.size());
                driver.committed(report.ticket, link::read_clocks());
            }
            for (auto& signal : std::exchange(driver.signals(), {}))
                if (auto* ended = std::get_if<JobEnded>(&signal))
                    job = static_cast<int>(ended->result.status);
        };
        line = link::Link::start(loop, std::move(*socket), driver, std::move(callbacks));
    });
    EXPECT_TRUE(testkit::eventually([&] { return reads >= 3; }));
    loop.run_and_wait([&] {
        auto now = link::read_clocks();
        driver.run({.id = 1, .deadline = now.steady + 20s},
                   WriteTag{.access = access_to(tag_a), .offset = 5, .data = hex("11223344")}, now);
        line->wake();
    });
    EXPECT_TRUE(testkit::eventually([&] { return job >= 0; }));
    EXPECT_EQ(job, static_cast<int>(Status::done));
    EXPECT_EQ(hf.block(tag_a, 5, link::read_clocks()), "11223344");
    loop.run_and_wait([&] { line.reset(); });
}

}  // namespace gantry::dagprog::test
