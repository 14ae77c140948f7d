// The reader as a whole: its link, its memory, its faults.
#include <random>

#include "device_support.hpp"

namespace gantry::caen::device_test {

using enum Attribute;

TEST(CaenDevice, AnswersTheVectorsOfTheManual) {
    Bench bench(Given{{"model", "R4300P"}, {"serial", "0000123"}, {"firmware", "4.1.0"}});
    // D1, D2, M1, M5 and D9 of vectors.tsv.
    EXPECT_EQ(to_hex(bench.ask(hex("80010001000053580012000000080001009E")).bytes),
              "00010001000053"
              "58002F000000080001009E0000001500765234333030502030303030313233000000000800020000");
    EXPECT_EQ(to_hex(bench.ask(hex("80010002000053580012000000080001007C")).bytes),
              "00010002000053580026000000080001007C0000000C005C342E312E30000000000800020000");
    EXPECT_EQ(to_hex(bench.ask(hex("8001000000005358001C00000008000100740000000A005400000003")).bytes),
              "0001000000005358001A00000008000100740000000800020000");
    EXPECT_EQ(to_hex(bench.ask(hex("8001000000005358001C00000008000100640000000A0096000003E8")).bytes),
              "0001000000005358001A00000008000100640000000800020000");
    EXPECT_EQ(
        to_hex(bench
                   .ask(hex("8001000900005358002C00000008000100780000000B0022416E7430000000000F00FB536F7572"
                            "63655F3000"))
                   .bytes),
        "00010009000053580022000000080001007800000008005700010000000800020000");
}

// The manual's own sample, and the stream as the light library takes it: S1 and D6 of vectors.tsv, 1400 s
// after power on.
TEST(CaenDevice, ReadsAsInTheManualsSample) {
    Bench bench({}, false);
    bench.shelf->add("05629FFFC0113001", event::Technology::iso18000_6b);
    bench.shelf->add("E0040F0E06010000", event::Technology::iso18000_6b);
    bench.sets(Command::set_protocol, {number(protocol, 0)});
    bench.waits(1398960ms);  // one second is over; the last read of the round comes with second 1400
    EXPECT_EQ(
        to_hex(bench.ask(hex("8001000000005358002100000008000100120000000F00FB536F757263655F3000")).bytes),
        "0001000000005358006600000008000100120000000F00FB536F757263655F30000000000B0022416E7430000000000E0010"
        "00000578000000000000000"
        "8000F00080000000E001105629FFFC01130010000000E0011E0040F0E060100000000000800"
        "020000");
}

TEST(CaenDevice, StreamsAsTheLightLibraryExpects) {
    Bench bench;
    bench.waits(1398960ms);
    bench.gets(request(Command::inventory_tag, {source(), number(bitmask, 6)}, 6));
    bench.waits(1s);
    EXPECT_EQ(
        to_hex(bench.says()),
        "0001000600005358000000000008000100130000000F00FB536F757263655F30000000000B0022416E7430000000000E0010"
        "00000578000000000000000800120003000000"
        "08000F000C000000120011300833B2DDD901403505000000000008000200"
        "00");
}

TEST(CaenDevice, EchoesTheMessageIdWhateverItIs) {
    Bench bench;
    for (int i = 0; i < 3; ++i)
        EXPECT_EQ(bench.ask(request(Command::get_power, {}, 0)).parsed.header.id, 0);
    EXPECT_EQ(bench.ask(request(Command::get_power, {}, 0xFFFF)).parsed.header.id, 0xFFFF);
    EXPECT_EQ(bench.ask(request(Command::get_power, {}, 0x0042)).parsed.header.id, 0x0042);
}

TEST(CaenDevice, AnswersPipelinedRequestsInOrder) {
    Bench bench;
    Bytes all;
    auto add = [&](const Bytes& request) { all.insert(all.end(), request.begin(), request.end()); };
    add(request(Command::get_power, {}, 1));
    add(request(Command::raw_read_ids, {source()}, 2));
    add(request(Command::get_protocol, {}, 3));
    add(request(Command::inventory_tag, {source()}, 4));
    add(request(Command::get_io, {}, 5));
    bench.gets(all);
    EXPECT_EQ(messages(bench.says()).size(), 1u) << "an inventory takes its time; what is behind it waits";
    bench.waits(1s);
    std::vector<std::uint16_t> ids;
    for (auto& said : messages(bench.says())) {
        EXPECT_EQ(said.result(), ResultCode::success);
        ids.push_back(said.parsed.header.id);
    }
    EXPECT_EQ(ids, (std::vector<std::uint16_t>{2, 3, 4, 5}));
}

TEST(CaenDevice, TakesRequestsInPiecesOfAnySize) {
    for (std::size_t piece = 1; piece < 40; ++piece) {
        Bench bench;
        auto all = request(Command::set_power, {number(power_set, 700)}, 1);
        auto next = request(Command::get_power, {}, 2);
        all.insert(all.end(), next.begin(), next.end());
        for (std::size_t at = 0; at < all.size(); at += piece)
            bench.gets(ByteView(all).subspan(at, std::min(piece, all.size() - at)));
        auto said = messages(bench.says());
        ASSERT_EQ(said.size(), 2u);
        EXPECT_EQ(said[1].number(power_get), 700u);
    }
}

TEST(CaenDevice, ARequestThatStopsHalfWayIsDropped) {
    Bench bench;
    auto ask = request(Command::set_power, {number(power_set, 700)});
    bench.gets(ByteView(ask).first(20));
    bench.waits(1900ms);
    bench.gets(ByteView(ask).subspan(20));
    EXPECT_EQ(messages(bench.says()).size(), 1u) << "slow is not dead";
    bench.gets(ByteView(ask).first(20));
    bench.waits(2s);
    EXPECT_EQ(bench.ask(Command::get_power).number(power_get), 700u);
    EXPECT_EQ(bench.state("skipped_bytes"), 20);
}

TEST(CaenDevice, FindsItsWayBackAfterGarbage) {
    Bench bench;
    bench.gets(hex("00112233445566778899"));
    EXPECT_EQ(bench.ask(Command::get_power).result(), ResultCode::success);
    EXPECT_GT(bench.state("skipped_bytes"), 0);
}

TEST(CaenDevice, WantsNoMoreThanItCanKeep) {
    Bench bench;
    auto slow = request(Command::raw_read_ids, {source()});
    bench.gets(slow);
    std::size_t given = 0;
    while (bench.device.wants_input()) {
        bench.gets(slow);
        given += slow.size();
        ASSERT_LT(given, 1'000'000u);
    }
    EXPECT_GT(given, 65535u) << "room for the longest message";
    bench.waits(10min);
    bench.says();
    EXPECT_TRUE(bench.device.wants_input());
}

TEST(CaenDevice, AHostThatDoesNotReadIsNotReadFrom) {
    Bench bench;
    auto ask = request(Command::get_reader_info);
    for (std::size_t sent = 0; bench.device.wants_input(); sent += ask.size()) {
        bench.gets(ask);
        ASSERT_LT(sent, 1'000'000u);
    }
    bench.says();
    EXPECT_TRUE(bench.device.wants_input());
}

TEST(CaenDevice, DefaultsAreThoseOfTables41To44) {
    Bench fixed(Given{{"model", "A948EU"}});
    for (unsigned i = 0; i < 4; ++i)
        for (unsigned j = 0; j < 4; ++j)
            EXPECT_EQ(fixed.ask(Command::check_read_point_in_source, {point(i), source(j)}).number(boolean),
                      std::uint32_t{i == j});
    EXPECT_EQ(fixed.state_text("network"), "192.168.0.125 255.255.255.0 192.168.0.1");
    EXPECT_EQ(fixed.state_text("serial_line"), "115200 8 1 parity 0 flow 0");
    Bench module(Given{{"model", "A828EU"}});
    EXPECT_EQ(module.result(Command::raw_read_ids, {source(0)}), ResultCode::success);
    EXPECT_EQ(module.result(Command::raw_read_ids, {source(1)}), ResultCode::source_not_found);
}

TEST(CaenDevice, EveryParameterOfEachSourceIsItsOwn) {
    Bench bench;
    for (std::uint32_t which = 0; which < config_size; ++which) {
        if (which == static_cast<std::uint32_t>(Config::matching)) continue;
        auto get = [&](unsigned of) {
            return bench.ask(Command::get_source_config, {source(of), number(config_parameter, which)})
                .number(config_value);
        };
        auto others = get(0);
        bench.sets(static_cast<Config>(which), 1, 2);
        EXPECT_EQ(get(2), 1u) << which;
        EXPECT_EQ(get(0), others) << which;
    }
    // Q and DESB of the whole reader are those of all sources.
    bench.sets(Command::g2_set_q, {number(q_parameter, 9)});
    auto q = number(config_parameter, static_cast<std::uint32_t>(Config::starting_q));
    EXPECT_EQ(bench.ask(Command::get_source_config, {source(2), q}).number(config_value), 9u);
}

TEST(CaenDevice, PowerIsSetInMilliwattsAndHeardInTheField) {
    Bench bench;
    bench.sets(Command::set_power, {number(power_set, 1000)});
    EXPECT_EQ(bench.ask(Command::get_power).number(power_get), 1000u);
    bench.sets(Command::raw_read_ids, {source()});
    EXPECT_NEAR(bench.shelf->powers.back(), 30.0, 0.001);
}

TEST(CaenDevice, OutputsAreSetAndInputsAreTheWorlds) {
    Bench bench;  // four lines in, then four out
    bench.does("input 1=1");
    EXPECT_EQ(bench.ask(Command::get_io).number(io_register), 0x01u);
    bench.sets(Command::set_io, {number(io_register, 0xFFFFFFA0)});
    EXPECT_EQ(bench.ask(Command::get_io).number(io_register), 0xA1u) << "inputs stay, other bits are nothing";
    EXPECT_EQ(bench.ask(Command::get_io_direction).number(io_register), 0xF0u);
    bench.sets(Command::set_io_direction, {number(io_register, 0x0F)});
    bench.sets(Command::set_io, {number(io_register, 0x03)});
    EXPECT_EQ(bench.ask(Command::get_io).number(io_register), 0x03u);
    EXPECT_FALSE(bench.device.inject("input 1=0", bench.now)) << "an output now";
    EXPECT_TRUE(bench.device.inject("input 8=1", bench.now));
    EXPECT_EQ(bench.ask(Command::get_io).number(io_register), 0x83u);
}

TEST(CaenDevice, ReadPointStatusFollowsTheManualsRevision) {
    auto states = [](const Given& settings) {
        Bench bench(settings);
        std::vector<std::uint32_t> all;
        for (auto state : {"good", "poor", "bad"}) {
            bench.does(std::string("antenna Ant0=") + state);
            all.push_back(bench.ask(Command::check_read_point_status, {point(0)}).number(read_point_status));
        }
        return all;
    };
    using States = std::vector<std::uint32_t>;
    EXPECT_EQ(states({{"model", "A948EU"}}), (States{2, 1, 0}));
    EXPECT_EQ(states({{"model", "A528B"}}), (States{0, 1, 2}));
    EXPECT_EQ(states({}), (States{0, 1, 2}));
    EXPECT_EQ(states({{"model", "A948EU"}, {"status_order", "good_first"}}), (States{0, 1, 2}));
    EXPECT_EQ(states({{"status_order", "good_last"}}), (States{2, 1, 0}));
}

TEST(CaenDevice, AnAntennaThatTheFieldLacksIsBad) {
    Bench bench;
    bench.shelf->connected = {1};
    EXPECT_EQ(bench.ask(Command::check_read_point_status, {point(1)}).number(read_point_status), 2u);
    EXPECT_EQ(bench.result(Command::match_rf_impedance,
                           {point(1), number(config_parameter, 14), number(config_value, 0)}),
              ResultCode::read_point_matching_error);
    bench.does("antenna 2=good");
    EXPECT_EQ(bench.ask(Command::check_read_point_status, {point(1)}).number(read_point_status), 0u);
    bench.does("antenna Ant1=auto");
    EXPECT_EQ(bench.ask(Command::check_read_point_status, {point(1)}).number(read_point_status), 2u);
}

TEST(CaenDevice, TheVswrIsARealNumber) {
    Bench bench;
    auto said = bench.ask(Command::match_rf_impedance,
                          {point(0), number(config_parameter, 14), number(config_value, 0)});
    EXPECT_EQ(said.hex_of(power_vswr), "3FA00000");  // 1.25
}

// --- its clock ---------------------------------------------------------------------------------------------

static std::string time_of_a_read(Bench& bench) {
    return bench.ask(Command::raw_read_ids, {source()}).hex_of(time_stamp);
}

TEST(CaenDevice, TheClockCountsSecondsSincePowerOnUntilItIsSet) {
    Bench bench;
    bench.waits(1399s);  // one is over already
    EXPECT_EQ(time_of_a_read(bench).substr(0, 8), "00000578");
    bench.sets(Command::set_date_time, {text(date_time, "2026-11-22 21:00:00")});
    EXPECT_EQ(time_of_a_read(bench).substr(0, 8), "6B0357D0");
    bench.waits(10s);  // and the one that the read before took
    EXPECT_EQ(time_of_a_read(bench).substr(0, 8), "6B0357DB");
    bench.reboots();
    EXPECT_EQ(time_of_a_read(bench).substr(0, 6), "000000");
}

TEST(CaenDevice, TheClockMayBeSetOrDeadFromTheStart) {
    Bench set(Given{{"clock", "set"}});
    EXPECT_EQ(time_of_a_read(set).substr(0, 4), "6955") << "1 January 2026, as the script's start";
    Bench dead(Given{{"clock", "zero"}});
    EXPECT_EQ(time_of_a_read(dead), "0000000000000000");
}

TEST(CaenDevice, OddTimesAreRefused) {
    Bench bench;
    for (auto odd : {"", "2026-11-22", "2026-11-22T21:00:00", "2026-02-30 00:00:00", "1969-12-31 23:59:59",
                     "2200-01-01 00:00:00", "2026-11-22 25:00:00"})
        EXPECT_EQ(bench.result(Command::set_date_time, {text(date_time, odd)}), ResultCode::invalid_time)
            << odd;
}

// --- restart -----------------------------------------------------------------------------------------------

TEST(CaenDevice, ARestartKeepsTheEepromAndLosesTheRest) {
    Bench bench;
    bench.sets(Command::set_network,
               {text(ip_address, "10.0.0.2"), text(ip_net_mask, "255.0.0.0"), text(ip_gateway, "10.0.0.1")});
    bench.sets(Command::set_rs232, {number(baud_rate, 9600), number(data_bits, 7), number(stop_bits, 2),
                                    number(parity, 1), number(flow_ctrl, 0)});
    bench.sets(Command::set_rf_regulation, {number(rf_regulation, 2)});
    bench.sets(Command::set_power, {number(power_set, 1234)});
    bench.sets(Config::session, 2);
    bench.sets(Command::remove_read_point_from_source, {source(), point()});
    bench.sets(Command::allocate_trigger, {text(trigger_name, "t"), text(trigger_type, "100")});
    bench.reboots();
    EXPECT_EQ(bench.state_text("network"), "10.0.0.2 255.0.0.0 10.0.0.1");
    EXPECT_EQ(bench.state_text("serial_line"), "9600 7 2 parity 1 flow 0");
    EXPECT_EQ(bench.ask(Command::get_rf_regulation).number(rf_regulation), 2u);
    EXPECT_EQ(bench.ask(Command::get_power).number(power_get), 500u);
    EXPECT_EQ(
        bench.ask(Command::get_source_config, {source(), number(config_parameter, 4)}).number(config_value),
        0u);
    EXPECT_EQ(bench.ask(Command::check_read_point_in_source, {point(), source()}).number(boolean), 1u);
    EXPECT_EQ(bench.ask(Command::get_triggers).number(no_of_triggers), 0u);
}

TEST(CaenDevice, WhileItBootsItTakesNoLink) {
    Bench bench;
    bench.does("restart");
    bench.device.link_lost(bench.now);
    bench.waits(1s);
    bench.device.start(bench.now);
    EXPECT_TRUE(bench.device.finished());
    bench.device.link_lost(bench.now);
    bench.waits(1s);
    bench.device.start(bench.now);
    EXPECT_FALSE(bench.device.finished());
    EXPECT_EQ(bench.result(Command::get_power), ResultCode::success);
}

TEST(CaenDevice, AFirmwareUpgradeIsAcceptedAndRestartsIt) {
    Bench bench;
    bench.sets(Command::firmware_upgrade,
               {number(upgrade_type, 1), text(upgrade_argument, "10.0.0.9:image.bin")});
    EXPECT_FALSE(bench.device.finished()) << "the answer goes out first";
    bench.waits(1s);
    EXPECT_TRUE(bench.device.finished());
    EXPECT_EQ(bench.state("restarts"), 1);
    Bench other;
    for (auto odd : {"image.bin", "10.0.0.9:", ":image.bin", "server:image.bin"})
        EXPECT_EQ(
            other.result(Command::firmware_upgrade, {number(upgrade_type, 1), text(upgrade_argument, odd)}),
            ResultCode::bad_address)
            << odd;
}

// --- faults from outside -----------------------------------------------------------------------------------

TEST(CaenDevice, FaultsFromOutside) {
    Bench bench;
    bench.does("result 211");
    EXPECT_EQ(bench.result(Command::get_power), ResultCode::insufficient_power);
    EXPECT_EQ(bench.result(Command::get_power), ResultCode::success) << "the next command only";
    bench.does("busy on");
    EXPECT_EQ(bench.result(Command::get_power), ResultCode::unknown_error);
    EXPECT_EQ(bench.result(Command::deallocate_channel, {text(channel_name, "c")}), ResultCode::channel_busy);
    EXPECT_EQ(bench.result(Command::deallocate_trigger, {text(trigger_name, "t")}), ResultCode::trigger_busy);
    bench.does("busy off");
    bench.does("truncate");
    bench.gets(request(Command::get_power));
    EXPECT_EQ(bench.says().size(), 18u) << "half of 36 bytes";
    bench.does("garbage 100");
    EXPECT_EQ(bench.says().size(), 100u);
    bench.does("silent");
    bench.gets(request(Command::get_power));
    bench.waits(1min);
    EXPECT_TRUE(bench.says().empty());
    EXPECT_FALSE(bench.device.finished());
    bench.does("silent off");
    EXPECT_EQ(bench.result(Command::get_power), ResultCode::success);
    bench.does("drop");
    EXPECT_TRUE(bench.device.finished());
}

TEST(CaenDevice, UnknownFaultsAreRefusedWithTheList) {
    Bench bench;
    for (auto odd : {"", "explode", "input", "input 0=1", "input 9=1", "input 1=2", "antenna Ant7=good",
                     "antenna Ant0=fair", "result x", "result 70000", "garbage -1", "busy maybe"}) {
        auto done = bench.device.inject(odd, bench.now);
        ASSERT_FALSE(done) << odd;
        EXPECT_FALSE(done.error().hint.empty()) << odd;
    }
}

TEST(CaenDevice, StateIsForPeople) {
    Bench bench;
    bench.sets(Command::raw_read_ids, {source()});
    EXPECT_EQ(bench.result(Command::raw_read_ids, {source(3)}), ResultCode::success);
    EXPECT_EQ(bench.state_text("model"), "all");
    EXPECT_EQ(bench.state_text("sources"), "Source_0:Ant0 Source_1:Ant1 Source_2:Ant2 Source_3:Ant3");
    EXPECT_EQ(bench.state("requests"), 2);
    EXPECT_EQ(bench.state("tags_sent"), 1);
    EXPECT_EQ(bench.state("connects"), 1);
    EXPECT_EQ(bench.state_text("inventory"), "off");
}

// --- hostile bytes -----------------------------------------------------------------------------------------

TEST(CaenDevice, RandomBytesDoNoHarm) {
    std::mt19937 random(20261122);
    auto byte = [&] { return static_cast<std::uint8_t>(random() & 0xFF); };
    std::vector<Bytes> seeds;
    for (auto& row : commands())
        seeds.push_back(request(row.code, {source(), number(config_parameter, 0), text(trigger_name, "t")}));
    seeds.push_back(request(Command::inventory_tag, {source(), number(bitmask, 0x146)}));
    seeds.push_back(request(Command::allocate_trigger, {text(trigger_name, "t"), text(trigger_type, "100")}));
    Bench bench;
    for (int round = 0; round < 4000; ++round) {
        auto bytes = seeds[random() % seeds.size()];
        for (auto spoils = random() % 4; spoils > 0; --spoils)
            bytes[random() % bytes.size()] = byte();
        if (random() % 8 == 0) bytes.resize(random() % bytes.size());
        if (random() % 8 == 0) bytes.push_back(abort_byte);
        bench.gets(bytes);
        if (random() % 4 == 0) bench.waits(std::chrono::milliseconds{random() % 300});
        bench.says();
        if (bench.device.finished()) {
            bench.device.link_lost(bench.now);
            bench.waits(3s);
            bench.device.start(bench.now);
        }
    }
    // Whatever state it was left in, a new link works.
    bench.device.link_lost(bench.now);
    bench.waits(3s);
    bench.device.start(bench.now);
    EXPECT_EQ(bench.result(Command::get_reader_info), ResultCode::success);
}

}  // namespace gantry::caen::device_test
