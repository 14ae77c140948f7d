#include "driver_support.hpp"

// Reading in every way, the set-up, and links that go wrong.
namespace gantry::harting::driver_test {
namespace {

// What a set-up in RAM has to say to a reader at its factory values.
constexpr std::string_view ram_note = "take effect only when they are in EEPROM";

bool only_the_ram_note(const Site& site) {
    return std::ranges::all_of(site.faults,
                               [](auto& fault) { return fault.text.find(ram_note) != std::string::npos; });
}

// --- every way of reading ----------------------------------------------------------------------------------

TEST(HartingPair, EveryWayOfReadingSeesTheTags) {
    struct Row {
        std::string_view says;
        Plan plan;
    };
    const std::string there = "127.0.0.1:4000";
    for (auto& row : std::vector<Row>{
             {"buffered read", {}},
             {"buffered read", {.driver = {{"com_address", "0"}, {"data_bank", "user"}}}},
             {"buffered read", {.device = "serial=true", .link = LinkKind::serial}},
             {"host commands", {.driver = {{"mode", "host"}, {"antennas", "1,2"}}}},
             {"host commands", {.device = "tx_buf=512", .driver = {{"mode", "host"}}}},
             {"notification", {.notify_at = there}},
             {"notification", {.driver = {{"acknowledge", "false"}}, .notify_at = there}},
             {"scan mode", {.device = "serial=true", .driver = {{"mode", "scan"}}, .link = LinkKind::serial}},
             {"scan mode",
              {.device = "serial=true config=CFG13.HEADER-USER=4040,CFG13.HEADER-USER-N=2,"
                         "CFG13.END-USER=0D0A,CFG13.END-USER-N=2",
              .driver = {{"mode", "scan"}, {"data_bank", "user"}},
              .link = LinkKind::serial}},
             {"buffered read",
              {.device = "config=CFG1.MODE=BufferedRead,CFG11.TR-DATA1=0x11", .driver = {{"mode", "keep"}}}},
             {"host commands", {.driver = {{"mode", "keep"}}}}})
        for (std::size_t piece : {std::size_t{0}, std::size_t{1}}) {
            SCOPED_TRACE(testing::Message() << row.says << " " << row.plan.device << " pieces of " << piece);
            Site site(row.plan);
            site.places(tag_1, 1);
            site.places(tag_2, 1);
            site.piece = piece;
            site.connect();
            site.run_for(8s);
            EXPECT_EQ(site.ids(), (std::set<std::string>{std::string(tag_1), std::string(tag_2)}));
            EXPECT_NE(site.described.detail.find("reads by " + std::string(row.says)), std::string::npos)
                << site.described.detail;
            EXPECT_TRUE(only_the_ram_note(site)) << site.faults_text();
            EXPECT_EQ(site.count(Count::malformed), 0u);
            EXPECT_EQ(site.count(Count::unknown_code), 0u);
            EXPECT_EQ(site.count(Count::resyncs), 0u);
            EXPECT_TRUE(site.reasons.empty());
            for (auto& [read, times] : site.reads())
                EXPECT_TRUE(times == 1 || read.second == 0) << read.first << " " << read.second;
            bool data = std::ranges::any_of(site.seen, [](auto& each) { return each.data_size == 4; });
            EXPECT_EQ(data, Settings::make(driver_settings, row.plan.driver)->text("data_bank") == "user");
        }
}

TEST(HartingPair, AnInventoryIsFetchedToItsEndAndOldReadersAreAskedInTheOldForm) {
    Site site({.device = "tx_buf=512", .driver = {{"mode", "host"}}});
    for (int i = 10; i < 60; ++i)
        site.places(fmt::format("300833B2DDD90140350500{}", i));
    site.listens();
    site.connect();
    site.run_for(1s);
    EXPECT_EQ(site.ids().size(), 50u);
    ASSERT_TRUE(site.device.inject("status 0x11", site.now));
    site.seen.clear();
    site.run_for(2s);
    EXPECT_EQ(site.ids().size(), 50u);
    EXPECT_TRUE(
        std::ranges::all_of(site.seen, [](auto& each) { return each.antenna == Observation::no_antenna; }) ||
        !site.seen.empty());
    EXPECT_TRUE(only_the_ram_note(site)) << site.faults_text();
}

TEST(HartingPair, ScanTextAroundAnswersIsNotLostAndNoiseIsNoTag) {
    Site site({.device = "serial=true", .driver = {{"mode", "scan"}}, .link = LinkKind::serial}, tag_1);
    site.run_for(2s);
    auto before = site.seen.size();
    // An answer with text of the next tags in one piece with it, and half a line before.
    std::string text = std::string(tag_2) + "\r";
    bool done = false;
    site.drop = [&](ByteView bytes, bool from_driver) {
        if (from_driver || done || bytes.front() != stx) return false;
        done = true;
        Bytes all = hex("3330303833334232444444393031343033353035303030330D");  // "3008...0003" with CR
        all.erase(all.begin());
        all.insert(all.begin(), '3');
        all.insert(all.end(), bytes.begin(), bytes.end());
        all.insert(all.end(), text.begin(), text.end());
        site.driver->received(all, site.now);
        return true;
    };
    EXPECT_EQ(site.runs(GetInputs{}).status, JobStatus::done);
    EXPECT_TRUE(done);
    EXPECT_TRUE(site.ids().contains(std::string(tag_2)));
    EXPECT_GT(site.seen.size(), before);
    site.drop = {};
    site.driver->received(hex("FFFE0D4142430D"), site.now);
    site.run_for(1s);
    EXPECT_TRUE(site.says("no tags by CFG13")) << site.faults_text();
    EXPECT_EQ(site.ids().size(), 3u);
    EXPECT_TRUE(site.reasons.empty());
}

// --- the set-up --------------------------------------------------------------------------------------------

TEST(HartingPair, TheSetUpWritesWhatDiffersAndSaysSo) {
    Site site({.driver = {{"antennas", "1,3"}, {"power_mw", "700"}, {"session", "2"}}}, tag_1);
    site.run_for(1s);
    auto& said = site.described.detail;
    for (auto* word : {"changed in its RAM", "CFG1.MODE from Host to BufferedRead", "CFG5.SESSION from",
                       "CFG15.ANTENNA-SELECTION from", "CFG3.RF-POWER-1 from", "reads by buffered read"})
        EXPECT_NE(said.find(word), std::string::npos) << word << " is not in: " << said;
    EXPECT_EQ(site.device.state().empty(), false);
    EXPECT_EQ(site.state_text("mode"), "BufferedRead");
    site.disconnect();
    site.listens();
    site.connect();
    site.run_for(1s);
    auto asked = site.asked();
    EXPECT_EQ(std::ranges::count(asked, "WriteConfiguration"), 0) << "all of it is there";
    EXPECT_EQ(site.described.detail.find("changed"), std::string::npos) << site.described.detail;
}

TEST(HartingPair, SettingsForGoodAreInEepromThoughRamHasThemAlready) {
    Plan plan{.driver = {{"session", "2"}}};
    Site first(plan, tag_1);
    first.run_for(1s);
    auto stored = [](Site& site, std::string_view name) {
        GetParameter job{std::string(name), true};
        return *wire::find(site.runs(job).values, name);
    };
    EXPECT_NE(stored(first, "CFG5.SESSION"), wire::Value(std::string("S2")));
    // The same reader, now for good: over a second driver.
    first.disconnect();
    plan.driver.emplace_back("permanent", "true");
    auto driver = plugin.make_driver(options_of(plan));
    driver->admitted({}, first.now);
    link::MemoryLink link(*driver, first.device, first.now);
    link.piece = 0;
    link.connect();
    link.run_for(500ms);
    std::string detail;
    for (auto& signal : driver->signals())
        if (auto* said = std::get_if<Described>(&signal)) detail = said->detail;
    EXPECT_NE(detail.find("changed in its EEPROM"), std::string::npos) << detail;
    link.cut();
    first.now = link.now();
    first.device.link_lost(first.now);
    ASSERT_TRUE(first.device.inject("restart", first.now));
    first.run_for(3s);
    first.connect();
    first.run_for(500ms);
    EXPECT_EQ(stored(first, "CFG5.SESSION"), wire::Value(std::string("S2")));
    EXPECT_EQ(stored(first, "CFG1.MODE"), wire::Value(std::string("BufferedRead")));
}

TEST(HartingPair, ItLogsInWhereItMustAndSaysWhatIsWrongWhereItCannot) {
    const std::string locked = "config=CFG0.PASSWORD=11223344,CFG0.LOCK-CFG1=1,CFG0.LOCK-CFG11=1";
    struct Row {
        Given driver;
        bool reads;
        std::string_view says;
    };
    for (auto& row : std::vector<Row>{{{{"password", "11223344"}}, true, ""},
                                      {{{"password", "11223345"}}, false, "the log-in failed"},
                                      {{}, false, "password_file"}}) {
        SCOPED_TRACE(row.says);
        Site site({.device = locked, .driver = row.driver}, tag_1);
        site.run_for(5s);
        EXPECT_EQ(!site.seen.empty(), row.reads);
        EXPECT_TRUE(row.says.empty() || site.says(row.says)) << site.faults_text();
        EXPECT_LT(site.faults.size(), 6u) << site.faults_text();
        // A restart logs out; on TCP the link breaks, and the next one begins anew.
        site.redials = true;
        ASSERT_TRUE(site.device.inject("restart", site.now));
        site.seen.clear();
        site.run_for(20s);
        EXPECT_EQ(!site.seen.empty(), row.reads);
    }
}

TEST(HartingPair, ABrokenBlockIsToldAndARestartHelps) {
    Site site({}, tag_1);
    ASSERT_TRUE(site.device.inject("eeprom CFG12", site.now));
    ASSERT_TRUE(site.device.inject("restart", site.now));
    site.redials = true;
    site.run_for(5s);
    EXPECT_TRUE(site.says("EE-Init")) << site.faults_text();
    auto told = site.faults.size();
    site.run_for(30s);
    EXPECT_LT(site.faults.size(), told + 3) << site.faults_text();
    EXPECT_TRUE(site.seen.empty() || site.state_text("mode") == "EE-Init");
    site.seen.clear();
    EXPECT_EQ(site.runs(RestartReader{}).status, JobStatus::done);
    site.run_for(10s);
    EXPECT_EQ(site.ids(), std::set<std::string>{std::string(tag_1)});
}

TEST(HartingPair, ARestartBehindASerialLineIsNoticedAndTheReaderSetUpAgain) {
    for (auto* mode : {"buffered", "host", "scan"}) {
        SCOPED_TRACE(mode);
        Site site({.device = "serial=true boot=500ms",
                   .driver = {{"mode", mode}, {"session", "1"}},
                   .link = LinkKind::serial},
                  tag_1);
        site.run_for(3s);
        ASSERT_TRUE(site.device.inject("restart", site.now));
        site.run_for(1s);
        site.seen.clear();
        site.run_for(1min);
        EXPECT_EQ(site.ids(), std::set<std::string>{std::string(tag_1)}) << site.faults_text();
        EXPECT_EQ(site.runs(GetParameter{"CFG5.SESSION"}).values.at(0).value, wire::Value(std::string("S1")));
    }
}

TEST(HartingPair, SingleCommandsLeaveTheReaderAsItIs) {
    Site site({.device = "config=CFG1.MODE=BufferedRead,CFG11.TR-DATA1=0x11"});
    site.places(tag_1);
    site.known.reading = false;
    site.listens();
    site.connect();
    site.run_for(3s);
    EXPECT_EQ(site.runs(GetInputs{}).status, JobStatus::done);
    EXPECT_EQ(std::ranges::count(site.asked(), "WriteConfiguration"), 0);
    EXPECT_EQ(site.runs(ReadTag{.access = access_to(tag_1)}).status, JobStatus::done);
    EXPECT_EQ(site.state_text("mode"), "BufferedRead") << "back before the job is told as done";
    EXPECT_TRUE(site.seen.empty());
    EXPECT_EQ(site.runs(StartReading{}).status, JobStatus::done);
    site.run_for(3s);
    EXPECT_FALSE(site.seen.empty());
}

TEST(HartingPair, TheClockIsSetToUtc) {
    Site site({.driver = {{"set_clock", "true"}}}, tag_1);
    site.run_for(1s);
    ASSERT_FALSE(site.seen.empty());
    auto wall = std::chrono::duration_cast<std::chrono::microseconds>(site.now.wall.time_since_epoch());
    EXPECT_LT(std::abs(site.seen.back().reader_time_us - wall.count()), 2'000'000);
}

// --- the buffer --------------------------------------------------------------------------------------------

TEST(HartingPair, TheBufferIsClearedOnlyWhenItsSetsAreOnDisk) {
    Site site({.driver = {{"valid_time", "100ms"}}}, tag_1);
    site.commits = false;
    site.run_for(20s);
    ASSERT_EQ(site.seen.size() > 0, true);
    EXPECT_EQ(site.state("sets_cleared"), 0);
    auto held = site.seen.size();
    EXPECT_GT(site.state("buffered"), static_cast<std::int64_t>(held)) << "the reader keeps the rest";
    EXPECT_EQ(site.runs(GetInputs{}).status, JobStatus::done) << "commands go on";
    site.commits = true;
    site.commit();
    EXPECT_EQ(site.state("sets_cleared"), static_cast<std::int64_t>(held));
    site.run_for(2s);
    for (auto& [read, times] : site.reads())
        EXPECT_EQ(times, 1) << read.first;
    EXPECT_LE(site.state("sets_stored") - static_cast<std::int64_t>(site.seen.size()), 2);
}

// However the link or the gateway dies between reading and clearing, each read comes once; where equal reads
// cannot be told apart, none is lost and those in doubt are marked.
TEST(HartingPair, SetsThatComeAgainAfterACrashAreKnown) {
    enum class Death { before_commit, after_commit, clear_lost, link_before_commit };
    for (auto death :
         {Death::before_commit, Death::after_commit, Death::clear_lost, Death::link_before_commit})
        for (bool timed : {true, false}) {
            SCOPED_TRACE(testing::Message() << static_cast<int>(death) << (timed ? " timed" : ""));
            Site site(timed ? Plan{.driver = {{"valid_time", "500ms"}}}
                            : Plan{.device = "config=CFG1.MODE=BufferedRead,CFG11.TR-DATA1=0x11,"
                                             "CFG12.TRANSPONDER-VALID-TIME=5",
                                   .driver = {{"mode", "keep"}}},
                      tag_1);
            site.run_for(5s);
            site.commits = false;
            site.run_for(3s);
            if (death == Death::clear_lost)
                site.drop = [](ByteView bytes, bool from_driver) {
                    return !from_driver && bytes.size() > 5 && bytes[4] == 0x32;
                };
            auto open = site.reports.size();
            if (death == Death::after_commit)
                site.drop = [](ByteView, bool from_driver) { return from_driver; };
            if (death == Death::after_commit || death == Death::clear_lost) site.commit();
            if (death == Death::before_commit || death == Death::link_before_commit) {
                // What was not stored is gone with the process.
                while (!site.reports.empty() && !site.reports.back().observations.empty() &&
                       site.reports.size() == open) {
                    auto gone = site.reports.back().observations.size();
                    site.seen.resize(site.seen.size() - gone);
                    site.reports.pop_back();
                }
            }
            auto known = site.seen.size();
            site.kill();
            site.run_for(2s);
            site.commits = true;
            site.drop = {};
            auto before = site.reports.size();
            site.connect();
            site.run_for(3s);
            site.removes(tag_1);
            site.run_for(2s);
            auto stored = static_cast<std::size_t>(site.state("sets_stored"));
            EXPECT_EQ(site.state("buffered"), 0);
            if (timed) {
                EXPECT_EQ(site.seen.size(), stored);
                for (auto& [read, times] : site.reads())
                    EXPECT_EQ(times, 1) << read.first << " " << read.second;
            } else {
                EXPECT_GE(site.seen.size(), stored) << "nothing is lost";
                bool doubt = false;
                for (auto i = before; i < site.reports.size(); ++i)
                    doubt = doubt || site.reports[i].possible_repeat;
                EXPECT_TRUE(doubt);
            }
            EXPECT_GT(site.seen.size(), known);
        }
}

TEST(HartingPair, WhatIsOnItsWayToTheDiskIsNotClearedByASecondLook) {
    // The sets come again over the same link before they are stored: after a set-up that was due again, and
    // after somebody's own Read Buffer.
    for (bool by_job : {true, false}) {
        Site site({.driver = {{"valid_time", "200ms"}}}, tag_1);
        site.run_for(12s);
        site.commits = false;
        site.run_for(1s);
        auto cleared = site.state("sets_cleared");
        if (by_job) {
            auto result = site.runs(command("ReadBuffer", "00FF"));
            EXPECT_EQ(result.status, JobStatus::done) << result.text;
        } else {
            site.does("status 0x13");  // the next answer wants a log-in
        }
        site.run_for(15s);
        EXPECT_EQ(site.state("sets_cleared"), cleared);
        site.commits = true;
        site.commit();
        site.run_for(3s);
        site.removes(tag_1);
        site.run_for(2s);
        EXPECT_EQ(static_cast<std::int64_t>(site.seen.size()), site.state("sets_stored"));
        for (auto& [read, times] : site.reads())
            EXPECT_EQ(times, 1);
    }
}

TEST(HartingPair, OverflowAndFlagsAreToldOnce) {
    Site site({.device = "buffer=20", .driver = {{"valid_time", "100ms"}}}, tag_1);
    site.places(tag_2, 2);
    site.run_for(1s);
    site.commits = false;
    site.run_for(20s);
    site.commits = true;
    site.commit();
    site.run_for(20s);
    EXPECT_EQ(site.overflows, 1u);
    site.does("antenna 1=bad");
    site.run_for(40s);
    auto text = site.faults_text();
    auto first = text.find("antenna 1 is missing or broken");
    ASSERT_NE(first, std::string::npos) << text;
    EXPECT_EQ(text.find("antenna 1 is missing or broken", first + 1), std::string::npos) << text;
    site.does("antenna 1=good");
    site.run_for(20s);
    site.does("antenna 1=bad");
    site.run_for(20s);
    EXPECT_NE(site.faults_text().find("antenna 1 is missing or broken", first + 1), std::string::npos)
        << "it was well in between";
}

TEST(HartingPair, InputEventsComeOutOfTheBuffer) {
    Site site({.driver = {{"input_events", "on"}}});
    site.connect();
    site.run_for(1s);
    site.does("input 1=1");
    site.run_for(1s);
    site.does("input 1=0");
    site.run_for(1s);
    ASSERT_EQ(site.inputs.size(), 2u);
    EXPECT_EQ(site.inputs[0].input, 1);
    EXPECT_TRUE(site.inputs[0].state);
    EXPECT_FALSE(site.inputs[1].state);
    EXPECT_TRUE(site.seen.empty());
}

// --- what goes wrong on the link ---------------------------------------------------------------------------

TEST(HartingPair, ALateAnswerIsNeverTakenForAnothers) {
    Site site({.driver = {{"mode", "host"}, {"poll", "1h"}}}, tag_1);
    site.run_for(1s);
    // The answer comes after it was given up; the next command of the same kind must not get it.
    site.does("slow 3500ms");
    auto one = site.begins(GetInputs{});
    site.run_for(10ms);
    site.does("slow off");
    site.run_for(3100ms);
    site.does("input 1=1");
    auto two = site.begins(GetInputs{});
    site.run_for(5s);
    std::map<JobId, JobResult> results;
    for (auto& each : site.ended)
        results[each.job] = each.result;
    EXPECT_EQ(results.at(one).status, JobStatus::timed_out);
    ASSERT_EQ(results.at(two).status, JobStatus::done);
    auto& inputs = *wire::find(results.at(two).values, "inputs")->get<wire::Value::List>();
    EXPECT_EQ(*wire::find(*inputs.at(0).get<wire::Fields>(), "state"), wire::Value(true));
    EXPECT_EQ(site.count(Count::timeouts), 1u);
}

TEST(HartingPair, AnAnswerThatComesInSlowlyIsWaitedFor) {
    Site site(
        {.device = "serial=true", .driver = {{"mode", "host"}, {"poll", "1h"}}, .link = LinkKind::serial},
        tag_1);
    site.run_for(1s);
    Bytes held;
    site.drop = [&](ByteView bytes, bool from_driver) {
        if (from_driver) return false;
        held.assign(bytes.begin(), bytes.end());
        return true;
    };
    auto job = site.begins(GetParameter{"CFG12.RAW"});
    site.run_for(2500ms);
    site.drop = {};
    for (auto byte : held) {  // 2.5 s of silence and 22 bytes in 1.1 s
        site.driver->received(Bytes{byte}, site.now);
        site.run_for(50ms);
    }
    site.commit();
    ASSERT_FALSE(site.ended.empty());
    EXPECT_EQ(site.ended.back().job, job);
    EXPECT_EQ(site.ended.back().result.status, JobStatus::done) << site.ended.back().result.text;
}

TEST(HartingPair, FaultsOfTheReaderAndTheLineDoNotStopTheReading) {
    for (auto* fault : {"bad_crc", "truncate", "garbage 200", "duplicate", "status 0x83", "status 0x0F",
                        "status 0x82", "status 0x80", "status 0x92", "status 0xF1", "slow 4s", "drop",
                        "half_open on", "silent on", "busy on"})
        for (bool serial : {false, true}) {
            SCOPED_TRACE(testing::Message() << fault << (serial ? " serial" : ""));
            Site site(
                {.device = serial ? "serial=true" : "", .link = serial ? LinkKind::serial : LinkKind::dial},
                tag_1);
            site.redials = true;
            site.run_for(3s);
            site.does(fault);
            site.run_for(15s);
            for (auto* over : {"slow off", "half_open off", "silent off", "busy off"})
                site.does(over);
            site.run_for(15s);
            site.seen.clear();
            site.run_for(15s);
            EXPECT_EQ(site.ids(), std::set<std::string>{std::string(tag_1)});
            EXPECT_LT(site.faults.size(), 12u) << site.faults_text();
        }
}

TEST(HartingPair, ASilentReaderIsLeftAndAStrangerIsCalledOne) {
    Site site({}, tag_1);
    site.run_for(1s);
    site.does("silent on");
    site.run_for(1min);
    ASSERT_EQ(site.reasons.size(), 1u);
    EXPECT_NE(site.reasons[0].find("without an answer"), std::string::npos) << site.reasons[0];
    for (bool hangs_up : {false, true}) {
        auto driver = plugin.make_driver(options_of({}));
        driver->admitted({}, site.now);
        driver->start(site.now);
        auto now = site.now;
        driver->received(as_bytes("SSH-2.0-OpenSSH_9.2p1\r\n"), now);
        if (hangs_up) driver->link_lost(now);
        for (int i = 0; i < 20 && !driver->finished(); ++i) {
            now = now + 1s;
            driver->time_passed(now);
        }
        EXPECT_TRUE(driver->finished());
        EXPECT_NE(driver->finish_reason().find("no HARTING reader: the connection began with \"SSH-2.0"),
                  std::string_view::npos)
            << driver->finish_reason();
    }
}

}  // namespace
}  // namespace gantry::harting::driver_test
