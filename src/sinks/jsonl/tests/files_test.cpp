#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/log.hpp"
#include "jsonl_testing.hpp"
#include "sinks/jsonl/file_names.hpp"
#include "testkit/eventually.hpp"

namespace gantry::sinks::jsonl {
namespace {

using testkit::eventually;
using testkit::LentEvents;
using testkit::patience;
using testkit::TempDir;
using testkit::write_file;

unsigned mode_of(const std::string& path) {
    struct stat about {};
    EXPECT_EQ(::stat(path.c_str(), &about), 0) << path;
    return about.st_mode & 07777U;
}

TEST(JsonlFiles, AFileIsFullBeforeItGrowsBeyondItsSize) {
    TempDir temp;
    auto sink = make_jsonl(temp.path(), {{"rotate_size", "20KiB"}});
    for (std::uint64_t batch = 0; batch < 10; ++batch)
        expect_accepted(sink->deliver(LentEvents(20, 1 + batch * 20).items(), patience(20s)), 20);
    auto names = names_in(temp.path());
    ASSERT_GT(names.size(), 2u);
    EXPECT_EQ(names[0], "archive-00000001.jsonl");
    EXPECT_EQ(names[1], "archive-00000002.jsonl");
    for (auto& name : names)
        EXPECT_LE(std::filesystem::file_size(temp.path() + '/' + name), 20u * 1024) << name;
    EXPECT_EQ(ids_in(temp.path()), ids_between(1, 200));
}

TEST(JsonlFiles, ABatchIsNeverSplitOverTwo) {
    TempDir temp;
    auto sink = make_jsonl(temp.path(), {{"rotate_size", "1KiB"}});
    for (std::uint64_t batch = 0; batch < 3; ++batch)
        expect_accepted(sink->deliver(LentEvents(50, 1 + batch * 50).items(), patience(20s)), 50);
    EXPECT_EQ(names_in(temp.path()).size(), 3u);
    EXPECT_EQ(ids_in(temp.path()), ids_between(1, 150));
}

TEST(JsonlFiles, MoreThanABufferAtOnceArrivesWhole) {
    TempDir temp;
    auto sink = make_jsonl(temp.path());
    LentEvents events(10'000);
    expect_accepted(sink->deliver(events.items(), patience(20s)), 10'000);
    EXPECT_GT(std::filesystem::file_size(temp.path() + "/archive-00000001.jsonl"), 2u * 1024 * 1024);
    EXPECT_EQ(ids_in(temp.path()), events.ids());
}

TEST(JsonlFiles, AnOldFileIsFullThoughNothingComes) {
    TempDir temp;
    auto sink = make_jsonl(temp.path(), {{"rotate_after", "1us"}});
    expect_accepted(sink->deliver(LentEvents(1).items(), patience(20s)), 1);
    EXPECT_TRUE(eventually([&] {
        sink->idle(patience(1s));
        return names_in(temp.path()).size() == 2;
    }));
    auto files = names_in(temp.path());
    for (int i = 0; i < 1000; ++i)
        sink->idle(patience(1s));
    EXPECT_EQ(names_in(temp.path()), files) << "an empty file never gets old";
    expect_accepted(sink->deliver(LentEvents(1, 2).items(), patience(20s)), 1);
    EXPECT_EQ(ids_in(temp.path()), ids_between(1, 2));
}

TEST(JsonlFiles, TheAgeOfAFileIsKnownAfterARestart) {
    TempDir temp;
    expect_accepted(make_jsonl(temp.path())->deliver(LentEvents(1).items(), patience(20s)), 1);
    expect_accepted(make_jsonl(temp.path())->deliver(LentEvents(1, 2).items(), patience(20s)), 1);
    EXPECT_EQ(names_in(temp.path()).size(), 1u) << "it is not a day old";
    EXPECT_TRUE(eventually([&] {
        auto sink = make_jsonl(temp.path(), {{"rotate_after", "30ms"}});
        expect_accepted(sink->deliver(LentEvents(1, 3).items(), patience(20s)), 1);
        return names_in(temp.path()).size() == 2;
    }));
}

TEST(JsonlFiles, FullFilesAreCompressedAndTheOldestGo) {
    TempDir temp;
    auto sink = make_jsonl(
        temp.path(), {{"rotate_size", "1KiB"}, {"gzip", "true"}, {"keep_files", "4"}, {"mode", "0640"}});
    for (std::uint64_t batch = 0; batch < 7; ++batch)
        expect_accepted(sink->deliver(LentEvents(50, 1 + batch * 50).items(), patience(20s)), 50);
    const std::vector<std::string> wanted = {"archive-00000004.jsonl.gz", "archive-00000005.jsonl.gz",
                                             "archive-00000006.jsonl.gz", "archive-00000007.jsonl"};
    EXPECT_TRUE(eventually([&] { return names_in(temp.path()) == wanted; }));
    EXPECT_EQ(names_in(temp.path()), wanted);
    EXPECT_EQ(ids_in(temp.path()), ids_between(151, 350));
    for (auto& name : wanted)
        EXPECT_EQ(mode_of(temp.path() + '/' + name), 0640u) << name;
    EXPECT_LT(std::filesystem::file_size(temp.path() + '/' + wanted[0]),
              std::filesystem::file_size(temp.path() + '/' + wanted[3]) / 4);
}

TEST(JsonlFiles, CompressingGoesOnWhereACrashLeftIt) {
    TempDir temp;
    {
        auto sink = make_jsonl(temp.path(), {{"rotate_size", "1KiB"}});
        for (std::uint64_t batch = 0; batch < 4; ++batch)
            expect_accepted(sink->deliver(LentEvents(50, 1 + batch * 50).items(), patience(20s)), 50);
    }
    auto file = [&](int number, const char* end) {
        return temp.path() + "/archive-0000000" + std::to_string(number) + ".jsonl" + end;
    };
    write_file(file(1, ".gz.tmp"), "half of a compressed f");
    auto* packed = ::gzopen(file(2, ".gz").c_str(), "wb");
    auto text = text_of(file(2, ""));
    ::gzwrite(packed, text.data(), static_cast<unsigned>(text.size()));
    ::gzclose(packed);
    auto sink = make_jsonl(temp.path(), {{"rotate_size", "1MiB"}, {"gzip", "true"}});
    expect_accepted(sink->deliver(LentEvents(50, 201).items(), patience(20s)), 50);
    const std::vector<std::string> wanted = {"archive-00000001.jsonl.gz", "archive-00000002.jsonl.gz",
                                             "archive-00000003.jsonl.gz", "archive-00000004.jsonl"};
    EXPECT_TRUE(eventually([&] { return names_in(temp.path()) == wanted; }));
    EXPECT_EQ(names_in(temp.path()), wanted);
    EXPECT_EQ(ids_in(temp.path()), ids_between(1, 250));
}

TEST(JsonlFiles, OnlyWholeLinesStayOfAFileThatACrashCutAnywhere) {
    TempDir temp;
    auto path = temp.path() + "/archive-00000001.jsonl";
    LentEvents events(2);
    std::string whole;
    std::vector<std::size_t> ends = {0};
    for (auto& item : events.items()) {
        whole += std::string(item.payload) + '\n';
        ends.push_back(whole.size());
    }
    for (std::size_t cut = 0; cut <= whole.size(); ++cut) {
        bool near_an_end =
            std::ranges::any_of(ends, [&](auto end) { return cut + 2 >= end && cut <= end + 2; });
        if (!near_an_end && cut % 19 != 0) continue;  // each costs a disk
        write_file(path, whole.substr(0, cut));
        log::Capture said;
        auto sink = make_jsonl(temp.path());
        expect_accepted(sink->deliver({}, patience(20s)), 0);
        auto left =
            static_cast<std::size_t>(std::ranges::count_if(ends, [&](auto end) { return end <= cut; })) - 1;
        ASSERT_EQ(text_of(path), whole.substr(0, ends[left])) << "cut at " << cut;
        ASSERT_EQ(said.take().empty(), ends[left] == cut) << "what was cut off is said";
    }
}

TEST(JsonlFiles, WhatAPowerCutLeftBlankIsCutOffWithAllBehindIt) {
    TempDir temp;
    LentEvents events(4);
    auto line = [&](std::size_t i) { return std::string(events.items()[i].payload) + '\n'; };
    auto path = temp.path() + "/archive-00000001.jsonl";
    write_file(path, line(0) + line(1) + std::string(5000, '\0') + "e\":1}\n" + line(3));
    auto sink = make_jsonl(temp.path());
    expect_accepted(sink->deliver(LentEvents(2, 3).items(), patience(20s)), 2);
    EXPECT_EQ(ids_in(temp.path()), events.ids());
}

TEST(JsonlFiles, LinesThatOthersWroteAreLeftAlone) {
    TempDir temp;
    auto path = temp.path() + "/archive-00000001.jsonl";
    write_file(path, "# a note of the operator\nno JSON\n");
    auto sink = make_jsonl(temp.path());
    LentEvents events(1);
    expect_accepted(sink->deliver(events.items(), patience(20s)), 1);
    EXPECT_EQ(text_of(path),
              "# a note of the operator\nno JSON\n" + std::string(events.items()[0].payload) + '\n');
}

TEST(JsonlFiles, TheModeIsWhatWasAskedForWhateverTheUmaskSays) {
    for (auto [text, bits] : {std::pair{"0600", 0600u}, std::pair{"0640", 0640u}}) {
        TempDir temp;
        auto before = ::umask(0);
        auto sink = make_jsonl(temp.path(), {{"mode", text}});
        expect_accepted(sink->deliver(LentEvents(1).items(), patience(20s)), 1);
        ::umask(before);
        EXPECT_EQ(mode_of(temp.path() + "/archive-00000001.jsonl"), bits);
    }
}

TEST(JsonlFiles, TwoWritersDoNotShareAFile) {
    TempDir temp;
    auto first = make_jsonl(temp.path(), {{"rotate_size", "1KiB"}});
    expect_accepted(first->deliver(LentEvents(10).items(), patience(20s)), 10);
    auto second = make_jsonl(temp.path());
    expect_kept(second->deliver(LentEvents(10, 100).items(), patience(20s)), 10,
                "another program is writing to");
    expect_accepted(first->deliver(LentEvents(10, 11).items(), patience(20s)), 10);
    expect_kept(second->deliver(LentEvents(10, 100).items(), patience(20s)), 10, "archive-00000002.jsonl");
    first.reset();
    expect_accepted(second->deliver(LentEvents(10, 21).items(), patience(20s)), 10);
    EXPECT_EQ(ids_in(temp.path()), ids_between(1, 30));
}

TEST(JsonlFiles, AFileThatWasTakenAwayIsFollowedByAnother) {
    TempDir temp, elsewhere;
    auto sink = make_jsonl(temp.path());
    auto path = temp.path() + "/archive-00000001.jsonl", moved = elsewhere.path() + "/moved";
    expect_accepted(sink->deliver(LentEvents(10).items(), patience(20s)), 10);
    std::filesystem::rename(path, moved);
    expect_accepted(sink->deliver(LentEvents(10, 11).items(), patience(20s)), 10);
    EXPECT_EQ(ids_in(temp.path()), ids_between(11, 20));
    EXPECT_EQ(ids_in(elsewhere.path()), ids_between(1, 10));
    std::filesystem::remove(path);
    expect_accepted(sink->deliver(LentEvents(10, 21).items(), patience(20s)), 10);
    EXPECT_EQ(ids_in(temp.path()), ids_between(21, 30));
}

TEST(JsonlFiles, LinksAndThingsThatAreNoFilesAreNotWrittenTo) {
    TempDir temp, elsewhere;
    auto path = temp.path() + "/archive-00000001.jsonl", victim = elsewhere.path() + "/victim";
    write_file(victim, "precious");
    std::filesystem::create_symlink(victim, path);
    auto sink = make_jsonl(temp.path());
    expect_kept(sink->deliver(LentEvents(1).items(), patience(20s)), 1, "cannot write to");
    EXPECT_EQ(text_of(victim), "precious");
    std::filesystem::remove(path);
    ASSERT_EQ(::mkfifo(path.c_str(), 0600), 0);
    expect_kept(sink->deliver(LentEvents(1).items(), patience(20s)), 1, "is no plain file");
    std::filesystem::remove(path);
    expect_accepted(sink->deliver(LentEvents(1).items(), patience(20s)), 1);
}

TEST(JsonlFiles, OnlyTheSinksNameIsInTheirNames) {
    EXPECT_EQ(stem_of("dock-1_b.x"), "dock-1_b.x");
    EXPECT_EQ(stem_of("../../etc/passwd"), "%2E.%2F..%2Fetc%2Fpasswd");
    EXPECT_EQ(stem_of(".hidden %2F\n"), "%2Ehidden%20%252F%0A");
    TempDir temp;
    for (auto* name : {"a", "a-1", "../up", "a-00000001"}) {
        auto made = try_make(name, {{"dir", temp.path()}});
        ASSERT_TRUE(made);
        expect_accepted((*made)->deliver(LentEvents(1).items(), patience(20s)), 1);
        expect_accepted((*made)->deliver(LentEvents(1, 2).items(), patience(20s)), 1);
    }
    EXPECT_EQ(names_in(temp.path()),
              (std::vector<std::string>{"%2E.%2Fup-00000001.jsonl", "a-00000001-00000001.jsonl",
                                        "a-00000001.jsonl", "a-1-00000001.jsonl"}));
}

TEST(JsonlFiles, FilesOfOthersAreNotOurs) {
    TempDir temp;
    const std::vector<std::string> others = {
        "archive-1.jsonl",         "archive-00000009.jsonl.bak",
        "archive-0x000009.jsonl",  "archive-99999999999999999999999.jsonl",
        "archive-.jsonl",          "archive.jsonl",
        "archive2-00000009.jsonl", "archive-000000009.jsonl",
        "archive--0000009.jsonl"};
    for (auto& name : others)
        write_file(temp.path() + '/' + name, "not ours");
    auto sink = make_jsonl(temp.path(), {{"rotate_size", "1B"}, {"keep_files", "1"}, {"gzip", "true"}});
    for (std::uint64_t i = 0; i < 3; ++i)
        expect_accepted(sink->deliver(LentEvents(1, 1 + i).items(), patience(20s)), 1);
    EXPECT_TRUE(eventually([&] { return names_in(temp.path()).size() == others.size() + 1; }));
    for (auto& name : others)
        EXPECT_EQ(text_of(temp.path() + '/' + name), "not ours") << name;
    EXPECT_TRUE(std::filesystem::exists(temp.path() + "/archive-00000003.jsonl"));
}

TEST(JsonlFiles, WhatIsWrongWithTheSettingsIsSaid) {
    TempDir temp;
    auto error = [](const std::string& name, const Given& given) {
        auto made = try_make(name, given);
        return made ? std::string() : made.error().text();
    };
    EXPECT_NE(error("archive", {}).find("needs a dir"), std::string::npos);
    EXPECT_NE(error("archive", {{"dir", "archive"}}).find("from the root on"), std::string::npos);
    EXPECT_NE(error("archive", {{"dir", "/x"}, {"rotate_size", "much"}}).find("rotate_size"),
              std::string::npos);
    EXPECT_NE(error("archive", {{"dir", "/x"}, {"rotate_size", "0B"}}).find("rotate_size"),
              std::string::npos);
    EXPECT_NE(error("archive", {{"dir", "/x"}, {"mode", "0666"}}).find("0600, 0640"), std::string::npos);
    EXPECT_NE(error(std::string(201, 'n'), {{"dir", "/x"}}).find("shorter"), std::string::npos);
    EXPECT_EQ(error("archive", {{"dir", temp.path() + "/not/there/yet"}}), "") << "it may be mounted later";
}

TEST(JsonlFiles, TheSampleShowsEverySetting) {
    for (auto& row : kind.settings)
        EXPECT_NE(kind.sample_toml.find("\n" + std::string(row.name) + " = "), std::string::npos) << row.name;
}

}  // namespace
}  // namespace gantry::sinks::jsonl
