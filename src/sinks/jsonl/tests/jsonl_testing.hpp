#pragma once
#include <zlib.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "sinks/jsonl/jsonl.hpp"
#include "testkit/sink_suite.hpp"
#include "testkit/temp_dir.hpp"

// What the tests of this sink share.
namespace gantry::sinks::jsonl {

using Given = std::map<std::string, std::string>;

inline Result<std::unique_ptr<sink::Sink>> try_make(const std::string& name, const Given& given) {
    static testkit::QuietHost host;
    std::vector<std::pair<std::string, std::string>> pairs(given.begin(), given.end());
    auto settings = Settings::make(kind.settings, pairs);
    if (!settings) return tl::unexpected(settings.error());
    return kind.make({.name = name, .gateway_id = "suite", .url = "", .settings = *settings, .batch = 1000},
                     host);
}

inline std::unique_ptr<sink::Sink> make_jsonl(const std::string& dir, Given given = {}) {
    given.emplace("dir", dir);
    auto made = try_make("archive", given);
    EXPECT_TRUE(made) << made.error().text();
    return made ? std::move(*made) : nullptr;
}

inline std::vector<std::string> names_in(const std::string& dir) {
    std::vector<std::string> names;
    for (auto& each : std::filesystem::directory_iterator(dir))
        names.push_back(each.path().filename());
    std::ranges::sort(names);
    return names;
}

// The text of a file, compressed or not.
inline std::string text_of(const std::string& path) {
    std::string text;
    auto* file = ::gzopen(path.c_str(), "rb");
    if (file == nullptr) return text;
    char piece[65536];
    for (int got = 0; (got = ::gzread(file, piece, sizeof piece)) > 0;)
        text.append(piece, static_cast<std::size_t>(got));
    EXPECT_EQ(::gzclose(file), Z_OK) << path << " is damaged";
    return text;
}

// The ids of all lines of all files, in the order of their names; every line must be a whole object.
inline std::vector<std::string> ids_in(const std::string& dir) {
    std::vector<std::string> ids;
    for (auto& name : names_in(dir)) {
        auto text = text_of(dir + '/' + name);
        EXPECT_TRUE(text.empty() || text.ends_with('\n')) << name << " ends within a line";
        for (std::size_t at = 0; at < text.size();) {
            auto end = std::min(text.find('\n', at), text.size());
            auto line = text.substr(at, end - at);
            EXPECT_TRUE(line.starts_with("{\"schema\":1,\"id\":\"") && line.ends_with('}'))
                << name << ": " << line;
            auto id = line.find("\"id\":\"") + 6;
            ids.push_back(line.substr(id, line.find('"', id) - id));
            at = end + 1;
        }
    }
    return ids;
}

inline std::vector<std::string> ids_between(std::uint64_t first, std::uint64_t last) {
    return testkit::LentEvents(last - first + 1, first).ids();
}

inline void expect_accepted(const sink::Outcome& outcome, std::size_t items) {
    EXPECT_EQ(outcome.trouble, "");
    EXPECT_EQ(outcome.fates, std::vector(items, sink::Fate::accepted));
}

inline void expect_kept(const sink::Outcome& outcome, std::size_t items, const std::string& why) {
    EXPECT_EQ(outcome.fates, std::vector(items, sink::Fate::kept));
    EXPECT_NE(outcome.trouble.find(why), std::string::npos) << outcome.trouble;
}

}  // namespace gantry::sinks::jsonl
