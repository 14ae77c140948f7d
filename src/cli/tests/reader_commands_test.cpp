#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <unistd.h>
#include <CLI/CLI.hpp>

#include "cli/completion.hpp"
#include "cli/job_text.hpp"
#include "cli/store.hpp"
#include "cli/tag_words.hpp"
#include "cli/tests/ran.hpp"
#include "protocols/registry.hpp"

namespace gantry::cli {
namespace {

namespace json = boost::json;

json::object object(std::string_view text) {
    return json::parse(text).as_object();
}

// A make that is dialled: an address of it needs nobody to be there.
const Plugin& dialled() {
    auto all = plugins();
    auto is_dialled = [](const Plugin* make) {
        return !make->schemes.empty() && make->schemes.front().kind == LinkKind::dial;
    };
    return **std::ranges::find_if(all, is_dialled);
}

std::string address() {
    return fmt::format("{}://127.0.0.1:1", dialled().schemes.front().name);
}

TEST(JobText, ValuesKeepTheirOrderAndANameMayComeTwice) {
    auto job = object(R"({"values":[["Id","00"],["Power",500],["Id",{"a":1}]]})");
    std::ostringstream out;
    print_values(out, job, [](std::string_view name) { return name == "Power" ? "mW" : "s"; });
    EXPECT_EQ(out.str(), "Id     00\nPower  500 mW\nId     {\"a\":1}\n");
    out.str("");
    print_values(out, object(R"({"values":{"b":1,"a":true}})"), [](std::string_view) { return ""; });
    EXPECT_EQ(out.str(), "b  1\na  true\n");
    EXPECT_TRUE(values_of(object("{}")).empty());
    EXPECT_TRUE(values_of(object(R"({"values":[["half"],7,[1,2]]})")).empty());
}

TEST(JobText, TextOfAReaderIsMadeSafe) {
    std::ostringstream out;
    print_values(out, object(R"({"values":[["Name","a\u001b[2J\nb"]]})"),
                 [](std::string_view) { return ""; });
    EXPECT_EQ(out.str(), "Name  a\\x1B[2J\\x0Ab\n");
}

TEST(JobText, WhatDidNotEndWellIsOneLineAndAnExitCode) {
    std::istringstream in;
    std::ostringstream out, err;
    Context context{in, out, err, {}};
    Target target;
    target.reader = "dock";
    EXPECT_EQ(conclude(context, target, object(R"({"status":"done"})"), "tag read"), done);
    EXPECT_EQ(out.str() + err.str(), "");
    auto refused = object(R"({"status":"failed","text":"locked"})");
    EXPECT_EQ(conclude(context, target, refused, "tag read"), failed);
    EXPECT_EQ(err.str(), "gantry tag read: dock: failed; locked\n");
    target.json = true;
    EXPECT_EQ(conclude(context, target, refused, "tag read"), failed);
    EXPECT_EQ(out.str(), "{\"status\":\"failed\",\"text\":\"locked\"}\n");
}

TEST(Target, TheReadersNameMayBeMissingWithAnAddress) {
    struct Case {
        std::string address;
        std::vector<std::string> words;
        std::string reader, rest, error;
    };
    for (auto& [address, words, reader, rest, error] : std::vector<Case>{
             {"", {"dock", "30"}, "dock", "30", ""},
             {"", {"dock"}, "", "", "TAG is missing"},
             {"", {}, "", "", "say which reader"},
             {"x://y", {"30"}, "", "30", ""},
             {"x://y", {"dock", "30"}, "dock", "30", ""},
             {"x://y", {}, "", "", "TAG is missing"},
         }) {
        Target target;
        target.address = address;
        auto left = words;
        auto taken = take_words(target, left, {"TAG"});
        ASSERT_EQ(taken.has_value(), error.empty()) << error;
        if (!taken) {
            EXPECT_EQ(taken.error().what, error);
            continue;
        }
        EXPECT_EQ(target.reader, reader);
        EXPECT_EQ(left, std::vector<std::string>{rest});
    }
}

TEST(Target, AddressesAndSettingsThatCannotBe) {
    auto ran = gantry({"gpio", "get", "--address", "127.0.0.1"});
    EXPECT_EQ(ran.code, failed);
    EXPECT_TRUE(
        ran.err.starts_with("gantry gpio get: --address: \"127.0.0.1\" is no address; write SCHEME://"))
        << ran.err;
    ran = gantry({"gpio", "get", "--address", address(), "--set", "xyzzy=1"});
    EXPECT_EQ(ran.code, failed);
    EXPECT_TRUE(ran.err.starts_with("gantry gpio get: --set xyzzy=1: ")) << ran.err;
    EXPECT_EQ(gantry({"gpio", "get", "--address", address(), "--set", "xyzzy"}).code, wrong_usage);
}

TEST(Target, AReaderThatIsNotThereIsNamed) {
    auto ran = gantry({"reader", "info", "--address", address()});
    EXPECT_EQ(ran.code, failed);
    EXPECT_TRUE(ran.err.starts_with("gantry reader info: cannot connect to 127.0.0.1:1: ")) << ran.err;
}

TEST(TagCommand, SlipsAreWrongUsageBeforeAnythingIsDone) {
    struct Case {
        std::vector<std::string> arguments;
        std::string error;
    };
    for (auto& [arguments, error] : std::vector<Case>{
             {{"read", "dock", "30", "--bank", "usr"}, "--bank: there is no bank usr; did you mean user?"},
             {{"read", "dock", "30", "--length", "0"}, "--length: 0 cannot be"},
             {{"write", "dock", "30", "--data", "0z"}, "--data: column 2: 'z' is no hex digit"},
             {{"write", "dock", "30"}, "--data is required"},
             {{"write", "dock", "30", "--data", "00"},
              "--data: 1 byte is no whole words; a word is two bytes"},
             {{"write", "dock", "30", "--data", ""}, "--data: 0 bytes are no whole words"},
             {{"read", "dock", "zz"}, "TAG: zz is no tag: column 1: 'z' is no hex digit"},
             {{"read", "dock", "303"}, "TAG: 303 is no tag: an odd number of hex digits"},
             {{"read", "dock", ""}, "TAG:  is no tag"},
             {{"read", "dock", "urn:epc:id:sgtin:0614141.812345.6789"},
              "TAG: urn:epc:id:sgtin:0614141.812345.6789 is not all that a tag holds: its filter value is "
              "missing"},
             {{"read", "dock", "(01)80614141123458(21)6789"},
              "TAG: (01)80614141123458(21)6789 is not all that a tag holds"},
             {{"read", "dock", "urn:epc:tag:sgtin-96:x"}, "TAG: "},
             {{"program", "dock", "30", "zz"}, "NEW: zz is no tag"},
             {{"read", "dock", "30", "--length", "99999"},
              "--length: 99999 cannot be; write a whole number, 1 to 65535"},
             {{"read", "dock", "30", "--offset", "-1"}, "--offset: -1 cannot be"},
             {{"program", "dock", "30"}, "NEW is missing"},
             {{"lock", "dock", "30"}, "say what to lock"},
             {{"lock", "dock", "30", "--field", "usr=locked"},
              "--field: usr has no lock; did you mean user?"},
             {{"lock", "dock", "30", "--field", "user=lockd"},
              "--field: lockd is no state of a lock; did you mean locked?"},
             {{"lock", "dock", "30", "--field", "user=locked", "--block", "7"},
              "--field and --block do not go together"},
             {{"lock", "dock", "30", "--field", "user=open", "--field", "user=locked"},
              "--field user is given twice"},
             {{"lock", "dock", "30", "--block", "-1"}, "--block"},
             {{"kill", "dock", "30", "--yes"}, "a tag is killed with its kill password"},
             {{"read", "dock", "30", "--technology", "gen2"}, "--technology: gen2 is"},
         }) {
        auto all = arguments;
        all.insert(all.begin(), "tag");
        auto ran = gantry(all);
        EXPECT_EQ(ran.code, wrong_usage) << error;
        EXPECT_EQ(ran.out, "");
        EXPECT_TRUE(ran.err.starts_with(fmt::format("gantry tag {}: {}", arguments.front(), error)))
            << ran.err;
    }
}

TEST(TagCommand, WhatIsForEverNeedsAWordWhereNobodyCanBeAsked) {
    for (auto& arguments : std::vector<std::vector<std::string>>{
             {"tag", "kill", "dock", "30", "--kill-password", "00000001"},
             {"tag", "lock", "dock", "30", "--field", "user=permanently_locked"},
             {"tag", "lock", "dock", "30", "--field", "epc=permanently_open", "--field", "user=open"},
             {"tag", "lock", "dock", "E004", "--block", "20"},
             {"tag", "lock", "dock", "E004", "--address", "20"},
         }) {
        auto ran = gantry(arguments, "y\n");
        EXPECT_EQ(ran.code, wrong_usage);
        EXPECT_NE(ran.err.find("cannot be undone"), std::string::npos) << ran.err;
        EXPECT_NE(ran.err.find("add --yes"), std::string::npos) << ran.err;
    }
}

TEST(TagCommand, AShortPasswordIsNone) {
    auto ran = gantry({"tag", "read", "--address", address(), "30", "--access-password", "ABCD"});
    EXPECT_EQ(ran.code, wrong_usage);
    EXPECT_NE(ran.err.find("8 hex digits, like 0000ABCD"), std::string::npos) << ran.err;
}

TEST(TagCommand, AnIdIsHexOrATagUri) {
    EXPECT_EQ(to_hex(*read_tag_id("urn:epc:tag:sgtin-96:3.0614141.812345.6789")), "3074257BF7194E4000001A85");
    EXPECT_EQ(to_hex(*read_tag_id("3074 257b")), "3074257B");
    EXPECT_FALSE(read_tag_id(std::string(400, '0')));
}

TEST(TagList, PatternsAreThoseOfTheStore) {
    EXPECT_TRUE(matches("", "dock"));
    EXPECT_TRUE(matches("d*k", "dock"));
    EXPECT_TRUE(matches("*o*ck", "oockock"));
    EXPECT_TRUE(matches("dock*", "dock"));
    EXPECT_FALSE(matches("dock", "dock-1"));
    EXPECT_FALSE(matches("*k", "dock-1"));
}

TEST(JobText, WhatSomebodyTookBackHasACodeOfItsOwn) {
    std::istringstream in;
    std::ostringstream out, err;
    Context context{in, out, err, {}};
    Target target;
    target.reader = "dock";
    auto job = object(R"({"status":"cancelled","text":"it was never sent","interrupted":true})");
    EXPECT_EQ(conclude(context, target, job, "tag read"), stopped_by_user);
    EXPECT_EQ(err.str(), "gantry tag read: dock: cancelled; it was never sent\n");
    err.str("");
    EXPECT_EQ(conclude(context, target, object(R"({"status":"done","interrupted":true})"), "gpio set"),
              stopped_by_user);
    EXPECT_EQ(err.str(), "gantry gpio set: dock: done; it was done before it could be taken back\n");
}

TEST(TagCommand, APasswordThatIsNoneIsNotShown) {
    auto file = std::filesystem::temp_directory_path() / fmt::format("gantry-secret-{}", getpid());
    std::ofstream(file) << "hunter2\n";
    auto given = gantry({"tag", "read", "--address", address(), "30", "--access-password", "hunter2"});
    auto from_file =
        gantry({"tag", "read", "--address", address(), "30", "--access-password-file", file.string()});
    ::setenv("GANTRY_ACCESS_PASSWORD", "hunter2", 1);
    auto from_environment = gantry({"tag", "read", "--address", address(), "30"});
    ::unsetenv("GANTRY_ACCESS_PASSWORD");
    std::filesystem::remove(file);
    for (auto& ran : {given, from_file, from_environment}) {
        EXPECT_EQ(ran.code, wrong_usage);
        EXPECT_NE(ran.err.find("that is no password; a password is 8 hex digits, like 0000ABCD"),
                  std::string::npos)
            << ran.err;
        EXPECT_EQ(ran.err.find("hunter2"), std::string::npos) << ran.err;
    }
    auto missing =
        gantry({"tag", "read", "--address", address(), "30", "--access-password-file", file.string()});
    EXPECT_NE(missing.err.find(file.string() + " cannot be read"), std::string::npos) << missing.err;
}

TEST(ExecCommand, TheMakesOwnTablesCheckWhatIsTyped) {
    auto ran = gantry({"reader", "exec", "--address", address(), "dock", "xyzzy"});
    EXPECT_EQ(ran.code, failed);
    EXPECT_TRUE(ran.err.starts_with("gantry reader exec: there is no message xyzzy; messages: ")) << ran.err;
    auto command = dialled().codec().names(wire::Direction::to_reader).front();
    ran = gantry({"reader", "exec", "--address", address(), std::string(command), "word"});
    EXPECT_EQ(ran.code, wrong_usage);
    EXPECT_TRUE(ran.err.starts_with("gantry reader exec: \"word\" is no Field=value")) << ran.err;
}

TEST(CompletionWords, ALineOfBashIsTakenApart) {
    using Words = std::vector<std::string>;
    EXPECT_EQ(split_line("gantry reader  exec 'a b' \"c d\" e\\ f x="),
              (Words{"gantry", "reader", "exec", "a b", "c d", "e f", "x="}));
    EXPECT_EQ(split_line("gantry reader "), (Words{"gantry", "reader", ""}));
    EXPECT_EQ(split_line(""), Words{""});
    EXPECT_EQ(split_line("gantry 'open"), (Words{"gantry", "open"}));
    EXPECT_EQ(without_prefix({"A=one", "A=two"}, "A=o"), (Words{"one", "two"}));
    EXPECT_EQ(without_prefix({"one"}, "o"), Words{"one"});
}

TEST(CompletionWords, ComeFromTheTablesOfTheMakeAtTheAddress) {
    std::istringstream in;
    std::ostringstream out;
    Context context{in, out, out, {}};
    CLI::App app;
    build(app, context);
    auto root = completion_tree(app, context);
    auto& codec = dialled().codec();
    auto names = codec.names(wire::Direction::to_reader);
    auto place = address();
    auto all = words_for(root, {"reader", "exec", "--address", place, ""});
    EXPECT_TRUE(std::ranges::equal(all, names));
    for (auto name : names) {
        auto fields = codec.field_names(name, wire::Direction::to_reader);
        auto offered = words_for(root, {"reader", "exec", "--address", place, "dock", std::string(name), ""});
        ASSERT_EQ(offered.size(), fields.size()) << name;
        for (std::size_t i = 0; i < fields.size(); ++i)
            EXPECT_EQ(offered[i], std::string(fields[i]) + "=");
    }
    auto parameters = words_for(root, {"reader", "config", "get", "--address=" + place, ""});
    EXPECT_EQ(parameters.size(), dialled().parameters.size());
    EXPECT_TRUE(words_for(root, {"reader", "exec", "--address", "nobody", ""}).empty());
    EXPECT_TRUE(words_for(root, {"decode", ""}).empty());
    EXPECT_TRUE(words_for(root, {}).empty());
}

TEST(Emulate, ALinkThatTheMakeCannotHaveIsWrongUsage) {
    std::string make(dialled().name);
    auto ran = gantry({"emulate", make, "--connect", "127.0.0.1:1"});
    EXPECT_EQ(ran.code, wrong_usage);
    EXPECT_NE(ran.err.find("say where with --listen HOST:PORT"), std::string::npos) << ran.err;
    ran = gantry({"emulate", make, "--listen", "127.0.0.1:65535", "--count", "2"});
    EXPECT_EQ(ran.code, wrong_usage);
    EXPECT_NE(ran.err.find("need ports over 65535"), std::string::npos) << ran.err;
    ran = gantry({"emulate", make, "--listen", "127.0.0.1:0", "--pty", "/tmp/x"});
    EXPECT_EQ(ran.code, wrong_usage);
    EXPECT_NE(ran.err.find("a reader has one link"), std::string::npos) << ran.err;
}

}  // namespace
}  // namespace gantry::cli
