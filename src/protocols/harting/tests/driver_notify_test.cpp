#include "driver_support.hpp"

// Notifications: beside the first link, and of readers that only dial in; and frames that the virtual reader
// never sends.
namespace gantry::harting::driver_test {
namespace {

const std::string here = "127.0.0.1:4000";
const Bytes ack = hex("020007FF325447");

Plan notified(Given driver = {}, std::string device = {}) {
    driver.emplace_back("valid_time", "300ms");
    return {.device = std::move(device), .driver = std::move(driver), .notify_at = here};
}
Plan dials_in(std::string device = {}, Given driver = {}) {
    return {
        .device = "connect=localhost:4000 " + device + (device.empty() ? "redial=500ms" : " redial=500ms"),
        .driver = std::move(driver),
        .link = LinkKind::listen};
}

void each_read_once(const Site& site) {
    for (auto& [read, times] : site.reads())
        EXPECT_EQ(times, 1) << read.first << " " << read.second;
}

// --- driver against device ---------------------------------------------------------------------------------

TEST(HartingNotify, ThePacketIsAcknowledgedOnlyWhenItIsOnDisk) {
    for (bool listens : {false, true})
        for (std::size_t piece : {std::size_t{0}, std::size_t{1}}) {
            SCOPED_TRACE(testing::Message() << listens << " pieces of " << piece);
            Site site(listens ? dials_in() : notified());
            site.places(tag_1);
            site.piece = piece;
            site.redials = true;
            if (!listens) site.connect();
            site.run_for(5s);
            EXPECT_GT(site.state("acks"), 3);
            EXPECT_EQ(site.ids(), std::set<std::string>{std::string(tag_1)});
            site.commits = false;
            site.run_for(1s);
            auto acks = site.state("acks");
            site.run_for(13s);  // it is repeated meanwhile
            EXPECT_EQ(site.state("acks"), acks);
            EXPECT_GE(site.state("resent"), 2);
            EXPECT_GE(site.count(Count::repeats), 2u);
            site.commits = true;
            site.commit();
            site.run_for(3s);
            site.removes(tag_1);
            site.run_for(3s);
            each_read_once(site);
            EXPECT_EQ(static_cast<std::int64_t>(site.seen.size()), site.state("sets_stored"));
            EXPECT_EQ(site.state("sets_acked"), site.state("sets_stored"));
            EXPECT_EQ(site.count(Count::malformed) + site.count(Count::unknown_code), 0u);
        }
}

TEST(HartingNotify, WhateverBreaksWhileAnAcknowledgementIsOpenEachReadComesOnce) {
    enum class Break { side_link, both_links, kill_before, kill_after, acks_lost, side_then_slow_disk };
    for (bool listens : {false, true})
        for (auto how : {Break::side_link, Break::both_links, Break::kill_before, Break::kill_after,
                         Break::acks_lost, Break::side_then_slow_disk}) {
            SCOPED_TRACE(testing::Message() << listens << " " << static_cast<int>(how));
            if (listens && (how == Break::side_link || how == Break::side_then_slow_disk)) continue;
            Site site(listens ? dials_in() : notified());
            site.places(tag_1);
            site.redials = true;
            if (!listens) site.connect();
            site.run_for(5s);
            site.commits = false;
            site.run_for(1s);
            auto acks = site.state("acks");
            auto lose_acks = [](ByteView, bool from_driver) { return from_driver; };
            switch (how) {
                case Break::side_link:
                    site.lose_side();
                    site.commit();
                    break;
                case Break::side_then_slow_disk:
                    site.lose_side();
                    site.run_for(4s);  // dialled again and repeated, and still not on disk
                    EXPECT_EQ(site.state("acks"), acks);
                    break;
                case Break::both_links:
                    site.commit();
                    site.disconnect();
                    break;
                case Break::kill_before:
                    while (!site.reports.empty() &&
                           site.reports.back().received.steady > site.now.steady - 1s) {
                        site.seen.resize(site.seen.size() - site.reports.back().observations.size());
                        site.reports.pop_back();
                    }
                    site.kill();
                    break;
                case Break::kill_after:
                    (listens ? site.drop : site.drop_side) = lose_acks;
                    site.commit();
                    site.kill();
                    break;
                case Break::acks_lost:
                    (listens ? site.drop : site.drop_side) = lose_acks;
                    site.commit();
                    site.run_for(12s);
                    EXPECT_EQ(site.state("acks"), acks);
                    break;
            }
            site.drop = site.drop_side = {};
            site.commits = true;
            if (site.driver) site.commit();
            site.run_for(8s);
            site.removes(tag_1);
            site.run_for(8s);
            each_read_once(site);
            EXPECT_EQ(static_cast<std::int64_t>(site.seen.size()), site.state("sets_stored"));
            EXPECT_EQ(site.state("buffered"), 0);
            for (auto& report : site.reports)
                EXPECT_FALSE(report.possible_repeat);
        }
}

TEST(HartingNotify, KeepalivesInBothFormsHoldTheLinkAndSilenceEndsIt) {
    for (auto* form : {"old", "new"})
        for (bool listens : {false, true}) {
            SCOPED_TRACE(testing::Message() << form << " " << listens);
            auto device = fmt::format("keepalive={} config=CFG49.HOLD-TIME=60", form);
            Site site(listens ? dials_in(device) : notified({}, device));
            site.redials = true;
            if (!listens) site.connect();
            site.run_for(2min);
            EXPECT_GT(site.state("keepalives"), 8);
            EXPECT_EQ(site.state("notify_connects"), 1);
            EXPECT_TRUE(site.reasons.empty());
            site.does("antenna 1=bad");
            site.run_for(30s);
            EXPECT_TRUE(site.says("antenna 1 is missing or broken")) << site.faults_text();
            EXPECT_FALSE(site.says("has not dialled"));
            site.does("half_open on");
            site.run_for(2min);
            ASSERT_FALSE(site.reasons.empty());
            EXPECT_NE(site.reasons[0].find(listens ? "no message for" : "without an answer"),
                      std::string::npos)
                << site.reasons[0];
        }
}

TEST(HartingNotify, WithoutAcknowledgementNothingIsAnswered) {
    for (bool listens : {false, true}) {
        Site site(listens ? dials_in("ack=false", {{"acknowledge", "false"}})
                          : notified({{"acknowledge", "false"}}));
        site.places(tag_1);
        site.redials = true;
        if (!listens) site.connect();
        site.run_for(5s);
        site.removes(tag_1);
        site.run_for(2s);
        EXPECT_EQ(site.state("acks"), 0);
        EXPECT_EQ(static_cast<std::int64_t>(site.seen.size()), site.state("sets_stored"));
        each_read_once(site);
    }
}

TEST(HartingNotify, ASlowDiskStopsTheNotificationsAndNotTheCommands) {
    Site site(notified({{"acknowledge", "false"}}));
    site.places(tag_1);
    site.connect();
    site.run_for(2s);
    site.commits = false;
    site.run_for(1min);
    EXPECT_TRUE(site.driver->stalled());
    EXPECT_LE(site.reports.size(), 60u);
    EXPECT_EQ(site.runs(GetInputs{}).status, JobStatus::done);
    EXPECT_TRUE(site.reasons.empty());
    site.commits = true;
    site.commit();
    site.run_for(3s);
    site.removes(tag_1);
    site.run_for(3s);
    each_read_once(site);
    EXPECT_EQ(static_cast<std::int64_t>(site.seen.size()), site.state("sets_stored"));
}

TEST(HartingNotify, JobsGoOnBesideTheNotifications) {
    Site site(notified());
    site.places(tag_1);
    site.connect();
    site.run_for(2s);
    EXPECT_NE(site.described.detail.find("CFG49.DESTINATION from"), std::string::npos)
        << site.described.detail;
    auto result = site.runs(ReadTag{.access = access_to(tag_1)});
    EXPECT_EQ(result.status, JobStatus::done) << result.text;
    EXPECT_EQ(site.runs(command("ForceNotifyTrigger", "00")).status, JobStatus::done);
    EXPECT_EQ(site.state_text("mode"), "Notification");
    EXPECT_EQ(site.runs(StopReading{}).status, JobStatus::done);
    site.run_for(2s);
    site.seen.clear();
    site.run_for(10s);
    EXPECT_TRUE(site.seen.empty());
    EXPECT_EQ(site.runs(StartReading{}).status, JobStatus::done);
    site.run_for(5s);
    EXPECT_FALSE(site.seen.empty());
    each_read_once(site);
}

TEST(HartingNotify, AReaderThatNeverDialsIsToldOnce) {
    Site site(notified());
    site.side_open = false;
    site.places(tag_1);
    site.connect();
    site.run_for(3min);
    auto text = site.faults_text();
    auto told = text.find("has not dialled 127.0.0.1:4000");
    ASSERT_NE(told, std::string::npos) << text;
    EXPECT_EQ(text.find("has not dialled", told + 1), std::string::npos);
    Site nowhere({.driver = {{"mode", "notification"}}}, tag_1);
    nowhere.run_for(1s);
    EXPECT_TRUE(nowhere.says("give the address with `notify`")) << nowhere.faults_text();
}

TEST(HartingNotify, AReaderThatDialsInWaitsUntilItIsAdmittedAndTakesNoJobs) {
    Site site(dials_in());
    site.places(tag_1);
    site.redials = true;
    site.admits = false;
    site.run_for(3s);
    EXPECT_TRUE(site.identified);
    EXPECT_TRUE(site.reports.empty());
    EXPECT_EQ(site.state("acks"), 0);
    site.driver->admitted(site.known, site.now);
    site.run_for(2s);
    EXPECT_FALSE(site.reports.empty());
    EXPECT_GT(site.state("acks"), 0);
    for (auto& job : {Job(GetInputs{}), Job(StopReading{}), Job(command("GetInput"))}) {
        auto result = site.runs(job);
        EXPECT_EQ(result.status, JobStatus::unsupported);
        EXPECT_NE(result.text.find("harting://"), std::string::npos);
    }
}

// --- frames that the virtual reader does not send ----------------------------------------------------------

struct Raw {
    explicit Raw(Given settings = {}) {
        driver = plugin.make_driver(options_of({.driver = std::move(settings), .link = LinkKind::listen}));
        driver->start(now);
    }
    void admit(const Known& known = {}) { driver->admitted(known, now); }
    void gets(ByteView bytes) {
        driver->received(bytes, now);
        take();
    }
    void notification(std::string_view data, std::uint8_t status = 0) {
        Bytes frame;
        append_reply(frame, 0, 0x22, status, hex(data));
        gets(frame);
    }
    void take() {
        for (auto& report : std::exchange(driver->reports(), {}))
            reports.push_back(std::move(report));
        auto said = device_test::taken(*driver);
        EXPECT_EQ(said.size() % ack.size(), 0u);
        for (ByteView left(said); left.size() >= ack.size(); left = left.subspan(ack.size())) {
            EXPECT_EQ(to_hex(left.first(ack.size())), to_hex(ack));
            ++acks;
        }
    }
    void commit() {
        if (reports.empty()) return;
        driver->committed(reports.back().ticket, now);
        take();
    }
    std::size_t reads() const {
        std::size_t all = 0;
        for (auto& report : reports)
            all += report.observations.size();
        return all;
    }

    Now now = testkit::script_start;
    std::unique_ptr<Driver> driver;
    std::vector<Report> reports;
    unsigned acks = 0;
};
// One data set: IDD and antenna, without a time; and with one (TIMER).
const std::string set_a = "0014 84000E 3000" + std::string(tag_1) + "01",
                  set_b = "0014 84000E 3000" + std::string(tag_2) + "01", plain = "11", one = "0001",
                  two = "0002";
const std::string timed_a = "0018 84000E 3000" + std::string(tag_1) + "0C1E0001 01";

TEST(HartingNotify, OnlyOneAcknowledgementIsOpenAndARepeatThatCrossesItGetsNone) {
    Raw raw;
    raw.admit();
    raw.notification("31" + one + timed_a);
    raw.notification("31" + one + timed_a);  // repeated before the disk had it
    EXPECT_EQ(raw.acks, 0u);
    raw.commit();
    EXPECT_EQ(raw.acks, 1u);
    // A repeat that was on its way when we acknowledged: another acknowledgement would be for what comes
    // next.
    raw.now = raw.now + 100ms;
    raw.notification("31" + one + timed_a);
    EXPECT_EQ(raw.acks, 1u);
    raw.notification(plain + one + set_b);
    EXPECT_EQ(raw.acks, 1u);
    raw.commit();
    EXPECT_EQ(raw.acks, 2u);
    EXPECT_EQ(raw.reads(), 2u);
    // Repeated after the time a reader waits: it has not got the acknowledgement.
    raw.now = raw.now + 5s;
    raw.notification(plain + one + set_b);
    EXPECT_EQ(raw.reads(), 3u) << "without a time it is a new read: the last one was acknowledged";
    raw.commit();
    raw.notification("31" + one + timed_a);
    raw.commit();
    raw.now = raw.now + 5s;
    raw.notification("31" + one + timed_a);
    EXPECT_EQ(raw.reads(), 4u);
    EXPECT_EQ(raw.acks, 5u);
    // Two in a row without waiting for us are both on disk before the one acknowledgement.
    raw.notification(plain + one + set_a);
    raw.notification(plain + one + set_b);
    EXPECT_EQ(raw.acks, 5u);
    raw.commit();
    EXPECT_EQ(raw.acks, 6u);
    EXPECT_EQ(raw.reads(), 6u);
}

TEST(HartingNotify, AfterACrashTheFrontThatIsStoredIsKnown) {
    Raw before;
    before.admit();
    before.notification("31" + one + timed_a);
    ASSERT_TRUE(before.reports.at(0).mark);
    const std::string timed_b = "0018 84000E 3000" + std::string(tag_2) + "0C1E0005 01";
    struct Row {
        std::string_view what;
        std::string data;
        bool unreadable;
        std::size_t reads;
        bool doubt;
        unsigned acks_at_once;
    };
    for (auto& row : std::vector<Row>{{"the same", "31" + one + timed_a, false, 0, false, 1},
                                      {"with one behind", "31" + two + timed_a + timed_b, false, 1, false, 0},
                                      {"another", "31" + one + timed_b, false, 1, false, 0},
                                      {"a damaged store", "31" + one + timed_a, true, 1, true, 0}}) {
        SCOPED_TRACE(row.what);
        Raw raw;
        raw.admit(
            {.mark = *before.reports[0].mark, .mark_from_disk = true, .mark_unreadable = row.unreadable});
        raw.notification(row.data);
        EXPECT_EQ(raw.reads(), row.reads);
        EXPECT_EQ(raw.acks, row.acks_at_once);
        raw.commit();
        EXPECT_EQ(raw.acks, 1u);
        if (row.reads > 0) {
            EXPECT_EQ(raw.reports.back().possible_repeat, row.doubt);
            EXPECT_EQ(to_hex(raw.reports.back().observations.back().tag.view()), row.doubt ? tag_1 : tag_2);
        }
    }
}

TEST(HartingNotify, FramesThatMakeNoSenseAreKeptAndAcknowledged) {
    Raw raw;
    raw.admit();
    for (auto* data : {"", "11", "1100", "110001", "110005 0003 84", "FFFFFFFF FFFF", "910001",
                       "11 0001 0000 84", "110000"}) {
        raw.now = raw.now + 1min;
        raw.notification("31" + one + timed_a);
        raw.commit();
        auto acks = raw.acks;
        raw.notification(data, data[0] == 0 ? 0x90 : 0x00);
        raw.commit();
        EXPECT_EQ(raw.acks, acks + 1) << "\"" << data << "\": else it would come for ever";
    }
    EXPECT_GT(raw.driver->counters()[static_cast<std::size_t>(Count::malformed)], 4u);
    // Newer events and answers to our acknowledgement are passed over.
    Bytes other;
    append_reply(other, 0, 0x2A, 0, hex("0102"));
    append_reply(other, 0, 0x32, 0, {});
    append_reply(other, 0, 0x6E, 0, hex("00"));
    auto acks = raw.acks;
    raw.gets(other);
    EXPECT_EQ(raw.acks, acks);
    EXPECT_FALSE(raw.driver->finished());
}

TEST(HartingNotify, AStrangerAtThePortIsCalledOne) {
    for (std::string_view bytes : {"GET / HTTP/1.1\r\nHost: dock\r\n\r\n", "SSH-2.0-OpenSSH_9.2p1\r\n"}) {
        for (bool hangs_up : {false, true}) {
            Raw raw;
            raw.gets(as_bytes(bytes));
            if (hangs_up) raw.driver->link_lost(raw.now);
            for (int i = 0; i < 100 && !raw.driver->finished(); ++i) {
                raw.now = raw.now + 1s;
                raw.driver->time_passed(raw.now);
            }
            EXPECT_TRUE(raw.driver->finished());
            EXPECT_NE(raw.driver->finish_reason().find(fmt::format(
                          "no HARTING reader: the connection began with \"{}", bytes.substr(0, 7))),
                      std::string::npos)
                << raw.driver->finish_reason();
            EXPECT_TRUE(raw.driver->signals().empty());
        }
    }
    Raw raw;
    for (int i = 0; i < 100 && !raw.driver->finished(); ++i) {
        raw.now = raw.now + 1s;
        raw.driver->time_passed(raw.now);
    }
    EXPECT_NE(raw.driver->finish_reason().find("no notification and no keepalive"), std::string::npos);
}

}  // namespace
}  // namespace gantry::harting::driver_test
