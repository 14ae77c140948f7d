// Notifications: triggers, channels, events.
#include "device_cases.hpp"
#include "device_support.hpp"

namespace gantry::caen::device_test {

using enum Attribute;

using Texts = std::vector<std::string>;

// A reader set up as the maker's demo does (section 9): read each second, tell each 100 ms.
struct Watch : Bench {
    explicit Watch(const Given& settings = {}) : Bench(settings) { sets_up(); }
    void sets_up() {
        sets(Command::allocate_trigger, {trigger("tell"), text(trigger_type, "100")});
        sets(Command::allocate_trigger, {trigger("read"), text(trigger_type, "1000")});
        sets(Command::allocate_channel, {channel(), text(channel_address, "192.168.0.10:3000")});
        sets(Command::add_source_to_channel, {source(), channel()});
        sets(Command::add_notify_trigger, {channel(), trigger("tell")});
        sets(Command::add_read_trigger, {source(), trigger("read")});
        link = device.dial_outs().at(0);
    }
    void connects() { link->start(now); }
    // The events told since last asked, as "type/id".
    Texts told() {
        Texts events;
        for (auto& said : messages(take_output(*link))) {
            EXPECT_EQ(said.parsed.header.fixed, to_host_head);
            if (said.parsed.command == static_cast<std::uint16_t>(Command::kill_message)) {
                EXPECT_TRUE(said.parsed.avps.empty());
                EXPECT_FALSE(said.parsed.result);
                EXPECT_EQ(said.bytes.size(), 18u) << "one pair of eight bytes";
                events.emplace_back("kill");
                continue;
            }
            EXPECT_EQ(said.parsed.command, static_cast<std::uint16_t>(Command::report_buffer));
            EXPECT_EQ(said.result(), ResultCode::success);
            auto types = said.all(event_type), ids = said.all(tag_id);
            EXPECT_EQ(types.size(), ids.size());
            EXPECT_EQ(said.parsed.avps.size(), 5 * types.size()) << "the five of table 3.1";
            for (std::size_t i = 0; i < types.size(); ++i)
                events.push_back(types[i].substr(7) + "/" + ids[i].substr(22));
        }
        return events;
    }
    Texts after(std::chrono::microseconds time) {
        waits(time);
        return told();
    }
    Shelf::Tag& tag() { return shelf->tags[0]; }

    std::shared_ptr<DialOut> link;
};

TEST(CaenDeviceNotify, DialsTheChannelsAddressAndAgainWhenItIsLost) {
    Watch watch;
    EXPECT_EQ(watch.link->address(), "192.168.0.10:3000");
    EXPECT_EQ(watch.link->dial_at(), watch.now.steady);
    watch.link->dial_failed(watch.now);
    EXPECT_EQ(watch.link->dial_at(), watch.now.steady + 2s);
    watch.connects();
    EXPECT_FALSE(watch.link->dial_at());
    watch.link->link_lost(watch.now);
    EXPECT_EQ(watch.link->dial_at(), watch.now.steady + 2s);
}

TEST(CaenDeviceNotify, TellsThePairsOfTable31InTheirOrder) {
    Watch watch;
    watch.connects();
    watch.waits(1100ms);
    auto said = messages(take_output(*watch.link));
    ASSERT_EQ(said.size(), 1u);
    auto types = said[0].types();
    types.resize(5);
    EXPECT_EQ(types, (std::vector<std::uint16_t>{0x10, 0x0F, 0x11, 0xFB, 0x0E}));
    EXPECT_EQ(said[0].text(source_name), "Source_0");
}

TEST(CaenDeviceNotify, ATagsEventsCountedInReadCycles) {
    Watch watch;
    watch.sets(Config::observed_threshold, 3);
    watch.sets(Config::lost_threshold, 2);
    watch.connects();
    EXPECT_EQ(watch.after(1100ms), Texts{"2/00"}) << "new";
    EXPECT_EQ(watch.after(1s), Texts{});
    EXPECT_EQ(watch.after(1s), Texts{"3/00"}) << "observed";
    EXPECT_EQ(watch.after(5s), Texts{});
    watch.tag().away = true;
    EXPECT_EQ(watch.after(1s), Texts{});
    EXPECT_EQ(watch.after(1s), Texts{"4/00"}) << "lost";
    watch.tag().away = false;
    EXPECT_EQ(watch.after(1s), Texts{"1/00"}) << "back: glimpsed";
    EXPECT_EQ(watch.after(2s), Texts{"3/00"});
    watch.tag().away = true;
    EXPECT_EQ(watch.after(4s), (Texts{"4/00", "5/00"})) << "lost, then purged";
    watch.tag().away = false;
    EXPECT_EQ(watch.after(1s), Texts{"2/00"});
    watch.tag().away = true;
    EXPECT_EQ(watch.after(2s), Texts{"5/00"}) << "never observed: purged at once";
}

TEST(CaenDeviceNotify, InTimeModeThresholdsAreMilliseconds) {
    Watch watch;
    watch.sets(Command::set_event_mode, {number(event_mode, 1)});
    watch.sets(Config::observed_threshold, 1500);
    watch.sets(Config::lost_threshold, 2500);
    watch.connects();
    EXPECT_EQ(watch.after(1100ms), Texts{"2/00"});
    EXPECT_EQ(watch.after(1s), Texts{});
    EXPECT_EQ(watch.after(1s), Texts{"3/00"});
    watch.tag().away = true;
    EXPECT_EQ(watch.after(2s), Texts{});
    EXPECT_EQ(watch.after(1s), Texts{"4/00"});
    EXPECT_EQ(watch.after(2s), Texts{"5/00"});
}

TEST(CaenDeviceNotify, WithoutEventsEveryReadIsTold) {
    Watch watch;
    watch.sets(Command::set_event_mode, {number(event_mode, 2)});
    watch.connects();
    EXPECT_EQ(watch.after(3100ms), (Texts{"0/00", "0/00", "0/00"}));
}

TEST(CaenDeviceNotify, KeepsEventsWhileNobodyListensAndDropsTheOldest) {
    Watch watch(Given{{"channel_buffer", "3"}});
    watch.sets(Command::set_event_mode, {number(event_mode, 2)});
    watch.waits(10500ms);
    EXPECT_EQ(watch.state("events_waiting"), 3);
    EXPECT_EQ(watch.state("events_dropped"), 7);
    watch.connects();
    EXPECT_EQ(watch.after(200ms).size(), 3u);
    EXPECT_EQ(watch.state("events_waiting"), 0);
}

TEST(CaenDeviceNotify, AHostThatDoesNotReadCostsABoundedBuffer) {
    Watch watch;
    watch.shelf->tags.clear();
    for (unsigned i = 0; i < 500; ++i) {
        char id[25];
        std::snprintf(id, sizeof id, "%024X", i + 1);
        watch.shelf->add(id);
    }
    watch.sets(Command::set_event_mode, {number(event_mode, 2)});
    watch.connects();
    watch.waits(5min);
    EXPECT_LT(watch.link->output().size(), 400'000u);
    EXPECT_GT(watch.state("events_dropped"), 0);
    auto told = watch.told();
    EXPECT_EQ(told.size() % 500, 0u);
}

TEST(CaenDeviceNotify, LongReportsAreCutIntoMessages) {
    Watch watch(Given{{"channel_buffer", "5000"}});
    watch.shelf->tags.clear();
    for (unsigned i = 0; i < 3000; ++i) {
        char id[25];
        std::snprintf(id, sizeof id, "%024X", i + 1);
        watch.shelf->add(id);
    }
    watch.sets(Command::set_event_mode, {number(event_mode, 2)});
    watch.connects();
    watch.waits(1050ms);
    watch.waits(100ms);
    auto said = messages(take_output(*watch.link));
    std::size_t events = 0;
    for (auto& each : said)
        events += each.all(tag_id).size();
    EXPECT_EQ(events, 3000u);
    EXPECT_GT(said.size(), 3u);
    EXPECT_EQ(said[1].parsed.header.id, said[0].parsed.header.id + 1);
}

TEST(CaenDeviceNotify, OnlySourcesInTheChannelAreTold) {
    Watch watch;
    watch.connects();
    watch.sets(Command::remove_source_from_channel, {source(), channel()});
    EXPECT_EQ(watch.after(3s), Texts{});
    watch.sets(Command::add_source_to_channel, {source(), channel()});
    watch.sets(Command::remove_read_trigger, {source(), trigger("read")});
    watch.tag().away = true;
    EXPECT_EQ(watch.after(5s), Texts{}) << "nothing makes it read";
}

TEST(CaenDeviceNotify, GoesOnWhileTheCommandLinkIsDown) {
    Watch watch;
    watch.connects();
    watch.device.link_lost(watch.now);
    EXPECT_EQ(watch.after(1100ms), (Texts{"2/00", "3/00"}));
}

TEST(CaenDeviceNotify, TakenDownInReverseItEndsWithTheKillMessage) {
    Watch watch;
    watch.connects();
    EXPECT_EQ(watch.result(Command::deallocate_channel, {channel()}), ResultCode::channel_busy);
    EXPECT_EQ(watch.result(Command::deallocate_trigger, {trigger("read")}), ResultCode::trigger_busy);
    EXPECT_EQ(watch.result(Command::deallocate_trigger, {trigger("tell")}), ResultCode::trigger_busy);
    watch.sets(Command::remove_read_trigger, {source(), trigger("read")});
    watch.sets(Command::remove_notify_trigger, {channel(), trigger("tell")});
    watch.sets(Command::remove_source_from_channel, {source(), channel()});
    EXPECT_FALSE(watch.link->finished());
    watch.sets(Command::deallocate_channel, {channel()});
    watch.sets(Command::deallocate_trigger, {trigger("tell")});
    watch.sets(Command::deallocate_trigger, {trigger("read")});
    EXPECT_EQ(watch.told(), Texts{"kill"});
    EXPECT_TRUE(watch.link->finished());
    EXPECT_FALSE(watch.link->dial_at());
    EXPECT_TRUE(watch.device.dial_outs().empty());
    EXPECT_EQ(watch.ask(Command::get_channels).number(no_of_channels), 0u);
    EXPECT_FALSE(watch.device.deadline()) << "no trigger, no time";
}

TEST(CaenDeviceNotify, ARestartEndsChannelsWithoutAWord) {
    Watch watch;
    watch.connects();
    watch.waits(1050ms);
    watch.does("restart");
    EXPECT_TRUE(watch.link->finished());
    EXPECT_TRUE(watch.link->output().empty());
    EXPECT_TRUE(watch.device.dial_outs().empty());
}

// Its bytes are those of the channel, as long as that speaks.
TEST(CaenDeviceNotify, FaultsOfALinkReachTheChannel) {
    Watch watch;
    watch.sets(Command::set_event_mode, {number(event_mode, 2)});
    watch.connects();
    EXPECT_EQ(watch.after(1100ms), Texts{"0/00"});
    auto does = [&](std::string_view word) { EXPECT_TRUE(watch.device.inject(word, watch.now)) << word; };
    auto bytes_after = [&](std::chrono::microseconds time) {
        watch.waits(time);
        watch.link->time_passed(watch.now);
        return take_output(*watch.link);
    };
    does("garbage 5");
    EXPECT_EQ(take_output(*watch.link).size(), 5u);
    EXPECT_TRUE(take_output(watch.device).empty());
    does("duplicate");
    EXPECT_EQ(watch.told(), Texts{"0/00"});
    auto whole = bytes_after(1s);
    does("truncated");
    EXPECT_EQ(bytes_after(1s).size(), whole.size() / 2);
    does("slow 10s");
    EXPECT_TRUE(bytes_after(9s).empty());
    ASSERT_TRUE(watch.link->deadline());
    does("slow off");
    EXPECT_EQ(bytes_after(13s).size(), whole.size() * 22) << "late, and none is lost";
    does("half-open");
    EXPECT_TRUE(bytes_after(5s).empty());
    EXPECT_FALSE(watch.link->finished());
    does("half-open off");
    EXPECT_EQ(bytes_after(1s).size(), whole.size());
    does("drop");
    EXPECT_TRUE(watch.link->finished());
    EXPECT_TRUE(watch.device.finished());
    watch.link->link_lost(watch.now);
    EXPECT_FALSE(watch.link->finished()) << "it dials again";
    EXPECT_TRUE(watch.link->dial_at());
}

TEST(CaenDeviceNotify, AMemoryThatIsFullLosesEventsAlsoOfAChannelToCome) {
    Watch watch;
    watch.sets(Command::set_event_mode, {number(event_mode, 2)});
    watch.waits(3100ms);
    auto lost = [&] { return *wire::as_number(*wire::find(watch.device.state(), "events_dropped")); };
    EXPECT_EQ(lost(), 0);
    ASSERT_TRUE(watch.device.inject("buffer-full", watch.now));
    EXPECT_EQ(lost(), 3);
    ASSERT_TRUE(watch.device.inject("buffer-full", watch.now));  // nothing is there: the next one
    watch.connects();
    EXPECT_EQ(watch.after(2s), Texts{"0/00"});
    EXPECT_EQ(lost(), 4);
    ASSERT_TRUE(watch.device.inject("reboot", watch.now));
    ASSERT_TRUE(watch.device.inject("buffer-full", watch.now));  // there is no channel
    watch.device.link_lost(watch.now);
    watch.waits(3s);
    watch.device.start(watch.now);
    watch.sets_up();
    watch.sets(Command::set_event_mode, {number(event_mode, 2)});
    watch.waits(3100ms);
    EXPECT_EQ(lost(), 5);
}

TEST(CaenDeviceNotify, ListsNames) {
    Watch watch;
    EXPECT_EQ(watch.ask(Command::get_triggers).all(trigger_name), (Texts{"74656C6C00", "7265616400"}));
    EXPECT_EQ(watch.ask(Command::get_channels).text(channel_name), "events");
}

TEST(CaenDeviceNotify, ChecksSayWhatTheModelsManualSays) {
    auto answers = [](const Given& settings) {
        Watch watch(settings);
        std::vector<std::uint32_t> all;
        for (auto name : {"read", "tell"}) {
            all.push_back(
                watch.ask(Command::check_source_in_trigger, {source(), trigger(name)}).number(boolean));
            all.push_back(
                watch.ask(Command::check_trigger_in_channel, {channel(), trigger(name)}).number(boolean));
            all.push_back(
                watch.ask(Command::check_channel_in_trigger, {channel(), trigger(name)}).number(boolean));
        }
        all.push_back(watch.ask(Command::check_source_in_channel, {source(), channel()}).number(boolean));
        all.push_back(watch.ask(Command::check_source_in_channel, {source(1), channel()}).number(boolean));
        return all;
    };
    using Answers = std::vector<std::uint32_t>;
    const Answers plain{1, 0, 0, 0, 1, 1, 1, 0}, old{0, 1, 1, 1, 0, 0, 1, 0};
    EXPECT_EQ(answers({}), plain);
    EXPECT_EQ(answers({{"model", "A948EU"}}), old) << "CheckSourceInChannel was never turned";
    EXPECT_EQ(answers({{"check_polarity", "true_is_0"}}), old);
    EXPECT_EQ(answers({{"model", "A928EU"}, {"check_polarity", "true_is_1"}}), plain);
}

TEST(CaenDeviceNotify, TriggersThatCannotBeAreRefused) {
    Bench bench;
    auto allocate = [&](std::string_view name, std::string_view type) {
        return bench.result(Command::allocate_trigger, {trigger(name), text(trigger_type, type)});
    };
    EXPECT_EQ(allocate("a", "1000"), ResultCode::success);
    EXPECT_EQ(allocate("b", "TIMED:250"), ResultCode::success);
    EXPECT_EQ(allocate("c", "timed:250"), ResultCode::success);
    EXPECT_EQ(allocate("a", "500"), ResultCode::trigger_name_exists);
    EXPECT_EQ(allocate("", "500"), ResultCode::invalid_trigger_name);
    for (auto odd : {"0", "-5", "12x", "99999999999", "TIMED:0"})
        EXPECT_EQ(allocate("d", odd), ResultCode::bad_timer_value) << odd;
    for (auto odd : {"", "soon", "IO:1", "TIMED:"})
        EXPECT_EQ(allocate("d", odd), ResultCode::bad_trigger) << odd;
    for (int i = 0; i < 13; ++i)
        EXPECT_EQ(allocate("t" + std::to_string(i), "1000"), ResultCode::success);
    EXPECT_EQ(allocate("more", "1000"), ResultCode::too_many_triggers);
}

TEST(CaenDeviceNotify, ChannelsThatCannotBeAreRefused) {
    Bench bench;
    auto allocate = [&](std::string_view name, std::string_view address) {
        return bench.result(Command::allocate_channel, {channel(name), text(channel_address, address)});
    };
    EXPECT_EQ(allocate("a", "10.0.0.1:3000"), ResultCode::success);
    EXPECT_EQ(allocate("a", "10.0.0.1:3001"), ResultCode::channel_name_exists);
    EXPECT_EQ(allocate("b", "10.0.0.1:3000"), ResultCode::address_in_use);
    EXPECT_EQ(allocate("", "10.0.0.1:3002"), ResultCode::invalid_channel_name);
    for (auto odd : {"", "host:3000", "10.0.0:3000", "10.0.0.0.1:3000", "1000.0.0.1:3000", "10..0.1:3000"})
        EXPECT_EQ(allocate("b", odd), ResultCode::bad_address) << odd;
    for (auto odd : {"10.0.0.1", "10.0.0.1:", "10.0.0.1:0", "10.0.0.1:65536", "10.0.0.1:x"})
        EXPECT_EQ(allocate("b", odd), ResultCode::bad_port_address) << odd;
    for (int i = 0; i < 7; ++i)
        EXPECT_EQ(allocate("c" + std::to_string(i), "10.0.0.2:300" + std::to_string(i)), ResultCode::success);
    EXPECT_EQ(allocate("more", "10.0.0.3:3000"), ResultCode::too_many_channels);
    EXPECT_EQ(bench.device.dial_outs().size(), 8u);
}

TEST(CaenDeviceNotify, ALateHostProcessIsNotBuriedInOldTriggers) {
    Watch watch;
    watch.sets(Command::allocate_trigger, {trigger("fast"), text(trigger_type, "1")});
    watch.now = watch.now + 24h;
    watch.device.time_passed(watch.now);
    EXPECT_GT(*watch.device.deadline(), watch.now.steady);
}

}  // namespace gantry::caen::device_test
