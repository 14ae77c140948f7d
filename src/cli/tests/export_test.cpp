#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>

#include <gtest/gtest.h>

#include "cli/csv.hpp"
#include "cli/tests/ran.hpp"
#include "journal/journal.hpp"
#include "testkit/temp_dir.hpp"

namespace gantry::cli {
namespace {

event::Event reads_with(const std::string& reader) {
    event::Event event;
    event.seq = 7;
    event.type = event::Type::reader_fault;
    event.time = *parse_rfc3339("2026-11-21T23:04:00Z");
    event.reader = reader;
    return event;
}

// The cell of the reader's name.
std::string cell(const std::string& reader, Cells cells = Cells::safe) {
    std::string line;
    append_csv(line, reads_with(reader), "site-7:", cells);
    std::string begin = "site-7:7,7,reader.fault,2026-11-21T23:04:00.000000Z,",
                end = std::string(28, ',') + "\n";
    EXPECT_TRUE(line.starts_with(begin) && line.ends_with(end)) << line;
    return line.substr(begin.size(), line.size() - begin.size() - end.size());
}

TEST(Csv, TextIsQuotedAsRfc4180Says) {
    EXPECT_EQ(cell("dock-1"), "dock-1");
    EXPECT_EQ(cell("a,b"), "\"a,b\"");
    EXPECT_EQ(cell("a\"b"), "\"a\"\"b\"");
    EXPECT_EQ(cell("a\nb"), "\"a\nb\"");
    EXPECT_EQ(cell("a\r\nb"), "\"a\r\nb\"");
    EXPECT_EQ(cell("Tür 7"), "Tür 7");
}

TEST(Csv, WhatASpreadsheetWouldRunIsText) {
    for (std::string_view text : {"=1+1", "+1", "-1", "@SUM(A1)", "\t=1", "\r=1"}) {
        auto safe = cell(std::string(text));
        EXPECT_NE(safe.find("'" + std::string(text)), std::string::npos) << safe;
        EXPECT_EQ(cell(std::string(text), Cells::raw).find('\''), std::string::npos);
    }
    EXPECT_EQ(cell("=cmd|' /C calc'!A0"), "'=cmd|' /C calc'!A0");
    EXPECT_EQ(cell("=A1,B1"), "\"'=A1,B1\"");
    EXPECT_EQ(cell("a=1"), "a=1");
}

TEST(Csv, ControlCharactersStayOutUnlessRaw) {
    constexpr const char* replaced = "\xEF\xBF\xBD";
    EXPECT_EQ(cell("a\x1B[31mb"), std::string("a") + replaced + "[31mb");
    EXPECT_EQ(cell(std::string("a\0b", 3)), std::string("a") + replaced + "b");
    EXPECT_EQ(cell("a\x7F"), std::string("a") + replaced);
    EXPECT_EQ(cell("a\xC2\x9B"), std::string("a") + replaced) << "a control character of two bytes";
    EXPECT_EQ(cell("a\xFF\xC3"), std::string("a") + replaced + replaced);
    EXPECT_EQ(cell("a\xE2\x82"), std::string("a") + replaced + replaced);
    EXPECT_EQ(cell("a\x1B\xFF", Cells::raw), "a\x1B\xFF");
}

TEST(Csv, NumbersStayNumbers) {
    auto event = reads_with("r");
    event.rssi = static_cast<std::int16_t>(-528);
    event.code = -3;
    event.by = "+1h";
    event.state = false;
    event.tid = {0xE2};
    event.user = {0x01};
    std::string line;
    append_csv(line, event, "site-7:", Cells::safe);
    EXPECT_EQ(line,
              "site-7:7,7,reader.fault,2026-11-21T23:04:00.000000Z,r,,,,,,,,,,-52.8,,,,,,,,-3,,,,0,,,,'+1h,,"
              "\"{\"\"tid\"\":\"\"E2\"\",\"\"user\"\":\"\"01\"\"}\"\n");
    auto header = csv_header();
    EXPECT_EQ(std::ranges::count(header, ','), 32);
    EXPECT_TRUE(header.starts_with("id,seq,type,time,reader,"));
}

class Export : public ::testing::Test {
protected:
    void SetUp() override {
        auto journal = journal::Journal::open({.path = db()});
        ASSERT_TRUE(journal);
        ASSERT_TRUE((*journal)->set_gateway_id("site-7"));
        journal::Batch batch;
        batch.time = *parse_rfc3339("2026-11-21T23:04:00Z");
        for (int i = 0; i < 5000; ++i) {
            auto& event = batch.events.emplace_back(reads_with(i % 2 == 0 ? "dock-1" : "dock-2"));
            event.seq = batch.take_seq();
        }
        ASSERT_TRUE((*journal)->commit(batch));
    }
    std::string db() const { return dir_.path() + "/gantry.db"; }
    std::string out() const { return dir_.path() + "/out"; }
    static std::string read(const std::string& file) {
        std::ifstream in(file, std::ios::binary);
        return {std::istreambuf_iterator<char>(in), {}};
    }
    Ran exported(std::vector<std::string> more) const {
        more.insert(more.begin(), {"events", "export", "--db", db()});
        return gantry(std::move(more));
    }
    testkit::TempDir dir_;
};

TEST_F(Export, GoesOnBehindANumber) {
    auto all = exported({"--format", "csv"});
    EXPECT_EQ(all.code, done) << all.err;
    auto first = exported({"--format", "csv", "--limit", "1234"});
    auto last_line = first.out.substr(first.out.rfind('\n', first.out.size() - 2) + 1);
    EXPECT_TRUE(last_line.starts_with("site-7:1234,1234,")) << last_line;
    auto rest = exported({"--format", "csv", "--after", "1234", "--no-header"});
    EXPECT_EQ(first.out + rest.out, all.out);
}

TEST_F(Export, AFileIsThereWhenItIsWhole) {
    std::ofstream(out()) << "what was there";
    auto all = exported({"-o", out()});
    EXPECT_EQ(all.code, done) << all.err;
    EXPECT_EQ(all.out, "");
    EXPECT_EQ(read(out()), exported({}).out);
    EXPECT_FALSE(std::filesystem::exists(out() + ".part"));
    auto nowhere = exported({"-o", dir_.path() + "/no/out"});
    EXPECT_EQ(nowhere.code, failed);
    EXPECT_NE(nowhere.err.find("/no/out: No such file or directory; is the directory there"),
              std::string::npos)
        << nowhere.err;
    auto full = exported({"-o", "/dev/full"});
    EXPECT_EQ(full.code, failed);
    EXPECT_NE(full.err.find("cannot write /dev/full; is the disk full?"), std::string::npos) << full.err;
}

TEST_F(Export, OfADamagedStoreLeavesWhatWasThereOrSkips) {
    std::ofstream(out()) << "what was there";
    // A flipped bit in the last event's text.
    auto bytes = read(db());
    auto at = bytes.find("dock-2");
    ASSERT_NE(at, std::string::npos);
    bytes[at + 5] = '3';
    std::ofstream(db(), std::ios::binary) << bytes;
    auto strict = exported({"-o", out()});
    EXPECT_EQ(strict.code, failed);
    EXPECT_NE(strict.err.find("is damaged: read point 2 is not as it was stored"), std::string::npos)
        << strict.err;
    EXPECT_EQ(read(out()), "what was there");
    EXPECT_FALSE(std::filesystem::exists(out() + ".part"));
    auto skipping = exported({"-o", out(), "--skip-damaged"});
    EXPECT_EQ(skipping.code, failed);
    EXPECT_NE(skipping.err.find("1 place of the store could not be read; all else was exported"),
              std::string::npos)
        << skipping.err;
    auto text = read(out());
    EXPECT_EQ(std::ranges::count(text, '\n'), 2500);
}

TEST_F(Export, NothingThatFitsIsAnEmptyFile) {
    EXPECT_EQ(exported({"--after", "5000", "--format", "csv"}).out, csv_header());
    auto ran = exported({"--reader", "dock-9", "-o", out()});
    EXPECT_EQ(ran.code, done);
    EXPECT_NE(ran.err.find("the store knows no reader \"dock-9\""), std::string::npos) << ran.err;
    EXPECT_TRUE(std::filesystem::exists(out()));
    EXPECT_EQ(read(out()), "");
}

}  // namespace
}  // namespace gantry::cli
