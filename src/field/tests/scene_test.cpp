#include "field/scene.hpp"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <map>
#include <set>
#include <thread>

#include "field/gen2.hpp"
#include "field/picture.hpp"
#include "field/propagation.hpp"
#include "field/tests/scenario_support.hpp"

namespace gantry {

static bool operator==(const AirSighting& a, const AirSighting& b) {
    return a.tag == b.tag && a.technology == b.technology && a.rssi == b.rssi && a.at == b.at &&
           a.phase == b.phase;
}

}  // namespace gantry

namespace gantry::field {
namespace {

using namespace test;

double per_second(const Scenario& scenario, Steady::duration lasts) {
    Scene scene(scenario, start);
    return static_cast<double>(heard(scene.air(0), start, start + lasts).size()) /
           std::chrono::duration<double>(lasts).count();
}
std::size_t different(const std::vector<AirSighting>& sightings) {
    std::set<std::string> ids;
    for (auto& sighting : sightings)
        ids.insert(to_hex(sighting.tag.view()));
    return ids.size();
}

// --- rounds
// --------------------------------------------------------------------------------------------------

// Published: 200 reads a second for slow links, about 1,000 for the fastest (docs/field.md).
TEST(Scene, AReaderReadsAsManyTagsASecondAsRealOnesDo) {
    struct Row {
        std::string_view mode;
        std::uint32_t tags;
        double least, most;
    };
    for (auto& row : {Row{"fast", 200, 850, 1050}, Row{"fast", 10, 700, 1000}, Row{"balanced", 200, 350, 450},
                      Row{"balanced", 1, 100, 250}, Row{"dense", 200, 190, 240}}) {
        auto rate = per_second(bench(row.tags, fmt::format("mode = \"{}\"", row.mode)), 4s);
        EXPECT_GE(rate, row.least) << row.mode << " " << row.tags;
        EXPECT_LE(rate, row.most) << row.mode << " " << row.tags;
    }
}

// Slotted ALOHA cannot do better than one slot in e; the Q algorithm comes near, wherever it starts.
TEST(Scene, TheQAlgorithmFindsTheRightFrameFromAnyStart) {
    for (auto q : {0, 4, 8, 12}) {
        Scene scene(bench(100, fmt::format("session = 2\nq = {}", q)), start);
        auto timing = timing_of(LinkMode::balanced);
        auto found = heard(scene.air(0), start, start + 3s);
        ASSERT_EQ(found.size(), 100u) << q << ": each once";
        // With one empty slot and 0.72 collisions for each read the best takes:
        auto best = 100 * (timing.success + timing.empty + timing.collision * 7 / 10);
        auto took = found.back().at - start;
        EXPECT_GT(took, best * 8 / 10) << q;
        EXPECT_LT(took, best * 2) << q;
    }
    QAlgorithm q(4);
    for (int i = 0; i < 1000; ++i)
        (void)q.collision();
    EXPECT_EQ(q.q(), 15u);
    for (int i = 0; i < 1000; ++i)
        (void)q.empty_slot();
    EXPECT_EQ(q.q(), 0u);
}

TEST(Scene, SessionsDecideHowOftenATagIsRead) {
    std::map<int, std::size_t> reads;
    for (int session : {0, 1, 2, 3}) {
        Scene scene(bench(50), start);
        auto found = heard(scene.air(0), start, start + 10s, {.session = static_cast<std::uint8_t>(session)});
        EXPECT_EQ(different(found), 50u) << session;
        reads[session] = found.size();
    }
    EXPECT_GT(reads[0], 50u * 20);
    EXPECT_GT(reads[1], 50u * 2) << "half a second to five";
    EXPECT_LT(reads[1], 50u * 20);
    EXPECT_EQ(reads[2], 50u) << "silent as long as there is power";
    EXPECT_EQ(reads[3], 50u);

    Scene scene(bench(50), start);
    Carrier carrier{.session = std::uint8_t{2}};
    EXPECT_EQ(heard(scene.air(0), start, start + 3s, carrier).size(), 50u);
    auto later = heard(scene.air(0), start + 5s, start + 8s, carrier).size();
    EXPECT_LT(later, 20u) << "most hold for more than two seconds without it";
    EXPECT_EQ(heard(scene.air(0), start + 100s, start + 103s, carrier).size(), 50u) << "but not for ever";
    EXPECT_EQ(different(heard(scene.air(0), start + 103s, start + 104s, {.session = std::uint8_t{3}})), 50u)
        << "each session has a flag of its own";
}

TEST(Scene, LessPowerReachesFewerTagsAndMorePowerMore) {
    auto scenario = bench(200, "session = 2", "loss_db = 4");
    std::size_t before = 0;
    double rssi = -200;
    for (double dbm : {3.0, 9.0, 15.0, 21.0, 27.0}) {
        Scene scene(scenario, start);
        auto found = heard(scene.air(0), start, start + 5s, {.power_dbm = dbm});
        EXPECT_GE(different(found), before) << dbm;
        before = different(found);
        if (found.empty()) continue;
        auto strongest = std::ranges::max_element(found, {}, &AirSighting::rssi)->rssi / 10.0;
        EXPECT_GT(strongest, rssi) << dbm;
        rssi = strongest;
    }
    EXPECT_EQ(before, 200u);
    Scene scene(scenario, start);
    EXPECT_TRUE(heard(scene.air(0), start, start + 2s, {.power_dbm = -20}).empty());
    EXPECT_TRUE(heard(scene.air(0), start + 2s, start + 3s, {.power_dbm = NAN}).empty());
    EXPECT_TRUE(heard(scene.air(0), start + 3s, start + 4s, {.antenna = 2}).empty());
    EXPECT_TRUE(heard(scene.air(0), start + 3s, start + 4s, {.antenna = 0}).empty());
}

// --- waves
// ---------------------------------------------------------------------------------------------------

TEST(Propagation, IsAsTheFormulasSay) {
    auto scenario = bench(1);
    scenario.path_loss = 2;
    Surroundings air(scenario);
    Beam beam(scenario.readers[0].antennas[0]);
    Vec across{0, 1, 0};
    // 8 dBi and a dipole of 2.15 dBi, 3 dB of polarisation, and 31.2 dB for the first metre at 866 MHz.
    EXPECT_NEAR(way_db(air, beam, {1, 0, 1}, across, 0), 8 + 2.15 - 3 - 31.2, 0.1);
    EXPECT_NEAR(way_db(air, beam, {2, 0, 1}, across, 0) - way_db(air, beam, {4, 0, 1}, across, 0), 6.02,
                0.05);
    EXPECT_NEAR(way_db(air, beam, {2, 0, 1}, across, 5) - way_db(air, beam, {2, 0, 1}, across, 0), -5, 1e-9);
    EXPECT_LT(way_db(air, beam, {2, 0, 1}, {1, 0, 0}, 0), way_db(air, beam, {2, 0, 1}, across, 0) - 10)
        << "the end of a dipole hears little";
    EXPECT_NEAR(way_db(air, beam, {-2, 0, 1}, across, 0), way_db(air, beam, {2, 0, 1}, across, 0) - 20, 0.1)
        << "and so does the back of the antenna";
    auto half = scenario.readers[0].antennas[0].beam / 2 * M_PI / 180;
    EXPECT_NEAR(way_db(air, beam, {2 * std::cos(half), 0, 1 + 2 * std::sin(half)}, across, 0),
                way_db(air, beam, {2, 0, 1}, across, 0) - 3, 0.1);
    // It wakes just where the way takes what it does not need.
    auto far = reach(air, beam, {1, 0, 0}, 30, -18);
    EXPECT_NEAR(30 + way_db(air, beam, {far, 0, 1}, across, 0), -18, 0.05);
    EXPECT_GT(far, 5);
    EXPECT_LT(far, 25);
    // The phase turns once in half a wave.
    EXPECT_EQ(phase_at(air, 1, 0), phase_at(air, 1 + air.metres / 2, 0));
    EXPECT_NEAR(phase_at(air, 1, 0) - phase_at(air, 1 - air.metres / 8, 0), 1024, 4096 * 0.002);

    // Echoes: the mean power is that of the direct way and of the echoes together, one.
    scenario.echo_db = 3;
    Surroundings rough(scenario);
    double sum = 0, lowest = 0;
    for (std::uint64_t pair = 0; pair < 2000; ++pair) {
        auto level = fading(rough, pair, {}, 1s).db;
        auto bounds = fading_bounds(rough, pair, {});
        ASSERT_LE(bounds.least, level);
        ASSERT_GE(bounds.most, level);
        sum += std::pow(10, level / 10);
        lowest = std::min(lowest, level);
    }
    EXPECT_NEAR(sum / 2000, 1, 0.06);
    EXPECT_LT(lowest, -10) << "some stand in a hole";
}

TEST(Scene, RssiAndPhaseFollowTheDistance) {
    auto scenario = bench(1, "", "");
    scenario.groups[0].jitter = 0;
    scenario.echo_db = 60;  // no echoes to speak of
    std::map<double, double> rssi;
    for (double x : {1.0, 2.0, 4.0}) {
        scenario.groups[0].position = {x, 0, 1};
        Scene scene(scenario, start);
        auto found = heard(scene.air(0), start, start + 2s);
        ASSERT_FALSE(found.empty());
        double sum = 0;
        for (auto& each : found) {
            sum += each.rssi / 10.0;
            EXPECT_LE(std::abs(*each.phase - *found[0].phase), 8) << "a still tag keeps its phase";
        }
        rssi[x] = sum / static_cast<double>(found.size());
    }
    EXPECT_NEAR(rssi[1] - rssi[2], 2 * 2.2 * 3.01, 0.3) << "there and back";
    EXPECT_NEAR(rssi[2] - rssi[4], 2 * 2.2 * 3.01, 0.3);
}

// --- determinism
// ---------------------------------------------------------------------------------------------

TEST(Scene, TheSameSeedGivesTheSameSightingsAndAnotherGivesOthers) {
    auto scenario = parsed(example("dock-door"));
    auto run = [&](std::uint64_t seed) {
        scenario.seed = seed;
        Scene scene(scenario, start);
        return heard(scene.air(0), start, start + 3s);
    };
    auto first = run(1);
    EXPECT_GT(first.size(), 50u);
    EXPECT_EQ(first, run(1));
    EXPECT_NE(first, run(2));
}

RC_GTEST_PROP(Scene, HowTimeIsSlicedDoesNotMatter, ()) {
    auto name = *rc::gen::element<std::string>("dock-door", "race-start", "desk", "conveyor");
    auto scenario = parsed(example(name));
    scenario.seed = *rc::gen::inRange<std::uint64_t>(0, 1000);
    auto reader = *rc::gen::inRange<std::size_t>(0, scenario.readers.size());
    auto speed = *rc::gen::element(1.0, 10.0, 0.5);
    Carrier carrier{.session = static_cast<std::uint8_t>(*rc::gen::inRange(0, 4))};
    Scene whole(scenario, start, speed), sliced(scenario, start, speed);
    auto from = start + std::chrono::milliseconds(*rc::gen::inRange(-500, 3000));
    auto at = from;
    std::vector<AirSighting> pieces;
    auto pieces_made = *rc::gen::inRange<std::size_t>(0, 12);
    for (auto slice : *rc::gen::container<std::vector<int>>(pieces_made, rc::gen::inRange(0, 60))) {
        auto end = at + std::chrono::microseconds(slice * 1000 + slice % 7);
        sliced.air(reader).inventory(carrier, at, end, pieces);
        // Other readers, and other sessions, change nothing; nor does it to ask again.
        heard(sliced.air((reader + 1) % scenario.readers.size()), at, end,
              {.session = static_cast<std::uint8_t>((*carrier.session + 1) % 4)});
        heard(sliced.air(reader), std::max(from, at - 30ms), end, carrier);
        at = end;
    }
    RC_ASSERT(pieces == heard(whole.air(reader), from, at, carrier));
    RC_ASSERT(std::ranges::is_sorted(pieces, {}, &AirSighting::at));
}

TEST(Scene, WhatWasHeardCanBeAskedForAgainAndAGapIsSilence) {
    Scene scene(bench(20), start);
    auto& air = scene.air(0);
    auto first = heard(air, start, start + 1s);
    EXPECT_EQ(heard(air, start, start + 1s), first);
    heard(air, start + 2s, start + 3s);
    EXPECT_EQ(heard(air, start, start + 1s), first);
    EXPECT_TRUE(heard(air, start + 1100ms, start + 1900ms).empty()) << "nobody listened then";
    auto slot = heard(air, start + 4s, start + 5s, {.dwell = 100ms});
    ASSERT_FALSE(slot.empty());
    EXPECT_GE(slot.front().at, start + 4900ms) << "only so long did it send";
}

TEST(Scene, FasterMeansThatAllOfItPassesInLessTime) {
    auto scenario = parsed(example("dock-door"));
    Scene usual(scenario, start), fast(scenario, start, 10);
    auto slow_reads = heard(usual.air(0), start, start + 4s),
         fast_reads = heard(fast.air(0), start, start + 400ms);
    ASSERT_EQ(slow_reads.size(), fast_reads.size());
    for (std::size_t i = 0; i < slow_reads.size(); ++i) {
        EXPECT_EQ(slow_reads[i].tag, fast_reads[i].tag);
        EXPECT_LE(std::chrono::abs((slow_reads[i].at - start) / 10 - (fast_reads[i].at - start)), 1ns);
    }
}

// --- scenes
// --------------------------------------------------------------------------------------------------

TEST(Scene, MostOfAPalletIsReadInOnePassAndLessWithLessPower) {
    auto scenario = parsed(example("dock-door"));
    std::vector<std::size_t> read;
    for (double turned : {0.0, -6.0, -14.0}) {
        Scene scene(scenario, start);
        Survey survey(scene, start, turned);
        survey.run_to(start + 4s);
        read.push_back(survey.read_of(0));
    }
    EXPECT_GE(read[0], 190u);
    EXPECT_LT(read[1], read[0] + 1);
    EXPECT_LT(read[2], 150u);
    EXPECT_GT(read[2], 5u);
}

// Thousands of still tags are sorted out once; what is left is counted to be cheap, in rounds and not in
// seconds.
TEST(Scene, AShelfOfThousandsIsCountedOnce) {
    Scene scene(parsed(example("shelf")), start);
    EXPECT_EQ(scene.tags(), 5000u);
    Survey survey(scene, start);
    survey.run_to(start + 6s);
    auto& reads = survey.readers()[0];
    EXPECT_GT(reads.tags, 4000u);
    EXPECT_LT(reads.tags, 5000u) << "some hang in a hole";
    EXPECT_LT(reads.reads, reads.tags * 11 / 10) << "in session 2 hardly one is read twice";
    for (auto each : reads.by_antenna)
        EXPECT_GT(each, 500u);
}

TEST(Scene, SeveralReadersSeeOneFieldEachFromItsPlace) {
    auto scenario = parsed(example("conveyor"));
    Scene scene(scenario, start);
    ASSERT_NE(scene.air("tunnel"), nullptr);
    EXPECT_EQ(scene.air("nobody"), nullptr);
    auto &tunnel = *scene.air("tunnel"), &check = *scene.air("check");
    EXPECT_EQ(tunnel.antennas(), (std::vector<std::uint16_t>{1, 2}));
    EXPECT_EQ(check.antennas(), (std::vector<std::uint16_t>{1}));
    std::map<std::string, Steady> before;
    for (auto& each : heard(tunnel, start, start + 9s))
        before.try_emplace(to_hex(each.tag.view()), each.at);
    std::set<std::string> after;
    for (auto& each : heard(check, start, start + 9s)) {
        auto id = to_hex(each.tag.view());
        if (!after.insert(id).second) continue;
        ASSERT_TRUE(before.contains(id)) << id;
        EXPECT_GT(each.at - before[id], 1s) << "three metres later";
    }
    EXPECT_GE(after.size(), 8u);
    // One tag has one memory, whoever writes to it.
    auto last = heard(check, start + 9s, start + 9s + 200ms).back();
    AirAccess access{.carrier = {}, .tag = last.tag, .now = last.at};
    ASSERT_TRUE(check.write(access, Bank::epc, 2, Bytes{0xBE, 0xEF}));
    EXPECT_EQ(check.read(access, Bank::epc, 2, 1).error(), AirError::no_tag) << "it has another name now";
    auto ids = scene.look(start);
    auto renamed = std::ranges::find_if(ids, [](auto& view) { return view.id.data[0] == 0xBE; });
    ASSERT_NE(renamed, ids.end());
    access.tag = renamed->id;
    EXPECT_EQ(to_hex(check.read(access, Bank::epc, 2, 1).value_or(Bytes{})), "BEEF");
    EXPECT_EQ(tunnel.read(access, Bank::epc, 2, 1).error(), AirError::no_tag) << "too far from here";
    access.carrier.power_dbm = -40;
    EXPECT_EQ(check.read(access, Bank::epc, 2, 1).error(), AirError::no_tag);
}

TEST(Scene, WritingTakesMorePowerThanReadingAndTheDeadAreSilent) {
    auto scenario = bench(1, "", "spread_db = 0");
    bool weak = false;
    for (double dbm = 27; dbm > -10; dbm -= 0.5) {
        Scene scene(scenario, start);
        auto& air = scene.air(0);
        AirAccess access{.carrier = {.power_dbm = dbm}, .tag = scene.look(start)[0].id, .now = start + 1s};
        auto read = air.read(access, Bank::tid, 0, 1);
        auto written = air.write(access, Bank::user, 0, Bytes{1, 2});
        if (!read) {
            EXPECT_EQ(written.error(), AirError::no_tag);
        }
        if (read && !written) {
            EXPECT_EQ(written.error(), AirError::insufficient_power);
            weak = true;
        }
    }
    EXPECT_TRUE(weak);
    Scene scene(scenario, start);
    AirAccess access{.carrier = {}, .tag = scene.look(start)[0].id, .now = start};
    ASSERT_TRUE(scene.air(0).write(access, Bank::reserved, 0, Bytes{0, 0, 0, 7}));
    EXPECT_FALSE(heard(scene.air(0), start, start + 1s).empty());
    ASSERT_TRUE(scene.air(0).kill(access, 7));
    EXPECT_TRUE(heard(scene.air(0), start + 2s, start + 3s).empty());
}

TEST(Scene, HfTagsCollideWhereTheReaderCannotTellThemApart) {
    auto scenario = parsed(example("desk"));
    Scene scene(scenario, start);
    auto &apart = *scene.air("desk-hf"), &plain = *scene.air("desk-hf-plain"),
         &single = *scene.air("desk-hf-single");
    EXPECT_TRUE(apart.anticollision());
    EXPECT_FALSE(plain.anticollision());
    auto found = heard(apart, start, start + 2s);
    EXPECT_EQ(different(found), 8u);
    EXPECT_GT(found.size(), 50u) << "some dozens a second";
    EXPECT_LT(found.size(), 200u);
    for (auto& each : found)
        EXPECT_EQ(each.technology, event::Technology::iso15693);
    EXPECT_TRUE(heard(plain, start, start + 2s).empty()) << "eight cards at once";
    EXPECT_EQ(different(heard(single, start, start + 2s)), 1u);
    Scene other(scenario, start);
    EXPECT_TRUE(heard(*other.air("desk-hf"), start, start + 2s, {.anticollision = false}).empty())
        << "a device whose make cannot says so";
    for (auto& each : heard(*scene.air("desk-uhf"), start, start + 2s))
        EXPECT_EQ(each.technology, event::Technology::epc_gen2);
}

TEST(Scene, EveryExampleIsPlayedAndEveryReaderInItHearsSomething) {
    for (auto name : {"dock-door", "conveyor", "shelf", "race-start", "desk"}) {
        SCOPED_TRACE(name);
        auto scenario = parsed(example(name));
        EXPECT_EQ(scenario.name, name);
        EXPECT_FALSE(scenario.about.empty());
        Scene scene(scenario, start);
        Survey survey(scene, start);
        survey.run_to(start + (scenario.tags() > 1000 ? 2s : 6s));
        for (std::size_t i = 0; i < scenario.readers.size(); ++i)
            if (scenario.readers[i].name != "desk-hf-plain") {
                EXPECT_GT(survey.readers()[i].reads, 0u) << scenario.readers[i].name;
            }
    }
}

TEST(Scene, ManyThreadsMayLookIntoIt) {
    Scene scene(parsed(example("desk")), start);
    std::vector<std::thread> threads;
    for (std::size_t reader = 0; reader < scene.scenario().readers.size(); ++reader)
        threads.emplace_back([&, reader] {
            for (int round = 0; round < 50; ++round) {
                auto from = start + round * 20ms;
                for (auto& each : heard(scene.air(reader), from, from + 20ms))
                    (void)scene.air(reader).write({.carrier = {}, .tag = each.tag, .now = each.at},
                                                  Bank::user, 0, Bytes{1, 2});
            }
        });
    for (auto& thread : threads)
        thread.join();
    EXPECT_EQ(scene.look(start).size(), scene.tags());
}

// --- pictures
// ------------------------------------------------------------------------------------------------

std::size_t occurrences(std::string_view text, std::string_view what) {
    std::size_t count = 0;
    for (auto at = text.find(what); at != text.npos; at = text.find(what, at + what.size()))
        ++count;
    return count;
}

TEST(Picture, ShowsAntennasBeamsTagsAndWhoReadsWhat) {
    auto scenario = parsed(example("dock-door"));
    scenario.about = "<b>\"&\x1B";
    Scene scene(scenario, start);
    Survey survey(scene, start);
    survey.run_to(start + 1500ms);
    auto svg = draw(scene, survey);
    EXPECT_TRUE(svg.starts_with("<svg "));
    EXPECT_TRUE(svg.ends_with("</svg>\n"));
    EXPECT_NE(svg.find("&lt;b&gt;&quot;&amp;\\x1B"), svg.npos) << "what the file says is shown safely";
    EXPECT_EQ(occurrences(svg, "class=\"view\""), 2u) << "from above and from the side";
    EXPECT_EQ(occurrences(svg, "class=\"antenna\""), 8u);
    EXPECT_EQ(occurrences(svg, "class=\"beam\""), 8u);
    EXPECT_EQ(occurrences(svg, "<title>"), 400u);
    EXPECT_GT(occurrences(svg, "class=\"reads\""), 40u);
    for (auto words :
         {"t = 1.5 s", "left low, left high", "read within the last 500ms",
          "where tags of pallet wake, echoes aside", "dock (any)", "200 of 200 are here", "dBm by dock"})
        EXPECT_NE(svg.find(words), svg.npos) << words;
    EXPECT_EQ(svg.find("nan"), svg.npos);

    Scene gone(scenario, start);
    auto none = draw(gone, Survey(gone, start));
    EXPECT_NE(none.find("0 of 200 are here, 0 have been read"), none.npos);
    EXPECT_EQ(occurrences(none, "class=\"reads\""), 0u);
}

}  // namespace
}  // namespace gantry::field
