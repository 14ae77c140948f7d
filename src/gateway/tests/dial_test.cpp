// Readers that the gateway dials, over real TCP: back-off, second links, and jobs that outlive a link.
#include <fcntl.h>

#include "base/log.hpp"
#include "gateway/config_makes.hpp"
#include "gateway/gateway.hpp"
#include "gateway/tests/toy_dial.hpp"
#include "link/link.hpp"
#include "link/pty.hpp"
#include "testkit/eventually.hpp"
#include "testkit/temp_dir.hpp"

namespace gantry::gateway {
namespace {

using test::DingReader;
using testkit::eventually;

Config config_of(const std::string& directory, const std::string& readers) {
    auto config =
        parse_config(fmt::format("[gateway]\nid = \"test\"\ndata_dir = \"{}\"\n[events]\ntag_read = true\n{}",
                                 directory, readers),
                     "test.toml", test::ding_makes);
    EXPECT_TRUE(config) << (config ? "" : config.error().text());
    return config ? *config : Config{};
}

std::string section(std::string_view name, std::uint16_t port, std::string_view more = "") {
    return fmt::format("[[reader]]\nname = \"{}\"\naddress = \"ding://127.0.0.1:{}\"\n{}", name, port, more);
}

struct Site {
    testkit::TempDir dir;
    std::unique_ptr<Gateway> gateway;

    void start(const std::string& readers) {
        auto started = Gateway::start(config_of(dir.path(), readers));
        ASSERT_TRUE(started) << started.error().text();
        gateway = std::move(*started);
    }
    ReaderStatus status(std::string_view name) const {
        for (auto& reader : gateway->readers())
            if (reader.name == name) return reader;
        ADD_FAILURE() << "no reader " << name;
        return {};
    }
    bool becomes(std::string_view name, std::string_view state) const {
        return eventually([&] { return status(name).state.starts_with(state); });
    }
    JobState state_of(JobId id) const { return gateway->jobs().find(id)->state; }
    bool job_becomes(JobId id, JobState state) const {
        return eventually([&] { return state_of(id) == state; });
    }
    std::vector<event::Event> events(event::Type type) const {
        std::vector<event::Event> out;
        journal::Filter filter;
        filter.types = {type};
        auto store = journal::Reader::open(dir.path() + "/gantry.db");
        EXPECT_TRUE(store);
        EXPECT_TRUE((*store)->query(filter, [&](const event::Event& event) {
            out.push_back(event);
            return true;
        }));
        return out;
    }
};

TEST(DialledReader, IsDialledToldItsSettingsAndRead) {
    Site site;
    DingReader reader;
    site.start(section("d-1", reader.port(), "model = \"D2\"\npower_mw = 7\n"));
    auto peer = reader.accept();
    EXPECT_EQ(reader.hello, "hello d-1 model=D2 notify= reading=1 power=7\n");
    ASSERT_TRUE(peer.send("tag E2001122\n"));
    EXPECT_EQ(peer.until("\n"), "committed\n");
    EXPECT_TRUE(site.becomes("d-1", "connected, last read"));
    EXPECT_EQ(site.status("d-1").model, "D1");
    ASSERT_EQ(site.events(event::Type::tag_read).size(), 1u);
    EXPECT_EQ(site.events(event::Type::tag_read)[0].reader, "d-1");
    ASSERT_EQ(site.events(event::Type::reader_connected).size(), 1u);
    EXPECT_LE(site.events(event::Type::reader_connected)[0].time, site.events(event::Type::tag_read)[0].time)
        << "what it said first does not come before it";
}

TEST(DialledReader, TidDataThatCameWithAReadIsStoredAsSuch) {
    Site site;
    DingReader reader;
    site.start(section("d-1", reader.port()));
    auto peer = reader.accept();
    ASSERT_TRUE(peer.send("tid E2001122 E280110520\n"));
    EXPECT_EQ(peer.until("\n"), "committed\n");
    auto reads = site.events(event::Type::tag_read);
    ASSERT_EQ(reads.size(), 1u);
    EXPECT_EQ(to_hex(reads[0].tid), "E280110520");
    EXPECT_TRUE(reads[0].user.empty());
}

TEST(DialledReader, ATidAndUserDataThatCameWithOneReadAreBothStored) {
    Site site;
    DingReader reader;
    site.start(section("d-1", reader.port()));
    auto peer = reader.accept();
    ASSERT_TRUE(peer.send("tid E2001122 E280110520 AABB\n"));
    EXPECT_EQ(peer.until("\n"), "committed\n");
    auto reads = site.events(event::Type::tag_read);
    ASSERT_EQ(reads.size(), 1u);
    EXPECT_EQ(to_hex(reads[0].tid), "E280110520");
    EXPECT_EQ(to_hex(reads[0].user), "AABB");
}

TEST(DialledReader, ThatIsOffIsTriedAgainUntilItIsOnAndDisturbsNobody) {
    Site site;
    DingReader off, on;
    off.switch_off();
    site.start(section("off", off.port()) + section("on", on.port()));
    auto peer = on.accept();
    EXPECT_TRUE(site.becomes("off", "cannot connect: connection refused; next try in "));
    EXPECT_TRUE(site.becomes("on", "connected, nothing read yet"));
    EXPECT_EQ(site.status("off").peer, "");
    off.switch_on();
    auto late = off.accept();
    EXPECT_TRUE(site.becomes("off", "connected"));
}

TEST(DialledReader, IsDialledAgainWhenItsLinkBreaksAndTheEventSaysWhy) {
    Site site;
    DingReader reader;
    site.start(section("d-1", reader.port(), "power_mw = 9\n"));
    for (int round = 0; round < 3; ++round) {
        auto peer = reader.accept();
        EXPECT_TRUE(reader.hello.ends_with("power=9\n")) << "each connection has the settings";
        if (round == 1) {
            ASSERT_TRUE(peer.send("bye\n"));
            EXPECT_TRUE(peer.at_end());
        }
    }
    auto last = reader.accept();
    EXPECT_TRUE(eventually([&] { return site.events(event::Type::reader_connected).size() == 4; }));
    auto ends = site.events(event::Type::reader_disconnected);
    ASSERT_EQ(ends.size(), 3u);
    EXPECT_EQ(ends[0].reason, "closed by the reader");
    EXPECT_EQ(ends[1].reason, "it said goodbye");
}

TEST(DialledReader, ThatTakesConnectionsAndSaysNothingIsNoEventAndOneLine) {
    Site site;
    log::Capture logged;
    DingReader reader;
    site.start(section("d-1", reader.port()));
    // The state between two links lasts only until the next try: who misses it looks after the next link.
    for (int rounds = 0, seen = 0; seen < 3; ++rounds) {
        ASSERT_LT(rounds, 6);
        auto peer = reader.accept_silent();
        EXPECT_FALSE(site.status("d-1").connected);
        peer.close();
        bool shown = false;
        EXPECT_TRUE(eventually([&] {
            auto state = site.status("d-1").state;
            shown = state.starts_with("disconnected: closed by the reader; next try in ");
            return shown || reader.is_called();
        })) << site.status("d-1").state;
        if (shown) ++seen;
    }
    EXPECT_TRUE(site.events(event::Type::reader_connected).empty());
    EXPECT_TRUE(site.events(event::Type::reader_disconnected).empty());
    auto peer = reader.accept();
    EXPECT_TRUE(site.becomes("d-1", "connected"));
    EXPECT_TRUE(eventually([&] { return site.events(event::Type::reader_connected).size() == 1; }));
    auto log = logged.take();
    auto said = log.find("it takes the connection and says nothing; closed by the reader");
    ASSERT_NE(said, std::string::npos) << log;
    EXPECT_EQ(log.find("says nothing", said + 50), std::string::npos) << log;
}

TEST(DialledReader, OnASerialLineIsOpenedWhenTheLineIsThere) {
    Site site;
    auto line = site.dir.path() + "/line";
    site.start(fmt::format("[[reader]]\nname = \"s-1\"\naddress = \"ding+serial://{}?baud=115200\"\n", line));
    EXPECT_TRUE(eventually([&] {
        return site.status("s-1").state.find("; next try in ") != std::string::npos;
    })) << site.status("s-1").state;
    link::Loop loop("line");
    std::unique_ptr<link::Pty> pty;
    link::Socket end;
    loop.run_and_wait([&] {
        auto opened = link::Pty::open(loop, line, 115200);
        ASSERT_TRUE(opened) << opened.error().text();
        pty = std::move(*opened);
        auto connected = pty->connect();
        ASSERT_TRUE(connected) << connected.error().text();
        end = std::move(*connected);
    });
    testkit::Peer peer(end.release());
    ::fcntl(peer.fd(), F_SETFL, ::fcntl(peer.fd(), F_GETFL) & ~O_NONBLOCK);
    EXPECT_TRUE(peer.until("\n").starts_with("hello s-1 "));
    ASSERT_TRUE(peer.send("tag E2001122\n"));
    EXPECT_EQ(peer.until("\n"), "committed\n");
    EXPECT_TRUE(site.becomes("s-1", "connected, last read"));
    loop.run_and_wait([&] { pty.reset(); });
    EXPECT_TRUE(eventually([&] { return !site.status("s-1").connected; })) << "the line was pulled out";
}

TEST(Notifications, ComeInOnASecondLinkAndAreTheSameReaders) {
    Site site;
    DingReader reader;
    site.start(section("d-1", reader.port(), "notify = \"127.0.0.1:0\"\n"));
    auto peer = reader.accept();
    auto listeners = site.gateway->listeners();
    ASSERT_EQ(listeners.size(), 1u);
    auto port = listeners[0].local.port;
    EXPECT_NE(reader.hello.find(fmt::format("notify=127.0.0.1:{} ", port)), std::string::npos)
        << reader.hello;
    EXPECT_TRUE(site.becomes("d-1", "connected"));
    auto side = testkit::Peer::to(port);
    ASSERT_TRUE(side.send("tag E2AA\n"));
    EXPECT_EQ(peer.until("\n"), "committed\n") << "the first link hears of it";
    EXPECT_EQ(site.gateway->listeners()[0].connections, 1u);
    // A newer one takes its place.
    auto newer = testkit::Peer::to(port);
    EXPECT_TRUE(side.at_end());
    EXPECT_EQ(peer.until("\n"), "side lost\n");
    ASSERT_TRUE(newer.send("tag E2BB\n"));
    EXPECT_EQ(peer.until("\n"), "committed\n");
    newer.close();
    EXPECT_EQ(peer.until("\n"), "side lost\n");
    EXPECT_EQ(site.events(event::Type::tag_read).size(), 2u);
    // And it ends with the first link.
    auto third = testkit::Peer::to(port);
    ASSERT_TRUE(third.send("tag E2CC\n"));
    EXPECT_EQ(peer.until("\n"), "committed\n");
    peer.close();
    EXPECT_TRUE(third.at_end());
    EXPECT_TRUE(eventually([&] { return site.gateway->listeners()[0].connections == 0; }));
}

TEST(Notifications, OfNobodyWeKnowAreRefusedAndCounted) {
    Site site;
    DingReader reader;
    reader.switch_off();
    site.start(section("d-1", reader.port(), "notify = \"127.0.0.1:0\"\nadvertise = \"10.1.2.3:3000\"\n"));
    auto port = site.gateway->listeners()[0].local.port;
    auto stranger = testkit::Peer::to(port);
    EXPECT_TRUE(stranger.at_end());
    EXPECT_EQ(site.gateway->listeners()[0].refused, 1u);
    reader.switch_on();
    auto peer = reader.accept();
    EXPECT_NE(reader.hello.find("notify=10.1.2.3:3000 "), std::string::npos) << reader.hello;
}

TEST(GatewayJobs, RunOnTheReaderAndComeBackWithItsAnswer) {
    Site site;
    DingReader reader;
    site.start(section("d-1", reader.port()));
    auto peer = reader.accept();
    auto id = site.gateway->submit("d-1", GetInputs{}, 20s);
    ASSERT_TRUE(id) << id.error().text();
    EXPECT_EQ(peer.until("\n"), fmt::format("job {} gpio.get again=0\n", *id));
    EXPECT_EQ(site.state_of(*id), JobState::running);
    ASSERT_TRUE(peer.send(fmt::format("done {}\n", *id)));
    auto ended = site.gateway->wait_for(*id);
    ASSERT_TRUE(ended);
    EXPECT_EQ(ended->state, JobState::done);
    EXPECT_EQ(*wire::find(ended->values, "answer"), wire::Value(42));
    EXPECT_TRUE(ended->ended);
}

TEST(GatewayJobs, WaitForAReaderThatIsAwayUntilTheirDeadline) {
    Site site;
    DingReader reader;
    reader.switch_off();
    site.start(section("d-1", reader.port()));
    auto late = site.gateway->run("d-1", GetInputs{}, 50ms);
    ASSERT_TRUE(late);
    EXPECT_EQ(late->status, JobResult::Status::cancelled);
    EXPECT_EQ(late->text, "d-1 was not connected before the deadline; it was never sent");
    auto id = site.gateway->submit("d-1", GetInputs{}, 30s);
    ASSERT_TRUE(id);
    EXPECT_EQ(site.state_of(*id), JobState::queued);
    reader.switch_on();
    auto peer = reader.accept();
    EXPECT_EQ(peer.until("\n"), fmt::format("job {} gpio.get again=0\n", *id));
    ASSERT_TRUE(peer.send(fmt::format("failed {}\n", *id)));
    EXPECT_EQ(site.gateway->wait_for(*id)->state, JobState::failed);
}

TEST(GatewayJobs, ThatALinkBrokeUnderRunAgainAndTheDriverKnows) {
    Site site;
    DingReader reader;
    site.start(section("d-1", reader.port()));
    WriteTag write;
    write.access.tag = event::TagId(Bytes{1, 2});
    write.data = {3, 4};
    JobId id = 0;
    {
        auto peer = reader.accept();
        id = *site.gateway->submit("d-1", write, 30s);
        EXPECT_EQ(peer.until("\n"), fmt::format("job {} tag.write again=0\n", id));
    }
    auto peer = reader.accept();
    EXPECT_EQ(peer.until("\n"), fmt::format("job {} tag.write again=1\n", id));
    ASSERT_TRUE(peer.send(fmt::format("done {}\n", id)));
    EXPECT_EQ(site.gateway->wait_for(id)->state, JobState::done);
}

// A driver that gives up its link ends its jobs before the link is gone.
TEST(GatewayJobs, GivenWhileTheLinkEndsWaitForTheNextOne) {
    Site site;
    DingReader reader;
    site.start(section("d-1", reader.port()));
    JobId id = 0;
    {
        auto peer = reader.accept();
        id = *site.gateway->submit("d-1", GetInputs{}, 30s);
        EXPECT_EQ(peer.until("\n"), fmt::format("job {} gpio.get again=0\n", id));
        ASSERT_TRUE(peer.send("drop\n"));
    }
    auto peer = reader.accept();
    EXPECT_EQ(peer.until("\n"), fmt::format("job {} gpio.get again=0\n", id));
    ASSERT_TRUE(peer.send(fmt::format("done {}\n", id)));
    EXPECT_EQ(site.gateway->wait_for(id)->state, JobState::done);
}

TEST(GatewayJobs, ThatCannotBeRepeatedEndAsUnknownWhenTheLinkBreaks) {
    Site site;
    DingReader reader;
    site.start(section("d-1", reader.port()));
    JobId id = 0;
    {
        auto peer = reader.accept();
        id = *site.gateway->submit("d-1", RestartReader{}, 30s);
        EXPECT_EQ(peer.until("\n"), fmt::format("job {} restart again=0\n", id));
    }
    EXPECT_EQ(site.gateway->wait_for(id)->state, JobState::unknown);
    auto peer = reader.accept();
    // What it hears next is a later job, not that one.
    auto next = *site.gateway->submit("d-1", GetInputs{}, 30s);
    EXPECT_EQ(peer.until("\n"), fmt::format("job {} gpio.get again=0\n", next));
}

TEST(GatewayJobs, CanBeCancelledBeforeAndWhileTheyRun) {
    Site site;
    DingReader reader;
    reader.switch_off();
    site.start(section("d-1", reader.port()));
    auto waiting = *site.gateway->submit("d-1", GetInputs{}, 30s);
    EXPECT_TRUE(site.gateway->cancel(waiting));
    EXPECT_EQ(site.state_of(waiting), JobState::cancelled);
    reader.switch_on();
    auto peer = reader.accept();
    auto running = *site.gateway->submit("d-1", GetInputs{}, 30s);
    EXPECT_EQ(peer.until("\n"), fmt::format("job {} gpio.get again=0\n", running));
    EXPECT_TRUE(site.gateway->cancel(running));
    EXPECT_EQ(peer.until("\n"), fmt::format("cancel {}\n", running));
    EXPECT_EQ(site.gateway->wait_for(running)->state, JobState::cancelled);
    EXPECT_TRUE(site.gateway->cancel(running)) << "it has ended, and stays as it is";
    EXPECT_FALSE(site.gateway->cancel(running + 100));
}

TEST(GatewayJobs, ThatStopAReaderHoldOverReconnectsAndRestarts) {
    Site site;
    DingReader reader;
    auto readers = section("d-1", reader.port());
    site.start(readers);
    {
        auto peer = reader.accept();
        auto id = *site.gateway->submit("d-1", StopReading{}, 30s);
        EXPECT_EQ(peer.until("\n"), fmt::format("job {} reader.stop again=0\n", id));
        ASSERT_TRUE(peer.send(fmt::format("done {}\n", id)));
        EXPECT_EQ(site.gateway->wait_for(id)->state, JobState::done);
        EXPECT_TRUE(site.becomes("d-1", "connected, stopped, nothing read yet"));
    }
    {
        auto peer = reader.accept();
        EXPECT_NE(reader.hello.find("reading=0"), std::string::npos) << reader.hello;
        site.gateway.reset();  // before the link ends, or it might dial once more
    }
    site.start(readers);
    {
        auto peer = reader.accept();
        EXPECT_NE(reader.hello.find("reading=0"), std::string::npos) << reader.hello;
        // A start that fails leaves it stopped, one that succeeds does not.
        auto refused = *site.gateway->submit("d-1", StartReading{}, 30s);
        EXPECT_EQ(peer.until("\n"), fmt::format("job {} reader.start again=0\n", refused));
        ASSERT_TRUE(peer.send(fmt::format("failed {}\n", refused)));
        EXPECT_EQ(site.gateway->wait_for(refused)->state, JobState::failed);
        EXPECT_FALSE(site.status("d-1").reading);
        auto id = *site.gateway->submit("d-1", StartReading{}, 30s);
        EXPECT_EQ(peer.until("\n"), fmt::format("job {} reader.start again=0\n", id));
        ASSERT_TRUE(peer.send(fmt::format("done {}\n", id)));
        EXPECT_EQ(site.gateway->wait_for(id)->state, JobState::done);
        site.gateway.reset();
    }
    site.start(readers);
    auto peer = reader.accept();
    EXPECT_NE(reader.hello.find("reading=1"), std::string::npos) << reader.hello;
}

TEST(GatewayJobs, EndWhenTheGatewayStopsAndAreRememberedByTheNext) {
    Site site;
    DingReader on, off;
    off.switch_off();
    auto readers = section("on", on.port()) + section("off", off.port());
    site.start(readers);
    auto peer = on.accept();
    auto waiting = *site.gateway->submit("off", GetInputs{}, 30s);
    auto running = *site.gateway->submit("on", GetInputs{}, 30s);
    EXPECT_EQ(peer.until("\n"), fmt::format("job {} gpio.get again=0\n", running));
    site.gateway.reset();
    peer.close();
    site.start(readers);
    EXPECT_EQ(site.state_of(waiting), JobState::cancelled);
    EXPECT_EQ(site.state_of(running), JobState::unknown);
    auto next = on.accept();
    auto id = *site.gateway->submit("on", GetInputs{}, 30s);
    EXPECT_GT(id, running) << "a number is never used twice";
    EXPECT_EQ(next.until("\n"), fmt::format("job {} gpio.get again=0\n", id)) << "and nothing ran again";
    EXPECT_EQ(site.gateway->jobs().list("", 100).size(), 3u);
    EXPECT_EQ(site.gateway->jobs().list("off", 100).size(), 1u);
    EXPECT_EQ(site.gateway->jobs().list("", 1).at(0).id, id);
}

// As after a crash: the store says what was under way, nobody ended it.
TEST(GatewayJobs, ThatWereUnderWayAtACrashEndAsUnknown) {
    Site site;
    DingReader reader;
    {
        journal::Options options;
        options.path = site.dir.path() + "/gantry.db";
        auto store = journal::Journal::open(options);
        ASSERT_TRUE(store);
        journal::Batch batch;
        batch.time = link::read_clocks().wall;
        batch.jobs.push_back(
            {7, "d-1", "tag.write", "tag 01", "running", "", batch.time, batch.time + 1h, std::nullopt});
        batch.jobs.push_back(
            {8, "d-1", "tag.write", "tag 02", "queued", "", batch.time, batch.time + 1h, std::nullopt});
        ASSERT_TRUE((*store)->commit(batch));
    }
    site.start(section("d-1", reader.port()));
    EXPECT_EQ(site.state_of(7), JobState::unknown);
    EXPECT_EQ(site.state_of(8), JobState::cancelled);
    auto peer = reader.accept();
    auto id = *site.gateway->submit("d-1", GetInputs{}, 30s);
    EXPECT_EQ(id, 9u);
    EXPECT_EQ(peer.until("\n"), "job 9 gpio.get again=0\n");
    site.gateway.reset();
    // It is on the disk, too.
    auto store = journal::Journal::open({.path = site.dir.path() + "/gantry.db"});
    ASSERT_TRUE(store);
    std::map<std::uint64_t, std::string> states;
    ASSERT_TRUE((*store)->load_jobs([&](const journal::JobRow& row) { states[row.id] = row.state; }));
    EXPECT_EQ(states,
              (std::map<std::uint64_t, std::string>{{7, "unknown"}, {8, "cancelled"}, {9, "unknown"}}));
}

}  // namespace
}  // namespace gantry::gateway
