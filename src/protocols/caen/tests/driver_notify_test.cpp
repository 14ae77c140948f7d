#include <algorithm>

#include "driver_support.hpp"

// Notifications (section 9): what the driver asks for, and everything that a reader may send.
namespace gantry::caen::driver_test {

using Names = std::vector<std::string>;

static const std::string tag_a = "3074257BF7194E4000001A85", tag_b = "3074257BF7194E4000001A86";

// One event in the order of the manual's table.
static void append_event(Bytes& out, std::string_view id, std::uint32_t event,
                         std::string_view source = "Source_0") {
    append_time(out, Attribute::time_stamp, 1'700'000'000'000'000);
    append_number(out, Attribute::tag_id_len, id.size() / 2);
    append_bytes(out, Attribute::tag_id, hex(id));
    append_text(out, Attribute::source_name, source);
    append_number(out, Attribute::event_type, event);
}
static Bytes notification(const Bytes& pairs, std::uint16_t code = 0xFFFE, std::uint16_t fixed = to_host_head,
                          bool result = true) {
    Bytes message;
    Builder builder(message, fixed, 1);
    builder.command(code);
    message.insert(message.end(), pairs.begin(), pairs.end());
    if (result) builder.result(ResultCode::success);
    EXPECT_TRUE(builder.finish());
    return message;
}

struct Notified : Ours {
    explicit Notified(const Given& settings = {{"sources", "Source_0,Source_1"}}, bool dials = true)
        : Ours(settings, "A948EU", "192.168.0.10:3000") {
        info = "A948EU 1";
        starts();
        side = driver.notifications();
        if (side != nullptr && dials) side->start(now);
    }
    void hears(const Bytes& bytes) {
        side->received(bytes, now);
        collect();
    }
    SideParty* side = nullptr;
};

TEST(CaenNotify, MakesTriggersAndChannelInTheOrderOfTheMakersDemo) {
    Notified ours(Given{{"sources", "Source_0,Source_1"}, {"notify_read", "200ms"}, {"notify_period", "3s"}});
    auto names = ours.asked();
    auto from = std::ranges::find(names, "SetEventMode") - names.begin();
    EXPECT_EQ(
        Names(names.begin() + from, names.end()),
        (Names{"SetEventMode", "AllocateTrigger", "AllocateTrigger", "AllocateChannel", "AddSourceToChannel",
               "AddSourceToChannel", "AddNotifyTrigger", "AddReadTrigger", "AddReadTrigger"}));
    Names before(names.begin(), names.begin() + from);
    EXPECT_NE(std::ranges::find(before, "DeallocateChannel"), before.end()) << "left-overs go first";
    EXPECT_EQ(ours.all(Command::set_event_mode).at(0).number(Attribute::event_mode), 2);
    auto triggers = ours.all(Command::allocate_trigger);
    EXPECT_EQ(triggers[0].text(Attribute::trigger_name), "gantry-notify");
    EXPECT_EQ(triggers[0].text(Attribute::trigger_type), "3000");
    EXPECT_EQ(triggers[1].text(Attribute::trigger_type), "200");
    auto channel_made = ours.all(Command::allocate_channel).at(0);
    EXPECT_EQ(channel_made.text(Attribute::channel_name), "gantry");
    EXPECT_EQ(channel_made.text(Attribute::channel_address), "192.168.0.10:3000");
    EXPECT_NE(ours.detail().find("reads with notifications"), std::string::npos);
    ours.waits(1min);
    EXPECT_TRUE(ours.all(Command::raw_read_ids).empty());
    EXPECT_GE(ours.all(Command::get_firmware_release).size(), 6u) << "the command link is kept alive";
}

TEST(CaenNotify, ATriggerTypeThatIsRefusedIsWrittenAnotherWay) {
    Ours ours({}, "A948EU", "192.168.0.10:3000");
    ours.answers[Command::allocate_trigger] = [](auto& heard, Bytes&) {
        return heard.text(Attribute::trigger_type).starts_with("TIMED:") ? ResultCode::success
                                                                         : ResultCode::bad_timer_value;
    };
    ours.starts();
    EXPECT_EQ(ours.all(Command::allocate_trigger).size(), 4u);
    EXPECT_NE(ours.detail().find("reads with notifications"), std::string::npos);
}

TEST(CaenNotify, AReaderThatRefusesTheChannelIsReadTheNextWay) {
    Ours ours(Given{{"sources", "Source_0,Source_1"}}, "A948EU", "192.168.0.10:3000");
    ours.refuses(Command::allocate_channel, ResultCode::bad_address);
    ours.starts();
    ours.waits(1s);
    EXPECT_NE(ours.detail().find("not with notifications: AllocateChannel answered bad address (114)"),
              std::string::npos)
        << ours.detail();
    EXPECT_FALSE(ours.all(Command::inventory_tag).empty() && ours.all(Command::raw_read_ids).empty());
    EXPECT_EQ(ours.all(Command::deallocate_trigger).size(), 4u) << "and what was made is taken away";
}

TEST(CaenNotify, IsThereOnlyWhereItCanBeWanted) {
    EXPECT_EQ(CaenDriver(options_with({}, "A948EU")).notifications(), nullptr);
    EXPECT_EQ(CaenDriver(options_with({{"mode", "raw"}}, "A948EU", "1.2.3.4:5")).notifications(), nullptr);
    EXPECT_NE(CaenDriver(options_with({}, "A948EU", "1.2.3.4:5")).notifications(), nullptr);
    Ours without(Given{{"mode", "notify"}}, "R1260I", "1.2.3.4:5");
    without.starts();
    EXPECT_NE(without.detail().find("has no notification channels"), std::string::npos) << without.detail();
    Ours nowhere(Given{{"mode", "notify"}}, "A948EU");
    nowhere.starts();
    EXPECT_NE(nowhere.detail().find("no notify address"), std::string::npos) << nowhere.detail();
}

TEST(CaenNotify, ReportsAreTakenWhateverTheirCodeAndFirstField) {
    for (std::uint16_t fixed : {to_host_head, to_reader_head})
        for (std::uint16_t code : {std::uint16_t{0xFFFE}, std::uint16_t{0}, std::uint16_t{0x12}})
            for (bool result : {true, false}) {
                Notified ours;
                Bytes pairs;
                append_event(pairs, tag_a, 1);
                append_event(pairs, tag_b, 0);
                ours.hears(notification(pairs, code, fixed, result));
                ASSERT_EQ(ours.seen.size(), 2u) << fixed << " " << code << " " << result;
                EXPECT_EQ(ours.seen[0].tag, epc(tag_a));
                EXPECT_EQ(ours.seen[0].reader_time_us, 1'700'000'000'000'000);
                EXPECT_EQ(ours.seen[0].technology, event::Technology::epc_gen2) << "the reader's protocol";
                EXPECT_EQ(ours.count(Count::reads), 2u);
                EXPECT_FALSE(ours.side->finished());
            }
}

TEST(CaenNotify, WhatTheReaderCallsLostOrPurgedIsNoRead) {
    Notified ours;
    Bytes pairs;
    for (std::uint32_t event = 0; event <= 6; ++event)
        append_event(pairs, event % 2 == 0 ? tag_a : tag_b, event);
    ours.hears(notification(pairs));
    EXPECT_EQ(ours.seen.size(), 5u);
    EXPECT_EQ(ours.count(Count::departures), 2u);
    EXPECT_EQ(ours.count(Count::reads), 5u);
    Bytes only_lost;
    append_event(only_lost, tag_a, 4);
    auto reports = ours.reports.size();
    ours.hears(notification(only_lost));
    EXPECT_EQ(ours.reports.size(), reports) << "nothing in it";
}

TEST(CaenNotify, OnePairAloneEndsTheChannelAndItIsMadeAnew) {
    Notified ours;
    auto made = ours.all(Command::allocate_channel).size();
    ours.hears(notification({}, 0xFFFF, to_host_head, false));
    EXPECT_TRUE(ours.side->finished());
    EXPECT_TRUE(ours.seen.empty());
    ours.side->link_lost(ours.now);
    ours.waits(9s);
    ASSERT_EQ(ours.faults.size(), 1u);
    EXPECT_EQ(ours.faults[0].code, fault_notifications);
    EXPECT_EQ(ours.all(Command::allocate_channel).size(), made);
    ours.waits(2s);
    EXPECT_EQ(ours.all(Command::allocate_channel).size(), made + 1);
    ours.side->start(ours.now);
    Bytes pairs;
    append_event(pairs, tag_a, 2);
    ours.hears(notification(pairs));
    EXPECT_EQ(ours.seen.size(), 1u);
}

TEST(CaenNotify, AReportMayBeEmptyOrInPieces) {
    Notified ours;
    ours.hears(notification({}));
    EXPECT_TRUE(ours.reports.empty());
    EXPECT_FALSE(ours.side->finished());
    Bytes pairs;
    append_event(pairs, tag_a, 1);
    for (auto byte : notification(pairs))
        ours.hears({byte});
    EXPECT_EQ(ours.seen.size(), 1u);
}

TEST(CaenNotify, AMalformedReportIsTakenAsFarAsItGoes) {
    Notified ours;
    Bytes pairs;
    append_event(pairs, tag_a, 1);
    for (auto byte : hex("000000020011"))
        pairs.push_back(byte);
    ours.hears(notification(pairs, 0xFFFE, to_host_head, false));
    EXPECT_EQ(ours.seen.size(), 1u);
    ASSERT_EQ(ours.faults.size(), 1u);
    EXPECT_EQ(ours.faults[0].code, fault_malformed);
}

TEST(CaenNotify, SixteenOpenTicketsStopTheChannel) {
    Notified ours;
    ours.commits = false;
    Bytes pairs;
    append_event(pairs, tag_a, 1);
    for (int i = 0; i < 100 && ours.side->wants_input(); ++i)
        ours.hears(notification(pairs));
    EXPECT_EQ(ours.tickets, Reports::max_open);
    EXPECT_TRUE(ours.driver.stalled());
    ours.driver.committed(ours.tickets, ours.now);
    EXPECT_TRUE(ours.side->wants_input());
}

TEST(CaenNotify, AReaderThatNeverDialsIsSaidOnce) {
    Notified ours({{"sources", "Source_0,Source_1"}}, false);
    ours.waits(29s);
    EXPECT_TRUE(ours.faults.empty());
    ours.waits(5min);
    ASSERT_EQ(ours.faults.size(), 1u);
    EXPECT_NE(ours.faults[0].text.find("192.168.0.10:3000"), std::string::npos);
}

TEST(CaenNotify, StoppingTakesTheChannelAwayAndStartingMakesItAgain) {
    Notified ours;
    ours.heard.clear();
    EXPECT_EQ(ours.does(StopReading{}).status, JobResult::Status::done);
    EXPECT_EQ(ours.asked(), (Names{"RemoveReadTrigger", "RemoveReadTrigger", "RemoveNotifyTrigger",
                                   "RemoveSourceFromChannel", "RemoveSourceFromChannel", "DeallocateChannel",
                                   "DeallocateTrigger", "DeallocateTrigger"}));
    ours.heard.clear();
    EXPECT_EQ(ours.does(StartReading{}).status, JobResult::Status::done);
    EXPECT_EQ(ours.all(Command::allocate_channel).size(), 1u);
}

TEST(CaenNotify, AReaderThatTellsOnlyEventsIsReadTheNextWay) {
    Ours ours({}, "A948EU", "192.168.0.10:3000");
    ours.refuses(Command::set_event_mode, ResultCode::bad_parameter_value);
    ours.starts();
    ours.waits(1s);
    EXPECT_NE(ours.detail().find("not with notifications: SetEventMode answered"), std::string::npos)
        << ours.detail();
    EXPECT_TRUE(ours.all(Command::allocate_channel).empty());
}

TEST(CaenNotify, AChannelOfAnEarlierRunIsTakenAwayWhereNoneIsWanted) {
    Ours stopped({}, "A948EU", "192.168.0.10:3000");
    stopped.driver.admitted({.mark = {}, .reading = false}, stopped.now);
    stopped.starts();
    Ours other_mode(Given{{"mode", "raw"}}, "A948EU");
    other_mode.starts();
    for (auto* ours : {&stopped, &other_mode}) {
        ours->waits(1min);
        EXPECT_EQ(ours->all(Command::deallocate_channel).size(), 1u);
        EXPECT_TRUE(ours->all(Command::allocate_channel).empty());
        EXPECT_TRUE(ours->faults.empty());
    }
    Ours without({}, "R1260I");
    without.starts();
    EXPECT_TRUE(without.all(Command::deallocate_channel).empty());
}

TEST(CaenNotify, TheEndOfAChannelThatWeTakeAwayIsNoFault) {
    Notified ours;
    EXPECT_EQ(ours.does(StopReading{}).status, JobResult::Status::done);
    ours.hears(notification({}, 0xFFFF, to_host_head, false));
    ours.waits(1s);
    EXPECT_EQ(ours.does(StartReading{}).status, JobResult::Status::done);
    ours.waits(1min);
    EXPECT_EQ(std::ranges::count_if(
                  ours.faults, [](auto& each) { return each.text.find("ended its") != std::string::npos; }),
              0);
    EXPECT_EQ(ours.all(Command::allocate_channel).size(), 2u) << "made once for each start";
}

TEST(CaenNotify, TheWholeTagsOfABrokenOffMessageAreTaken) {
    Notified ours;
    Bytes pairs;
    append_event(pairs, tag_a, 1);
    auto whole = pairs.size();
    append_event(pairs, tag_b, 1);
    auto message = notification(pairs);
    // A tag ends with its event: what is cut inside the second one leaves the first.
    for (auto extra : {std::size_t{0}, std::size_t{3}, pairs.size() - whole - 1}) {
        ours.seen.clear();
        auto size = header_size + 8 + whole + extra;
        ours.hears(Bytes(message.begin(), message.begin() + static_cast<std::ptrdiff_t>(size)));
        EXPECT_TRUE(ours.seen.empty());
        ours.side->link_lost(ours.now);
        ours.collect();
        ASSERT_EQ(ours.seen.size(), 1u) << extra;
        EXPECT_EQ(ours.seen[0].tag, epc(tag_a));
        ours.side->start(ours.now);
    }
    auto skipped = ours.count(Count::skipped_bytes);
    ours.hears(Bytes(message.begin(), message.begin() + header_size + 3));
    ours.side->link_lost(ours.now);
    ours.collect();
    EXPECT_EQ(ours.count(Count::skipped_bytes), skipped + header_size + 3) << "no tag, but counted";
    EXPECT_TRUE(ours.faults.empty());
}

TEST(CaenNotify, WhatIsMalformedAgainAndAgainIsSaidOnceAMinute) {
    Notified ours;
    Bytes pairs;
    for (int i = 0; i < 100; ++i) {
        append_event(pairs, tag_a, 1);
        append_event(pairs, "", 1);
    }
    for (int i = 0; i < 5; ++i)
        ours.hears(notification(pairs));
    ASSERT_EQ(ours.faults.size(), 1u);
    EXPECT_EQ(ours.faults[0].bytes.size(), 256u);
    EXPECT_EQ(ours.count(Count::malformed), 5u);
    ours.waits(61s);
    ours.hears(notification(pairs));
    ASSERT_EQ(ours.faults.size(), 2u);
    EXPECT_NE(ours.faults[1].text.find("4 more messages"), std::string::npos) << ours.faults[1].text;
}

TEST(CaenNotify, JobsGoOverTheCommandLinkMeanwhile) {
    Notified ours;
    ours.answers[Command::get_io] = [](auto&, Bytes& pairs) {
        append_number(pairs, Attribute::io_register, 1);
        return ResultCode::success;
    };
    EXPECT_EQ(ours.does(GetInputs{}).status, JobResult::Status::done);
    EXPECT_EQ(ours.all(Command::deallocate_channel).size(), 1u) << "only that of the beginning";
}

TEST(CaenNotify, GarbageOnTheChannelEndsOnlyTheChannel) {
    Notified ours;
    ours.hears(Bytes(70'000, 0xEE));
    EXPECT_TRUE(ours.side->finished());
    EXPECT_FALSE(ours.driver.finished());
    EXPECT_EQ(ours.count(Count::skipped_bytes), 70'000u);
}

}  // namespace gantry::caen::driver_test
