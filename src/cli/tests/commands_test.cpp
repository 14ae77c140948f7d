#include <algorithm>
#include <filesystem>
#include <fstream>
#include <sstream>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <unistd.h>
#include <CLI/CLI.hpp>

#include "cli/cli.hpp"
#include "cli/completion.hpp"
#include "cli/input.hpp"
#include "cli/tests/ran.hpp"

namespace gantry::cli {
namespace {

std::string make() {
    return make_names().front();
}

template <class Each>
void for_each_command(const CLI::App& app, std::vector<std::string> path, const Each& each) {
    for (auto* sub : app.get_subcommands([](const CLI::App*) { return true; })) {
        auto below = path;
        below.push_back(sub->get_name());
        each(below, *sub);
        for_each_command(*sub, below, each);
    }
}

TEST(CommandLine, EveryCommandHasHelpWithAnExample) {
    std::istringstream in;
    std::ostringstream out;
    Context context{in, out, out, {}};
    CLI::App app;
    build(app, context);
    std::size_t commands = 0;
    for_each_command(app, {}, [&](std::vector<std::string> path, const CLI::App& command) {
        ++commands;
        auto name = fmt::format("{}", fmt::join(path, " "));
        EXPECT_FALSE(command.get_description().empty()) << name;
        path.push_back("--help");
        auto ran = gantry(path);
        EXPECT_EQ(ran.code, done) << name;
        EXPECT_NE(ran.out.find("Examples:"), std::string::npos) << name;
        EXPECT_NE(ran.out.find("gantry " + name), std::string::npos) << ran.out;
        EXPECT_EQ(ran.err, "") << name;
    });
    EXPECT_GE(commands, all_commands().size());
}

TEST(CommandLine, HelpAndVersionAreNoErrors) {
    auto version = gantry({"--version"});
    EXPECT_EQ(version.code, done);
    EXPECT_EQ(version.out, "gantry " GANTRY_VERSION "\n");
    auto help = gantry({"--help"});
    EXPECT_EQ(help.code, done);
    EXPECT_NE(help.out.find("decode"), std::string::npos);
    auto nothing = gantry({});
    EXPECT_EQ(nothing.code, wrong_usage);
    EXPECT_EQ(nothing.out, "");
    EXPECT_EQ(nothing.err, help.out);
}

TEST(CommandLine, ASlipIsOneLineWithTheNearestWordAndExitCodeTwo) {
    struct Case {
        std::vector<std::string> arguments;
        std::string error;
    };
    for (auto& [arguments, error] : std::vector<Case>{
             {{"decoed"}, "gantry: decoed is not known; did you mean decode?; see gantry --help\n"},
             {{"decode", "-d", "to-host", "-p", make(), "--rwa"},
              "gantry decode: --rwa is not known; did you mean --raw?; see gantry decode --help\n"},
             {{"decode", "-d", "to-hots", "-p", make()},
              "gantry decode: --direction: to-hots is not known; did you mean to-host?; see gantry decode "
              "--help\n"},
             {{"decode", "-d", "to-host"},
              "gantry decode: --protocol is required; see gantry decode --help\n"},
             {{"config"},
              "gantry config: say what to do; one of: check, schema, example; see gantry config --help\n"},
             {{"config", "chekc"},
              "gantry config: chekc is not known; did you mean check?; see gantry config --help\n"},
             {{"config", "schema", "a"},
              "gantry config schema: a is one argument too many; see gantry config schema --help\n"},
             {{"--log-level", "loud", "config", "schema"},
              "gantry config schema: --log-level: loud is none of: debug, info, warn, error, off; see gantry "
              "config "
              "schema --help\n"},
         }) {
        auto ran = gantry(arguments);
        EXPECT_EQ(ran.code, wrong_usage);
        EXPECT_EQ(ran.err, error);
        EXPECT_EQ(ran.out, "");
    }
}

TEST(CommandLine, TheLogLevelMayStandBeforeOrAfterTheCommand) {
    EXPECT_EQ(gantry({"--log-level", "error", "config", "schema"}).code, done);
    EXPECT_EQ(gantry({"config", "schema", "--log-level", "error"}).code, done);
}

TEST(CommandLine, OutputThatCannotBeWrittenIsAFailure) {
    std::istringstream in;
    std::ofstream full("/dev/full");
    std::ostringstream err;
    Context context{in, full, err, {}};
    EXPECT_EQ(run({"config", "schema"}, context), failed);
    EXPECT_EQ(err.str(), "gantry config schema: cannot write the output; is the disk full?\n");
}

TEST(Decode, BadHexNamesItsLineAndColumn) {
    std::vector<std::string> decode = {"decode", "-p", make(), "-d", "to-host"};
    auto ran = gantry(decode, "\n80 0z\n");
    EXPECT_EQ(ran.code, failed);
    EXPECT_EQ(ran.err,
              "gantry decode: line 2: column 5: 'z' is no hex digit; write bytes as 8001 or 80 01\n");
    ran = gantry(decode, "800\n");
    EXPECT_EQ(ran.err, "gantry decode: line 1: an odd number of hex digits; a byte is two digits\n");
}

TEST(Decode, BytesThatAreNoFrameAreShownAndMakeItFail) {
    auto ran = gantry({"decode", "-p", make(), "-d", "to-host"}, "00\r\n");
    EXPECT_EQ(ran.code, failed);
    EXPECT_TRUE(ran.out.ends_with("\"bytes\":\"00\"}\n")) << ran.out;
    EXPECT_EQ(ran.err,
              "gantry decode: 1 byte could not be decoded; see the line with \"error\" in the output\n");
}

TEST(Decode, AFileThatIsNotThereIsNamed) {
    auto ran = gantry({"decode", "-p", make(), "-d", "to-host", "/nowhere/frames.hex"});
    EXPECT_EQ(ran.code, failed);
    EXPECT_EQ(ran.err,
              "gantry decode: there is no file /nowhere/frames.hex; name a file, or - for the standard "
              "input\n");
    EXPECT_EQ(gantry({"decode", "-p", make(), "-d", "to-host", "/tmp"}).code, failed);
}

TEST(Encode, ALineOfAnotherProtocolOrDirectionIsRefused) {
    std::vector<std::string> encode = {"encode", "-p", make(), "-d", "to-host"};
    auto ran = gantry(encode, R"({"protocol":"other","error":"x","bytes":"00"})");
    EXPECT_EQ(ran.code, failed);
    EXPECT_EQ(ran.err,
              fmt::format("gantry encode: line 1: the line is of other, not {}; use -p other\n", make()));
    ran = gantry(encode, R"({"direction":"to-reader","error":"x","bytes":"00"})");
    EXPECT_EQ(ran.err, "gantry encode: line 1: the line is of to-reader, not to-host; use -d to-reader\n");
}

TEST(Encode, ErrorObjectsGiveTheirBytesBack) {
    std::string lines = "{\"error\":\"x\",\"bytes\":\"00ff\"}\n\n{\"error\":\"x\",\"bytes\":\"01\"}\n";
    std::vector<std::string> encode = {"encode", "-p", make(), "-d", "to-host"};
    EXPECT_EQ(gantry(encode, lines).out, "00FF\n01\n");
    encode.push_back("--raw");
    EXPECT_EQ(gantry(encode, lines).out, std::string("\0\xFF\x01", 3));
}

TEST(Encode, AWordThatIsNeitherMessageNorFileIsExplained) {
    auto ran = gantry({"encode", "-p", make(), "-d", "to-host", "xyzzy"});
    EXPECT_EQ(ran.code, failed);
    EXPECT_TRUE(ran.err.starts_with("gantry encode: there is neither a message nor a file xyzzy; messages: "))
        << ran.err;
}

TEST(EpcCommand, DecodesForPeopleAndPrograms) {
    auto ran = gantry({"epc", "decode", "--json", "3074257BF7194E4000001A85"});
    EXPECT_EQ(ran.code, done);
    EXPECT_EQ(ran.out,
              "{\"hex\":\"3074257BF7194E4000001A85\",\"scheme\":\"sgtin-96\",\"filter\":3,"
              "\"epc\":\"urn:epc:id:sgtin:0614141.812345.6789\","
              "\"tag_uri\":\"urn:epc:tag:sgtin-96:3.0614141.812345.6789\","
              "\"gs1\":\"(01)80614141123458(21)6789\",\"link\":\"https://id.gs1.org/01/80614141123458/21/"
              "6789\"}\n");
    ran = gantry({"epc", "decode", "30 74257BF7194E4000001A85"});
    EXPECT_EQ(ran.out,
              "3074257BF7194E4000001A85\n"
              "  scheme   sgtin-96\n"
              "  filter   3\n"
              "  EPC      urn:epc:id:sgtin:0614141.812345.6789\n"
              "  tag URI  urn:epc:tag:sgtin-96:3.0614141.812345.6789\n"
              "  GS1      (01)80614141123458(21)6789\n"
              "  link     https://id.gs1.org/01/80614141123458/21/6789\n");
}

TEST(EpcCommand, WhatIsNoEpcIsAnAnswerAndWhatIsNoHexAFailure) {
    auto ran = gantry({"epc", "decode", "--json", "-"}, "0000\n\n30\n");
    EXPECT_EQ(ran.code, done);
    EXPECT_TRUE(ran.out.starts_with("{\"hex\":\"0000\",\"scheme\":\"unknown\",\"reason\":\"")) << ran.out;
    EXPECT_EQ(std::ranges::count(ran.out, '\n'), 2);
    ran = gantry({"epc", "decode", "-"}, "\nxyz\n");
    EXPECT_EQ(ran.code, failed);
    EXPECT_EQ(ran.err,
              "gantry epc decode: line 2: \"xyz\" is not hex: column 1: 'x' is no hex digit; write bytes as "
              "8001 or 80 01\n");
}

TEST(EpcCommand, EncodesBackToTheSameBytes) {
    EXPECT_EQ(gantry({"epc", "encode", "urn:epc:tag:sgtin-96:3.0614141.812345.6789"}).out,
              "3074257BF7194E4000001A85\n");
    EXPECT_EQ(gantry({"epc", "encode", "urn:epc:id:sgtin:0614141.812345.6789", "--filter", "3"}).out,
              "3074257BF7194E4000001A85\n");
    EXPECT_EQ(
        gantry({"epc", "encode", "(01)80614141123458(21)6789", "--filter", "3", "--prefix-digits", "7"}).out,
        "3074257BF7194E4000001A85\n");
    EXPECT_EQ(gantry({"epc", "encode", "urn:nonsense"}).code, failed);
    EXPECT_EQ(gantry({"epc", "encode", "urn:epc:id:sgtin:1.2.3", "--filter", "8"}).code, wrong_usage);
}

TEST(ConfigCommand, TheExampleChecksClean) {
    auto example = gantry({"config", "example"});
    EXPECT_EQ(example.code, done);
    auto check = gantry({"config", "check", "-"}, example.out);
    EXPECT_EQ(check.code, done) << check.err;
    EXPECT_TRUE(check.out.starts_with("-: good, ")) << check.out;
    EXPECT_EQ(check.err, "");
    auto one = gantry({"config", "example", make()});
    EXPECT_EQ(gantry({"config", "check", "-"}, one.out).code, done) << one.out;
}

TEST(ConfigCommand, ErrorsAreTheOnlyThingOnStderr) {
    auto ran = gantry({"config", "check", "-"}, "[stor]\n");
    EXPECT_EQ(ran.code, failed);
    EXPECT_EQ(ran.out, "");
    EXPECT_EQ(ran.err, "stdin:1:2: unknown section \"stor\"; did you mean [store]?\n");
    ran = gantry({"config", "check", "--json", "-"}, "[stor]\n[pres]\n");
    EXPECT_EQ(ran.code, failed);
    EXPECT_EQ(
        ran.out,
        "{\"file\":\"-\",\"valid\":false,\"errors\":[\"stdin:1:2: unknown section \\\"stor\\\"; did you mean "
        "[store]?\",\"stdin:2:2: unknown section \\\"pres\\\"; sections: gateway, reader, presence, zone, "
        "events, store, sink, api\"],\"warnings\":[]}\n");
}

TEST(ConfigCommand, WarningsDoNotFailTheCheck) {
    auto ran = gantry({"config", "check", "-"}, "[api]\nlisten = \"127.0.0.1:1\"\n");
    EXPECT_EQ(ran.code, done);
    EXPECT_EQ(ran.out, "-: good, 0 readers, with warnings\n");
    EXPECT_TRUE(ran.err.starts_with("stdin:2:1: api.listen is not served by this version")) << ran.err;
}

TEST(ConfigCommand, TheMissingFileIsNamed) {
    auto ran = gantry({"config", "check", "/nowhere.toml"});
    EXPECT_EQ(ran.code, failed);
    EXPECT_EQ(ran.err,
              "/nowhere.toml: there is no such file; `gantry config example` prints one to start from\n");
}

TEST(Completion, KnowsTheWholeTreeInEveryShell) {
    std::istringstream in;
    std::ostringstream out;
    Context context{in, out, out, {}};
    CLI::App app;
    build(app, context);
    for (std::string shell : {"bash", "zsh", "fish"}) {
        auto script = gantry({"completion", shell});
        ASSERT_EQ(script.code, done);
        for_each_command(app, {}, [&](const std::vector<std::string>& path, const CLI::App& command) {
            if (command.get_group().empty()) return;  // hidden
            EXPECT_NE(script.out.find(fmt::format("gantry {}", fmt::join(path, " "))), std::string::npos)
                << fmt::format("{} {}", shell, fmt::join(path, " "));
            for (auto* option : command.get_options())
                for (auto& name : option->get_lnames())
                    EXPECT_NE(script.out.find(name), std::string::npos) << shell << ' ' << name;
        });
        EXPECT_NE(script.out.find("to-reader to-host"), std::string::npos) << shell;
    }
}

TEST(Completion, QuotesWhatAShellWouldRead) {
    CompletionNode root;
    root.path = "gantry";
    root.options = {{{"--odd"}, "it's `odd` $HOME \\", false, {}}};
    EXPECT_NE(zsh_completion(root).find("'--odd:it'\\''s `odd` $HOME \\'"), std::string::npos);
    EXPECT_NE(fish_completion(root).find("'it\\'s `odd` $HOME \\\\'"), std::string::npos);
}

TEST(Input, LinesEndInEitherWayAndTheLastNeedsNoEnd) {
    std::istringstream in("a\r\n\nb");
    std::ostringstream out;
    Context context{in, out, out, {}};
    auto input = Input::open(context, "-");
    std::string line;
    std::vector<std::string> lines;
    while (*input->next_line(line))
        lines.push_back(line);
    EXPECT_EQ(lines, (std::vector<std::string>{"a", "", "b"}));
}

TEST(Input, ALineWithoutEndIsRefusedBeforeItFillsTheMemory) {
    std::istringstream in(std::string(Input::max_line + 1, 'A'));
    std::ostringstream out;
    Context context{in, out, out, {}};
    auto input = Input::open(context, "-");
    std::string line;
    auto got = input->next_line(line);
    ASSERT_FALSE(got);
    EXPECT_EQ(got.error().text(),
              "line 1 of the standard input is over 64 MiB; is it binary? then use --raw");
}

TEST(Input, PiecesAreWhatTheFileHolds) {
    auto path = std::filesystem::temp_directory_path() / fmt::format("gantry-input-test-{}", getpid());
    std::string bytes;
    for (int i = 0; i < 200'000; ++i)
        bytes.push_back(static_cast<char>(i * 7));
    std::ofstream(path, std::ios::binary) << bytes;
    std::istringstream in;
    std::ostringstream out;
    Context context{in, out, out, {}};
    auto input = Input::open(context, path.string());
    ASSERT_TRUE(input);
    std::string read;
    for (;;) {
        auto piece = input->next_piece();
        ASSERT_TRUE(piece);
        if (piece->empty()) break;
        EXPECT_LE(piece->size(), 64u << 10);
        read += as_text(*piece);
    }
    std::filesystem::remove(path);
    EXPECT_EQ(read, bytes);
}

}  // namespace
}  // namespace gantry::cli
