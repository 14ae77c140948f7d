#include "driver_support.hpp"

// Jobs: all kinds, and every command of the table.
namespace gantry::harting::driver_test {
namespace {

using Status = JobStatus;

const wire::Value* value_of(const JobResult& result, std::string_view name) {
    return wire::find(result.values, name);
}

// --- every command -----------------------------------------------------------------------------------------

struct Case {
    std::string_view name, well, ill;  // data; ill: none, where every input is well
    std::string_view field = {};       // of the answer
    std::string_view ill_text = {};
    Status well_status = Status::done;
};
constexpr std::string_view buffer_mode = "config=CFG1.MODE=BufferedRead,CFG11.TR-DATA1=0x11";
const std::string epc = "310C" + std::string(tag_1);  // addressed, bank and address follow
const std::string key = "00112233445566778899AABBCCDDEEFF";

const std::vector<Case>& cases() {
    static const std::string read = epc + "03000002", read_ill = epc + "03FFF002",
                             write = epc + "0300000102CAFE", write_ill = epc + "03FFF00102CAFE",
                             kill = "110C" + std::string(tag_1) + "0400000001",
                             kill_ill = "110C" + std::string(tag_1) + "0400000000",
                             lock = "110C" + std::string(tag_1) + "8403080200" + "0400000000",
                             lock_ill = "110C" + std::string(tag_1) + "8403080200" + "0411111111",
                             permalock = epc + "0300000180 00", permalock_ill = epc + "0200000180 00",
                             status = epc + "03000001", status_ill = epc + "03FFFF01", aes = "01000010" + key,
                             auth = "010010" + key, auth_ill = "010310" + key;
    static const std::vector<Case> all{
        {"ReadBuffer", "00FF", "0000", "DATA-SETS", "outside its range"},
        {"ReadDataBufferInfo", "", "", "TAB-LENGTH"},
        {"ClearDataBuffer", "", ""},
        {"InitializeBuffer", "", ""},
        {"ForceNotifyTrigger", "00", "", "", "not available", Status::failed},
        {"BaudRateDetection", "", ""},
        {"RfControllerReset", "", ""},
        {"SystemReset", "00", "01", "", "outside its range"},
        {"GetReaderInfo", "00", "77", "SW-TYPE", "outside its range"},
        {"RfReset", "", ""},
        {"RfOutput", "01", "15", "", "outside its range"},
        {"ReaderDiagnostic", "01", "02", "FLAGS-A", "outside its range"},
        {"SetOutput", "010101010005", "0102810300058203000A", "", "outside its range"},
        {"GetInput", "", "", "INPUTS"},
        {"ReadConfiguration", "0C", "06", "CFG-DATA", "must not be read"},
        {"WriteConfiguration", "3F0102030405060708090A0B0C0D0E", "060000000000000000000000000000", "",
         "must not be written"},
        {"ResetConfiguration", "3F", "06", "", "must not be written"},
        {"SetSystemTimer", "0C1E2710", "0C1EEA60", "", ""},
        {"GetSystemTimer", "", "", "HOUR"},
        {"SetSystemTimeAndDate", "141A0B1E000C1E2710", "14190D010000000000", "", ""},
        {"GetSystemTimeAndDate", "", "", "CENTURY"},
        {"LockRegion", "00", "", "", "not available", Status::failed},
        {"ReaderLogin", "00000000", "11223344", "", "wrong password"},
        {"WriteAesReaderKeys", aes, "01000002AABB", "", "outside its range"},
        {"WriteReaderAuthenticationKey", auth, auth_ill, "", "outside its range"},
        {"Inventory", "00", "1010", "DATA-SETS", "outside its range"},
        {"ReadMultipleBlocks", read, read_ill, "DB-N", "no such place"},
        {"WriteMultipleBlocks", write, write_ill, "", "no such place"},
        {"Kill", kill, kill_ill, "", "authentication failed"},
        {"Lock", lock, lock_ill, "", "authentication failed"},
        {"BlockPermalock", permalock, permalock_ill, "", ""},
        {"ReadPermalockStatus", status, status_ill, "", "no such place"},
        {"Untraceable", "00", "", "", "not available", Status::failed},
        {"Authenticate", "00", "", "", "not available", Status::failed},
    };
    return all;
}

TEST(HartingJobs, EveryCommandOfTheTableGoesThroughWellAndIll) {
    for (auto& row : commands()) {
        SCOPED_TRACE(row.name);
        auto found = std::ranges::find(cases(), row.name, &Case::name);
        if (found == cases().end()) {
            EXPECT_FALSE(row.of_manual) << "it has no case";
            continue;
        }
        Plan plan{.driver = {{"mode", "host"}, {"poll", "1h"}}};
        if (row.when == When::buffer_mode)
            plan = {.device = std::string(buffer_mode), .driver = {{"mode", "keep"}, {"poll", "1h"}}};
        Site site(plan);
        site.places(tag_1, 1, -50, [](auto& tag) { tag.kill_password = 1; });
        site.redials = true;
        site.connect();
        site.run_for(100ms);
        if (row.when == When::buffer_mode) site.run_for(1s);
        // Whatever the reader refuses it for, its word comes through.
        site.does("status 0x0F");
        auto busy = site.runs(command(row.name, found->well));
        EXPECT_EQ(busy.status, Status::failed);
        EXPECT_NE(busy.text.find("busy"), std::string::npos) << busy.text;
        if (found->ill != "") {
            auto ill = site.runs(command(row.name, found->ill));
            EXPECT_EQ(ill.status, Status::failed) << ill.text;
            EXPECT_NE(ill.text.find(found->ill_text), std::string::npos) << ill.text;
            site.run_for(100ms);
        }
        if (row.name == "ClearDataBuffer") site.runs(command("ReadBuffer", "0001"));
        auto well = site.runs(command(row.name, found->well));
        EXPECT_EQ(well.status, found->well_status) << well.text;
        EXPECT_TRUE(well.status == Status::done || well.text.find(found->ill_text) != std::string::npos)
            << well.text;
        EXPECT_TRUE(found->field.empty() || value_of(well, found->field) != nullptr);
    }
}

TEST(HartingJobs, CommandsOnTagsInterruptTheReadingAndItGoesOn) {
    for (auto* mode : {"buffered", "host"}) {
        Site site({.driver = {{"mode", mode}, {"valid_time", "300ms"}}}, tag_1);
        site.run_for(3s);
        auto result = site.runs(command("Inventory", "00"));
        EXPECT_EQ(result.status, Status::done) << result.text;
        EXPECT_EQ(site.state_text("mode"), std::string_view(mode) == "host" ? "Host" : "BufferedRead");
        site.seen.clear();
        site.run_for(3s);
        EXPECT_GT(site.seen.size(), 3u);
        EXPECT_EQ(site.state("sets_lost_at_reset") + site.state("sets_initialized"), 0);
    }
    // Old and wrong messages never reach the reader.
    Site site({.driver = {{"mode", "host"}}}, tag_1);
    site.listens();
    for (auto* name : {"GetReaderInfo", "SetOutput"}) {
        auto wrong = command("GetInput");
        wrong.command.name = name;
        wrong.command.fields.push_back({"NO-SUCH", wire::Value(1)});
        site.asked();
        auto result = site.runs(wrong);
        EXPECT_EQ(result.status, Status::failed);
        EXPECT_EQ(std::ranges::count(site.asked(), name), 0);
    }
}

// --- jobs of every make ------------------------------------------------------------------------------------

TEST(HartingJobs, InputsOutputsAndTheRelay) {
    Site site({}, tag_1);
    site.run_for(1s);
    site.does("input 2=1");
    auto result = site.runs(GetInputs{});
    ASSERT_EQ(result.status, Status::done) << result.text;
    auto& inputs = *value_of(result, "inputs")->get<wire::Value::List>();
    ASSERT_EQ(inputs.size(), 2u);
    EXPECT_EQ(*wire::find(*inputs[1].get<wire::Fields>(), "state"), wire::Value(true));
    EXPECT_EQ(
        site.runs(SetOutputs{{{.output = 1, .state = true, .for_ms = 450}, {.output = 3, .state = true}}})
            .status,
        Status::done);
    EXPECT_EQ(site.state_text("outputs"), "on off on");
    site.run_for(1s);
    EXPECT_EQ(site.state_text("outputs"), "off off on") << "output 3 is the relay";
    EXPECT_EQ(site.runs(SetOutputs{{{.output = 3, .state = false}}}).status, Status::done);
    EXPECT_EQ(site.state_text("outputs"), "off off off");
    struct Row {
        SetOutputs job;
        bool again;
        Status status;
        std::string_view text;
    };
    for (auto& row :
         std::vector<Row>{{{}, false, Status::failed, "no output is named"},
                          {{{{.output = 4}}}, false, Status::unsupported, "2 outputs and 1"},
                          {{{{.output = 0}}}, false, Status::unsupported, "no output 0"},
                          {{{{.output = 1}, {.output = 1}}}, false, Status::failed, "twice"},
                          {{{{.output = 1, .for_ms = 7'000'000}}}, false, Status::failed, "longest"},
                          {{{{.output = 1, .for_ms = 100}}}, true, Status::unknown, "timed"},
                          {{{{.output = 1, .state = true}}}, true, Status::done, ""}}) {
        auto refused = site.runs(row.job, row.again);
        EXPECT_EQ(refused.status, row.status) << row.text;
        EXPECT_NE(refused.text.find(row.text), std::string::npos) << refused.text;
    }
}

TEST(HartingJobs, ReadingStopsAndStartsAndARestartIsSurvived) {
    for (auto* mode : {"buffered", "host"}) {
        Site site({.driver = {{"mode", mode}, {"valid_time", "100ms"}}}, tag_1);
        site.redials = true;
        site.run_for(1s);
        EXPECT_EQ(site.runs(StopReading{}).status, Status::done);
        EXPECT_EQ(site.state_text("mode"), "Host");
        site.run_for(1s);
        site.seen.clear();
        site.run_for(5s);
        EXPECT_TRUE(site.seen.empty());
        EXPECT_EQ(site.runs(StartReading{}).status, Status::done);
        site.run_for(2s);
        EXPECT_FALSE(site.seen.empty());
        EXPECT_EQ(site.runs(RestartReader{}).status, Status::done);
        site.run_for(10ms);
        EXPECT_EQ(site.state("restarts"), 1);
        site.run_for(5s);
        site.seen.clear();
        site.run_for(2s);
        EXPECT_FALSE(site.seen.empty());
        EXPECT_EQ(site.runs(RestartReader{}, true).status, Status::done);
        EXPECT_EQ(site.state("restarts"), 1) << "the link broke over the first try: that was it";
    }
}

TEST(HartingJobs, TagsAreReadWrittenProgrammedLockedAndKilled) {
    for (auto* device : {"", "config=CFG4.IDENTIFIER=2", "config=CFG1.MODE=BufferedRead"})
        for (auto* mode : {"buffered", "host"}) {
            SCOPED_TRACE(testing::Message() << device << " " << mode);
            Site site({.device = device, .driver = {{"mode", mode}}});
            site.places(tag_1, 1, -50, [](auto& tag) { tag.kill_password = 0x01020304; });
            site.places(tag_2);
            site.connect();
            site.run_for(1s);
            auto to = access_to(tag_1);
            to.antenna = 1;
            ReadTag read{.access = to, .bank = Bank::user, .offset = 1, .length = 2};
            auto result = site.runs(read);
            EXPECT_EQ(result.status, Status::done) << result.text;
            EXPECT_EQ(*value_of(result, "data"), wire::Value(hex("02030405")));
            WriteTag write{.access = to, .bank = Bank::user, .offset = 1, .data = hex("CAFEBABE")};
            EXPECT_EQ(site.runs(write).status, Status::done);
            EXPECT_EQ(*value_of(site.runs(read), "data"), wire::Value(hex("CAFEBABE")));
            EXPECT_EQ(site.runs(write, true).status, Status::done) << "it is looked at, and is there";
            ProgramTag program{.access = to, .new_id = event::TagId(hex(tag_3))};
            result = site.runs(program);
            EXPECT_EQ(result.status, Status::done) << result.text;
            read.access = to = access_to(tag_3);
            EXPECT_EQ(site.runs(read).status, Status::done);
            EXPECT_NE(site.runs(write).status, Status::done) << "there is no tag of the old id";
            LockTag lock{.access = to, .mask = 0x003, .action = 0x002, .address = {}};
            EXPECT_EQ(site.runs(lock).status, Status::done);
            write.access = to;
            write.access.password = 0x99;
            EXPECT_EQ(site.runs(write).status, Status::failed) << "the wrong password";
            EXPECT_EQ(site.runs(KillTag{.access = to, .kill_password = 1}).status, Status::failed);
            result = site.runs(KillTag{.access = to, .kill_password = 0x01020304});
            EXPECT_EQ(result.status, Status::done) << result.text;
            EXPECT_NE(site.runs(read).status, Status::done);
            // The reading went on in between, and goes on.
            EXPECT_EQ(site.state_text("mode"), std::string_view(mode) == "host" ? "Host" : "BufferedRead");
            site.seen.clear();
            site.run_for(3s);
            EXPECT_EQ(site.ids(), std::set<std::string>{std::string(tag_2)}) << site.faults_text();
        }
    struct Row {
        Job job;
        Status status;
        std::string_view text;
    };
    Site site({}, tag_1);
    site.run_for(1s);
    auto to = access_to(tag_1), old = to, far = to;
    old.technology = event::Technology::iso18000_6b;
    far.antenna = 5;
    for (auto& row : std::vector<Row>{
             {ReadTag{.access = old}, Status::unsupported, "no commands for"},
             {ReadTag{.access = far}, Status::failed, "no antenna 5"},
             {ReadTag{.access = to, .offset = 0xFFFF, .length = 2}, Status::failed, "beyond"},
             {ReadTag{.access = to, .offset = 200}, Status::failed, "tag"},
             {LockTag{.access = to, .address = 3}, Status::failed, "by bank"},
             {ProgramTag{.access = to, .new_id = event::TagId(hex("AABBCC"))}, Status::failed, "words"},
             {ReadTag{.access = access_to(tag_3)}, Status::failed, ""}}) {
        auto result = site.runs(row.job);
        EXPECT_EQ(result.status, row.status) << row.text << ": " << result.text;
        EXPECT_NE(result.text.find(row.text), std::string::npos) << result.text;
    }
}

TEST(HartingJobs, WhatLiesInTheBufferIsTakenBeforeItIsLeftForATag) {
    Site site({.driver = {{"poll", "1h"}, {"valid_time", "200ms"}}}, tag_1);
    site.run_for(5s);
    auto waiting = site.state("buffered");
    EXPECT_GT(waiting, 5);
    site.listens();
    EXPECT_EQ(site.runs(ReadTag{.access = access_to(tag_1)}).status, Status::done);
    EXPECT_GE(site.state("sets_cleared"), waiting);
    auto asked = site.asked();
    auto cleared = std::ranges::find(asked, "ClearDataBuffer"),
         read = std::ranges::find(asked, "ReadMultipleBlocks");
    EXPECT_TRUE(cleared < read && read < asked.end()) << fmt::format("{}", fmt::join(asked, " "));
    EXPECT_EQ(site.state_text("mode"), "BufferedRead");
    EXPECT_EQ(site.state("sets_lost_at_reset"), 0);
}

TEST(HartingJobs, ParametersAreReadAndSetInRamAndForGood) {
    Site site({.device = "config=CFG0.PASSWORD=11223344,CFG49.HOLD-TIME=9"}, tag_1);
    site.run_for(1s);
    auto get = [&](std::string_view name, bool permanent = false) {
        auto result = site.runs(GetParameter{std::string(name), permanent});
        auto* found = value_of(result, name);
        return found != nullptr ? *found : wire::Value(std::string(result.text));
    };
    EXPECT_EQ(get("CFG49.HOLD-TIME"), wire::Value(9));
    EXPECT_EQ(site.runs(SetParameter{"CFG49.HOLD-TIME", "7"}).status, Status::done);
    EXPECT_EQ(get("CFG49.HOLD-TIME"), wire::Value(7));
    EXPECT_EQ(get("CFG49.HOLD-TIME", true), wire::Value(9));
    EXPECT_EQ(site.runs(SetParameter{"CFG5.SESSION", "S2"}).status, Status::done);
    EXPECT_EQ(site.runs(SetParameter{"CFG49.HOLD-TIME", "6", true}).status, Status::done);
    EXPECT_EQ(get("CFG49.HOLD-TIME", true), wire::Value(6));
    EXPECT_EQ(get("CFG5.SESSION"), wire::Value(std::string("S2"))) << "what else is in RAM stays there";
    EXPECT_EQ(get("CFG5.SESSION", true), wire::Value(std::string("S0")));
    auto all = site.runs(GetParameter{});
    EXPECT_EQ(all.status, Status::done) << all.text;
    EXPECT_GT(all.values.size(), 150u);
    EXPECT_EQ(value_of(all, "CFG0.PASSWORD"), nullptr);
    auto secret = site.runs(SetParameter{"CFG0.PASSWORD", "AABBCCDD"});
    EXPECT_EQ(secret.status, Status::done) << secret.text;
    EXPECT_EQ(*value_of(secret, "CFG0.PASSWORD"), wire::Value(std::string("(set)")));
    struct Row {
        Job job;
        std::string_view text;
    };
    for (auto& row : std::vector<Row>{{GetParameter{"CFG0.PASSWORD"}, "secret"},
                                      {GetParameter{"CFG99.NO"}, "no parameter"},
                                      {SetParameter{"CFG99.NO", "1"}, "no parameter"},
                                      {SetParameter{"CFG49.HOLD-TIME", "300"}, ""},
                                      {SetParameter{"CFG5.SESSION", "S9"}, ""}}) {
        auto result = site.runs(row.job);
        EXPECT_EQ(result.status, Status::failed);
        EXPECT_NE(result.text.find(row.text), std::string::npos) << result.text;
    }
    EXPECT_EQ(site.runs(SetParameter{"CFG5.SESSION", "S0"}).status, Status::done);
    site.seen.clear();
    site.run_for(3s);
    EXPECT_FALSE(site.seen.empty());
}

// --- ends --------------------------------------------------------------------------------------------------

TEST(HartingJobs, EveryJobEndsOnceWhateverHappensToTheLink) {
    const auto to = access_to(tag_1);
    const std::vector<Job> jobs{GetInputs{},
                                SetOutputs{{{.output = 1}}},
                                RestartReader{},
                                StartReading{},
                                StopReading{},
                                ReadTag{.access = to},
                                WriteTag{.access = to, .data = hex("CAFE")},
                                GetParameter{"CFG5.SESSION"},
                                SetParameter{"CFG5.SESSION", "S1"},
                                command("GetReaderInfo", "00")};
    for (std::size_t i = 0; i < jobs.size(); ++i)
        for (auto* end : {"cut", "silent", "cancel", "deadline", "finished"}) {
            SCOPED_TRACE(testing::Message() << "job " << i << " " << end);
            std::string_view how = end;
            Site site({}, tag_1);
            site.run_for(1s);
            if (how == "silent" || how == "deadline") site.does("silent on");
            if (how == "cut" || how == "cancel") site.drop = [](ByteView, bool) { return true; };
            auto first = site.begins(jobs[i], false, how == "deadline" ? 1s : 30s);
            auto second = site.begins(GetInputs{}, false, how == "deadline" ? 1s : 30s);
            if (how == "cancel") {
                site.driver->cancel(second, site.now);
                site.driver->cancel(first, site.now);
            }
            if (how == "cut" || how == "finished") site.disconnect();
            site.redials = true;
            site.run_for(40s);
            if (site.driver && site.link) site.commit();
            for (auto job : {first, second})
                EXPECT_EQ(std::ranges::count(site.ended, job, &JobEnded::job), 1) << job;
        }
}

}  // namespace
}  // namespace gantry::harting::driver_test
