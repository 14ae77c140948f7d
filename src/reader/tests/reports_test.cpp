#include "reader/reports.hpp"

#include <gtest/gtest.h>

namespace gantry {
namespace {

constexpr Now start{Steady{} + std::chrono::hours{1}, Wall{} + std::chrono::years{56}};

TEST(Reports, OnlyWhatHasSomethingInItBecomesAReport) {
    std::vector<Report> out;
    Reports reports(out);
    reports.flush();
    reports.open(start);
    reports.flush();
    EXPECT_TRUE(out.empty());
    EXPECT_TRUE(reports.all_committed());
    reports.notice(InputNotice{.input = 1, .state = true}, start);
    reports.open_for_tags(start + 1s).observations.emplace_back();  // tags stand before notices
    reports.notice(InputNotice{.input = 2, .state = true}, start + 1s);
    reports.flush();
    reports.open(start + 2s).mark = Bytes{1};
    reports.flush();
    ASSERT_EQ(out.size(), 3u);
    for (std::size_t i = 0; i < out.size(); ++i)
        EXPECT_EQ(out[i].ticket, i + 1);
    EXPECT_EQ(out[0].notices.size() + out[1].notices.size(), 2u);
    EXPECT_EQ(out[1].observations.size(), 1u);
    EXPECT_EQ(out[1].received.steady, (start + 1s).steady);
    EXPECT_TRUE(out[2].mark);
    EXPECT_EQ(reports.last_issued(), 3u);
}

TEST(Reports, OpenTicketsFillItAndCommitsEmptyIt) {
    std::vector<Report> out;
    Reports reports(out);
    for (std::size_t i = 0; i < Reports::max_open; ++i) {
        EXPECT_FALSE(reports.full());
        reports.notice(FaultNotice{}, start);
        reports.flush();
    }
    EXPECT_TRUE(reports.full());
    reports.committed(1);
    EXPECT_FALSE(reports.full());
    reports.committed(0);  // never back
    EXPECT_EQ(reports.last_committed(), 1u);
    reports.committed(1000);  // nor beyond what was issued
    EXPECT_EQ(reports.last_committed(), Reports::max_open);
    EXPECT_TRUE(reports.all_committed());
}

TEST(OncePerMinute, ATextPassesOnceAMinuteAndSaysHowOftenItWasHeldBack) {
    OncePerMinute told;
    EXPECT_EQ(told.pass("broken", start), "broken");
    for (int i = 1; i <= 5; ++i)
        EXPECT_EQ(told.pass("broken", start + i * 10s), std::nullopt);
    EXPECT_EQ(told.pass("other", start + 10s), "other");
    EXPECT_EQ(told.pass("broken", start + 61s), "broken (5 more since the last of these)");
    EXPECT_EQ(told.pass("broken", start + 125s), "broken");
    std::size_t passed = 0;
    for (int i = 0; i < 1000; ++i)
        if (told.pass(std::to_string(i), start + 200s)) ++passed;
    EXPECT_LE(passed, OncePerMinute::most_texts) << "invented texts do not fill the memory";
    EXPECT_TRUE(told.pass("later", start + 300s));
}

TEST(Reports, TimesOfAClockThatWasNeverSetAreNotPassedOn) {
    std::array<Observation, 3> all{};
    all[0].reader_time_us = 1'000'000;
    all[1].reader_time_us = 946'684'800'000'000;
    all[2].reader_time_us = -5;
    drop_implausible_times(all);
    EXPECT_EQ(all[0].reader_time_us, 0);
    EXPECT_EQ(all[1].reader_time_us, 946'684'800'000'000);
    EXPECT_EQ(all[2].reader_time_us, 0);
}

}  // namespace
}  // namespace gantry
