#include "field/field.hpp"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>
#include <thread>

#include "field/tags.hpp"
#include "testkit/vectors.hpp"

namespace gantry {

bool operator==(const AirSighting& a, const AirSighting& b) {
    return a.tag == b.tag && a.technology == b.technology && a.rssi == b.rssi && a.at == b.at;
}

}  // namespace gantry

namespace gantry::field {
namespace {

using std::chrono::milliseconds;
using testkit::hex;

const Steady start = Steady{} + 100h;

PlacedTag tag_at(std::string_view epc, std::uint16_t antenna, std::optional<double> rssi = {}) {
    PlacedTag placed;
    placed.tag.id = event::TagId(hex(epc));
    placed.antenna = antenna;
    placed.rssi_dbm = rssi;
    return placed;
}
AirAccess at(std::uint16_t antenna, const event::TagId& tag, Steady now, std::uint32_t password = 0) {
    return {.carrier = {.antenna = antenna}, .tag = tag, .password = password, .now = now};
}
AirAccess with(double power_dbm, const event::TagId& tag) {
    return {.carrier = {.antenna = 1, .power_dbm = power_dbm}, .tag = tag, .now = start};
}
std::vector<AirSighting> heard(Air& air, std::uint16_t antenna, Steady from, Steady to) {
    std::vector<AirSighting> out;
    air.inventory({.antenna = antenna}, from, to, out);
    return out;
}

TEST(Field, AStandingTagIsHeardByItsAntennaAboutAsOftenAsAsked) {
    Field field;
    auto& air = field.add_reader("dock", 4, 10.0);
    field.place(air, tag_at("111122223333444455556666", 2));
    auto sightings = heard(air, 2, start, start + 60s);
    EXPECT_NEAR(static_cast<double>(sightings.size()), 600, 2);
    for (auto& sighting : sightings) {
        EXPECT_EQ(to_hex(sighting.tag.view()), "111122223333444455556666");
        EXPECT_EQ(sighting.technology, event::Technology::epc_gen2);
        EXPECT_GE(sighting.at, start);
        EXPECT_LT(sighting.at, start + 60s);
    }
    EXPECT_TRUE(heard(air, 1, start, start + 60s).empty());
    EXPECT_TRUE(heard(air, 0, start, start + 60s).empty());
    EXPECT_TRUE(heard(air, 5, start, start + 60s).empty());
    EXPECT_EQ(air.antennas(), (std::vector<std::uint16_t>{1, 2, 3, 4}));
}

TEST(Field, TheStrengthOfAStandingTagStaysNearItsMean) {
    Field field;
    auto& air = field.add_reader("dock", 1);
    field.place(air, tag_at("1111", 1, -48.5));
    double sum = 0;
    std::set<int> values;
    auto sightings = heard(air, 1, start, start + 200s);
    for (auto& sighting : sightings) {
        EXPECT_NEAR(sighting.rssi, -485, 15);
        sum += sighting.rssi;
        values.insert(sighting.rssi);
    }
    EXPECT_NEAR(sum / static_cast<double>(sightings.size()), -485, 2);
    EXPECT_GT(values.size(), 10u) << "it fades a little from read to read";
}

TEST(Field, AntennasAndTagsDifferInStrengthWhenNobodySays) {
    Field field;
    auto& air = field.add_reader("dock", 1);
    for (std::uint64_t i = 0; i < 40; ++i) {
        PlacedTag placed;
        placed.tag.id = sgtin96(1, i);
        field.place(air, placed);
    }
    std::map<std::string, int> first;
    for (auto& sighting : heard(air, 1, start, start + 2s)) {
        EXPECT_GE(sighting.rssi, -670);
        EXPECT_LE(sighting.rssi, -430);
        first.emplace(to_hex(sighting.tag.view()), sighting.rssi);
    }
    EXPECT_EQ(first.size(), 40u);
    auto [low, high] = std::ranges::minmax_element(first, {}, [](auto& each) { return each.second; });
    EXPECT_GT(high->second - low->second, 80);
}

TEST(Field, ARemovedTagIsGone) {
    Field field;
    auto& air = field.add_reader("dock", 1);
    field.place(air, tag_at("1111", 1));
    field.place(air, tag_at("2222", 1));
    EXPECT_EQ(field.tags(), 2u);
    field.remove(air, event::TagId(hex("1111")));
    field.remove(air, event::TagId(hex("3333")));
    EXPECT_EQ(field.tags(), 1u);
    for (auto& sighting : heard(air, 1, start, start + 1s))
        EXPECT_EQ(to_hex(sighting.tag.view()), "2222");
}

TEST(Field, TrafficComesStaysAndGoes) {
    Field field;
    auto& air = field.add_reader("dock", 3);
    TrafficSpec traffic;
    traffic.tags = 20;
    field.add_traffic(air, traffic, start);
    EXPECT_EQ(field.tags(), 20u);

    // Gaps of more than two periods between sightings of one tag divide its stays from its absences.
    struct Seen {
        Steady at;
        std::uint16_t antenna;
        int rssi;
    };
    std::map<std::string, std::vector<Seen>> seen;
    for (std::uint16_t antenna = 1; antenna <= 3; ++antenna)
        for (auto& sighting : heard(air, antenna, start, start + 10min))
            seen[to_hex(sighting.tag.view())].push_back({sighting.at, antenna, sighting.rssi});
    EXPECT_EQ(seen.size(), 20u);
    int stays = 0, changes = 0;
    for (auto& [tag, all] : seen) {
        std::ranges::sort(all, {}, &Seen::at);
        EXPECT_LT(all.front().at - start, 11s) << "all have come once within the longest absence";
        auto since = all.front().at;
        for (std::size_t i = 1; i < all.size(); ++i) {
            auto gap = all[i].at - all[i - 1].at;
            if (all[i].antenna != all[i - 1].antenna && gap < 2s) ++changes;
            if (gap <= 2s) continue;
            EXPECT_LT(gap, 11s);
            EXPECT_GT(all[i - 1].at - since, 2s);
            EXPECT_LT(all[i - 1].at - since, 25s);
            since = all[i].at;
            ++stays;
        }
    }
    EXPECT_GT(stays, 300);
    EXPECT_GT(changes, 100) << "some pass two antennas";
}

TEST(Field, TrafficTakesItsTagsFromThePool) {
    Field field;
    auto& air = field.add_reader("dock", 1);
    TrafficSpec traffic;
    for (auto epc : {"1111", "2222", "3333"})
        traffic.pool.push_back(tag_at(epc, 1).tag);
    traffic.tags = 2;
    field.add_traffic(air, traffic, start);
    std::set<std::string> seen;
    for (auto& sighting : heard(air, 1, start, start + 1min))
        seen.insert(to_hex(sighting.tag.view()));
    EXPECT_EQ(seen, (std::set<std::string>{"1111", "2222"}));
}

TEST(Field, TheSameSeedGivesTheSameSightingsAndAnotherGivesOthers) {
    auto run = [](std::uint64_t seed) {
        Field field;
        auto& air = field.add_reader("dock", 2);
        TrafficSpec traffic;
        traffic.seed = seed;
        traffic.pool.push_back(tag_at("1111", 1).tag);
        field.add_traffic(air, traffic, start);
        return heard(air, 1, start, start + 5min);
    };
    EXPECT_FALSE(run(1).empty());
    EXPECT_EQ(run(1), run(1));
    EXPECT_NE(run(1), run(2));
}

TEST(Field, TrafficOfNoLengthAtAllDoesNotHang) {
    Field field;
    auto& air = field.add_reader("dock", 1);
    TrafficSpec traffic;
    traffic.stay_min = traffic.stay_max = traffic.away_min = traffic.away_max = 0ms;
    traffic.visits_max = 0;
    field.add_traffic(air, traffic, start);
    EXPECT_LT(heard(air, 1, start, start + 1s).size(), 12'000u);
}

RC_GTEST_PROP(Field, HowTimeIsSlicedDoesNotMatter, ()) {
    TrafficSpec traffic;
    traffic.seed = *rc::gen::arbitrary<std::uint64_t>();
    traffic.tags = *rc::gen::inRange(1u, 10u);
    traffic.stay_min = milliseconds(*rc::gen::inRange(0, 3000));
    traffic.stay_max = milliseconds(*rc::gen::inRange(0, 5000));
    traffic.away_max = milliseconds(*rc::gen::inRange(0, 4000));
    traffic.visits_max = *rc::gen::inRange(0u, 5u);
    auto rate = *rc::gen::element(0.0, 0.5, 5.0, 37.0, 200.0);
    auto make = [&](Field& field) -> Air& {
        auto& air = field.add_reader("dock", 2, rate);
        field.add_traffic(air, traffic, start);
        for (auto& placed : default_tags())
            field.place(air, placed);
        return air;
    };
    Field whole, sliced;
    auto& whole_air = make(whole);
    auto& sliced_air = make(sliced);

    auto from = start + milliseconds(*rc::gen::inRange(-2000, 20'000));
    std::vector<AirSighting> pieces;
    auto at = from;
    for (auto slice : *rc::gen::container<std::vector<int>>(rc::gen::inRange(0, 1500))) {
        auto end = at + std::chrono::microseconds(slice * 1000 + slice % 7);
        sliced_air.inventory({.antenna = 1}, at, end, pieces);
        heard(sliced_air, 2, at - 3s, at + 3s);  // what others ask in between changes nothing
        at = end;
    }
    auto all = heard(whole_air, 1, from, at);
    RC_ASSERT(pieces == all);
    RC_ASSERT(std::ranges::is_sorted(all, {}, &AirSighting::at));
}

TEST(Field, TagsAreReachedOnlyInFrontOfTheAntenna) {
    Field field;
    auto& air = field.add_reader("dock", 2);
    auto& other = field.add_reader("gate", 2);
    field.place(air, tag_at("111122223333444455556666", 1));
    auto id = tag_at("111122223333444455556666", 1).tag.id;
    EXPECT_EQ(to_hex(air.read(at(1, id, start), Bank::epc, 0, 2).value_or(Bytes{})), "18353000");
    EXPECT_EQ(air.read(at(2, id, start), Bank::epc, 0, 2).error(), AirError::no_tag);
    EXPECT_EQ(air.read(at(0, id, start), Bank::epc, 0, 2).error(), AirError::no_tag);
    EXPECT_EQ(air.read(at(3, id, start), Bank::epc, 0, 2).error(), AirError::no_tag);
    EXPECT_EQ(other.read(at(1, id, start), Bank::epc, 0, 2).error(), AirError::no_tag);
    auto stranger = event::TagId(hex("9999"));
    EXPECT_EQ(air.read(at(1, stranger, start), Bank::epc, 0, 1).error(), AirError::no_tag);
    EXPECT_EQ(air.write(at(1, stranger, start), Bank::user, 0, hex("0001")).error(), AirError::no_tag);
    EXPECT_EQ(air.lock(at(1, stranger, start), {}).error(), AirError::no_tag);
    EXPECT_EQ(air.kill(at(1, stranger, start), 0).error(), AirError::no_tag);
    EXPECT_EQ(air.read(at(1, id, start), Bank::user, 99, 1).error(), AirError::bad_address);
}

TEST(Field, AMovingTagIsReachedWhileItIsThere) {
    Field field;
    auto& air = field.add_reader("dock", 1);
    TrafficSpec traffic;
    traffic.tags = 1;
    field.add_traffic(air, traffic, start);
    auto sightings = heard(air, 1, start, start + 2min);
    ASSERT_FALSE(sightings.empty());
    auto& first = sightings.front();
    EXPECT_TRUE(air.read(at(1, first.tag, first.at), Bank::tid, 0, 2));
    EXPECT_EQ(air.read(at(1, first.tag, start - 1s), Bank::tid, 0, 2).error(), AirError::no_tag);
    auto gap = std::ranges::adjacent_find(sightings, [](auto& a, auto& b) { return b.at - a.at > 1s; });
    ASSERT_NE(gap, sightings.end());
    EXPECT_EQ(air.read(at(1, first.tag, gap->at + 600ms), Bank::tid, 0, 2).error(), AirError::no_tag);
}

TEST(Field, AWrittenEpcIsHeardAndReachedByItsNewId) {
    Field field;
    auto& air = field.add_reader("dock", 1);
    field.place(air, tag_at("111122223333444455556666", 1));
    auto before = heard(air, 1, start, start + 10s);
    auto old_id = tag_at("111122223333444455556666", 1).tag.id;
    ASSERT_TRUE(air.write(at(1, old_id, start), Bank::epc, 2, hex("AAAA")));
    auto after = heard(air, 1, start, start + 10s);
    ASSERT_EQ(after.size(), before.size()) << "another id does not change its ways";
    EXPECT_EQ(after.front().at, before.front().at);
    EXPECT_EQ(to_hex(after.front().tag.view()), "AAAA22223333444455556666");
    EXPECT_EQ(air.read(at(1, old_id, start), Bank::user, 0, 1).error(), AirError::no_tag);
    EXPECT_TRUE(air.read(at(1, after.front().tag, start), Bank::user, 0, 1));
    field.remove(air, after.front().tag);
    EXPECT_EQ(field.tags(), 0u);
}

TEST(Field, AKilledTagIsSilent) {
    Field field;
    auto& air = field.add_reader("dock", 1);
    auto placed = tag_at("1111", 1);
    placed.tag.kill_password = 7;
    field.place(air, placed);
    EXPECT_EQ(air.kill(at(1, placed.tag.id, start), 8).error(), AirError::locked);
    EXPECT_FALSE(heard(air, 1, start, start + 1s).empty());
    ASSERT_TRUE(air.kill(at(1, placed.tag.id, start), 7));
    EXPECT_TRUE(heard(air, 1, start, start + 1s).empty());
    EXPECT_EQ(air.read(at(1, placed.tag.id, start), Bank::epc, 0, 1).error(), AirError::no_tag);
}

TEST(Field, AProgrammedTagIsHeardAndReachedByItsNewId) {
    for (auto technology : {event::Technology::epc_gen1, event::Technology::epc_1_19}) {
        SCOPED_TRACE(event::to_text(technology));
        Field field;
        auto& air = field.add_reader("dock", 1);
        auto placed = tag_at("1111222233334444", 1);
        placed.tag.technology = technology;
        field.place(air, placed);
        auto before = heard(air, 1, start, start + 5s);
        auto old_id = placed.tag.id, new_id = event::TagId(hex("5555666677778888"));
        ASSERT_TRUE(air.program(at(1, old_id, start), new_id, 0, false));
        auto after = heard(air, 1, start, start + 5s);
        ASSERT_EQ(after.size(), before.size());
        EXPECT_EQ(after.front().at, before.front().at);
        EXPECT_EQ(after.front().tag, new_id);
        EXPECT_EQ(after.front().technology, technology);
        EXPECT_EQ(air.program(at(1, old_id, start), new_id, 0, false).error(), AirError::no_tag);
        EXPECT_TRUE(air.program(at(1, new_id, start), old_id, 0, false)) << "and back";
        EXPECT_EQ(heard(air, 1, start, start + 5s), before);
    }
}

TEST(Field, TagsThatGotTheSameIdAreStillTwo) {
    Field field;
    auto& air = field.add_reader("dock", 1);
    auto first = tag_at("1111222233334444", 1), second = tag_at("5555666677778888", 1);
    first.tag.technology = second.tag.technology = event::Technology::epc_1_19;
    field.place(air, first);
    field.place(air, second);
    ASSERT_TRUE(air.program(at(1, second.tag.id, start), first.tag.id, 0, false));
    EXPECT_TRUE(air.program(at(1, first.tag.id, start), event::TagId(hex("AAAAAAAAAAAAAAAA")), 0, false));
    EXPECT_TRUE(air.program(at(1, first.tag.id, start), event::TagId(hex("BBBBBBBBBBBBBBBB")), 0, false));
    EXPECT_EQ(air.program(at(1, first.tag.id, start), second.tag.id, 0, false).error(), AirError::no_tag);
    EXPECT_EQ(field.tags(), 2u);
}

TEST(Field, Iso6bMemoryIsReachedThroughTheAir) {
    Field field;
    auto& air = field.add_reader("dock", 2);
    auto placed = tag_at("E001105629FFFC01", 1);
    placed.tag.technology = event::Technology::iso18000_6b;
    field.place(air, placed);
    auto access = at(1, placed.tag.id, start), elsewhere = at(2, placed.tag.id, start);
    ASSERT_TRUE(air.write_bytes(access, 8, hex("0A0B")));
    EXPECT_EQ(to_hex(air.read_bytes(access, 6, 4).value_or(Bytes{})), "FC010A0B");
    ASSERT_TRUE(air.lock_byte(access, 8));
    EXPECT_EQ(air.write_bytes(access, 8, hex("FF")).error(), AirError::locked);
    EXPECT_EQ(air.read_bytes(elsewhere, 0, 8).error(), AirError::no_tag);
    EXPECT_EQ(air.write_bytes(elsewhere, 9, hex("FF")).error(), AirError::no_tag);
    EXPECT_EQ(air.lock_byte(elsewhere, 9).error(), AirError::no_tag);
    EXPECT_EQ(air.read(access, Bank::user, 0, 1).error(), AirError::no_tag) << "it hears no Gen2 command";
    EXPECT_EQ(air.write(access, Bank::user, 0, hex("0001")).error(), AirError::no_tag);
    EXPECT_EQ(air.lock(access, {}).error(), AirError::no_tag);
    EXPECT_EQ(air.kill(access, 1).error(), AirError::no_tag);
    EXPECT_EQ(air.program(access, placed.tag.id, 0, false).error(), AirError::no_tag);
    EXPECT_EQ(heard(air, 1, start, start + 1s).front().technology, event::Technology::iso18000_6b);
}

TEST(Field, PowerShiftsTheStrengthAndNothingElse) {
    Field field;
    auto& air = field.add_reader("dock", 2);
    field.add_traffic(air, {}, start);
    field.place(air, tag_at("1111", 1, -60.0));
    auto usual = heard(air, 1, start, start + 30s);
    ASSERT_FALSE(usual.empty());
    for (double power : {20.0, 24.5, 27.0, 30.0, 36.0}) {
        std::vector<AirSighting> other;
        air.inventory({.antenna = 1, .power_dbm = power}, start, start + 30s, other);
        ASSERT_EQ(other.size(), usual.size()) << power;
        for (std::size_t i = 0; i < usual.size(); ++i) {
            EXPECT_EQ(other[i].tag, usual[i].tag);
            EXPECT_EQ(other[i].at, usual[i].at);
            EXPECT_NEAR(other[i].rssi - usual[i].rssi, (power - 27) * 10, 1);
        }
    }
}

TEST(Field, TooLittlePowerIsNotAnswered) {
    struct Row {
        double rssi, power;
        bool hears, writes;
    };
    constexpr auto nan = std::numeric_limits<double>::quiet_NaN(),
                   infinity = std::numeric_limits<double>::infinity();
    for (auto& row : {
             Row{-60, 27, true, true},
             Row{-60, 15, true, true},
             Row{-60, 14.5, true, false},
             Row{-60, 12, true, false},
             Row{-60, 11.5, false, false},
             Row{-60, -100, false, false},
             Row{-60, -infinity, false, false},
             Row{-60, nan, false, false},
             Row{-60, infinity, true, true},
             Row{-74, 27, true, false},
             Row{-74, 26, true, false},
             Row{-74, 25.5, false, false},
             Row{-74, 29, true, true},
             // Heard at 27 dBm as strong as said, however little that is.
             Row{-80, 27, true, false},
             Row{-80, 26.5, false, false},
             Row{-80, 34.5, true, false},
             Row{-80, 35, true, true},
         }) {
        SCOPED_TRACE(std::to_string(row.rssi) + " at " + std::to_string(row.power));
        Field field;
        auto& air = field.add_reader("dock", 1);
        auto placed = tag_at("111122223333444455556666", 1, row.rssi);
        placed.tag.kill_password = 7;
        field.place(air, placed);
        auto access = with(row.power, placed.tag.id);
        std::vector<AirSighting> sightings;
        air.inventory(access.carrier, start, start + 2s, sightings);
        EXPECT_EQ(!sightings.empty(), row.hears);
        EXPECT_EQ(air.read(access, Bank::user, 0, 1).has_value(), row.hears);
        auto written = air.write(access, Bank::user, 0, hex("0001"));
        auto locked = air.lock(access, {});
        auto killed = air.kill(access, 7);
        EXPECT_EQ(written.has_value(), row.writes);
        EXPECT_EQ(locked.has_value(), row.writes);
        EXPECT_EQ(killed.has_value(), row.writes);
        if (row.writes) continue;
        auto expected = row.hears ? AirError::insufficient_power : AirError::no_tag;
        EXPECT_EQ(written.error(), expected);
        EXPECT_EQ(locked.error(), expected);
        EXPECT_EQ(killed.error(), expected);
        EXPECT_EQ(to_hex(air.read(with(36, placed.tag.id), Bank::user, 0, 1).value_or(Bytes{})), "0000");
    }
}

TEST(Field, APlaceOfTooLittlePowerDoesNotHideATagOfTheSameId) {
    Field field;
    auto& air = field.add_reader("dock", 1);
    field.place(air, tag_at("1111", 1, -70.0));
    field.place(air, tag_at("1111", 1, -50.0));
    auto id = event::TagId(hex("1111"));
    EXPECT_TRUE(air.write(with(10, id), Bank::user, 0, hex("0001"))) << "the near one answers";
    EXPECT_EQ(air.write(with(1, id), Bank::user, 0, hex("0001")).error(), AirError::no_tag);
}

TEST(Field, ReadersOfOneFieldHearTheirOwnTagsInTheirOwnWay) {
    Field field;
    auto& dock = field.add_reader("dock", 1);
    auto& gate = field.add_reader("gate", 1);
    field.place(dock, tag_at("1111", 1));
    field.place(gate, tag_at("1111", 1));
    auto at_dock = heard(dock, 1, start, start + 10s), at_gate = heard(gate, 1, start, start + 10s);
    EXPECT_FALSE(at_gate.empty());
    EXPECT_NE(at_dock, at_gate);
}

TEST(Field, ManyThreadsMayLookIntoIt) {
    Field field;
    std::vector<Air*> airs;
    for (int reader = 0; reader < 4; ++reader)
        airs.push_back(&field.add_reader("r" + std::to_string(reader), 2, 50.0));
    TrafficSpec traffic;
    for (auto* air : airs)
        field.add_traffic(*air, traffic, start);
    std::vector<std::size_t> counts(4);
    std::vector<std::thread> threads;
    for (std::size_t i = 0; i < 4; ++i)
        threads.emplace_back([&, i] {
            for (int round = 0; round < 200; ++round) {
                auto from = start + round * 100ms;
                auto sightings = heard(*airs[i], 1, from, from + 100ms);
                counts[i] += sightings.size();
                for (auto& sighting : sightings)
                    EXPECT_TRUE(airs[i]->write(at(1, sighting.tag, sighting.at), Bank::user, 0, hex("0001")));
                if (i == 0) field.place(*airs[1], tag_at("1111", 2));
            }
        });
    for (auto& thread : threads)
        thread.join();
    EXPECT_EQ(field.tags(), 4u * 12 + 200);
    for (std::size_t i = 0; i < 4; ++i)
        EXPECT_EQ(counts[i], heard(*airs[i], 1, start, start + 20s).size());
}

}  // namespace
}  // namespace gantry::field
