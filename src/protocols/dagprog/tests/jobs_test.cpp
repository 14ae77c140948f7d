#include <set>

#include "support.hpp"

namespace gantry::dagprog::test {

namespace {

const Given icode1 = {{"family", "icode1"}};

struct Desk : Pair {
    explicit Desk(const Given& device_settings = {}, const Given& driver_settings = {})
        : Pair(device_settings, driver_settings) {
        run_for(8s);
    }
};
ReadTag reading(std::string_view tag, std::uint32_t block, std::uint32_t count = 1) {
    return {.access = access_to(tag), .offset = block, .length = count};
}
WriteTag writing(std::string_view tag, std::uint32_t block, std::string_view data) {
    return {.access = access_to(tag), .offset = block, .data = hex(data)};
}
std::string text_of(const JobResult& result) {
    return std::string(to_text(result.status)) + ": " + result.text;
}

}  // namespace

TEST(DagprogJobs, ReadsAndWritesBlocksAndReadsOn) {
    for (auto& settings : {Given{}, icode1}) {
        Desk desk(settings);
        auto tag = is_icode1(settings) ? icode_a : tag_a;
        desk.hf.put(tag);
        desk.run_for(1s);
        auto written = desk.does(writing(tag, 5, "1122334455667788"));
        EXPECT_EQ(written.status, Status::done) << written.text;
        EXPECT_EQ(desk.block(tag, 5), "11223344");
        EXPECT_EQ(desk.block(tag, 6), "55667788");
        auto read = desk.does(reading(tag, 5, 2));
        EXPECT_EQ(read.status, Status::done) << read.text;
        EXPECT_EQ(value_text(read, "data"), "1122334455667788");
        desk.run_for(2s);
        EXPECT_EQ(desk.state("mode"), "UR") << "it reads on";
        EXPECT_EQ(desk.state("first_block"), "0") << "as it was";
        EXPECT_EQ(desk.state("transmit"), is_icode1(settings) ? "1" : "5");
        EXPECT_EQ(desk.state("saved_first_block"), "0");
        EXPECT_EQ(desk.faults(), "");
    }
}

TEST(DagprogJobs, ATagThatIsToldByItsDataIsFoundByThem) {
    Desk desk(icode1, {{"first_block", "5"}, {"blocks", "2"}});
    auto blocks = Bytes(64);
    auto number = hex("0000123400005678");
    std::ranges::copy(number, blocks.begin() + 20);
    for (std::size_t i = 8; i < 12; ++i)
        blocks[i] = 0xFF;
    desk.hf.put(icode_a, blocks);
    desk.run_for(1s);
    EXPECT_GT(desk.reads("0000123400005678"), 0u);
    auto done = desk.does(writing("0000123400005678", 7, "AABBCCDD"));
    EXPECT_EQ(done.status, Status::done) << done.text;
    EXPECT_EQ(desk.block(icode_a, 7), "AABBCCDD");
    auto wrong = desk.does(writing("0000123400005679", 7, "00000000"));
    EXPECT_EQ(wrong.status, Status::failed);
    EXPECT_NE(wrong.text.find("its data are 0000123400005678"), std::string::npos) << wrong.text;
    EXPECT_EQ(desk.block(icode_a, 7), "AABBCCDD");
    // Its serial number tells it as well.
    EXPECT_EQ(value_text(desk.does(reading(icode_a, 7)), "data"), "AABBCCDD");
}

TEST(DagprogJobs, NothingIsWrittenToAnotherTagOrToNobody) {
    for (auto& settings : {Given{}, icode1}) {
        Desk desk(settings);
        auto tag = is_icode1(settings) ? icode_a : tag_a;
        auto nobody = desk.does(writing(tag, 5, "11223344"));
        EXPECT_EQ(nobody.status, Status::failed) << nobody.text;
        EXPECT_NE(nobody.text.find("no tag"), std::string::npos) << nobody.text;
        desk.hf.put(tag_b.substr(0, 2) == "E0" && !is_icode1(settings) ? tag_b : "0102030405060709");
        auto other = is_icode1(settings) ? "0102030405060709" : tag_b;
        desk.run_for(1s);
        auto wrong = desk.does(writing(tag, 5, "11223344"));
        EXPECT_EQ(wrong.status, Status::failed);
        EXPECT_NE(wrong.text.find("another tag is there"), std::string::npos) << wrong.text;
        EXPECT_EQ(desk.block(other, 5), "00000000");
        desk.hf.put(tag);
        desk.run_for(1s);
        EXPECT_EQ(desk.does(writing(tag, 5, "11223344")).status, Status::failed) << "two in the field";
        EXPECT_EQ(desk.block(other, 5), "00000000");
        EXPECT_EQ(desk.block(tag, 5), "00000000");
    }
}

TEST(DagprogJobs, AWriteErrorIsLookedAtBeforeItIsRepeated) {
    Desk desk;
    desk.hf.put(tag_a);
    desk.run_for(1s);
    desk.inject("write_error");
    auto done = desk.does(writing(tag_a, 5, "11223344"));
    EXPECT_EQ(done.status, Status::done) << done.text;
    EXPECT_EQ(desk.block(tag_a, 5), "11223344");
    EXPECT_EQ(desk.state("writes"), "1");
    Desk once;
    once.hf.put(tag_a);
    once.run_for(1s);
    auto job = writing(tag_a, 5, "11223344");
    job.access.retries = 0;
    once.inject("write_error");
    auto failed = once.does(job);
    EXPECT_NE(failed.status, Status::done);
    EXPECT_NE(failed.text.find("write error"), std::string::npos) << failed.text;
    // A job that was sent before a link broke looks first.
    EXPECT_EQ(once.does(job).status, Status::done);
    EXPECT_EQ(once.state("writes"), "1");
    auto again = once.does(job, 20s, true);
    EXPECT_EQ(again.status, Status::done);
    EXPECT_EQ(once.state("writes"), "1");
    EXPECT_NE(value_text(again, "note").find("before the link broke"), std::string::npos);
}

TEST(DagprogJobs, SystemBlocksOfIcode1AreWrittenOnlyWhenForced) {
    Desk desk(icode1);
    desk.hf.put(icode_a);
    desk.run_for(1s);
    for (std::uint32_t block = 0; block < 4; ++block) {
        auto refused = desk.does(writing(icode_a, block, "F0FFFFFF"));
        EXPECT_EQ(refused.status, Status::failed);
        EXPECT_NE(refused.text.find("force_system_blocks"), std::string::npos) << refused.text;
        auto typed =
            desk.does(command("WriteData", {{"Block", wire::Value(block)}, {"Data", words("F0FFFFFF")}}));
        EXPECT_NE(typed.text.find("force_system_blocks"), std::string::npos) << typed.text;
    }
    EXPECT_EQ(desk.does(writing(icode_a, 3, "0011223344556677")).status, Status::failed)
        << "the first of two";
    EXPECT_EQ(desk.does(writing(icode_a, 4, "11223344")).status, Status::done);
    Desk forced(icode1, {{"force_system_blocks", "true"}});
    forced.hf.put(icode_a);
    forced.run_for(1s);
    EXPECT_EQ(forced.does(writing(icode_a, 3, "00000000")).status, Status::done);
    EXPECT_NE(forced.does(writing(icode_a, 0, "11223344")).status, Status::done) << "the tag says no";
    Desk iso;
    iso.hf.put(tag_a);
    iso.run_for(1s);
    EXPECT_EQ(iso.does(writing(tag_a, 0, "11223344")).status, Status::done);
}

TEST(DagprogJobs, WhatTheMakeHasNotIsUnsupported) {
    Desk desk;
    desk.hf.put(tag_a);
    desk.run_for(1s);
    LockTag lock;
    lock.access = access_to(tag_a);
    KillTag kill;
    kill.access = access_to(tag_a);
    ProgramTag program{.access = access_to(tag_a), .new_id = id(tag_b)};
    auto secret = reading(tag_a, 1);
    secret.access.password = 1;
    auto bank = reading(tag_a, 1);
    bank.bank = Bank::tid;
    auto kind = reading(tag_a, 1);
    kind.access.technology = event::Technology::icode1;
    for (const Job& job : std::vector<Job>{GetInputs{}, SetOutputs{{{1, true, 0}}}, RestartReader{}, lock,
                                           kill, program, secret, bank, kind, command("ReadSerialNumber")})
        EXPECT_EQ(desk.does(job).status, Status::unsupported) << job.index();
    for (const Job& job : std::vector<Job>{
             reading(tag_a, 15), reading(tag_a, 14, 2), reading(tag_a, 0, 0), writing(tag_a, 5, "112233"),
             writing(tag_a, 0xFFFFFFFF, "11223344"), command("Nonsense"), GetParameter{"Nonsense"},
             SetParameter{"Nonsense", "1"}, SetParameter{"Version", "1"}})
        EXPECT_EQ(desk.does(job).status, Status::failed) << job.index();
    Desk icode(icode1);
    EXPECT_EQ(icode.does(SetParameter{"PowerUpMode", "ReadOnce"}).status, Status::unsupported);
    EXPECT_EQ(icode.does(GetParameter{"PowerUpMode"}).status, Status::unsupported);
    for (auto name : {"ReadOnce", "ReadChecked", "GetPowerUpMode"})
        EXPECT_EQ(icode.does(command(name)).status, Status::unsupported) << name;
    auto crc = icode.does(command("WriteDataCrc8", {{"Block", wire::Value(5)}, {"Data", words("112233")}}));
    EXPECT_EQ(crc.status, Status::unsupported);
}

TEST(DagprogJobs, ParametersAreReadSetAndKeptOverARestart) {
    Desk desk;
    auto all = desk.does(GetParameter{});
    EXPECT_EQ(value_text(all, "FirstBlock"), "0");
    EXPECT_EQ(value_text(all, "BlockCountMinus1"), "0");
    EXPECT_EQ(value_text(all, "TransmitMode"), "SerialNumberAndData");
    EXPECT_EQ(value_text(all, "PowerUpMode"), "ReadForever");
    EXPECT_EQ(value_text(all, "Version"), "V1.00A");
    auto set = desk.does(SetParameter{"firstblock", "7"});
    EXPECT_EQ(set.status, Status::done) << set.text;
    EXPECT_EQ(value_text(set, "FirstBlock"), "7");
    EXPECT_EQ(desk.does(SetParameter{"PowerUpMode", "ReadOnce"}).status, Status::done);
    EXPECT_EQ(desk.does(SetParameter{"TransmitMode", "SerialNumber"}).status, Status::done);
    EXPECT_EQ(value_text(desk.does(GetParameter{"TransmitMode"}), "TransmitMode"), "SerialNumber");
    EXPECT_EQ(desk.state("saved_first_block"), "7");
    EXPECT_EQ(desk.state("saved_power_up"), "2");
    EXPECT_EQ(desk.state("save_next"), "false");
    desk.inject("restart");
    desk.run_for(10s);
    EXPECT_EQ(value_text(desk.does(GetParameter{"FirstBlock"}), "FirstBlock"), "7");
    for (auto [name, value] : {std::pair{"FirstBlock", "15"}, std::pair{"TransmitMode", "2"},
                               std::pair{"PowerUpMode", "9"}, std::pair{"FirstBlock", "x"}}) {
        auto wrong = desk.does(SetParameter{name, value});
        EXPECT_EQ(wrong.status, Status::failed) << name;
        EXPECT_NE(wrong.text.find("it is"), std::string::npos) << wrong.text;
    }
}

TEST(DagprogJobs, EveryCommandCanBeSentByItsName) {
    Desk desk;
    desk.hf.put(tag_a);
    desk.run_for(1s);
    EXPECT_EQ(value_text(desk.does(command("GetVersion")), "Version"), "V1.00A");
    EXPECT_EQ(value_text(desk.does(command("GetPowerUpMode")), "PowerUpMode"), "ReadForever");
    EXPECT_EQ(value_text(desk.does(command("GetTransmitMode")), "TransmitMode"), "SerialNumberAndData");
    EXPECT_EQ(value_text(desk.does(command("SetFirstBlock", {{"FirstBlock", words("2")}})), "FirstBlock"),
              "2");
    for (auto name : {"ReadForever", "ReadChecked", "ReadOnce", "Stop", "FieldOff", "FieldOn", "EmptyLine",
                      "GetFirstBlock", "GetBlockCount"})
        EXPECT_EQ(desk.does(command(name)).status, Status::done) << name;
    auto crc = desk.does(command("WriteDataCrc8", {{"Block", wire::Value(5)}, {"Data", words("001234")}}));
    EXPECT_EQ(crc.status, Status::done) << crc.text;
    EXPECT_EQ(value_text(crc, "Data"), "0012341F");
    EXPECT_EQ(value_text(crc, "SerialNumber"), tag_a);
    desk.hf.take(tag_a);
    desk.run_for(1s);
    auto nobody = desk.does(command("WriteData", {{"Block", wire::Value(5)}, {"Data", words("11")}}));
    EXPECT_EQ(text_of(nobody), "failed: no tag in the field");
    auto again =
        desk.does(command("WriteData", {{"Block", wire::Value(5)}, {"Data", words("11")}}), 5s, true);
    EXPECT_EQ(again.status, Status::unknown) << "never twice";
    Desk icode(icode1);
    icode.hf.put(icode_a);
    icode.run_for(1s);
    EXPECT_EQ(value_text(icode.does(command("ReadSerialNumber")), "SerialNumber"), icode_a);
}

TEST(DagprogJobs, WhatFollowsSaveNextIsNotSetByAccident) {
    Desk desk;
    desk.hf.put(tag_a);
    desk.run_for(1s);
    EXPECT_EQ(desk.does(command("SaveNext")).status, Status::done);
    auto refused = desk.does(reading(tag_a, 9));
    EXPECT_NE(refused.text.find("SaveNext was sent"), std::string::npos) << refused.text;
    EXPECT_EQ(desk.does(command("SetFirstBlock", {{"FirstBlock", words("1")}})).status, Status::done);
    EXPECT_EQ(desk.does(reading(tag_a, 9)).status, Status::done);
    EXPECT_EQ(desk.state("saved_first_block"), "1");
    desk.run_for(1s);
    EXPECT_EQ(desk.state("first_block"), "1");
}

TEST(DagprogJobs, TheCrc8OfAUnitIsLearnedFromWhatItWrites) {
    Desk desk(Given{{"crc8", "rohc"}});
    desk.hf.put(tag_a);
    desk.run_for(1s);
    for (std::string_view data : {"000001", "001234", "123456", "ABCDEF", "807060"})
        EXPECT_EQ(
            desk.does(command("WriteDataCrc8", {{"Block", wire::Value(5)}, {"Data", words(data)}})).status,
            Status::done);
    EXPECT_NE(desk.detail().find("CRC8 rohc"), std::string::npos) << desk.detail();
    Desk named(Given{{"crc8", "rohc"}}, {{"crc8", "i-code"}});
    named.hf.put(tag_a);
    named.run_for(1s);
    auto differs =
        named.does(command("WriteDataCrc8", {{"Block", wire::Value(5)}, {"Data", words("001234")}}));
    EXPECT_NE(differs.text.find("is not i-code"), std::string::npos) << differs.text;
}

TEST(DagprogJobs, JobsThatWaitOrRunAreTakenBackAndTimedOut) {
    Ours ours;
    ours.run(1, GetParameter{"Version"});
    ours.driver.cancel(1, ours.now);
    ours.run(2, GetParameter{"Version"}, 1s);
    ours.waits(1100ms);
    ours.collect();
    ASSERT_EQ(ours.ended().size(), 2u);
    EXPECT_EQ(ours.ended()[0].result.status, Status::cancelled);
    EXPECT_EQ(ours.ended()[1].result.status, Status::cancelled);
    ours.identifies();
    ours.run(3, GetParameter{"Version"});
    ours.driver.cancel(3, ours.now);
    ours.collect();
    EXPECT_EQ(ours.ended().back().result.status, Status::unknown);
    ours.gets(said({"V=\tV1.00A"}));
    ours.run(4, writing(tag_a, 5, "11223344"), 2s);
    ours.run(5, GetParameter{"Version"});
    ours.waits(4s);
    EXPECT_TRUE(std::ranges::any_of(
        ours.ended(), [](auto& each) { return each.job == 4 && each.result.status != Status::done; }));
    ours.run(6, GetParameter{"Version"}, 60s);
    ours.driver.link_lost(ours.now);
    ours.collect();
    std::set<JobId> ended;
    for (auto& each : ours.ended())
        EXPECT_TRUE(ended.insert(each.job).second) << "once each";
    EXPECT_EQ(ended.size(), 6u);
    ours.run(7, GetParameter{"Version"});
    EXPECT_EQ(ours.ended().back().result.status, Status::cancelled);
}

}  // namespace gantry::dagprog::test
