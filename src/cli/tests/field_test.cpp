#include <filesystem>
#include <fstream>
#include <sstream>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "cli/tests/ran.hpp"
#include "testkit/temp_dir.hpp"

namespace gantry::cli {
namespace {

std::string example(std::string_view name) {
    return fmt::format("{}/examples/scenarios/{}.toml", GANTRY_SOURCE_DIR, name);
}

constexpr std::string_view small = R"([scenario]
name = "small"
[[reader]]
name = "one"
[[reader.antenna]]
position = [0, 0, 1]
towards = [1, 0, 1]
[[tags]]
name = "tag"
position = [1, 0, 1]
axis = [0, 1, 0]
)";

TEST(FieldCommand, ChecksFilesAndSaysWhatTheyHoldOrWhatIsWrong) {
    auto fine = gantry({"field", "check", example("dock-door"), "-"}, std::string(small));
    EXPECT_EQ(fine.code, done) << fine.err;
    EXPECT_EQ(fine.out, example("dock-door") +
                            ": fine; 1 reader, 4 antennas, 200 tags\n-: fine; 1 reader, 1 antenna, 1 tag\n");
    auto wrong = gantry({"field", "check", "-"}, std::string(small) + "axes = 1\n");
    EXPECT_EQ(wrong.code, failed);
    EXPECT_EQ(wrong.err, "stdin:12:1: unknown key \"axes\" in [[tags]]; did you mean \"axis\"?\n");
    auto json = gantry({"field", "check", "--json", "-"}, std::string(small) + "axes = 1\n");
    EXPECT_EQ(json.code, failed);
    EXPECT_EQ(
        json.out,
        "{\"file\":\"-\",\"valid\":false,\"errors\":[\"stdin:12:1: unknown key \\\"axes\\\" in [[tags]]; did "
        "you mean \\\"axis\\\"?\"]}\n");
    auto missing = gantry({"field", "check", "/no/such.toml"});
    EXPECT_EQ(missing.code, failed);
    EXPECT_NE(missing.err.find("there is no file /no/such.toml"), std::string::npos);
}

TEST(FieldCommand, ListsEveryExampleAndEveryOneIsFine) {
    auto ran = gantry({"field", "list", std::string(GANTRY_SOURCE_DIR) + "/examples/scenarios"});
    EXPECT_EQ(ran.code, done) << ran.err;
    for (auto name : {"dock-door", "conveyor", "shelf", "race-start", "desk"})
        EXPECT_NE(ran.out.find(name), std::string::npos) << name;
    EXPECT_NE(ran.out.find("reader dock (any): 4 antennas, session 1, q 4, fast"), std::string::npos)
        << ran.out;
    EXPECT_NE(
        ran.out.find("reader desk-hf-plain (any): 1 antenna, session 0, q 4, balanced, no anticollision"),
        std::string::npos);
    EXPECT_EQ(gantry({"field", "list", "/no/such/folder/"}).code, failed);
}

TEST(FieldCommand, PlaysAndCounts) {
    auto ran = gantry({"field", "run", "-", "--for", "2s"}, std::string(small));
    EXPECT_EQ(ran.code, done) << ran.err;
    EXPECT_TRUE(ran.out.starts_with("reader one ")) << ran.out;
    EXPECT_NE(ran.out.find(" of 1 tags; by antenna: "), std::string::npos);
    EXPECT_NE(ran.out.find(" 1 of 1 read, 0 missed\n"), std::string::npos);
    auto weak = gantry({"field", "run", "-", "--for", "2s", "--turn", "-60", "--json"}, std::string(small));
    EXPECT_EQ(weak.out,
              "{\"reader\":\"one\",\"reads\":0,\"reads_per_s\":0.0,\"tags\":0,\"by_antenna\":[0]}\n"
              "{\"group\":\"tag\",\"tags\":1,\"read\":0,\"missed\":1}\n");
}

TEST(FieldCommand, DrawsAPictureIntoAFileOrForAPipe) {
    auto piped = gantry({"field", "draw", "-", "--at", "1.5s"}, std::string(small));
    EXPECT_EQ(piped.code, done) << piped.err;
    EXPECT_TRUE(piped.out.starts_with("<svg "));
    EXPECT_NE(piped.out.find("t = 1.5 s"), std::string::npos);
    testkit::TempDir dir;
    auto path = std::filesystem::path(dir.path()) / "field.svg";
    auto written = gantry({"field", "draw", "-", "--at", "1.5s", "-o", path.string()}, std::string(small));
    EXPECT_EQ(written.code, done) << written.err;
    EXPECT_EQ(written.out, "");
    std::ostringstream text;
    text << std::ifstream(path).rdbuf();
    EXPECT_EQ(text.str(), piped.out) << "and it is the same each time";
    auto refused = gantry({"field", "draw", "-", "-o", "/no/such/folder/x.svg"}, std::string(small));
    EXPECT_EQ(refused.code, failed);
    EXPECT_NE(refused.err.find("/no/such/folder/x.svg cannot be written"), std::string::npos) << refused.err;
}

TEST(EmulateScenario, WhatDoesNotFitTogetherIsToldBeforeAnythingStarts) {
    auto makes = make_names();
    auto other = makes.back();
    auto of_make = std::string(small);
    of_make.insert(of_make.find("[[reader.antenna]]"), fmt::format("make = \"{}\"\n", other));
    struct Row {
        std::vector<std::string> arguments;
        std::string input;
        int code;
        std::string error;
    };
    for (auto& row : std::vector<Row>{
             {{makes[0], "--scenario", "-", "--count", "2"},
              "",
              wrong_usage,
              "--count does not go with --scenario"},
             {{makes[0], "--scenario", "-", "--moving"},
              "",
              wrong_usage,
              "--moving does not go with --scenario"},
             {{makes[0], "--speed", "2"}, "", wrong_usage, "--speed is for a scenario; add --scenario FILE"},
             {{makes[0], "--reader", "x"},
              "",
              wrong_usage,
              "--reader is for a scenario; add --scenario FILE"},
             {{"any"}, "", wrong_usage, "any is for the readers of a scenario"},
             {{"any", "--scenario", "-"},
              std::string(small),
              wrong_usage,
              "reader \"one\" may be of any make"},
             {{makes[0], "--scenario", "-", "--reader", "ones"},
              std::string(small),
              wrong_usage,
              "the scenario has no reader \"ones\"; did you mean \"one\"?"},
             {{makes[0], "--scenario", "-"},
              of_make,
              wrong_usage,
              fmt::format("the scenario has no {} reader; its readers: one", makes[0])},
             {{makes[0], "--scenario", "-", "--reader", "one"},
              of_make,
              wrong_usage,
              fmt::format("reader \"one\" is a {0} reader; write gantry emulate {0}", other)},
             {{makes[0], "--scenario", "-"},
              std::string(small) + "axes = 1\n",
              failed,
              "stdin:12:1: unknown key \"axes\""},
         }) {
        auto arguments = row.arguments;
        arguments.insert(arguments.begin(), "emulate");
        auto ran = gantry(arguments, row.input);
        EXPECT_EQ(ran.code, row.code) << row.error;
        EXPECT_NE(ran.err.find(row.error), std::string::npos) << ran.err;
    }
}

}  // namespace
}  // namespace gantry::cli
