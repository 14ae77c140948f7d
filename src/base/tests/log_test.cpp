#include "base/log.hpp"

#include <gtest/gtest.h>

#include "base/error.hpp"
#include "base/text.hpp"

namespace gantry {

TEST(Log, ACaptureSeesEachLineWithItsLevelAndModule) {
    log::start(log::Level::info, log::Format::human);
    log::Capture capture;
    log::info("link", "listening on {}", 9055);
    log::warn("link", "slow");
    log::error("store", "disk full");
    EXPECT_EQ(capture.take(), "info link listening on 9055\nwarn link slow\nerror store disk full\n");
    EXPECT_EQ(capture.take(), "") << "taken is taken";
}

TEST(Log, LinesBelowTheLevelAreNotWritten) {
    log::start(log::Level::warn, log::Format::human);
    log::Capture capture;
    log::debug("x", "no");
    log::info("x", "no");
    log::warn("x", "yes");
    EXPECT_EQ(capture.take(), "warn x yes\n");
    EXPECT_FALSE(log::enabled(log::Level::info));
    EXPECT_TRUE(log::enabled(log::Level::error));
    log::start(log::Level::off, log::Format::human);
    log::error("x", "no");
    EXPECT_EQ(capture.take(), "");
    log::start(log::Level::info, log::Format::human);
}

TEST(Log, AsJsonEachLineIsOneObjectWhateverTheMessageHolds) {
    log::start(log::Level::info, log::Format::json);
    testing::internal::CaptureStderr();
    log::info("link", "reader \"{}\"", printable("a\nb"));
    auto out = testing::internal::GetCapturedStderr();
    log::start(log::Level::info, log::Format::human);
    EXPECT_EQ(out.substr(0, 10), "{\"time\":\"2");
    auto rest = out.substr(out.find("\"level\""));
    EXPECT_EQ(rest, "\"level\":\"info\",\"module\":\"link\",\"message\":\"reader \\\"a\\\\x0Ab\\\"\"}\n");
}

TEST(Log, ForPeopleALineNamesLevelModuleAndMessage) {
    log::start(log::Level::info, log::Format::human);
    testing::internal::CaptureStderr();
    log::warn("link", "slow");
    auto out = testing::internal::GetCapturedStderr();
    EXPECT_NE(out.find("link: slow\n"), std::string::npos) << out;
    EXPECT_NE(out.find("warn"), std::string::npos) << out;
}

TEST(Error, TheHintFollowsWhatHappened) {
    EXPECT_EQ((Error{"port 9055 is in use", "give another with --listen"}.text()),
              "port 9055 is in use; give another with --listen");
    EXPECT_EQ((Error{"no route"}.text()), "no route");
    Result<int> result = fail("broken", "mend it");
    ASSERT_FALSE(result);
    EXPECT_EQ(result.error(), (Error{"broken", "mend it"}));
}

}  // namespace gantry
