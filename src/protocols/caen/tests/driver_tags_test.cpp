#include <algorithm>
#include <tuple>

#include "jobs_support.hpp"

namespace gantry::caen::driver_test {

// --- tags --------------------------------------------------------------------------------------------------

TEST(CaenTagJobs, Gen2WordsBecomeBytes) {
    Idle ours;
    ours.answers[Command::g2_read] = [](auto& heard, Bytes& pairs) {
        append_bytes(pairs, Attribute::tag_value,
                     Bytes(static_cast<std::size_t>(heard.number(Attribute::length)), 0x5A));
        return ResultCode::success;
    };
    ReadTag read{.access = access_to(tag_a), .bank = Bank::tid, .offset = 3, .length = 2};
    read.access.password = 0x01020304;
    auto result = ours.does(read);
    EXPECT_EQ(result.status, Status::done) << result.text;
    EXPECT_EQ(value_text(result, "data"), "5A5A5A5A");
    EXPECT_EQ(to_hex(ours.all(Command::g2_read).at(0).bytes).substr(20),
              "00000008000100960000000F00FB536F757263655F3000"
              "00000008000F000C000000120011" +
                  tag_a +
                  "0000000800710002"
                  "00000008004E0006"
                  "0000000800500004"
                  "0000000A007301020304");
}

TEST(CaenTagJobs, ATagThatIsAwayIsTriedOnEverySource) {
    Idle ours("A948EU");
    ours.refuses(Command::g2_read, ResultCode::tag_not_present);
    auto result = ours.does(ReadTag{.access = access_to(tag_a)});
    EXPECT_EQ(result.status, Status::failed);
    EXPECT_EQ(result.text, "tag not present (202), after 3 tries");
    EXPECT_EQ(ours.all(Command::g2_read).size(), 12u);
    EXPECT_EQ(ours.all(Command::g2_read).at(3).text(Attribute::source_name), "Source_3");
}

TEST(CaenTagJobs, TheAntennaSaysWhichSource) {
    Idle ours("A948EU");
    ours.answers[Command::check_read_point_in_source] = [](auto& heard, Bytes& pairs) {
        append_number(pairs, Attribute::boolean, heard.text(Attribute::source_name) == "Source_2" ? 1 : 0);
        return ResultCode::success;
    };
    ReadTag read{.access = access_to(tag_a)};
    read.access.antenna = 3;
    ours.refuses(Command::g2_read, ResultCode::tag_not_present);
    ours.does(read);
    EXPECT_EQ(ours.all(Command::check_read_point_in_source).at(0).text(Attribute::read_point_name), "Ant3");
    EXPECT_EQ(ours.all(Command::g2_read).size(), 3u);
    EXPECT_EQ(ours.all(Command::g2_read).at(0).text(Attribute::source_name), "Source_2");
    read.access.antenna = 9;
    ours.answers[Command::check_read_point_in_source] = gives(Attribute::boolean, 0);
    EXPECT_EQ(ours.does(read).text, "no source that is read has the antenna Ant9");
}

TEST(CaenTagJobs, AWriteIsReadBack) {
    Idle ours;
    Bytes memory(8);
    ours.answers[Command::g2_write] = [&](auto& heard, Bytes&) {
        auto parsed = heard.parsed();
        auto value = parsed.find(Attribute::tag_value)->value;
        std::copy(value.begin(), value.end(), memory.begin());
        return ResultCode::success;
    };
    ours.answers[Command::g2_read] = [&](auto& heard, Bytes& pairs) {
        append_bytes(pairs, Attribute::tag_value,
                     ByteView(memory).first(static_cast<std::size_t>(heard.number(Attribute::length))));
        return ResultCode::success;
    };
    WriteTag write{.access = access_to(tag_a), .bank = Bank::user, .offset = 0, .data = hex("CAFEBABE")};
    EXPECT_EQ(ours.does(write).status, Status::done);
    EXPECT_EQ(ours.asked(), (std::vector<std::string>{"G2Write", "G2Read"}));
    ours.heard.clear();
    EXPECT_EQ(ours.does(write, true).status, Status::done);
    EXPECT_EQ(ours.asked(), (std::vector<std::string>{"G2Read"})) << "it is there already";
    ours.refuses(Command::g2_write, ResultCode::tag_locked);
    auto locked = ours.does(write);
    EXPECT_EQ(locked.status, Status::failed);
    EXPECT_EQ(locked.text, "tag locked (209)");
}

TEST(CaenTagJobs, ALockHasItsTwentyBitsAndAKillItsPassword) {
    Idle ours;
    LockTag lock{.access = access_to(tag_a), .mask = 0x003, .action = 0x002, .address = {}};
    EXPECT_EQ(ours.does(lock).status, Status::done);
    EXPECT_EQ(ours.all(Command::g2_lock).at(0).number(Attribute::payload), 0x0C02);
    KillTag kill{.access = access_to(tag_a), .kill_password = 0xA1B2C3D4};
    EXPECT_EQ(ours.does(kill).status, Status::done);
    EXPECT_EQ(ours.all(Command::g2_kill).at(0).number(Attribute::g2_password), 0xA1B2C3D4);
    ours.refuses(Command::g2_kill, ResultCode::kill_error);
    EXPECT_EQ(ours.does(kill).status, Status::failed);
    lock.address = 5;
    EXPECT_EQ(ours.does(lock).status, Status::failed);
}

TEST(CaenTagJobs, AProgramWritesPcAndEpcOfTheTagThatIsMeant) {
    Idle ours;
    ProgramTag program{.access = access_to(tag_a), .new_id = epc(tag_b), .numbering_system = 0x105};
    EXPECT_EQ(ours.does(program).status, Status::done);
    auto write = ours.all(Command::g2_write).at(0).parsed();
    EXPECT_EQ(to_hex(write.find(Attribute::tag_id)->value), tag_a);
    EXPECT_EQ(to_hex(write.find(Attribute::tag_value)->value), "3105" + tag_b);
    EXPECT_EQ(write.number(Attribute::tag_address), 2u);
    auto look = ours.all(Command::g2_read).at(0).parsed();
    EXPECT_EQ(to_hex(look.find(Attribute::tag_id)->value), tag_b);
    program.new_id = epc("ABCDEF");
    EXPECT_EQ(ours.does(program).status, Status::failed) << "no whole words";
}

TEST(CaenTagJobs, WithoutG2WriteOnlyATagThatIsAloneIsProgrammed) {
    Idle ours("R1230CB");
    ours.refuses(Command::g2_write);
    ours.tags = tag_pairs(tag_a);
    append_tag(ours.tags, tag_b);
    ProgramTag program{.access = access_to(tag_a), .new_id = epc("30000001")};
    program.verify = false;
    auto crowded = ours.does(program);
    EXPECT_EQ(crowded.status, Status::failed);
    EXPECT_NE(crowded.text.find("2 tags are in front of Source_0"), std::string::npos) << crowded.text;
    EXPECT_TRUE(ours.all(Command::g2_program_id).empty());
    ours.tags = tag_pairs(tag_a);
    EXPECT_EQ(ours.does(program).status, Status::done);
    EXPECT_EQ(to_hex(ours.all(Command::g2_program_id).at(0).parsed().find(Attribute::tag_id)->value),
              "30000001");
}

TEST(CaenTagJobs, OtherKindsHaveTheirOwnCommandsAndTheProtocolGoesBack) {
    Idle ours("A948EU");
    using event::Technology;
    ours.answers[Command::read_tag_data] = [](auto&, Bytes& pairs) {
        append_bytes(pairs, Attribute::tag_value, hex("0102"));
        return ResultCode::success;
    };
    auto b = access_to("E00112345678ABCD", Technology::iso18000_6b);
    auto read = ours.does(ReadTag{.access = b, .offset = 9, .length = 2});
    EXPECT_EQ(value_text(read, "data"), "0102");
    EXPECT_EQ(value_text(read, "note"), "the reader left EPCC1G2 for this tag, and is back");
    EXPECT_EQ(ours.all(Command::read_tag_data).at(0).number(Attribute::tag_address), 9);
    auto switched = ours.all(Command::set_protocol);
    ASSERT_EQ(switched.size(), 2u);
    EXPECT_EQ(switched[0].number(Attribute::protocol), 0);
    EXPECT_EQ(switched[1].number(Attribute::protocol), 3);

    ours.answers[Command::read_tag_data] = [](auto&, Bytes& pairs) {
        append_bytes(pairs, Attribute::tag_value, hex("AB"));
        return ResultCode::success;
    };
    EXPECT_EQ(ours.does(WriteTag{.access = b, .offset = 20, .data = hex("AB")}).status, Status::done);
    EXPECT_EQ(ours.all(Command::write_tag_data).size(), 1u);
    EXPECT_EQ(ours.does(LockTag{.access = b, .mask = 0, .action = 0, .address = 20}).status, Status::done);
    EXPECT_EQ(ours.all(Command::lock_tag).at(0).number(Attribute::tag_address), 20);
    EXPECT_EQ(ours.does(KillTag{.access = b}).status, Status::unsupported);

    auto gen1 = access_to(tag_a, Technology::epc_gen1);
    EXPECT_EQ(ours.does(KillTag{.access = gen1, .kill_password = 0x1234}).status, Status::done);
    EXPECT_EQ(ours.all(Command::kill_tag).at(0).number(Attribute::epc_password), 0x1234);
    EXPECT_EQ(ours.does(KillTag{.access = gen1, .kill_password = 0x12345}).status, Status::failed);
    EXPECT_EQ(ours.does(ReadTag{.access = gen1}).status, Status::unsupported);
    ours.tags = tag_pairs(tag_a);
    ProgramTag program{.access = gen1, .new_id = epc(tag_b), .numbering_system = 0, .verify = false};
    EXPECT_EQ(ours.does(program).status, Status::done);
    EXPECT_EQ(ours.all(Command::program_id).size(), 1u);

    program.access.technology = Technology::epc_1_19;
    EXPECT_EQ(ours.does(program).status, Status::done);
    auto last = ours.all(Command::e119_program_id).at(0).parsed();
    EXPECT_EQ(to_hex(last.find(Attribute::tag_value)->value), tag_b);
    program.access.technology = Technology::iso15693;
    EXPECT_EQ(ours.does(program).status, Status::unsupported);
    EXPECT_EQ(ours.all(Command::set_protocol).back().number(Attribute::protocol), 3) << "always back";
}

TEST(CaenTagJobs, AJobThatTimesOutStillPutsTheProtocolBack) {
    Idle ours("A948EU");
    ours.silences(Command::read_tag_data);
    ours.runs(ReadTag{.access = access_to("E00112345678ABCD", event::Technology::iso18000_6b)}, false, 2s);
    ours.waits(3s);
    ASSERT_EQ(ours.ended.size(), 1u);
    EXPECT_EQ(ours.ended[0].result.status, Status::timed_out);
    ours.waits(3s);
    EXPECT_EQ(ours.all(Command::set_protocol).back().number(Attribute::protocol), 3);
    EXPECT_EQ(ours.ended.size(), 1u);
}

TEST(CaenTagJobs, AProtocolThatMayHaveBeenSwitchedIsSetBack) {
    for (bool refused : {false, true}) {
        Idle ours("A948EU");
        int asked = 0;
        ours.answers[Command::set_protocol] = [&](auto&, Bytes&) -> std::optional<ResultCode> {
            if (++asked == 1) return std::nullopt;
            return asked == 2 && refused ? ResultCode::unknown_error : ResultCode::success;
        };
        ours.runs(ReadTag{.access = access_to("E00112345678ABCD", event::Technology::iso18000_6b)});
        ours.waits(6s);
        ASSERT_EQ(ours.ended.size(), 1u);
        EXPECT_EQ(ours.ended[0].result.status, Status::timed_out);
        auto set = ours.all(Command::set_protocol);
        ASSERT_GE(set.size(), 2u);
        EXPECT_EQ(set[1].number(Attribute::protocol), 3);
        EXPECT_EQ(
            std::ranges::count_if(
                ours.faults,
                [](auto& each) { return each.text.find("did not go back to EPCC1G2") != std::string::npos; }),
            refused ? 1 : 0);
    }
}

TEST(CaenTagJobs, EveryConnectionBeginsInTheConfiguredProtocol) {
    auto first_protocol = [](const Given& settings, std::string model) {
        Ours ours(settings, std::move(model));
        ours.starts();
        auto set = ours.all(Command::set_protocol);
        return set.empty() ? -1 : set[0].number(Attribute::protocol);
    };
    EXPECT_EQ(first_protocol({}, "A948EU"), 3) << "a job may have left another one";
    EXPECT_EQ(first_protocol({{"protocol", "ISO18000-6B"}}, "A948EU"), 0);
    EXPECT_EQ(first_protocol({{"protocol", ""}}, "A948EU"), -1);
}

TEST(CaenTagJobs, EveryFailureOfTheReaderHasItsPlace) {
    struct Case {
        ResultCode code;
        Status status;
        std::size_t tries;
    };
    for (auto [code, status, tries] : {Case{ResultCode::tag_not_present, Status::failed, 3},
                                       {ResultCode::tag_read_error, Status::failed, 3},
                                       {ResultCode::insufficient_power, Status::failed, 3},
                                       {ResultCode::bad_tag_address, Status::failed, 1},
                                       {ResultCode::tag_locked, Status::failed, 1},
                                       {ResultCode::invalid_parameter, Status::failed, 1},
                                       {ResultCode::invalid_function, Status::unsupported, 1}}) {
        Idle ours;
        ours.refuses(Command::g2_read, code);
        auto result = ours.does(ReadTag{.access = access_to(tag_a)});
        EXPECT_EQ(result.status, status) << static_cast<int>(code);
        EXPECT_EQ(ours.heard.size(), tries) << static_cast<int>(code);
        EXPECT_NE(result.text.find(caen::describe(static_cast<std::uint16_t>(code))), std::string::npos);
    }
}

TEST(CaenTagJobs, ALinkThatBreaksUnderAWriteLeavesItUnknown) {
    Idle ours;
    ours.silences(Command::g2_write);
    ours.runs(WriteTag{.access = access_to(tag_a), .data = hex("CAFE")});
    ours.driver.link_lost(ours.now);
    ours.collect();
    ASSERT_EQ(ours.ended.size(), 1u);
    EXPECT_EQ(ours.ended[0].result.status, Status::unknown);
}

}  // namespace gantry::caen::driver_test
