#include <algorithm>
#include <stdexcept>

#include <gtest/gtest.h>

#include "reader/plugin.hpp"

namespace gantry {

using Kind = SettingRow::Kind;
static constexpr std::string_view modes[] = {"auto", "fast", "quiet"};
static constexpr std::string_view switches[] = {"", "on", "off"};
static constexpr SettingRow rows[] = {
    {.name = "mode", .kind = Kind::choice, .fallback = "auto", .help = "how it reads", .choices = modes},
    {.name = "power_mw", .kind = Kind::number, .fallback = "500", .help = "power", .min = 1, .max = 2000},
    {.name = "session", .kind = Kind::number, .fallback = "-1.5", .help = "any number"},
    {.name = "crc", .kind = Kind::boolean, .fallback = "false", .help = "frames carry a CRC"},
    {.name = "timeout", .kind = Kind::duration, .fallback = "2s", .help = "wait", .min = 0.1, .max = 60},
    {.name = "label", .kind = Kind::text, .fallback = "", .help = "free text"},
    {.name = "serial", .kind = Kind::text, .fallback = "", .help = "a short text", .max = 4},
    {.name = "mask", .kind = Kind::hex, .fallback = "", .help = "bytes"},
    {.name = "lbt", .kind = Kind::choice, .fallback = "", .help = "a switch", .choices = switches},
};
using Given = std::vector<std::pair<std::string, std::string>>;

static std::string refusal(const std::string& name, const std::string& value) {
    auto settings = Settings::make(rows, Given{{name, value}});
    return settings ? "accepted" : settings.error().text();
}

TEST(Settings, ATextMayHaveAMostLength) {
    EXPECT_EQ(refusal("serial", "1234"), "accepted");
    EXPECT_EQ(refusal("serial", "12345"), "serial = \"12345\" has 5 characters, at most 4 are allowed");
    EXPECT_EQ(refusal("label", std::string(500, 'x')), "accepted");
}

TEST(Settings, HexIsWholeBytes) {
    EXPECT_EQ(refusal("mask", "30 34"), "accepted");
    EXPECT_EQ(refusal("mask", ""), "accepted");
    for (std::string value : {"zz", "303"})
        EXPECT_EQ(refusal("mask", value),
                  "mask = \"" + value + "\" is not hex; write whole bytes, two digits each, like \"3034\"");
}

TEST(Settings, ChoicesAreListedWithoutTheEmptyOne) {
    EXPECT_EQ(refusal("lbt", ""), "accepted");
    EXPECT_EQ(refusal("lbt", "yes"), "lbt = \"yes\" is none of: on, off");
}

TEST(Settings, WhatTheUserLeftOutHasItsFallback) {
    auto settings = Settings::make(rows, {});
    ASSERT_TRUE(settings);
    EXPECT_EQ(settings->text("mode"), "auto");
    EXPECT_EQ(settings->number("power_mw"), 500);
    EXPECT_EQ(settings->number("session"), -1.5);
    EXPECT_FALSE(settings->boolean("crc"));
    EXPECT_EQ(settings->duration("timeout"), 2s);
    EXPECT_EQ(settings->text("label"), "");
}

TEST(Settings, WhatTheUserGaveTakesItsPlace) {
    Given given = {
        {"mode", "quiet"}, {"power_mw", "2000"}, {"crc", "true"}, {"timeout", "1min"}, {"label", "any \x01"}};
    auto settings = Settings::make(rows, given);
    ASSERT_TRUE(settings) << settings.error().text();
    EXPECT_EQ(settings->text("mode"), "quiet");
    EXPECT_EQ(settings->number("power_mw"), 2000);
    EXPECT_TRUE(settings->boolean("crc"));
    EXPECT_EQ(settings->duration("timeout"), 60s);
    EXPECT_EQ(settings->text("label"), "any \x01");
}

TEST(Settings, AnUnknownNameIsRefusedWithASuggestion) {
    EXPECT_EQ(refusal("powr_mw", "5"), "there is no setting \"powr_mw\"; did you mean \"power_mw\"?");
    EXPECT_EQ(
        refusal("frequency", "5"),
        "there is no setting \"frequency\"; settings: mode, power_mw, session, crc, timeout, label, serial, "
        "mask, lbt");
    EXPECT_TRUE(refusal("\x1B[2J", "5").starts_with("there is no setting \"\\x1B[2J\"; "));
}

TEST(Settings, AValueOfTheWrongKindIsRefused) {
    EXPECT_EQ(refusal("mode", "loud"), "mode = \"loud\" is none of: auto, fast, quiet");
    EXPECT_EQ(refusal("power_mw", "much"), "power_mw = \"much\" is no number");
    EXPECT_EQ(refusal("power_mw", ""), "power_mw = \"\" is no number");
    EXPECT_EQ(refusal("power_mw", "5 mW"), "power_mw = \"5 mW\" is no number");
    EXPECT_EQ(refusal("crc", "yes"), "crc = \"yes\" is neither true nor false");
    EXPECT_EQ(refusal("timeout", "2"),
              "timeout = \"2\" is no duration; write it like \"500ms\", \"2s\" or \"1h\"");
}

TEST(Settings, AValueOutsideItsRangeIsRefused) {
    EXPECT_EQ(refusal("power_mw", "0"), "power_mw = 0 is outside 1 to 2000");
    EXPECT_EQ(refusal("power_mw", "2000.5"), "power_mw = 2000.5 is outside 1 to 2000");
    EXPECT_EQ(refusal("timeout", "50ms"), "timeout = 50ms is outside 0.1 to 60");
    EXPECT_EQ(refusal("session", "1e300"), "accepted") << "a row without a range takes any number";
}

TEST(Settings, AskingForANameThatIsNoRowIsASlipOfOurOwn) {
    auto settings = Settings::make(rows, {});
    ASSERT_TRUE(settings);
    EXPECT_THROW(static_cast<void>(settings->text("powr_mw")), std::logic_error);
}

TEST(JobResult, EveryStatusHasItsWord) {
    using Status = JobResult::Status;
    EXPECT_EQ(to_text(Status::done), "done");
    EXPECT_EQ(to_text(Status::failed), "failed");
    EXPECT_EQ(to_text(Status::unsupported), "unsupported");
    EXPECT_EQ(to_text(Status::timed_out), "timed_out");
    EXPECT_EQ(to_text(Status::cancelled), "cancelled");
    EXPECT_EQ(to_text(Status::unknown), "unknown");
}

TEST(Counters, EveryCounterHasItsOwnName) {
    std::vector<std::string_view> names;
    for (std::size_t i = 0; i < count_size; ++i) {
        auto name = to_text(static_cast<Count>(i));
        EXPECT_EQ(std::ranges::count(names, name), 0) << name;
        names.push_back(name);
    }
}

// Output of a party: the pump takes it in pieces of its own size.
class Talker : public Party {
public:
    void start(Now) override {}
    void received(ByteView bytes, Now) override { out().insert(out().end(), bytes.begin(), bytes.end()); }
    void time_passed(Now) override {}
    std::optional<Steady> deadline() const override { return {}; }
    bool finished() const override { return false; }
    void forget() { drop_output(); }
};

TEST(Party, OutputIsTakenInPiecesAndGoesOnAtTheirEnd) {
    Talker talker;
    talker.received(as_bytes("hello"), {});
    EXPECT_EQ(as_text(talker.output()), "hello");
    talker.output_sent(2);
    EXPECT_EQ(as_text(talker.output()), "llo");
    talker.received(as_bytes("!"), {});
    EXPECT_EQ(as_text(talker.output()), "llo!");
    talker.output_sent(4);
    EXPECT_TRUE(talker.output().empty());
    talker.received(as_bytes("again"), {});
    talker.output_sent(1);
    talker.forget();
    EXPECT_TRUE(talker.output().empty());
    talker.received(as_bytes("x"), {});
    EXPECT_EQ(as_text(talker.output()), "x") << "nothing of what was dropped is left over";
}

}  // namespace gantry
