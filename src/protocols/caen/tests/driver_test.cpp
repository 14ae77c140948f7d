#include "protocols/caen/driver.hpp"

#include <algorithm>
#include <set>

#include "driver_support.hpp"
#include "protocols/caen/driver_setup.hpp"

namespace gantry::caen::driver_test {

using Names = std::vector<std::string>;

static const std::string tag_a = "3074257BF7194E4000001A85", tag_b = "3074257BF7194E4000001A86";

static Bytes both(std::string_view point = "Ant0") {
    auto pairs = tag_pairs(tag_a, point);
    append_tag(pairs, tag_b, point);
    return pairs;
}

// --- set-up ------------------------------------------------------------------------------------------------

TEST(CaenDriver, IntroducesItselfAndAsksForNothingThatIsNotConfigured) {
    Ours ours(Given{{"mode", "inventory"}});
    ours.starts();
    EXPECT_EQ(ours.asked(), (Names{"GetReaderInfo", "GetFirmwareRelease", "SetProtocol", "InventoryTag"}));
    EXPECT_EQ(to_hex(ours.heard[0].bytes), "80010000000053580012000000080001009E");
    EXPECT_EQ(ours.heard[1].id, 1);
    ASSERT_EQ(ours.described.size(), 1u);
    EXPECT_EQ(ours.described[0].model, "R1260I");
    EXPECT_EQ(ours.described[0].firmware, "4.1.0");
    EXPECT_EQ(ours.described[0].detail, "serial 0000123; reads with InventoryTag rounds");
}

TEST(CaenDriver, AppliesEverySettingThatIsGiven) {
    Ours ours(Given{{"mode", "inventory"},
                    {"power_mw", "500"},
                    {"protocol", "EPCC1G2"},
                    {"q", "4"},
                    {"session", "1"},
                    {"target", "0"},
                    {"selected", "3"},
                    {"tid_length", "12"},
                    {"regulation", "FCC"},
                    {"channel", "7"},
                    {"lbt", "on"},
                    {"set_clock", "true"}},
              "all");
    ours.now.wall = *parse_rfc3339("2026-11-21T23:04:05.999Z");
    ours.starts();
    auto names = ours.asked();
    auto from = std::ranges::find(names, "SetRFRegulation");
    ASSERT_NE(from, names.end());
    Names first(from, from + 6);
    EXPECT_EQ(first, (Names{"SetRFRegulation", "SetProtocol", "SetPower", "SetLBTMode", "SetRFChannel",
                            "SetDateTime"}));
    EXPECT_EQ(ours.all(Command::set_power).at(0).number(Attribute::power_set), 500);
    EXPECT_EQ(ours.all(Command::set_protocol).at(0).number(Attribute::protocol), 3);
    EXPECT_EQ(ours.all(Command::set_rf_regulation).at(0).number(Attribute::rf_regulation), 2);
    EXPECT_EQ(ours.all(Command::set_rf_channel).at(0).number(Attribute::rf_channel), 7);
    EXPECT_EQ(ours.all(Command::set_lbt_mode).at(0).number(Attribute::boolean), 1);
    EXPECT_EQ(ours.all(Command::set_date_time).at(0).text(Attribute::date_time), "2026-11-21 23:04:05");
    std::map<std::int64_t, std::int64_t> values;
    for (auto& each : ours.all(Command::set_source_config))
        if (each.text(Attribute::source_name) == "Source_3")
            values[each.number(Attribute::config_parameter)] = each.number(Attribute::config_value);
    EXPECT_EQ(values, (std::map<std::int64_t, std::int64_t>{{3, 4}, {4, 1}, {5, 0}, {6, 3}, {13, 12}}));
    EXPECT_TRUE(ours.faults.empty());
    EXPECT_EQ(ours.all(Command::get_protocol).size(), 0u) << "it is known";
}

TEST(CaenDriver, ARefusedSettingIsSaidInTheManualsWordsAndReadingGoesOn) {
    Ours ours(Given{{"mode", "inventory"}, {"power_mw", "9999"}});
    ours.refuses(Command::set_power, ResultCode::power_out_of_range);
    ours.tags = both();
    ours.starts();
    ASSERT_EQ(ours.faults.size(), 1u);
    EXPECT_EQ(ours.faults[0].code, 183);
    EXPECT_EQ(ours.faults[0].text, "power_mw is not applied: SetPower answered power out of range (183)");
    EXPECT_EQ(ours.seen.size(), 2u);
}

TEST(CaenDriver, WhatTheModelLacksIsSaidAndNotAskedFor) {
    Ours ours(Given{{"mode", "raw"}, {"power_mw", "500"}, {"session", "1"}}, "A828EU");
    ours.starts();
    EXPECT_TRUE(ours.all(Command::set_power).empty());
    EXPECT_TRUE(ours.all(Command::set_source_config).empty());
    ASSERT_EQ(ours.faults.size(), 2u);
    EXPECT_EQ(ours.faults[0].code, fault_setting);
    EXPECT_EQ(ours.faults[0].text, "power_mw is not applied: the model A828EU has no SetPower");
}

TEST(CaenDriver, RevisionFourHasOneQForTheWholeReader) {
    Ours ours(Given{{"mode", "raw"}, {"q", "5"}}, "A948EU");
    ours.starts();
    EXPECT_EQ(ours.all(Command::g2_set_q).at(0).number(Attribute::q_parameter), 5);
    EXPECT_TRUE(ours.all(Command::set_source_config).empty());
}

TEST(CaenDriver, LearnsTheModelFromTheReader) {
    Ours ours({}, "");
    ours.info = "A948 77";
    ours.starts();
    EXPECT_EQ(ours.described.at(0).model, "A948");
    ours.waits(200ms);
    std::set<std::string> sources;
    for (auto& each : ours.heard)
        if (each.text(Attribute::source_name) != "-") sources.insert(each.text(Attribute::source_name));
    EXPECT_EQ(sources, (std::set<std::string>{"Source_0", "Source_1", "Source_2", "Source_3"}));
}

TEST(CaenDriver, AnUnknownReaderIsAskedWhichSourcesItHas) {
    Ours ours(Given{{"mode", "raw"}}, "");
    ours.info = "R9999X 1\x1B[2J";
    ours.answers[Command::get_source_config] = [](auto& heard, Bytes& pairs) {
        if (heard.text(Attribute::source_name) != "Source_1") return ResultCode::invalid_source_name;
        append_number(pairs, Attribute::config_value, 1);
        return ResultCode::success;
    };
    ours.starts();
    ours.waits(20ms);
    EXPECT_EQ(ours.described.at(0).model, "R9999X");
    EXPECT_EQ(ours.described.at(0).detail.find('\x1B'), std::string::npos);
    EXPECT_EQ(ours.all(Command::get_source_config).size(), 2u);
    EXPECT_EQ(ours.all(Command::raw_read_ids).at(1).text(Attribute::source_name), "Source_1");
}

TEST(CaenDriver, AReaderWithoutReaderInfoIsReadAllTheSame) {
    Ours ours({}, "");
    for (auto command : {Command::get_reader_info, Command::get_firmware_release, Command::get_protocol,
                         Command::get_source_config, Command::inventory_tag})
        ours.refuses(command, ResultCode::invalid_command);
    ours.tags = both();
    ours.starts();
    ours.waits(100ms);
    EXPECT_GT(ours.seen.size(), 2u);
    EXPECT_NE(ours.detail().find("reads with RawReadIDs rounds"), std::string::npos) << ours.detail();
    EXPECT_NE(ours.detail().find("invalid command (127)"), std::string::npos) << ours.detail();
}

TEST(CaenDriver, ComposesSourcesAsTheSettingsSay) {
    Ours ours(Given{{"mode", "raw"}, {"sources", "Source_0=Ant0+Ant2, Source_1"}}, "A948EU");
    ours.answers[Command::check_read_point_in_source] = [](auto& heard, Bytes& pairs) {
        auto point = heard.text(Attribute::read_point_name);
        append_number(pairs, Attribute::boolean, point == "Ant0" || point == "Ant1" ? 1 : 0);
        return ResultCode::success;
    };
    ours.starts();
    EXPECT_EQ(ours.all(Command::check_read_point_in_source).size(), 4u);
    auto added = ours.all(Command::add_read_point_to_source);
    auto removed = ours.all(Command::remove_read_point_from_source);
    ASSERT_EQ(added.size(), 1u);
    ASSERT_EQ(removed.size(), 1u);
    EXPECT_EQ(added[0].text(Attribute::read_point_name), "Ant2");
    EXPECT_EQ(removed[0].text(Attribute::read_point_name), "Ant1");
    EXPECT_TRUE(ours.faults.empty());
}

TEST(CaenDriver, ReadsTheTextOfSources) {
    auto good = parse_sources(" Source_0 = Ant0 + Ant1 ,Source_1");
    ASSERT_TRUE(good);
    ASSERT_EQ(good->size(), 2u);
    EXPECT_EQ((*good)[0].read_points, (std::vector<std::string>{"Ant0", "Ant1"}));
    EXPECT_FALSE((*good)[1].composed);
    EXPECT_TRUE(parse_sources("")->empty());
    for (auto bad : {"Source_0,", "=Ant0", "Source_0=", "Source_0=Antenna", "Source_0,Source_0",
                     "Source_0=Ant0+", "a-name-that-is-longer-than-thirty-bytes"})
        EXPECT_FALSE(parse_sources(bad)) << bad;
    Ours ours(Given{{"mode", "inventory"}, {"sources", "Source_0,,"}});
    ours.starts();
    ASSERT_EQ(ours.faults.size(), 1u);
    EXPECT_NE(ours.faults[0].text.find("Source_0,Source_1"), std::string::npos) << ours.faults[0].text;
}

}  // namespace gantry::caen::driver_test
