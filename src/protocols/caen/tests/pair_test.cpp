#include <gtest/gtest.h>

#include <functional>
#include <memory>
#include <set>

#include "device_cases.hpp"
#include "link/memory_link.hpp"
#include "protocols/caen/codec.hpp"
#include "protocols/caen/driver.hpp"
#include "protocols/caen/driver_settings.hpp"

// The driver against the virtual reader, joined in memory on virtual time. What both get wrong alike is not
// found here: the vectors and the clients of other people are for that.
namespace gantry::caen::pair_test {

using device_test::Given;
using device_test::Shelf;
using Status = JobResult::Status;

static const std::string tag_a = "3074257BF7194E4000001A85", tag_b = "3074257BF7194E4000001A86";

class Site {
public:
    explicit Site(Given device_settings = {}, Given driver_settings = {}, std::string notify_at = {})
        : device({"caen", 3, device_test::device_with(device_settings)}, shelf),
          notify_at_(std::move(notify_at)) {
        auto settings = Settings::make(caen::driver_settings, driver_settings);
        if (!settings) throw std::invalid_argument(settings.error().text());
        settings_ = *settings;
        device.power_on(now);
        run_for(3s);
        connect();
    }
    void connect() {
        driver = std::make_unique<CaenDriver>(
            DriverOptions{.settings = settings_, .name = "dock-1", .model = {}, .notify_at = notify_at_});
        driver->admitted({}, now);
        link = std::make_unique<link::MemoryLink>(*driver, device, now);
        link->piece = piece;
        link->after_turn = [this] { collect(); };
        link->drop = [this](ByteView bytes, bool from_driver) { return drop && drop(bytes, from_driver); };
        tickets_ = 0;
        link->connect();
    }
    void disconnect() {
        link->cut();
        driver->link_lost(now);
        collect();
        device.link_lost(now);
        side_link_.reset();
        link.reset();
    }
    void run_for(std::chrono::microseconds time) {
        auto end = now + time;
        while (now.steady < end.steady) {
            auto slice = std::min<std::chrono::microseconds>(
                10ms, std::chrono::ceil<std::chrono::microseconds>(end.steady - now.steady));
            if (link) {
                link->run_for(slice);
                now = link->now();
                if (driver->finished()) reasons.emplace_back(driver->finish_reason());
                if (driver->finished() || device.finished()) disconnect();
            } else {
                now = now + slice;
                for (auto due = device.deadline(); due && *due <= now.steady; due = device.deadline())
                    device.time_passed(now);
            }
            if (link) carry_notifications();
        }
    }
    JobResult does(const Job& job, bool again = false) {
        auto id = ++last_job_;
        driver->run({.id = id, .deadline = now.steady + 30s, .again = again}, job, now);
        for (int i = 0; i < 400; ++i) {
            collect();
            for (auto& each : ended)
                if (each.job == id) return each.result;
            run_for(50ms);
        }
        ADD_FAILURE() << "the job never ends";
        return {};
    }
    std::set<std::string> ids() const {
        std::set<std::string> found;
        for (auto& each : seen)
            found.insert(to_hex(each.tag.view()));
        return found;
    }
    std::uint64_t count(Count which) const { return driver->counters()[static_cast<std::size_t>(which)]; }

    Shelf shelf;
    Now now = testkit::script_start;
    CaenDevice device;
    std::unique_ptr<CaenDriver> driver;
    std::unique_ptr<link::MemoryLink> link;
    std::size_t piece = 0;
    std::function<bool(ByteView, bool)> drop;
    std::vector<Observation> seen;
    std::vector<FaultNotice> faults;
    std::vector<JobEnded> ended;
    std::vector<std::string> reasons;
    Described described;
    unsigned dialled = 0;

private:
    void collect() {
        for (auto& signal : driver->signals()) {
            if (auto* job = std::get_if<JobEnded>(&signal)) ended.push_back(*job);
            if (auto* said = std::get_if<Described>(&signal)) described = *said;
        }
        driver->signals().clear();
        for (auto& report : driver->reports()) {
            EXPECT_EQ(report.ticket, ++tickets_);
            for (auto& each : report.observations)
                seen.push_back(each);
            for (auto& notice : report.notices)
                faults.push_back(std::get<FaultNotice>(notice));
        }
        driver->reports().clear();
        if (tickets_ > 0 && !driver->finished()) driver->committed(tickets_, now);
    }
    // The reader's channel to the driver's second end.
    void carry_notifications() {
        auto* side = driver->notifications();
        if (side == nullptr) return;
        auto wanted = device.dial_outs();
        if (!side_link_ && !wanted.empty() && wanted[0]->dial_at() && *wanted[0]->dial_at() <= now.steady) {
            channel_ = wanted[0];
            EXPECT_EQ(channel_->address(), notify_at_);
            side_link_ = std::make_unique<link::MemoryLink>(*side, *channel_, now);
            side_link_->piece = piece;
            side_link_->connect();
            ++dialled;
        }
        if (!side_link_) return;
        side_link_->exchange();
        collect();
        if (!side->finished() && !channel_->finished()) return;
        side_link_->cut();
        side->link_lost(now);
        channel_->link_lost(now);
        side_link_.reset();
    }

    Settings settings_;
    std::string notify_at_;
    Ticket tickets_ = 0;
    JobId last_job_ = 0;
    std::shared_ptr<DialOut> channel_;
    std::unique_ptr<link::MemoryLink> side_link_;
};

static TagAccess access_to(std::string_view id, event::Technology technology = event::Technology::epc_gen2) {
    TagAccess access;
    access.tag = device_test::id_of(id);
    access.technology = technology;
    return access;
}

TEST(CaenPair, EveryModelIsReadTheBestWayItHas) {
    for (auto& model : models()) {
        SCOPED_TRACE(model.name);
        Site site(Given{{"model", std::string(model.name)}});
        site.shelf.add(tag_a);
        site.run_for(5s);
        EXPECT_EQ(site.ids(), std::set<std::string>{tag_a});
        EXPECT_TRUE(site.reasons.empty());
        EXPECT_TRUE(site.faults.empty()) << site.faults[0].text;
        EXPECT_EQ(site.described.firmware, model.firmware);
        EXPECT_EQ(site.count(Count::malformed), 0u);
        EXPECT_EQ(site.count(Count::unknown_code), 0u);
    }
}

TEST(CaenPair, EveryModeSeesTheTags) {
    for (auto mode : {"auto", "raw", "inventory", "framed"})
        for (std::size_t piece : {std::size_t{0}, std::size_t{1}}) {
            SCOPED_TRACE(testing::Message() << mode << " " << piece);
            Site site(Given{}, Given{{"mode", mode}, {"sources", "Source_1"}, {"tid", "true"}});
            site.piece = piece;
            site.disconnect();
            site.connect();
            site.shelf.add(tag_a, event::Technology::epc_gen2, 2);
            site.shelf.add(tag_b, event::Technology::epc_gen2, 2);
            site.run_for(5s);
            EXPECT_EQ(site.ids(), (std::set<std::string>{tag_a, tag_b}));
            for (auto& each : site.seen)
                EXPECT_EQ(each.antenna, 1);
            if (std::string_view(mode) != "raw") {
                EXPECT_EQ(site.seen.back().rssi, -500);
                EXPECT_GT(site.seen.back().data_size, 0u);
            }
        }
}

TEST(CaenPair, PcAndXpcReachTheObservationInEveryModeThatHasThem) {
    for (auto mode : {"raw", "inventory", "framed"})
        for (auto compact : {"false", "true"})
            for (auto pc_size : {"2", "4"}) {
                SCOPED_TRACE(testing::Message() << mode << " compact " << compact << ", PC of " << pc_size);
                Site site(Given{{"pc_size", pc_size}}, Given{{"mode", mode},
                                                             {"sources", "Source_0"},
                                                             {"compact", compact},
                                                             {"xpc", "true"},
                                                             {"pc", "true"}});
                site.shelf.add(tag_a);
                site.shelf.add(tag_b);
                auto& bank = site.shelf.tags[1].banks[Bank::epc];
                bank[2] |= 2;  // the XPC indicator
                bank.resize(0x22 * 2);
                bank[0x42] = 0x08;
                site.run_for(5s);
                EXPECT_EQ(site.ids(), (std::set<std::string>{tag_a, tag_b}));
                bool said = std::string_view(mode) != "raw";
                for (auto& each : site.seen) {
                    bool has_xpc = to_hex(each.tag.view()) == tag_b;
                    EXPECT_EQ(each.pc, !said ? 0 : has_xpc ? 0x3200 : 0x3000);
                    EXPECT_EQ(each.xpc, !said ? Observation::no_xpc : has_xpc ? 0x08000000u : 0u);
                }
            }
}

TEST(CaenPair, StreamsOfBothKindsStopForJobsAndGoOn) {
    for (auto begin : {"none", "result"})
        for (auto end : {"none", "result"}) {
            SCOPED_TRACE(testing::Message() << begin << " " << end);
            Site site(Given{{"stream_start", begin}, {"stream_end", end}, {"model", "R1260I"}});
            site.shelf.add(tag_a);
            site.run_for(2s);
            EXPECT_NE(site.described.detail.find("the framed stream"), std::string::npos);
            auto before = site.seen.size();
            EXPECT_GT(before, 10u);
            for (int i = 0; i < 5; ++i) {
                EXPECT_EQ(site.does(GetInputs{}).status, Status::done);
                site.run_for(1s);
            }
            EXPECT_GT(site.seen.size(), before + 10);
            EXPECT_TRUE(site.faults.empty());
            EXPECT_EQ(site.count(Count::skipped_bytes), 0u);
        }
}

TEST(CaenPair, StreamsOfAllKindsStopForSeveralJobsAtOnce) {
    for (auto begin : {"none", "result"})
        for (auto end : {"none", "result"}) {
            SCOPED_TRACE(testing::Message() << begin << " " << end);
            Site site(Given{{"stream_start", begin}, {"stream_end", end}, {"model", "R1260I"}});
            for (bool tags : {false, true}) {
                if (tags) site.shelf.add(tag_a);
                site.run_for(2s);
                auto from = site.ended.size();
                for (int i = 0; i < 2; ++i)
                    site.driver->run({.id = static_cast<JobId>(1000 + i), .deadline = site.now.steady + 30s},
                                     GetInputs{}, site.now);
                EXPECT_EQ(site.does(GetInputs{}).status, Status::done);
                ASSERT_EQ(site.ended.size(), from + 3);
                for (auto i = from; i < from + 3; ++i)
                    EXPECT_EQ(site.ended[i].result.status, Status::done) << site.ended[i].result.text;
            }
            auto before = site.seen.size();
            site.run_for(2s);
            EXPECT_GT(site.seen.size(), before + 10);
            EXPECT_TRUE(site.reasons.empty());
            EXPECT_TRUE(site.faults.empty());
            EXPECT_EQ(site.count(Count::timeouts), 0u);
            EXPECT_EQ(site.count(Count::skipped_bytes), 0u);
            EXPECT_EQ(site.count(Count::unknown_code), 0u);
        }
}

TEST(CaenPair, SettingsAreAppliedAgainAfterARestart) {
    Site site(Given{}, Given{{"mode", "inventory"}, {"power_mw", "321"}, {"session", "2"}});
    auto power = [&] { return *wire::find(site.does(GetParameter{"Power"}).values, "Power"); };
    auto session = [&] {
        return *wire::find(site.does(GetParameter{"Source_3.Session"}).values, "Source_3.Session");
    };
    EXPECT_EQ(power(), wire::Value(321));
    EXPECT_EQ(session(), wire::Value(2));
    EXPECT_EQ(site.does(SetParameter{"Power", "111"}).status, Status::done);
    EXPECT_EQ(power(), wire::Value(111));
    ASSERT_TRUE(site.device.inject("restart", site.now));
    site.run_for(5s);
    EXPECT_EQ(site.link, nullptr);
    site.connect();
    EXPECT_EQ(power(), wire::Value(321));
    EXPECT_EQ(session(), wire::Value(2));
}

TEST(CaenPair, Gen2JobsChangeTheTag) {
    Site site;
    auto& tag = site.shelf.add(tag_a);
    site.run_for(1s);
    ReadTag read{.access = access_to(tag_a), .bank = Bank::tid, .offset = 0, .length = 6};
    auto result = site.does(read);
    EXPECT_EQ(result.status, Status::done) << result.text;
    EXPECT_EQ(*wire::find(result.values, "data"), wire::Value(tag.banks[Bank::tid]));
    WriteTag write{
        .access = access_to(tag_a), .bank = Bank::user, .offset = 2, .data = device_test::hex("CAFEBABE")};
    EXPECT_EQ(site.does(write).status, Status::done);
    EXPECT_EQ(to_hex(ByteView(tag.banks[Bank::user]).subspan(4, 4)), "CAFEBABE");
    EXPECT_EQ(site.does(write, true).status, Status::done);
    write.offset = 500;
    EXPECT_EQ(site.does(write).text, "bad tag address (205)");
    LockTag lock{.access = access_to(tag_a), .mask = 3, .action = 2, .address = {}};
    EXPECT_EQ(site.does(lock).status, Status::done);
    EXPECT_EQ(tag.lock_mask, 3);
    EXPECT_EQ(tag.lock_action, 2);
    ProgramTag program{.access = access_to(tag_a), .new_id = device_test::id_of(tag_b)};
    EXPECT_EQ(site.does(program).status, Status::done);
    EXPECT_EQ(to_hex(tag.id.view()), tag_b);
    tag.kill_password = 7;
    KillTag kill{.access = access_to(tag_b), .kill_password = 8};
    EXPECT_EQ(site.does(kill).status, Status::failed);
    kill.kill_password = 7;
    EXPECT_EQ(site.does(kill).status, Status::done);
    EXPECT_TRUE(tag.away);
    EXPECT_EQ(site.does(kill, true).status, Status::unknown);
}

TEST(CaenPair, OtherKindsAreReachedAndTheProtocolGoesBack) {
    Site site;
    auto& tag = site.shelf.add("E00112345678ABCD", event::Technology::iso18000_6b);
    auto access = access_to("E00112345678ABCD", event::Technology::iso18000_6b);
    WriteTag write{.access = access, .bank = Bank::user, .offset = 20, .data = device_test::hex("ABCDEF")};
    auto result = site.does(write);
    EXPECT_EQ(result.status, Status::done) << result.text;
    EXPECT_EQ(to_hex(ByteView(tag.banks[Bank::user]).subspan(20, 3)), "ABCDEF");
    EXPECT_EQ(site.does(LockTag{.access = access, .mask = 0, .action = 0, .address = 20}).status,
              Status::done);
    EXPECT_EQ(site.does(write).status, Status::failed);
    EXPECT_EQ(*wire::find(site.does(GetParameter{"Protocol"}).values, "Protocol"),
              wire::Value(std::string("EPCC1G2")));
}

TEST(CaenPair, OutputsAndInputsAreTheReadersLines) {
    Site site(Given{{"model", "A948EU"}});
    EXPECT_EQ(site.does(SetOutputs{{{.output = 2, .state = true, .for_ms = 500}}}).status, Status::done);
    auto outputs = [&] {
        return *wire::find(site.does(GetParameter{"IO"}).values, "IO")->get<std::int64_t>() >> 4;
    };
    EXPECT_EQ(outputs(), 2);
    site.run_for(1s);
    EXPECT_EQ(outputs(), 0);
    ASSERT_TRUE(site.device.inject("input 3=1", site.now));
    auto inputs = site.does(GetInputs{});
    auto& third = (*wire::find(inputs.values, "inputs")->get<wire::Value::List>()).at(2);
    EXPECT_EQ(*wire::find(*third.get<wire::Fields>(), "state"), wire::Value(true));
}

TEST(CaenPair, AllParametersComeInOneJob) {
    Site site;
    auto result = site.does(GetParameter{});
    EXPECT_EQ(result.status, Status::done);
    EXPECT_GT(result.values.size(), 40u);
}

// --- every command of the table
// ------------------------------------------------------------------------------

static Execute execute(std::uint16_t code, const device_test::Pairs& pairs) {
    auto decoded = codec().decode(device_test::request(code, pairs), wire::Direction::to_reader, true);
    return {*decoded.message};
}
static void is_refused(const JobResult& result, ResultCode code) {
    EXPECT_EQ(result.status, Status::failed);
    EXPECT_EQ(result.text, describe(static_cast<std::uint16_t>(code)));
    EXPECT_NE(wire::find(result.values, "ResultCode"), nullptr);
}
static void is_done(const JobResult& result, const std::vector<Attribute>& answers) {
    EXPECT_EQ(result.status, Status::done) << result.text;
    EXPECT_NE(wire::find(result.values, "ResultCode"), nullptr);
    for (auto attribute : answers)
        EXPECT_NE(wire::find(result.values, row_of(attribute).name), nullptr) << row_of(attribute).name;
}

TEST(CaenPair, EveryCommandOfTheTableGoesThroughAsAJobWellAndIll) {
    std::size_t refused_by_the_reader = 0, done = 0;
    for (auto& row : commands()) {
        if (row.reserved || row.notification) continue;
        SCOPED_TRACE(row.name);
        Site site(Given{{"model", "all"}}, Given{{"mode", "inventory"}, {"poll", "1h"}});
        site.shelf.add(device_test::gen2);
        device_test::fill(site.shelf);
        // Whatever the reader refuses it for, its code comes through.
        ASSERT_TRUE(site.device.inject("result 126", site.now));
        const auto* found = device_test::find_case(row.code);
        auto well = found != nullptr ? found->well : device_test::Ask{};
        is_refused(site.does(execute(row.code, well.pairs)), ResultCode::file_system_error);
        if (found == nullptr) {  // known by name alone; two of them mean something without parameters
            bool plain = row.code == 0xA5 || row.code == 0xB8;
            auto result = site.does(execute(row.code, {}));
            plain ? is_done(result, {}) : is_refused(result, ResultCode::unsupported);
            continue;
        }
        for (auto& [command, pairs] : found->before)
            EXPECT_EQ(site.does(execute(static_cast<std::uint16_t>(command), pairs)).status, Status::done);
        // What the table itself does not allow never gets as far as the reader.
        auto ill = execute(row.code, found->ill.pairs);
        auto result = site.does(ill);
        if (codec().check(ill.command, wire::Direction::to_reader) && result.status != Status::unsupported) {
            is_refused(result, found->ill.result);
            ++refused_by_the_reader;
        } else {
            EXPECT_NE(result.status, Status::done);
            EXPECT_FALSE(result.text.empty());
        }
        result = site.does(execute(row.code, well.pairs));
        if (well.result == ResultCode::success) {
            is_done(result, well.answers);
            ++done;
        } else {
            is_refused(result, well.result);
        }
    }
    EXPECT_GT(refused_by_the_reader, 25u);
    EXPECT_GT(done, 65u);
}

TEST(CaenPair, NotificationsComeOverTheReadersOwnLink) {
    for (std::size_t piece : {std::size_t{0}, std::size_t{1}}) {
        Site site(Given{{"model", "A948EU"}}, Given{}, "192.168.0.10:3000");
        site.piece = piece;
        site.shelf.add(tag_a);
        site.run_for(20s);
        EXPECT_NE(site.described.detail.find("reads with notifications"), std::string::npos)
            << site.described.detail;
        EXPECT_EQ(site.dialled, 1u);
        EXPECT_EQ(site.ids(), std::set<std::string>{tag_a});
        EXPECT_GT(site.seen.size(), 10u) << "every read, not only events";
        EXPECT_TRUE(site.faults.empty()) << site.faults[0].text;
        auto before = site.seen.size();
        EXPECT_EQ(site.does(StopReading{}).status, Status::done);
        site.run_for(2s);
        before = site.seen.size();
        site.run_for(10s);
        EXPECT_EQ(site.seen.size(), before);
        EXPECT_TRUE(site.device.dial_outs().empty());
        EXPECT_EQ(site.does(StartReading{}).status, Status::done);
        site.run_for(10s);
        EXPECT_GT(site.seen.size(), before);
    }
}

TEST(CaenPair, ALinkThatBreaksUnderAWriteIsLookedAtAfterwards) {
    Site site(Given{}, Given{{"mode", "inventory"}});
    auto& tag = site.shelf.add(tag_a);
    site.run_for(1s);
    WriteTag write{
        .access = access_to(tag_a), .bank = Bank::user, .offset = 0, .data = device_test::hex("CAFE")};
    site.drop = [&](ByteView, bool from_driver) { return !from_driver; };  // the answer never comes
    site.driver->run({.id = 99, .deadline = site.now.steady + 30s}, write, site.now);
    for (int i = 0; i < 100 && to_hex(ByteView(tag.banks[Bank::user]).first(2)) != "CAFE"; ++i)
        site.run_for(100ms);
    EXPECT_EQ(to_hex(ByteView(tag.banks[Bank::user]).first(2)), "CAFE");
    site.disconnect();
    ASSERT_EQ(site.ended.size(), 1u);
    EXPECT_EQ(site.ended[0].result.status, Status::unknown);
    site.drop = {};
    site.connect();
    auto again = site.does(write, true);
    EXPECT_EQ(again.status, Status::done);
    EXPECT_NE(wire::find(again.values, "note"), nullptr);
}

TEST(CaenPair, ASilentReaderIsLeftAndFoundAgain) {
    Site site(Given{}, Given{{"mode", "inventory"}});
    site.shelf.add(tag_a);
    site.run_for(1s);
    ASSERT_TRUE(site.device.inject("silent on", site.now));
    site.run_for(1min);
    ASSERT_EQ(site.reasons.size(), 1u);
    EXPECT_NE(site.reasons[0].find("without an answer"), std::string::npos);
}

}  // namespace gantry::caen::pair_test
