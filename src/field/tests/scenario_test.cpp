#include "field/tests/scenario_support.hpp"

#include <rapidcheck/gtest.h>

#include <algorithm>

namespace gantry::field {
namespace {

using namespace test;

TEST(Scenario, WhatAFileSaysIsThereAndTheRestHasSensibleValues) {
    auto scenario = parsed(R"(
[scenario]
name = "all"
about = "of it"
seed = 7
lasts = "3s"
region = "us"
path_loss = 2
echo_db = 5.5
[[reader]]
name = "dock"
make = "acme"
connect = "127.0.0.1:9055"
session = 2
q = 6
mode = "fast"
anticollision = false
settings = { model = "R1", ack = true, round = 5 }
[[reader.antenna]]
name = "left"
position = [0, -1.5, 2]
towards = [0, 0, 1]
gain_dbi = 6
beam = 65
power_dbm = 27
[[reader.antenna]]
position = [1, 0, 0]
towards = [1, 0, 1]
band = "hf"
reach = 0.2
[[tags]]
name = "pallet"
grid = [2, 3, 4]
position = [1, 2, 3]
axis = [0, 1, 0]
first_id = "3034 0000 0000 0000 0000 00FF"
sensitivity_dbm = -20
[tags.motion]
path = [[0, 0, 0], [4, 0, 0.5]]
lasts = "3s"
every = "10s"
outside = "stays"
[[tags]]
name = "one"
position = [0, 0, 0]
)");
    EXPECT_EQ(scenario.name, "all");
    EXPECT_EQ(scenario.seed, 7u);
    EXPECT_EQ(scenario.lasts, 3s);
    EXPECT_EQ(scenario.region, Region::us);
    EXPECT_EQ(scenario.echo_db, 5.5);
    ASSERT_EQ(scenario.readers.size(), 1u);
    auto& reader = scenario.readers[0];
    EXPECT_EQ(reader.make, "acme");
    EXPECT_EQ(reader.connect->text, "127.0.0.1:9055");
    EXPECT_EQ(reader.connect->at.line, 13u);
    EXPECT_EQ(reader.session, 2);
    EXPECT_EQ(reader.q, 6);
    EXPECT_EQ(reader.mode, LinkMode::fast);
    EXPECT_FALSE(reader.anticollision);
    ASSERT_EQ(reader.settings.size(), 3u);
    for (auto& [name, value] : reader.settings)
        EXPECT_EQ(value.text, name == "ack" ? "true" : name == "round" ? "5" : "R1");
    ASSERT_EQ(reader.antennas.size(), 2u);
    EXPECT_EQ(reader.antennas[0].beam, 65);
    EXPECT_EQ(reader.antennas[1].band, Band::hf);
    EXPECT_EQ(reader.antennas[1].name, "2");
    ASSERT_EQ(scenario.groups.size(), 2u);
    EXPECT_EQ(scenario.groups[0].count, 24u);
    EXPECT_EQ(scenario.groups[0].motion->path[1], (Vec{4, 0, 0.5}));
    EXPECT_TRUE(scenario.groups[0].motion->stays);
    EXPECT_EQ(scenario.groups[1].count, 1u);
    EXPECT_EQ(scenario.tags(), 25u);

    Scene scene(scenario, start);
    auto views = scene.look(start);
    EXPECT_EQ(to_hex(views[0].id.view()), "3034000000000000000000FF");
    EXPECT_EQ(to_hex(views[1].id.view()), "303400000000000000000100");
    EXPECT_EQ(*views[23].place, (Vec{1.1, 2.2, 3.3}));
    EXPECT_EQ(*scene.look(start + 1500ms)[0].place, (Vec{3, 2, 3.25}));
    EXPECT_EQ(*scene.look(start + 11500ms)[0].place, (Vec{3, 2, 3.25})) << "and over again";
    EXPECT_EQ(*scene.look(start + 5s)[0].place, (Vec{5, 2, 3.5})) << "it stays there until then";
}

struct Wrong {
    std::string_view section, line, error;  // the line stands in place of what follows the section's own
};

// Each table puts one wrong line into a good file, behind the keys that are required.
TEST(Scenario, ErrorsNameThePlaceWhatWasExpectedAndTheNearestWord) {
    auto with = [](std::string_view section, std::string_view line) {
        auto at = [&](std::string_view name) { return name == section ? line : std::string_view{}; };
        return fmt::format(
            "[scenario]\nname = \"x\"\n{}\n"                                      // 3
            "[[reader]]\nname = \"r\"\n{}\n"                                      // 6
            "[[reader.antenna]]\nposition = [0,0,1]\n{}\n{}\n"                    // 9
            "[[tags]]\nname = \"t\"\nposition = [1,0,1]\n{}\n"                    // 14
            "[tags.motion]\npath = [[0,0,0],[1,0,0]]\nlasts = \"1s\"\n{}\n{}\n",  // 18
            at("scenario"), at("reader"), at("antenna"), section == "towards" ? line : "towards = [1,0,1]",
            at("tags"), at("motion"), at("end"));
    };
    EXPECT_TRUE(parse_scenario(with("", ""), "s", makes))
        << parse_scenario(with("", ""), "s", makes).error().text();
    for (
        auto& row : std::vector<Wrong>{
            {"scenario", "sead = 1", R"(s:3:1: unknown key "sead" in [scenario]; did you mean "seed"?)"},
            {"scenario", "lasts = 3",
             R"(s:3:9: lasts is a whole number; write it like "500ms", "2s", "5min", "1h" or "30d")"},
            {"scenario", "lasts = \"25h\"", "s:3:9: lasts is over a day; it may be \"24h\" at most"},
            {"scenario", "region = \"use\"", R"(s:3:10: region = "use" is not known; did you mean "us"?)"},
            {"scenario", "echo_db = 99", "s:3:11: echo_db = 99 is outside -10 to 60"},
            {"scenario", "echo_db = nan", "s:3:11: echo_db = nan is outside -10 to 60"},
            {"reader", "make = \"acne\"", R"(s:6:8: make = "acne" is not known; did you mean "acme"?)"},
            {"reader", "session = 4", "s:6:11: session = 4 is outside 0 to 3"},
            {"reader", "mode = \"fastest\"", R"(s:6:8: mode = "fastest" is not known; did you mean "fast"?)"},
            {"reader", "connect = \"a:1\"\nlisten = \"b:2\"",
             "s:4:1: connect, listen and pty are ways to reach a reader, and it has one; keep one of them"},
            {"reader", "settings = { a = [1] }",
             "s:6:18: a is a list; a setting is text in quotes, a number, true or false"},
            {"reader", "antenas = 1",
             R"(s:6:1: unknown key "antenas" in [[reader]]; did you mean "antenna"?)"},
            {"antenna", "gain = 8",
             "s:9:1: unknown key \"gain\" in [[reader.antenna]]; keys: name, position, "
             "towards, band, gain_dbi, beam, power_dbm, reach"},
            {"antenna", "reach = 0.2",
             "s:9:9: reach is for HF antennas; remove it, or choose the other band"},
            {"antenna", "band = \"hf\"\nbeam = 60",
             "s:10:8: beam is for UHF antennas; remove it, or choose the other band"},
            {"towards", "", "s:7:1: [[reader.antenna]] has no towards"},
            {"towards", "towards = [0, 0]",
             "s:10:11: towards holds a list of 2; expected three numbers: towards = [1.0, 0.5, 2.0]"},
            {"towards", "towards = [0, 0, \"up\"]",
             "s:10:11: towards holds text; expected three numbers: towards = [1.0, 0.5, 2.0]"},
            {"towards", "towards = [0, 0, 1]",
             "s:10:11: the antenna looks at the point where it is; name another point that it looks at"},
            {"tags", "count = 0", "s:14:9: count = 0 is outside 1 to 100000"},
            {"tags", "grid = [2, 2, 2]\ncount = 9",
             "s:15:9: count = 9 is more than the 8 places of the grid; make the grid larger, or leave count "
             "out"},
            {"tags", "grid = [2, 2.5, 2]",
             "s:14:8: grid holds 2.5; expected whole numbers: grid = [5, 5, 8]"},
            {"tags", "grid = [1000, 1000, 1]",
             "s:14:8: grid has 1000000 places; a scenario has 200000 tags at most"},
            {"tags", "axis = [0, 0, 0]",
             "s:14:8: axis has no direction; write it like [1, 0, 0], or leave it out"},
            {"tags", "first_id = \"xyz\"",
             R"(s:14:12: first_id = "xyz" is not hex; write two digits for each byte)"},
            {"tags", "technology = \"iso15693\"\nfirst_id = \"E004\"",
             "s:15:12: first_id has 2 bytes; the UID of an iso15693 tag has 8"},
            {"tags", "technology = \"iso18000-6b\"",
             R"(s:14:14: technology = "iso18000-6b" is not known; expected one of: "epc-gen2", "iso15693", "icode1")"},
            {"motion", "every = \"500ms\"",
             "s:18:9: the next round would begin before the slowest tag has ended its; every must be longer "
             "than 1s"},
            {"motion", "spread = 1",
             "s:18:10: spread = 1 is too much; it may be 0.9 at most: some are ten times as "
             "fast as others then"},
            {"motion", "outside = \"goes\"",
             R"(s:18:11: outside = "goes" is not known; did you mean "gone"?)"},
            {"end", "[[reders]]", "s:19:3: unknown section \"reders\"; did you mean [[reader]]?"},
            {"end", "[[reader]]\nname = \"r\"\n[[reader.antenna]]\nposition=[0,0,0]\ntowards=[1,0,0]",
             "s:20:8: there is a reader \"r\" already; names must differ"},
            {"end", "[[reader]]\nname = \"bare\"",
             "s:19:1: reader \"bare\" has no antenna; add a [[reader.antenna]] with position and towards"},
            {"end", "oops", "s:19:"},
        }) {
        SCOPED_TRACE(row.line);
        auto scenario = parse_scenario(with(row.section, row.line), "s", makes);
        ASSERT_FALSE(scenario);
        auto text = scenario.error().text();
        if (row.error.ends_with(':'))
            EXPECT_TRUE(text.starts_with(row.error)) << text;
        else
            EXPECT_EQ(text, row.error);
    }
    EXPECT_EQ(parse_scenario("", "s", makes).error().text(),
              "s:1:1: there is no section [scenario]; begin with [scenario] and name = \"my-scene\"");
    EXPECT_EQ(parse_scenario("[scenario]\nname='x'\n", "s", makes).error().text(),
              "s:1:1: nobody reads in this scenario; add a [[reader]] with a [[reader.antenna]]");
    auto all = parse_scenario("[scenario]\nsead=1\n[[tags]]\ncount=0\n", "s", makes).error().text();
    EXPECT_EQ(std::ranges::count(all, '\n'), 4) << all << ": all of them at once";
}

// Values of any kind in any place are refused or survived; what is accepted can be played.
RC_GTEST_PROP(Scenario, AnyValuesMakeASceneOrAnError, ()) {
    auto value = [] {
        return *rc::gen::element<std::string>(
            "0", "1", "-1", "3", "1e300", "nan", "-inf", "'x'", "'1s'", "'0s'", "'24h'", "[0,0,0]", "[1,1,1]",
            "[[0,0,0],[1,1,1]]", "[]", "{}", "true", "100000", "9223372036854775807", "'hf'", "'stays'");
    };
    auto lines = [&](std::initializer_list<std::string_view> keys) {
        std::string out;
        for (auto key : keys)
            if (*rc::gen::inRange(0, 4) == 0) out += fmt::format("{} = {}\n", key, value());
        return out;
    };
    auto text = fmt::format(
        "[scenario]\nname='x'\n{}[[reader]]\nname='r'\n{}[[reader.antenna]]\nposition=[0,0,0]\ntowards=[1,0,"
        "0]\n{}"
        "[[tags]]\nname='t'\nposition=[0,0,0]\n{}[tags.motion]\npath=[[0,0,0],[1,0,0]]\nlasts='1s'\n{}",
        lines({"seed", "path_loss", "echo_db"}), lines({"session", "q", "anticollision"}),
        lines({"band", "gain_dbi", "beam", "power_dbm", "reach"}),
        lines({"spacing", "jitter", "axis", "sensitivity_dbm", "spread_db", "loss_db", "grid"}),
        lines({"starts", "interval", "spread", "every", "outside"}));
    auto scenario = parse_scenario(text, "s", makes);
    if (!scenario) {
        RC_ASSERT(scenario.error().what.starts_with("s:"));
        return;
    }
    Scene scene(*scenario, start);
    for (auto& sighting : heard(scene.air(0), start - 100ms, start + 500ms)) {
        RC_ASSERT(sighting.at >= start - 100ms);
        RC_ASSERT(sighting.phase.value_or(0) < 4096);
    }
}

}  // namespace
}  // namespace gantry::field
