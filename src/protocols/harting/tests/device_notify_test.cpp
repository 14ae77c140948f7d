#include "protocols/harting/tests/device_support.hpp"

namespace gantry::harting::device_test {
namespace {

const Bytes ack = hex("02000 7FF325447");

// A reader that notifies, and the host that it dials: on a link beside its first one, or as the only one.
struct Notified : Bench {
    explicit Notified(std::string_view config = "", std::string_view given = "", bool only = false)
        : Bench(fmt::format("{}{} config=CFG1.MODE=Notification,CFG49.DESTINATION=127.0.0.1,CFG49.PORT=4000,"
                            "CFG11.TR-DATA1=0x11,CFG12.TRANSPONDER-VALID-TIME=600{}{}",
                            only ? "connect=localhost:4000" : "redial=2s",
                            given.empty() ? "" : fmt::format(" {}", given), config.empty() ? "" : ",",
                            config)),
          only_(only) {
        device.power_on(now);
    }

    Party& link() { return only_ ? static_cast<Party&>(device) : *channel_; }
    bool is_dialled() {
        if (only_) return device.dial_at() && *device.dial_at() <= now.steady;
        auto wanted = device.dial_outs();
        return !wanted.empty() && wanted[0]->dial_at() && *wanted[0]->dial_at() <= now.steady;
    }
    void takes() {
        ASSERT_TRUE(is_dialled());
        if (!only_) channel_ = device.dial_outs()[0];
        link().start(now);
        device.time_passed(now);
        connected = true;
    }
    void loses() {
        if (only_)
            device.link_lost(now);
        else
            channel_->link_lost(now);
        connected = false;
    }
    std::vector<Reply> hears() { return replies(taken(link())); }
    void acknowledges() { link().received(ack, now); }

    bool connected = false;

private:
    bool only_;
    std::shared_ptr<DialOut> channel_;
};

TEST(HartingDeviceNotify, WithoutAcknowledgementSetsAreSentAndGone) {
    for (bool only : {false, true}) {
        Notified reader("CFG49.ACK=0", "", only);
        reader.waits(5s);
        EXPECT_FALSE(reader.is_dialled() && !only) << "nobody has anything to say";
        reader.places(tag_1);
        reader.waits(1s);
        reader.takes();
        auto said = reader.hears();
        ASSERT_EQ(said.size(), 1u);
        EXPECT_EQ(said[0].control, 0x22);
        EXPECT_EQ(said[0].status, Status::ok);
        EXPECT_EQ(records_of(said[0]).ids(), std::vector<std::string>{std::string(tag_1)});
        EXPECT_EQ(reader.state("buffered"), 0);
        EXPECT_EQ(reader.state("sets_cleared"), 1);
        reader.waits(20s);
        EXPECT_EQ(reader.state("resent"), 0);
        reader.places(tag_2);
        reader.waits(1s);
        if (reader.link().finished()) continue;  // its hold time is over
        EXPECT_EQ(reader.hears().size(), only ? 3u : 1u) << "with keepalives where it dials";
    }
}

TEST(HartingDeviceNotify, UnacknowledgedItIsRepeatedEvery5SecondsAndOnANewLink) {
    for (bool only : {false, true}) {
        Notified reader("CFG49.ACK=1,CFG49.KEEPALIVE=0", "", only);
        reader.places(tag_1);
        reader.waits(1s);
        reader.takes();
        auto first = taken(reader.link());
        ASSERT_FALSE(first.empty());
        reader.places(tag_2);
        reader.waits(4900ms);
        EXPECT_TRUE(reader.link().output().empty()) << "the next one waits for the acknowledgement";
        reader.waits(200ms);
        EXPECT_EQ(taken(reader.link()), first);
        reader.loses();
        EXPECT_FALSE(reader.is_dialled());
        reader.waits(2s);
        reader.takes();
        EXPECT_EQ(taken(reader.link()), first) << "what was not acknowledged comes first";
        reader.link().received(hex("020007FF325448"), reader.now);
        EXPECT_TRUE(reader.link().output().empty()) << "no acknowledgement";
        reader.does("stuck_ack on");
        reader.acknowledges();
        EXPECT_EQ(reader.state("waiting_for_ack"), 1);
        reader.does("stuck_ack off");
        reader.acknowledges();
        auto said = reader.hears();
        ASSERT_EQ(said.size(), 2u);
        EXPECT_EQ(said[0].control, 0x32);
        EXPECT_EQ(said[0].status, Status::ok);
        EXPECT_EQ(records_of(said[1]).ids(), std::vector<std::string>{std::string(tag_2)});
        reader.acknowledges();
        reader.acknowledges();
        said = reader.hears();
        ASSERT_EQ(said.size(), 2u);
        EXPECT_EQ(said[1].status, Status::no_valid_data) << "nothing waits";
        EXPECT_EQ(reader.state("sets_acked"), 2);
        EXPECT_EQ(reader.state("sets_cleared"), 2);
        EXPECT_EQ(reader.state("acks"), 2);
        EXPECT_EQ(reader.state("resent"), 2);
        EXPECT_EQ(reader.state("buffered"), 0);
    }
}

TEST(HartingDeviceNotify, OnlyAcknowledgementsAreTakenOnTheChannelAndTheHostPortTakesTheRest) {
    Notified reader("CFG49.ACK=1", "answer_ack=false");
    reader.places(tag_1);
    reader.waits(1s);
    reader.takes();
    EXPECT_EQ(reader.hears().size(), 1u);
    reader.link().received(request(Command::get_input), reader.now);
    auto said = reader.hears();
    ASSERT_EQ(said.size(), 1u);
    EXPECT_EQ(said[0].status, Status::command_not_available);
    reader.device.start(reader.now);
    EXPECT_EQ(reader.status(Command::read_buffer, "0001"), Status::command_not_available);
    EXPECT_EQ(to_hex(reader.ask(Command::read_data_buffer_info).data), "06A400000001");
    EXPECT_EQ(reader.status(Command::get_input), Status::ok);
    reader.acknowledges();
    EXPECT_TRUE(reader.hears().empty()) << "as it was told";
    EXPECT_EQ(to_hex(reader.ask(Command::read_data_buffer_info).data), "06A400010000");
}

TEST(HartingDeviceNotify, TheLinkIsHeldForTheHoldTimeOnly) {
    Notified reader("CFG49.HOLD-TIME=3");
    reader.places(tag_1);
    reader.waits(1s);
    reader.takes();
    EXPECT_EQ(reader.hears().size(), 1u);
    reader.waits(2900ms);
    EXPECT_FALSE(reader.link().finished());
    reader.waits(200ms);
    EXPECT_TRUE(reader.link().finished());
    reader.loses();
    EXPECT_FALSE(reader.is_dialled());
    reader.places(tag_2);
    reader.waits(500ms);
    EXPECT_TRUE(reader.is_dialled()) << "at once: there is news";
}

TEST(HartingDeviceNotify, KeepalivesComeInBothForms) {
    for (std::string form : {"old", "new"}) {
        Notified reader("CFG49.KEEPALIVE=1,CFG49.KEEPALIVE-INTERVAL=10,CFG49.HOLD-TIME=30",
                        "keepalive=" + form);
        reader.does("antenna 1=bad");
        EXPECT_FALSE(reader.is_dialled());
        reader.waits(10s);
        reader.takes();
        reader.waits(21s);
        auto said = reader.hears();
        ASSERT_EQ(said.size(), 3u);
        EXPECT_EQ(said[0].control, 0x6E);
        EXPECT_EQ(said[0].status, Status::rf_warning);
        if (form == "old") {
            EXPECT_EQ(to_hex(said[0].data), "0001");
        } else {
            EXPECT_EQ(to_hex(said[0].data).substr(0, 16),
                      "0000005B"
                      "02"
                      "01"
                      "0001");
        }
        EXPECT_EQ(said[0].data.size(), form == "old" ? 2u : 5u + 2 * 31);
        EXPECT_EQ(reader.state("keepalives"), 3);
    }
}

TEST(HartingDeviceNotify, ATriggerDecidesWhenItTells) {
    struct Row {
        std::string_view given;
        std::size_t before, after, forced;  // messages after 1 s, 3 s, and [0x34]
    };
    for (auto& row :
         {Row{"notify_trigger=continuous", 1, 0, 0}, Row{"notify_trigger=time notify_period=3s", 0, 1, 0},
          Row{"notify_trigger=host", 0, 0, 1}}) {
        Notified reader("CFG49.KEEPALIVE=1,CFG49.KEEPALIVE-INTERVAL=100,CFG49.HOLD-TIME=200", row.given);
        reader.waits(100s);
        reader.takes();
        EXPECT_EQ(reader.hears().size(), 1u);
        reader.device.start(reader.now);
        reader.places(tag_1);
        reader.waits(1s);
        EXPECT_EQ(reader.hears().size(), row.before) << row.given;
        reader.waits(3s);
        EXPECT_EQ(reader.hears().size(), row.after) << row.given;
        EXPECT_EQ(reader.status(Command::force_notify_trigger, "00"), Status::ok);
        EXPECT_EQ(reader.hears().size(), row.forced) << row.given;
    }
}

TEST(HartingDeviceNotify, WhatDoesNotFitFollowsInFurtherMessages) {
    Notified reader("CFG49.ACK=1", "tx_buf=512");
    for (int i = 0; i < 60; ++i)
        reader.places(fmt::format("{:024X}", 0x1000 + i));
    reader.waits(1s);
    reader.takes();
    std::size_t tags = 0;
    std::vector<Status> statuses;
    for (auto said = reader.hears(); !said.empty(); said = reader.hears()) {
        for (auto& each : said) {
            if (each.control != 0x22) continue;
            statuses.push_back(each.status);
            tags += records_of(each).tags.size();
            EXPECT_LE(each.data.size() + min_reply, 512u);
        }
        if (reader.state("waiting_for_ack") == 0) break;
        reader.acknowledges();
    }
    EXPECT_EQ(tags, 60u);
    EXPECT_EQ(statuses, (std::vector{Status::more_data, Status::more_data, Status::ok}));
}

TEST(HartingDeviceNotify, WithAReadTriggerEventsAreToldAtOnceAndInMessagesOfTheirOwn) {
    Notified reader(
        "CFG10.ENABLE=1,CFG11.TR-DATA1=0x81,CFG11.TR-DATA2=0x01,CFG12.IN1-EVENT=1,CFG49.HOLD-TIME=60",
        "notify_trigger=time notify_period=30s");
    reader.places(tag_1);
    reader.waits(1s);
    reader.does("input 1=1");
    reader.takes();
    auto said = reader.hears();
    ASSERT_EQ(said.size(), 1u);
    auto event = records_of(said[0]);
    EXPECT_TRUE(event.tags.empty());
    ASSERT_EQ(event.events.size(), 1u);
    EXPECT_EQ(event.events[0].inputs, 1);
    reader.waits(20s);
    EXPECT_TRUE(reader.hears().empty()) << "the tag waits for its time";
    reader.does("input 1=0");
    reader.waits(100ms);
    said = reader.hears();
    ASSERT_EQ(said.size(), 2u) << "what was before it goes first";
    EXPECT_EQ(records_of(said[0]).tags.size(), 1u);
    EXPECT_EQ(records_of(said[1]).events.size(), 1u);
}

TEST(HartingDeviceNotify, AResetLosesWhatWasNotAcknowledgedAndSaysSo) {
    for (bool only : {false, true}) {
        Notified reader("CFG49.ACK=1", "", only);
        reader.places(tag_1);
        reader.waits(1s);
        reader.takes();
        (void)reader.hears();
        reader.does("restart");
        EXPECT_TRUE(reader.link().finished());
        reader.loses();
        EXPECT_EQ(reader.state("sets_lost_at_reset"), 1);
        EXPECT_EQ(reader.state("waiting_for_ack"), 0);
        EXPECT_FALSE(reader.is_dialled());
        reader.waits(3s);
        EXPECT_TRUE(reader.is_dialled()) << "the tag is new again";
    }
}

TEST(HartingDeviceNotify, FaultsReachTheChannel) {
    for (bool only : {false, true}) {
        Notified reader("CFG49.ACK=0,CFG49.KEEPALIVE=0,CFG12.TRANSPONDER-VALID-TIME=0", "", only);
        reader.places(tag_1);
        reader.waits(1s);
        reader.takes();
        (void)reader.hears();
        reader.does("bad_crc");
        reader.waits(500ms);  // a turn of all antennas
        auto bad = taken(reader.link());
        EXPECT_EQ(look_at(bad, wire::Direction::to_host).what, Look::What::wrong);
        reader.does("duplicate");
        EXPECT_EQ(reader.hears().size(), 1u);
        reader.does("half_open on");
        reader.waits(1s);
        EXPECT_TRUE(reader.link().output().empty());
        reader.does("half_open off");
        reader.does("drop");
        EXPECT_TRUE(reader.link().finished());
        reader.loses();
        reader.device.dial_outs();
    }
}

TEST(HartingDeviceNotify, AnotherDestinationOrModeEndsTheLink) {
    Notified reader("CFG49.HOLD-TIME=200");
    reader.places(tag_1);
    reader.waits(1s);
    reader.takes();
    reader.device.start(reader.now);
    EXPECT_EQ(reader.device.dial_outs()[0]->address(), "127.0.0.1:4000");
    reader.sets("CFG49.PORT", "4001");
    EXPECT_TRUE(reader.link().finished());
    reader.loses();
    EXPECT_EQ(reader.device.dial_outs()[0]->address(), "127.0.0.1:4001");
    reader.sets("CFG1.MODE", "Host");
    EXPECT_TRUE(reader.device.dial_outs().empty());
    reader.sets("CFG1.MODE", "Notification");
    EXPECT_EQ(reader.device.dial_outs().size(), 1u);
    reader.sets("CFG49.DESTINATION", "0.0.0.0");
    EXPECT_TRUE(reader.device.dial_outs().empty()) << "nobody to notify";
}

}  // namespace
}  // namespace gantry::harting::device_test
