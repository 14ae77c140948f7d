#include <gtest/gtest.h>

#include <algorithm>
#include <sstream>

#include "presence/tests/presence_world.hpp"

namespace gantry::presence::testing {

static std::string since_start(Wall time) {
    return to_text(time - start.wall);
}

std::string to_line(const Transition& transition) {
    auto name = event::to_text(transition.type);
    name.remove_prefix(4);  // "tag."
    auto zone = [](ZoneIndex index) { return index == 0 ? "Z" : "Y"; };
    auto line = since_start(transition.time) + " " + std::string(name) + " " +
                std::string(as_text(transition.record.tag.view())) + " " + zone(transition.record.zone);
    if (!transition.reason.empty()) line += " " + std::string(transition.reason);
    if (transition.type == event::Type::tag_moved) line += std::string(" from ") + zone(transition.from);
    return line;
}

std::string play(const Rules& z, const Rules& y, std::string_view script, bool every_deadline) {
    Presence presence;
    presence.add_zone(z);
    presence.add_zone(y);
    for (int reader = 0; reader < 3; ++reader)
        presence.add_reader();
    std::vector<Transition> out;

    std::istringstream lines{std::string(script)};
    for (std::string line; std::getline(lines, line);) {
        std::istringstream words(line);
        std::string time, verb, tag, in, zone, by, reader, times;
        if (!(words >> time >> verb)) continue;
        auto offset = parse_duration(time);
        if (!offset) throw std::invalid_argument("no time in: " + line);
        auto now = start + *offset;
        while (every_deadline) {
            auto due = presence.deadline();
            if (!due || *due > now.steady) break;
            presence.time_passed(start + std::chrono::ceil<std::chrono::microseconds>(*due - start.steady),
                                 out);
        }
        if (verb == "see") {
            if (!(words >> tag >> in >> zone >> by >> reader)) throw std::invalid_argument(line);
            words >> times;
            Sighting sighting{.tag = tag_of(tag),
                              .technology = event::Technology::epc_gen2,
                              .zone = zone == "Z" ? 0u : 1u,
                              .reader = static_cast<ReaderIndex>(reader.at(1) - '1'),
                              .antenna = 1};
            if (!times.empty()) sighting.reads = static_cast<std::uint32_t>(std::stoul(times.substr(1)));
            presence.sighted(sighting, now, out);
        } else if (verb == "online" || verb == "offline") {
            words >> reader;
            auto index = static_cast<ReaderIndex>(reader.at(1) - '1');
            verb == "online" ? presence.reader_online(index, now) : presence.reader_offline(index, now);
        } else if (verb == "end") {
            presence.time_passed(now, out);
        } else {
            throw std::invalid_argument("unknown verb in: " + line);
        }
    }
    std::ranges::stable_sort(out, {}, &Transition::time);
    std::string story;
    for (auto& transition : out)
        story += to_line(transition) + "\n";
    return story;
}

void expect_story(const Rules& z, const Rules& y, std::string_view script, std::string_view expected) {
    EXPECT_EQ(play(z, y, script, true), expected) << "with every deadline kept";
    EXPECT_EQ(play(z, y, script, false), expected) << "with no deadline kept before the end";
}
void expect_story(const Rules& rules, std::string_view script, std::string_view expected) {
    expect_story(rules, rules, script, expected);
}

namespace {

const Rules at_once{};  // the defaults
const Rules by_time{.observe_after = 1s};
const Rules by_count{.observe_after_reads = 3};

TEST(PresenceRules, WithNoThresholdNewAndObservedComeTogetherInThatOrder) {
    expect_story(at_once,
                 "0s online r1\n"
                 "0s see A in Z by r1\n"
                 "1s see A in Z by r1\n"
                 "2900ms end\n",
                 "0s new A Z\n"
                 "0s observed A Z\n");
}

TEST(PresenceRules, GlimpsedIsToldBetweenNewAndObservedWhenWanted) {
    auto rules = at_once;
    rules.glimpsed_events = true;
    expect_story(rules,
                 "0s online r1\n"
                 "0s see A in Z by r1\n"
                 "2s see A in Z by r1\n"
                 "2s end\n",
                 "0s new A Z\n"
                 "0s glimpsed A Z\n"
                 "0s observed A Z\n"
                 "2s lost A Z\n"
                 "2s glimpsed A Z\n"
                 "2s observed A Z\n");
}

TEST(PresenceRules, ATagIsLostExactlyLoseAfterItsLastSighting) {
    expect_story(at_once,
                 "0s online r1\n"
                 "0s see A in Z by r1\n"
                 "1999999us see A in Z by r1\n"
                 "3999998us end\n",
                 "0s new A Z\n"
                 "0s observed A Z\n");
    expect_story(at_once,
                 "0s online r1\n"
                 "0s see A in Z by r1\n"
                 "1999999us see A in Z by r1\n"
                 "3999999us end\n",
                 "0s new A Z\n"
                 "0s observed A Z\n"
                 "3999999us lost A Z\n");
}

TEST(PresenceRules, ALossCarriesTheTimeOfItsDeadlineHoweverLateItIsNoticed) {
    expect_story(at_once,
                 "0s online r1\n"
                 "0s see A in Z by r1\n"
                 "2h end\n",
                 "0s new A Z\n"
                 "0s observed A Z\n"
                 "2s lost A Z\n"
                 "3602s purged A Z\n");
}

TEST(PresenceRules, ObservedByTimeNeedsASpanOfSightings) {
    expect_story(by_time,
                 "0s online r1\n"
                 "0s see A in Z by r1 x99\n"
                 "999999us see A in Z by r1\n"
                 "999999us end\n",
                 "0s new A Z\n");
    expect_story(by_time,
                 "0s online r1\n"
                 "0s see A in Z by r1\n"
                 "1s see A in Z by r1\n"
                 "1s end\n",
                 "0s new A Z\n"
                 "1s observed A Z\n");
}

TEST(PresenceRules, ObservedByCountNeedsThatManyReads) {
    expect_story(by_count,
                 "0s online r1\n"
                 "0s see A in Z by r1\n"
                 "100ms see A in Z by r1\n"
                 "1500ms see B in Z by r1 x3\n"
                 "1600ms see A in Z by r1\n"
                 "1600ms end\n",
                 "0s new A Z\n"
                 "1500ms new B Z\n"
                 "1500ms observed B Z\n"
                 "1600ms observed A Z\n");
}

TEST(PresenceRules, OfTimeAndCountEitherIsEnough) {
    Rules either{.observe_after = 1s, .observe_after_reads = 3};
    expect_story(either,
                 "0s online r1\n"
                 "0s see A in Z by r1\n"
                 "0s see B in Z by r1 x2\n"
                 "500ms see B in Z by r1\n"
                 "1s see A in Z by r1\n"
                 "1s end\n",
                 "0s new A Z\n"
                 "0s new B Z\n"
                 "500ms observed B Z\n"
                 "1s observed A Z\n");
}

TEST(PresenceRules, ATagThatWasNeverObservedIsPurgedAfterTheGlimpseTimeout) {
    expect_story(by_count,
                 "0s online r1\n"
                 "0s see A in Z by r1\n"
                 "1s see A in Z by r1\n"
                 "3s see A in Z by r1\n"  // exactly the timeout: the timeout goes before the threshold
                 "6s end\n",
                 "0s new A Z\n"
                 "3s purged A Z glimpse_timeout\n"
                 "3s new A Z\n"
                 "5s purged A Z glimpse_timeout\n");
}

TEST(PresenceRules, ALostTagThatComesBackIsNotNewAndIsLostAgain) {
    expect_story(at_once,
                 "0s online r1\n"
                 "0s see A in Z by r1\n"
                 "3601s see A in Z by r1\n"
                 "3700s end\n",
                 "0s new A Z\n"
                 "0s observed A Z\n"
                 "2s lost A Z\n"
                 "3601s observed A Z\n"
                 "3603s lost A Z\n");
}

TEST(PresenceRules, ALostTagIsForgottenExactlyPurgeAfterItsLoss) {
    expect_story(at_once,
                 "0s online r1\n"
                 "0s see A in Z by r1\n"
                 "3602s see A in Z by r1\n"
                 "3602s end\n",
                 "0s new A Z\n"
                 "0s observed A Z\n"
                 "2s lost A Z\n"
                 "3602s purged A Z\n"
                 "3602s new A Z\n"
                 "3602s observed A Z\n");
}

TEST(PresenceRules, AGlimpseAfterALossThatComesToNothingIsSilent) {
    auto rules = by_count;
    rules.glimpsed_events = true;
    rules.purge_after = 10s;
    expect_story(rules,
                 "0s online r1\n"
                 "0s see A in Z by r1 x3\n"
                 "5s see A in Z by r1\n"  // lost since 2s; glimpsed until 7s, lost again without a word
                 "16s see A in Z by r1\n"
                 "16s see A in Z by r1 x2\n"
                 "17s see A in Z by r1\n"
                 "40s end\n",
                 "0s new A Z\n"
                 "0s glimpsed A Z\n"
                 "0s observed A Z\n"
                 "2s lost A Z\n"
                 "5s glimpsed A Z\n"
                 "16s glimpsed A Z\n"
                 "16s observed A Z\n"
                 "19s lost A Z\n"
                 "29s purged A Z\n");
    rules.glimpsed_events = false;
    expect_story(rules,
                 "0s online r1\n"
                 "0s see A in Z by r1 x3\n"
                 "5s see A in Z by r1\n"
                 "40s end\n",
                 "0s new A Z\n"
                 "0s observed A Z\n"
                 "2s lost A Z\n"
                 "17s purged A Z\n");
}

TEST(PresenceRules, ReadsAndTimesStartAgainWithEachLife) {
    Presence presence;
    presence.add_zone(by_count);
    presence.reader_online(presence.add_reader(), start);
    std::vector<Transition> out;
    Sighting sighting{.tag = tag_of("A"), .antenna = 4, .rssi = std::int16_t{-512}, .reads = 5};
    presence.sighted(sighting, start, out);
    sighting.antenna = 2;
    presence.sighted(sighting, start + 1s, out);
    presence.sighted(sighting, start + 10s, out);
    ASSERT_EQ(out.size(), 4u);
    EXPECT_EQ(out[1].record.antenna, 4);
    const auto& lost = out[2];
    EXPECT_EQ(lost.type, event::Type::tag_lost);
    EXPECT_EQ(lost.time, (start + 3s).wall);
    EXPECT_EQ(lost.record.reads, 10u);
    EXPECT_EQ(lost.record.first_seen, start.wall);
    EXPECT_EQ(lost.record.last_seen, (start + 1s).wall);
    EXPECT_EQ(lost.record.antenna, 2);
    EXPECT_EQ(lost.record.rssi, std::int16_t{-512});
    const auto& again = out[3];
    EXPECT_EQ(again.type, event::Type::tag_observed);
    EXPECT_EQ(again.record.reads, 5u);
    EXPECT_EQ(again.record.first_seen, (start + 10s).wall);
    EXPECT_EQ(again.record.id, lost.record.id);
}

TEST(PresenceRules, PcAndXpcAreThoseThatWereSaidLast) {
    Presence presence;
    presence.add_zone(at_once);
    presence.reader_online(presence.add_reader(), start);
    std::vector<Transition> out;
    auto sees = [&](Now now, std::optional<std::uint16_t> pc, std::optional<std::uint32_t> xpc) {
        presence.sighted({.tag = tag_of("A"), .pc = pc, .xpc = xpc}, now, out);
    };
    sees(start, {}, {});
    ASSERT_EQ(out.size(), 2u);
    EXPECT_EQ(out[1].record.pc, 0);
    EXPECT_EQ(out[1].record.xpc, 0u);
    sees(start + 1s, std::uint16_t{0x3200}, 0x08000000u);
    sees(start + 2s, {}, {});
    sees(start + 10s, {}, {});
    ASSERT_EQ(out.size(), 4u);
    EXPECT_EQ(out[2].type, event::Type::tag_lost);
    EXPECT_EQ(out[2].record.pc, 0x3200) << "the last sighting did not say it, one before did";
    EXPECT_EQ(out[2].record.xpc, 0x08000000u);
    EXPECT_EQ(out[3].type, event::Type::tag_observed);
    EXPECT_EQ(out[3].record.pc, 0x3200) << "in the next life too: it is the same tag";
    sees(start + 11s, std::uint16_t{0x3000}, 0u);
    presence.time_passed(start + 20s, out);
    ASSERT_EQ(out.size(), 5u);
    EXPECT_EQ(out[4].record.pc, 0x3000);
    EXPECT_EQ(out[4].record.xpc, 0u) << "the tag has none any more";
}

TEST(PresenceRules, ATagMovesWhenAnotherZoneObservesIt) {
    expect_story(at_once, at_once,
                 "0s online r1\n"
                 "0s see A in Z by r1\n"
                 "1s see A in Y by r1\n"
                 "1s end\n"
                 "10s see A in Z by r1\n"  // both are lost by now, and remembered
                 "10s end\n",
                 "0s new A Z\n"
                 "0s observed A Z\n"
                 "1s new A Y\n"
                 "1s observed A Y\n"
                 "1s moved A Y from Z\n"
                 "2s lost A Z\n"
                 "3s lost A Y\n"
                 "10s observed A Z\n"
                 "10s moved A Z from Y\n");
}

TEST(PresenceRules, ATagThatComesBackToTheZoneItWasLastObservedInHasNotMoved) {
    expect_story(at_once,
                 "0s online r1\n"
                 "0s see A in Z by r1\n"
                 "1s see A in Y by r1\n"
                 "20s see A in Y by r1\n"
                 "20s end\n",
                 "0s new A Z\n"
                 "0s observed A Z\n"
                 "1s new A Y\n"
                 "1s observed A Y\n"
                 "1s moved A Y from Z\n"
                 "2s lost A Z\n"
                 "3s lost A Y\n"
                 "20s observed A Y\n");
}

TEST(PresenceRules, AGlimpseInAnotherZoneIsNoMove) {
    expect_story(at_once, by_time,
                 "0s online r1\n"
                 "0s see A in Z by r1\n"
                 "1s see A in Y by r1\n"
                 "1500ms see A in Z by r1\n"
                 "2s see A in Y by r1\n"
                 "2s end\n",
                 "0s new A Z\n"
                 "0s observed A Z\n"
                 "1s new A Y\n"
                 "2s observed A Y\n"
                 "2s moved A Y from Z\n");
}

TEST(PresenceRules, AForgottenZoneIsNotMovedFrom) {
    Rules brief{.purge_after = 5s};
    expect_story(brief, at_once,
                 "0s online r1\n"
                 "0s see A in Z by r1\n"
                 "7s see A in Y by r1\n"
                 "7s end\n",
                 "0s new A Z\n"
                 "0s observed A Z\n"
                 "2s lost A Z\n"
                 "7s purged A Z\n"
                 "7s new A Y\n"
                 "7s observed A Y\n");
}

TEST(PresenceRules, ShortRulesThatComeWhileTagsArePresentHoldAtOnce) {
    Presence presence;
    auto zone = presence.add_zone({.lose_after = 1h});
    auto reader = presence.add_reader();
    presence.reader_online(reader, start);
    std::vector<Transition> out;
    presence.sighted({.tag = tag_of("A"), .zone = zone, .reader = reader}, start, out);
    presence.set_rules(zone, {.lose_after = 5s, .purge_after = 1s});
    out.clear();
    EXPECT_EQ(presence.deadline(), (start + 5s).steady);
    presence.time_passed(start + 6s, out);
    ASSERT_EQ(out.size(), 2u);
    EXPECT_EQ(to_line(out[0]), "5s lost A Z");
    EXPECT_EQ(to_line(out[1]), "6s purged A Z");
}

TEST(PresenceRules, EndlessTimersDoNotOverflow) {
    auto forever = std::chrono::microseconds::max();
    expect_story(Rules{.lose_after = forever, .purge_after = forever, .offline_lose_after = forever},
                 "0s online r1\n"
                 "0s see A in Z by r1\n"
                 "1h offline r1\n"
                 "1000h online r1\n"
                 "9999h end\n",
                 "0s new A Z\n"
                 "0s observed A Z\n");
}

}  // namespace
}  // namespace gantry::presence::testing
