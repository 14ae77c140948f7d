#include "driver_support.hpp"

// Whatever a reader sends, or does not: no crash, no time that stands still, nothing that grows, every job
// ends once.
namespace gantry::harting::driver_test {
namespace {

// --- a good dialog, with each thing the reader says missing or spoilt
// ---------------------------------------

struct Recorded {
    testkit::Script script;
    std::size_t answers = 0;
};

testkit::Step commits() {
    return testkit::does([](Party& party, Now now) {
        auto& driver = static_cast<Driver&>(party);
        driver.signals().clear();
        auto reports = std::exchange(driver.reports(), {});
        if (!reports.empty()) driver.committed(reports.back().ticket, now);
    });
}

Recorded record(const Plan& plan, const std::vector<Job>& jobs) {
    Site site(plan);
    site.places(tag_1);
    site.now = testkit::script_start;  // the script plays at its own time
    Recorded recorded;
    auto& script = recorded.script;
    auto at = site.now.steady;
    auto sync = [&] {
        auto now = site.link ? std::max(site.link->now().steady, site.now.steady) : site.now.steady;
        if (now > at)
            script.push_back(
                testkit::waits(std::chrono::ceil<std::chrono::microseconds>(now - std::exchange(at, now))));
    };
    site.heard = [&](ByteView bytes, bool from_driver) {
        sync();
        script.push_back(from_driver ? testkit::sends(to_hex(bytes)) : testkit::gets(to_hex(bytes)));
        if (from_driver) return;
        script.push_back(commits());
        ++recorded.answers;
    };
    site.connect();
    site.run_for(300ms);
    JobId id = 0;
    for (auto& job : jobs) {
        sync();
        script.push_back(testkit::does([job, order = ++id](Party& party, Now now) {
            static_cast<Driver&>(party).run({.id = order, .deadline = now.steady + 30s}, job, now);
        }));
        site.runs(job);
    }
    site.run_for(300ms);
    return recorded;
}

TEST(HartingDriverProperty, SilenceAndGarbageAtEveryStepAreSurvived) {
    const std::vector<Job> jobs{ReadTag{.access = access_to(tag_1)}, SetParameter{"CFG5.SESSION", "S1", true},
                                GetInputs{}, StopReading{}};
    for (auto& plan :
         std::vector<Plan>{{},
                           {.driver = {{"mode", "host"}, {"permanent", "true"}, {"antennas", "1,2"}}},
                           {.device = "serial=true", .driver = {{"mode", "scan"}}, .link = LinkKind::serial},
                           {.device = "config=CFG0.PASSWORD=11223344,CFG0.LOCK-CFG1=1",
                           .driver = {{"password", "11223344"}}}}) {
        auto recorded = record(plan, jobs);
        EXPECT_GE(recorded.answers, 20u);
        auto make = [&]() -> std::unique_ptr<Party> {
            auto driver = plugin.make_driver(options_of(plan));
            driver->admitted({}, testkit::script_start);
            return driver;
        };
        testkit::play(*make(), recorded.script);
        testkit::survives_every_reply_missing(make, recorded.script);
    }
}

// --- readers that are out of their mind --------------------------------------------------------------------

class Dice {
public:
    explicit Dice(std::uint32_t seed) : state_(seed * 2654435761u + 1) {}
    std::uint32_t roll(std::uint32_t sides) {
        state_ ^= state_ << 13;
        state_ ^= state_ >> 17;
        state_ ^= state_ << 5;
        return state_ % sides;
    }
    std::uint8_t byte() { return static_cast<std::uint8_t>(roll(256)); }
    Bytes bytes(std::uint32_t most) {
        Bytes some(roll(most + 1));
        for (auto& each : some)
            each = byte();
        return some;
    }

private:
    std::uint32_t state_;
};

// Answers to what was asked, wrong in all ways; or noise.
Bytes answer(Dice& dice, ByteView asked, std::uint32_t sane) {
    constexpr std::array<std::uint8_t, 14> statuses = {0x00, 0x00, 0x00, 0x00, 0x01, 0x10, 0x11,
                                                       0x13, 0x82, 0x84, 0x92, 0x93, 0x94, 0x95};
    Bytes out;
    auto look = look_at(asked, wire::Direction::to_reader);
    auto control = look.what == Look::What::frame ? look.frame.control : dice.byte();
    if (dice.roll(8) == 0) control = dice.roll(2) == 0 ? dice.byte() : std::uint8_t{0x22};
    auto status = dice.roll(10) == 0 ? dice.byte() : statuses[dice.roll(statuses.size())];
    Bytes data;
    if (dice.roll(100) < sane) {
        if (control == 0x22) data = hex("11 0001 0014 84000E 3000 300833B2DDD9014035050001 01");
        if (control == 0xB0) data = hex("01 01 84000E 3000 300833B2DDD9014035050001");
        if (control == 0x80) data = Bytes(block_size);
        append_reply(out, 0, control, 0, data);
        return out;
    }
    switch (dice.roll(4)) {
        case 0:
            data = dice.bytes(60);
            break;
        case 1:
            data = Bytes(block_size);
            for (auto& each : data)
                each = dice.roll(3) == 0 ? dice.byte() : std::uint8_t{0};
            break;
        default: {
            auto sets = dice.roll(4);
            data = hex("11 0000");
            data[2] = static_cast<std::uint8_t>(sets);
            for (std::uint32_t i = 0; i < sets; ++i) {
                auto record = hex("0014 84000E 3000 300833B2DDD9014035050001 01");
                record[dice.roll(static_cast<std::uint32_t>(record.size()))] = dice.byte();
                data.insert(data.end(), record.begin(), record.end());
            }
        }
    }
    append_reply(out, 0, control, status, data);
    if (dice.roll(12) == 0) out[dice.roll(static_cast<std::uint32_t>(out.size()))] ^= dice.byte();
    if (dice.roll(12) == 0) out.resize(dice.roll(static_cast<std::uint32_t>(out.size())));
    if (dice.roll(12) == 0) out = dice.bytes(300);
    return out;
}

TEST(HartingDriverProperty, AReaderOutOfItsMindDoesNoHarm) {
    const auto to = access_to(tag_1);
    const std::vector<Job> jobs{GetInputs{},
                                ReadTag{.access = to},
                                GetParameter{},
                                StopReading{},
                                StartReading{},
                                SetParameter{"CFG1.MODE", "Host", true},
                                WriteTag{.access = to, .data = hex("CAFE")},
                                command("Inventory", "00"),
                                command("ReadBuffer", "00FF"),
                                RestartReader{}};
    std::uint64_t reads = 0, finished = 0;
    for (std::uint32_t seed = 0; seed < 400; ++seed) {
        SCOPED_TRACE(seed);
        Dice dice(seed);
        constexpr std::array<const char*, 5> modes = {"buffered", "host", "notification", "scan", "keep"};
        Plan plan{.driver = {{"mode", modes[seed % modes.size()]}, {"password", "11223344"}},
                  .notify_at = "127.0.0.1:4000",
                  .link = seed % 3 == 0   ? LinkKind::serial
                          : seed % 7 == 1 ? LinkKind::listen
                                          : LinkKind::dial};
        auto driver = plugin.make_driver(options_of(plan));
        auto now = testkit::script_start;
        if (plan.link != LinkKind::listen) driver->admitted({.mark = dice.bytes(30)}, now);
        driver->start(now);
        auto* side = driver->notifications();
        if (side != nullptr) side->start(now);
        JobId begun = 0, ended = 0;
        Ticket last = 0;
        auto drain = [&] {
            for (auto& signal : std::exchange(driver->signals(), {})) {
                ended += std::holds_alternative<JobEnded>(signal) ? 1 : 0;
                if (std::holds_alternative<Identified>(signal)) driver->admitted({}, now);
            }
            for (auto& report : std::exchange(driver->reports(), {})) {
                ASSERT_EQ(report.ticket, ++last);
                reads += report.observations.size();
            }
        };
        for (int i = 0; i < 150 && !driver->finished(); ++i) {
            auto asked = device_test::taken(*driver);
            ASSERT_LT(asked.size(), 3000u);
            auto said = answer(dice, asked, seed % 2 == 0 ? 90 : 20);
            if (dice.roll(4) == 0 && side != nullptr && side->wants_input() && !side->finished())
                side->received(said, now);
            else if (driver->wants_input())
                driver->received(said, now);
            ASSERT_LT(side != nullptr ? device_test::taken(*side).size() : 0, 3000u);
            if (dice.roll(6) == 0)
                driver->run({.id = ++begun, .deadline = now.steady + 5s}, jobs[dice.roll(10)], now);
            if (dice.roll(20) == 0) driver->cancel(begun, now);
            drain();
            if (dice.roll(3) == 0 && last > 0) driver->committed(last, now);
            now = now + std::chrono::milliseconds(dice.roll(dice.roll(10) == 0 ? 5000 : 200));
            for (auto* each : std::initializer_list<Party*>{driver.get(), side})
                for (int turn = 0; each != nullptr && turn < 50; ++turn) {
                    auto due = each->deadline();
                    if (!due || *due > now.steady) break;
                    each->time_passed(now);
                    (void)device_test::taken(*driver);
                    ASSERT_LT(turn, 49) << "a deadline that does not move on";
                }
        }
        finished += driver->finished() ? 1u : 0u;
        if (side != nullptr) side->link_lost(now);
        driver->link_lost(now);
        drain();
        EXPECT_EQ(ended, begun);
    }
    EXPECT_GT(reads, 200u) << "some of it was good";
    EXPECT_GT(finished, 10u);
    EXPECT_LT(finished, 390u);
}

}  // namespace
}  // namespace gantry::harting::driver_test
