#include <algorithm>
#include <tuple>

#include "jobs_support.hpp"

namespace gantry::caen::driver_test {

// --- inputs and outputs ------------------------------------------------------------------------------------

TEST(CaenJobs, InputsAreTheLowBitsOfTheRegister) {
    Idle ours("A948EU");
    ours.answers[Command::get_io] = gives(Attribute::io_register, 0xF5);
    auto result = ours.does(GetInputs{});
    EXPECT_EQ(result.status, Status::done);
    auto& inputs = *wire::find(result.values, "inputs")->get<wire::Value::List>();
    ASSERT_EQ(inputs.size(), 4u);
    for (std::size_t i = 0; i < 4; ++i) {
        auto& input = *inputs[i].get<wire::Fields>();
        EXPECT_EQ(*wire::find(input, "input"), wire::Value(i + 1));
        EXPECT_EQ(*wire::find(input, "state"), wire::Value(i % 2 == 0));
    }
    ours.refuses(Command::get_io, ResultCode::unknown_error);
    result = ours.does(GetInputs{});
    EXPECT_EQ(result.status, Status::failed);
    EXPECT_EQ(result.text, "the reader answered: unknown error (102)");
    ours.refuses(Command::get_io);
    EXPECT_EQ(ours.does(GetInputs{}).status, Status::unsupported);
}

TEST(CaenJobs, OutputsAreSetAboveTheInputsAndTheRestStays) {
    Idle ours("A948EU");
    ours.answers[Command::get_io] = gives(Attribute::io_register, 0x8F);
    SetOutputs job{{{.output = 1, .state = true}, {.output = 4, .state = false}}};
    EXPECT_EQ(ours.does(job).status, Status::done);
    EXPECT_EQ(ours.all(Command::set_io).at(0).number(Attribute::io_register), 0x1F);
    EXPECT_EQ(ours.does(SetOutputs{{{.output = 5, .state = true}}}).status, Status::unsupported);
    EXPECT_EQ(ours.does(SetOutputs{}).status, Status::failed);
    EXPECT_EQ(ours.does(SetOutputs{{{.output = 1}, {.output = 1}}}).status, Status::failed);
    EXPECT_EQ(ours.all(Command::set_io).size(), 1u);
}

TEST(CaenJobs, ATimedOutputGoesBackByItself) {
    Idle ours("A948EU");
    ours.answers[Command::get_io] = gives(Attribute::io_register, 0);
    EXPECT_EQ(ours.does(SetOutputs{{{.output = 2, .state = true, .for_ms = 1500}}}).status, Status::done);
    ours.waits(1400ms);
    EXPECT_EQ(ours.all(Command::set_io).size(), 1u);
    ours.answers[Command::get_io] = gives(Attribute::io_register, 0x20);
    ours.waits(200ms);
    auto set = ours.all(Command::set_io);
    ASSERT_EQ(set.size(), 2u);
    EXPECT_EQ(set[0].number(Attribute::io_register), 0x20);
    EXPECT_EQ(set[1].number(Attribute::io_register), 0);
    EXPECT_EQ(ours.does(SetOutputs{{{.output = 2, .state = true, .for_ms = 1500}}}, true).status,
              Status::unknown)
        << "a pulse is not given twice";
    EXPECT_EQ(ours.does(SetOutputs{{{.output = 2, .state = true}}}, true).status, Status::done);
}

// --- parameters --------------------------------------------------------------------------------------------

TEST(CaenJobs, ParametersAreReadAndSetByName) {
    Idle ours;
    ours.answers[Command::get_power] = gives(Attribute::power_get, 446);
    EXPECT_EQ(value_text(ours.does(GetParameter{"Power"}), "Power"), "446");
    EXPECT_EQ(value_text(ours.does(GetParameter{"protocol"}), "Protocol"), "EPCC1G2");
    auto set = ours.does(SetParameter{"Protocol", "ISO18000-6B"});
    EXPECT_EQ(set.status, Status::done);
    EXPECT_EQ(value_text(set, "Protocol"), "ISO18000-6B");
    EXPECT_EQ(ours.all(Command::set_protocol).at(0).number(Attribute::protocol), 0);
    EXPECT_EQ(ours.does(SetParameter{"Source_0.Session", "2"}).status, Status::done);
    auto session = ours.all(Command::set_source_config).at(0);
    EXPECT_EQ(session.text(Attribute::source_name), "Source_0");
    EXPECT_EQ(session.number(Attribute::config_parameter), 4);
    EXPECT_EQ(session.number(Attribute::config_value), 2);
}

TEST(CaenJobs, AParameterThatCannotBeIsRefusedBeforeItIsSent) {
    Idle ours;
    EXPECT_EQ(ours.does(GetParameter{"Pwoer"}).status, Status::failed);
    EXPECT_EQ(ours.does(SetParameter{"Pwoer", "1"}).status, Status::failed);
    EXPECT_EQ(ours.does(SetParameter{"Firmware", "5"}).text, "Firmware cannot be set");
    auto wrong = ours.does(SetParameter{"Protocol", "EPC"});
    EXPECT_EQ(wrong.status, Status::failed);
    EXPECT_NE(wrong.text.find("EPCC1G2"), std::string::npos) << wrong.text;
    EXPECT_EQ(ours.does(SetParameter{"Power", "-1"}).status, Status::failed);
    EXPECT_EQ(ours.does(SetParameter{"Power", "5000000000"}).status, Status::failed);
    EXPECT_EQ(ours.does(GetParameter{"EventMode"}).status, Status::unsupported) << "the model has none";
    EXPECT_EQ(ours.does(SetParameter{"Power", "500", true}).status, Status::unsupported);
    EXPECT_EQ(ours.does(GetParameter{"Power", true}).status, Status::unsupported);
    EXPECT_TRUE(ours.heard.empty());
    ours.refuses(Command::set_power, ResultCode::power_out_of_range);
    EXPECT_EQ(ours.does(SetParameter{"Power", "4000"}).text, "the reader answered: power out of range (183)");
}

TEST(CaenJobs, AllParametersAreThoseThatTheModelHas) {
    Idle ours;
    ours.answers[Command::get_power] = gives(Attribute::power_get, 446);
    ours.answers[Command::get_source_config] = gives(Attribute::config_value, 1);
    ours.refuses(Command::get_rf_channel, ResultCode::invalid_parameter);
    auto result = ours.does(GetParameter{});
    EXPECT_EQ(result.status, Status::done);
    EXPECT_EQ(value_text(result, "Power"), "446");
    EXPECT_EQ(value_text(result, "Source_0.Session"), "1");
    EXPECT_EQ(value_text(result, "RFChannel"), "-");
    EXPECT_EQ(value_text(result, "Source_1.Session"), "-") << "it has one source";
    EXPECT_TRUE(ours.all(Command::get_event_mode).empty());
}

TEST(CaenJobs, AfterABrokenLinkAParameterIsLookedAtFirst) {
    Idle ours;
    ours.answers[Command::get_power] = gives(Attribute::power_get, 500);
    auto there = ours.does(SetParameter{"Power", "500"}, true);
    EXPECT_EQ(there.status, Status::done);
    EXPECT_EQ(value_text(there, "note"), "it was done before the link broke");
    EXPECT_TRUE(ours.all(Command::set_power).empty());
    EXPECT_EQ(ours.does(SetParameter{"Power", "600"}, true).status, Status::done);
    EXPECT_EQ(ours.all(Command::set_power).size(), 1u);
}

// --- any command -------------------------------------------------------------------------------------------

TEST(CaenJobs, AnyCommandOfTheTableIsSentByName) {
    Idle ours;
    auto result =
        ours.does(command("SetSourceConfig", {{"SourceName", wire::Value(std::string("Source_0"))},
                                              {"ConfigParameter", wire::Value(std::string("G2Session"))},
                                              {"ConfigValue", wire::Value(std::string("1"))}}));
    EXPECT_EQ(result.status, Status::done) << result.text;
    EXPECT_EQ(to_hex(ours.all(Command::set_source_config).at(0).bytes).substr(8),
              "000053580035000000080001008A0000000F00FB536F757263655F3000"
              "0000000A006A00000004"
              "0000000A006B00000001");
    EXPECT_EQ(value_text(result, "ResultCode"), "success");
}

TEST(CaenJobs, AnAnswerWithAnErrorFailsAndItsFieldsAreThere) {
    Idle ours;
    ours.answers[Command::g2_query_ack] = [](auto&, Bytes& pairs) {
        append_bytes(pairs, Attribute::tag_id, hex(tag_a));
        return ResultCode::tag_not_present;
    };
    auto result = ours.does(command("G2QueryAck", {{"SourceName", wire::Value(std::string("Source_0"))}}));
    EXPECT_EQ(result.status, Status::failed);
    EXPECT_EQ(result.text, "tag not present (202)");
    EXPECT_EQ(value_text(result, "TagID"), tag_a);
}

TEST(CaenJobs, WhatIsNoCommandIsRefusedBeforeItIsSent) {
    Idle ours;
    EXPECT_EQ(ours.does(command("SetPwoer")).status, Status::failed);
    EXPECT_EQ(ours.does(command("SetPower", {{"PowerSet", wire::Value(std::string("much"))}})).status,
              Status::failed);
    EXPECT_EQ(ours.does(command("Abort")).status, Status::unsupported);
    EXPECT_EQ(ours.does(command("InventoryTag", {{"SourceName", wire::Value(std::string("Source_0"))},
                                                 {"Bitmask", wire::Value(6)}}))
                  .status,
              Status::unsupported);
    EXPECT_EQ(ours.does(RestartReader{}).status, Status::unsupported);
    EXPECT_TRUE(ours.heard.empty());
}

TEST(CaenJobs, AfterABrokenLinkOnlyACommandThatLooksIsSentAgain) {
    Idle ours;
    EXPECT_EQ(ours.does(command("GetPower"), true).status, Status::done);
    EXPECT_EQ(ours.does(command("RFOnOff", {{"RFOnOff", wire::Value(1)}}), true).status, Status::unknown);
    EXPECT_EQ(ours.heard.size(), 1u);
}

TEST(CaenJobs, TheStatusOfAReadPointIsReadAsTheModelMeansIt) {
    for (auto [model, status, text] : {std::tuple{"A948EU", 2, "Good"},
                                       {"A948EU", 0, "Bad"},
                                       {"A948EU", 1, "Poor"},
                                       {"A948EU", 24371, "InvalidReadPoint"},
                                       {"R4300P", 0, "Good"},
                                       {"R4300P", 2, "Bad"}}) {
        Idle ours(model);
        ours.answers[Command::check_read_point_status] =
            gives(Attribute::read_point_status, static_cast<std::uint32_t>(status));
        auto result =
            ours.does(command("CheckReadPointStatus", {{"ReadPointName", wire::Value(std::string("Ant0"))}}));
        EXPECT_EQ(value_text(result, "ReadPointStatus"), text) << model << " " << status;
    }
}

TEST(CaenJobs, AnInventoryInAJobReportsItsTags) {
    Ours ours(Given{{"mode", "inventory"}, {"poll", "1h"}});
    ours.starts();
    ours.tags = tag_pairs(tag_a);
    auto inventory = command("InventoryTag", {{"SourceName", wire::Value(std::string("Source_0"))}});
    EXPECT_EQ(ours.does(inventory).status, Status::done);
    ours.waits(1s);
    ASSERT_EQ(ours.seen.size(), 1u);
    EXPECT_EQ(ours.seen[0].tag, epc(tag_a));
    EXPECT_EQ(ours.does(StopReading{}).status, Status::done);
    EXPECT_EQ(ours.does(inventory).status, Status::done);
    EXPECT_EQ(ours.seen.size(), 1u) << "a stopped reader reports nothing";
}

TEST(CaenJobs, AllParametersLeaveTimeForRounds) {
    Ours ours(Given{{"mode", "inventory"}}, "R4300P");
    ours.starts();
    ours.answers[Command::get_source_config] = [&](auto&, Bytes& pairs) {
        ours.now = ours.now + 200ms;
        append_number(pairs, Attribute::config_value, 1);
        return ResultCode::success;
    };
    ours.heard.clear();
    EXPECT_EQ(ours.does(GetParameter{}).status, Status::done);
    auto names = ours.asked();
    std::size_t run = 0, longest = 0;
    for (auto& name : names) {
        run = name == "GetSourceConfig" ? run + 1 : name == "InventoryTag" ? 0 : run;
        longest = std::max(longest, run);
    }
    EXPECT_GT(ours.all(Command::get_source_config).size(), 40u);
    EXPECT_LE(longest, 7u) << "a round about every second";
}

TEST(CaenJobs, ATimedOutputThatTheLinkLeavesOnIsSaid) {
    Idle ours("A948EU");
    ours.answers[Command::get_io] = gives(Attribute::io_register, 0);
    EXPECT_EQ(ours.does(SetOutputs{{{.output = 2, .state = true, .for_ms = 1500}}}).status, Status::done);
    ours.driver.link_lost(ours.now);
    ours.collect();
    ASSERT_EQ(ours.faults.size(), 1u);
    EXPECT_EQ(ours.faults[0].text, "output 2 is not switched off again: the link broke before its time");
}

// --- the queue ---------------------------------------------------------------------------------------------

TEST(CaenJobs, WaitForTheirTurnAndForTheirDeadline) {
    Ours ours(Given{{"mode", "inventory"}});
    ours.starts();
    ours.silences(Command::get_io);
    auto first = ours.runs(GetInputs{}, false, 3s);
    auto second = ours.runs(GetInputs{}, false, 2s);
    ours.waits(4s);
    ASSERT_EQ(ours.ended.size(), 2u);
    EXPECT_EQ(ours.ended[0].job, second);
    EXPECT_EQ(ours.ended[0].result.status, Status::cancelled);
    EXPECT_EQ(ours.ended[1].job, first);
    EXPECT_EQ(ours.ended[1].result.status, Status::timed_out);
    ours.waits(2s);
    EXPECT_EQ(ours.heard.back().command, Command::inventory_tag) << "reading goes on";
}

TEST(CaenJobs, ARoundIsReadBetweenTwoJobs) {
    Ours ours(Given{{"mode", "inventory"}});
    ours.starts();
    ours.heard.clear();
    auto now = ours.now;
    ours.answers[Command::get_io] = [&](auto&, Bytes& pairs) {
        ours.now = ours.now + 20ms;
        append_number(pairs, Attribute::io_register, 0);
        return ResultCode::success;
    };
    for (JobId id = 1; id <= 3; ++id)
        ours.driver.run({.id = id, .deadline = now.steady + 10s}, GetInputs{}, now);
    ours.waits(100ms);
    auto names = ours.asked();
    for (std::size_t i = 1; i < names.size(); ++i)
        EXPECT_FALSE(names[i] == "GetIO" && names[i - 1] == "GetIO" && i > 1) << i;
    EXPECT_EQ(ours.all(Command::get_io).size(), 3u);
}

TEST(CaenJobs, AreCancelledBeforeAndAfterTheyWereSent) {
    Idle ours;
    ours.silences(Command::get_io);
    auto sent = ours.runs(GetInputs{});
    auto waiting = ours.runs(GetInputs{});
    ours.driver.cancel(waiting, ours.now);
    ours.driver.cancel(sent, ours.now);
    ours.driver.cancel(77, ours.now);
    ours.collect();
    ASSERT_EQ(ours.ended.size(), 2u);
    EXPECT_EQ(ours.ended[0].result.status, Status::cancelled);
    EXPECT_EQ(ours.ended[1].result.status, Status::unknown);
    ours.waits(6s);
    EXPECT_EQ(ours.ended.size(), 2u);
}

TEST(CaenJobs, ABrokenLinkEndsThemAll) {
    Idle ours;
    ours.silences(Command::get_io);
    auto sent = ours.runs(GetInputs{});
    ours.runs(StopReading{});
    ours.driver.link_lost(ours.now);
    ours.collect();
    ASSERT_EQ(ours.ended.size(), 2u);
    EXPECT_EQ(ours.ended[0].job, sent);
    EXPECT_EQ(ours.ended[0].result.status, Status::unknown);
    EXPECT_EQ(ours.ended[1].result.status, Status::cancelled);
    ours.runs(GetInputs{});
    EXPECT_EQ(ours.ended.back().result.status, Status::cancelled);
}

}  // namespace gantry::caen::driver_test
