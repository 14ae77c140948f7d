#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "protocols/harting/device_info.hpp"
#include "protocols/harting/tests/device_support.hpp"

namespace gantry::harting::device_test {
namespace {

// --- frames ------------------------------------------------------------------------------------------------

TEST(HartingDeviceFrames, ItAnswersItsOwnAddressAnd255WithItsOwn) {
    Reader reader("config=CFG1.COM-ADR=7");
    for (int address : {7, 255}) {
        auto reply = reader.ask(request(Command::get_input, "", static_cast<std::uint8_t>(address)));
        EXPECT_EQ(reply.address, 7);
        EXPECT_EQ(reply.control, 0x74);
    }
    reader.gets(request(Command::get_input, "", 8));
    reader.waits(1s);
    EXPECT_TRUE(reader.device.output().empty());
    EXPECT_EQ(reader.state("foreign"), 1);
}

TEST(HartingDeviceFrames, ABrokenFrameHasNoAnswer) {
    Reader reader;
    reader.gets(hex("02000800B0844FDC"));
    reader.waits(10s);
    EXPECT_TRUE(reader.device.output().empty());
    EXPECT_EQ(reader.status(Command::get_input), Status::ok) << "and the next one has";
    reader.does("drop");
    reader.reconnects();
    EXPECT_EQ(reader.status(Command::baud_rate_detection), Status::ok);
}

TEST(HartingDeviceFrames, APauseWithinAFrameEndsItSerialLinesAfter12Milliseconds) {
    struct Row {
        std::string_view serial;
        std::chrono::microseconds pause;
        bool answered;
    };
    for (auto& row : {Row{"true", 11ms, true}, Row{"true", 13ms, false}, Row{"false", 13ms, true},
                      Row{"false", 3s, false}}) {
        Reader reader("serial=" + std::string(row.serial));
        auto frame = request(Command::get_input);
        reader.gets(ByteView(frame).first(3));
        reader.waits(row.pause);
        reader.gets(ByteView(frame).subspan(3));
        EXPECT_EQ(!taken(reader.device).empty(), row.answered) << row.serial << " " << row.pause.count();
        reader.waits(3s);
        EXPECT_EQ(reader.status(Command::get_input), Status::ok);
    }
}

TEST(HartingDeviceFrames, SeveralRequestsInOnePieceAreAnsweredInTurn) {
    Reader reader;
    auto bytes = request(Command::inventory, "00");
    auto next = request(Command::get_input);
    bytes.insert(bytes.end(), next.begin(), next.end());
    reader.gets(bytes);
    EXPECT_TRUE(reader.device.output().empty()) << "an inventory takes its time";
    reader.waits(200ms);
    auto all = replies(taken(reader.device));
    ASSERT_EQ(all.size(), 2u);
    EXPECT_EQ(all[0].control, 0xB0);
    EXPECT_EQ(all[1].control, 0x74);
}

// --- every command and its wrong forms ---------------------------------------------------------------------

TEST(HartingDeviceCommands, EveryCommandOfTheManualHasAHandler) {
    std::set<std::uint16_t> known;
    for (auto& row : commands()) {
        auto code = static_cast<std::uint16_t>(row.control << 8 | row.sub);
        EXPECT_EQ(find_handler(static_cast<Command>(code)) != nullptr, row.of_manual) << row.name;
    }
}

TEST(HartingDeviceCommands, EachWrongInputHasItsStatus) {
    using enum Command;
    struct Row {
        Command command;
        std::string_view data;
        Status status;
    };
    using enum Status;
    Reader reader;
    reader.sets("CFG12.TRANSPONDER-VALID-TIME", "0");
    for (auto& row : std::initializer_list<Row>{
             {baud_rate_detection, "", ok},
             {baud_rate_detection, "00", length_error},
             {rf_controller_reset, "00", length_error},
             {system_reset, "", length_error},
             {system_reset, "01", parameter_range},
             {get_software_version, "", unknown_command},
             {get_reader_info, "", length_error},
             {get_reader_info, "0000", length_error},
             {get_reader_info, "77", parameter_range},
             {reader_diagnostic, "02", parameter_range},
             {rf_reset, "", ok},
             {rf_reset, "01", length_error},
             {rf_output, "01", ok},
             {rf_output, "15", parameter_range},
             {rf_output, "41", parameter_range},
             {rf_output, "", length_error},
             {set_output, "", length_error},
             {set_output, "0101", length_error},
             {set_output, "010101010005", ok},
             {set_output, "0102810300058203000A", parameter_range},
             {set_output, "020101010005", parameter_range},
             {set_output, "0100", parameter_range},
             {get_input, "00", length_error},
             {read_configuration, "", length_error},
             {read_configuration, "06", read_protect},
             {read_configuration, "95", read_protect},
             {read_configuration, "41", parameter_range},
             {write_configuration, "06", length_error},
             {write_configuration, "060000000000000000000000000000", write_protect},
             {write_configuration, "01FF000801000000000000000000 00", parameter_range},
             {write_configuration, "01000008010000000000000000 0077", parameter_range},
             {write_configuration, "0300107F0000000000000000000000", parameter_range},
             {reset_configuration, "06", write_protect},
             {reset_configuration, "", length_error},
             {set_system_timer, "180000 00", parameter_range},
             {set_system_timer, "1700EA60", parameter_range},
             {set_system_timer, "1700", length_error},
             {set_system_time_and_date, "14190D0100000000 00", parameter_range},
             {set_system_time_and_date, "1419021E0000000000", parameter_range},
             {get_system_timer, "00", length_error},
             {get_system_time_and_date, "00", length_error},
             {lock_region, "", length_error},
             {lock_region, "00", command_not_available},
             {reader_login, "00", length_error},
             {write_aes_reader_keys, "0100", length_error},
             {write_aes_reader_keys, "01000010AABB", length_error},
             {write_aes_reader_keys, "01000002AABB", parameter_range},
             {write_aes_reader_keys, "0100001000112233445566778899AABBCCDDEEFF", ok},
             {write_reader_authentication_key, "01031000112233445566778899AABBCCDDEEFF", parameter_range},
             {write_reader_authentication_key, "01001000112233445566778899AABBCCDDEEFF", ok},
             {read_buffer, "0001", command_not_available},
             {read_data_buffer_info, "", command_not_available},
             {clear_data_buffer, "", command_not_available},
             {initialize_buffer, "", command_not_available},
             {force_notify_trigger, "00", command_not_available},
             {force_notify_trigger, "", length_error},
             {force_notify_trigger, "01", parameter_range},
             {inventory, "", length_error},
             {inventory, "00 01", length_error},
             {inventory, "10", length_error},
             {inventory, "10 00", parameter_range},
             {inventory, "10 10", parameter_range},
             {inventory, "01", parameter_range},
             {inventory, "80", no_valid_data},
             {untraceable, "", length_error},
             {untraceable, "31", command_not_available},
             {authenticate, "31", command_not_available},
         })
        EXPECT_EQ(describe(static_cast<std::uint8_t>(reader.status(row.command, row.data))),
                  describe(static_cast<std::uint8_t>(row.status)))
            << find_command(control_of(row.command), sub_of(row.command))->name << " " << row.data;
    EXPECT_EQ(reader.ask(request(0x77, {})).status, unknown_command);
    EXPECT_EQ(reader.ask(request(0xB0, {})).status, length_error);
    EXPECT_EQ(reader.ask(request(0xB0, hex("7700"))).status, unknown_command);
    EXPECT_EQ(reader.ask(request(0x74, Bytes(2042))).status, length_error) << "longer than RX-BUF";
    EXPECT_EQ(reader.state("keys"), 2);
}

TEST(HartingDeviceCommands, WhileItReadsByItselfHostCommandsAreNotAvailable) {
    for (std::string mode : {"Scan", "BufferedRead", "Notification"}) {
        Reader reader("config=CFG1.MODE=" + mode);
        for (auto& row : commands()) {
            if (!row.on_tags || !row.of_manual) continue;
            auto data = hex("00");
            data.insert(data.begin(), row.sub);
            EXPECT_EQ(reader.ask(request(row.control, data)).status, Status::command_not_available)
                << mode << " " << row.name;
        }
        EXPECT_EQ(reader.status(Command::get_input), Status::ok);
        // [0x6A] with its highest bit keeps it in host mode; without, it goes on.
        EXPECT_EQ(reader.status(Command::rf_output, "81"), Status::ok);
        EXPECT_EQ(reader.status(Command::inventory, "00"), Status::ok);
        EXPECT_EQ(reader.status(Command::rf_output, "01"), Status::ok);
        EXPECT_EQ(reader.status(Command::inventory, "00"), Status::command_not_available);
    }
}

TEST(HartingDeviceCommands, InfoAndDiagnosticRecordsAreThoseOfTheTables) {
    Reader reader;
    struct Kind {
        Command command;
        std::span<const RecordRow> rows;
        std::span<const InfoRow> made;
    };
    for (auto& kind : {Kind{Command::get_reader_info, info_records(), info_rows()},
                       Kind{Command::reader_diagnostic, diagnostic_records(), diagnostic_rows()}}) {
        EXPECT_EQ(kind.rows.size(), kind.made.size());
        for (auto& row : kind.rows) {
            auto reply = reader.ask(request(control_of(kind.command), Bytes{row.mode}));
            EXPECT_EQ(reply.status, Status::ok) << row.name;
            wire::Fields fields;
            wire::Reader in(reply.data);
            decode_record(row.layout, in, fields);
            EXPECT_FALSE(in.fault()) << row.name;
            EXPECT_EQ(wire::find(fields, rest_field), nullptr) << row.name;
        }
        auto all = reader.ask(kind.command, "FF");
        EXPECT_EQ(all.data.size(), 1 + kind.rows.size() * (1 + padded_record));
        wire::Fields fields;
        EXPECT_TRUE(decode_reply(row_of(kind.command), hex("FF"), 0, all.data, fields));
    }
    auto firmware = reader.ask(Command::get_reader_info, "00");
    EXPECT_EQ(firmware.data[4], 91);
    EXPECT_EQ(to_hex(ByteView(firmware.data).subspan(7)), "08000800");
    EXPECT_EQ(to_hex(reader.ask(Command::get_reader_info, "40").data), "0040FC7D8BF060C04001")
        << "the blocks that the manual names";
}

// --- configuration, passwords, resets ----------------------------------------------------------------------

TEST(HartingDeviceConfig, RamIsLostAtAResetAndTheEepromIsNot) {
    Reader reader;
    reader.sets("CFG12.TRANSPONDER-VALID-TIME", "7");
    reader.sets("CFG49.PORT", "4000", true);
    EXPECT_EQ(to_hex(reader.ask(Command::read_configuration, "0C").data).substr(0, 4), "0007");
    EXPECT_EQ(to_hex(reader.ask(Command::read_configuration, "8C").data).substr(0, 4), "0037");
    EXPECT_EQ(to_hex(reader.ask(Command::read_configuration, "31").data).substr(22, 4), "0FA0")
        << "what goes to the EEPROM is in the RAM";
    EXPECT_EQ(reader.status(Command::rf_controller_reset), Status::ok);
    reader.reconnects();
    EXPECT_EQ(to_hex(reader.ask(Command::read_configuration, "0C").data).substr(0, 4), "0037");
    EXPECT_EQ(to_hex(reader.ask(Command::read_configuration, "31").data).substr(22, 4), "0FA0");
    EXPECT_EQ(reader.status(Command::reset_configuration, "C0"), Status::ok) << "all blocks";
    EXPECT_EQ(to_hex(reader.ask(Command::read_configuration, "B1").data).substr(22, 4), "0000");
}

TEST(HartingDeviceConfig, TheBusAddressChangesWithTheNextResetTheModeAtOnce) {
    Reader reader;
    reader.sets("CFG1.COM-ADR", "9", true);
    EXPECT_EQ(reader.ask(Command::get_input).address, 0);
    reader.sets("CFG1.MODE", "BufferedRead", true);
    EXPECT_EQ(reader.status(Command::inventory, "00"), Status::command_not_available);
    EXPECT_EQ(reader.status(Command::system_reset, "00"), Status::ok);
    reader.reconnects();
    EXPECT_EQ(reader.ask(Command::get_input).address, 9);
    EXPECT_EQ(reader.status(Command::inventory, "00"), Status::command_not_available);
}

TEST(HartingDeviceConfig, LockedBlocksNeedALoginThatAResetTakesBack) {
    Reader reader;
    reader.sets("CFG0.LOCK-CFG12", "1", true);
    reader.sets("CFG0.LOCK-CFG22-29", "1", true);
    reader.sets("CFG0.PASSWORD", "11223344", true);
    auto closed = [&](std::string_view block) {
        auto read = reader.status(Command::read_configuration, block);
        auto reset = reader.status(Command::reset_configuration, block);
        EXPECT_EQ(read, reset);
        return read == Status::login_request;
    };
    EXPECT_TRUE(closed("0C"));
    EXPECT_TRUE(closed("8C"));
    EXPECT_TRUE(closed("1B"));
    EXPECT_FALSE(closed("31"));
    EXPECT_EQ(reader.status(Command::reset_configuration, "40"), Status::login_request) << "all";
    EXPECT_EQ(reader.status(Command::write_aes_reader_keys, "0100001000112233445566778899AABBCCDDEEFF"),
              Status::login_request);
    EXPECT_EQ(reader.status(Command::lock_region, "01"), Status::login_request);
    EXPECT_EQ(to_hex(reader.ask(Command::get_reader_info, "41").data).substr(6, 2), "75");
    EXPECT_EQ(reader.status(Command::reader_login, "11223344"), Status::ok);
    EXPECT_FALSE(closed("0C"));
    EXPECT_EQ(reader.status(Command::read_configuration, "06"), Status::read_protect) << "reserved stays so";
    EXPECT_EQ(reader.status(Command::reader_login, "11223345"), Status::login_error);
    EXPECT_TRUE(closed("0C")) << "a wrong password logs out";
    EXPECT_EQ(reader.status(Command::reader_login, "11223344"), Status::ok);
    EXPECT_EQ(reader.status(Command::rf_controller_reset), Status::ok);
    reader.reconnects();
    EXPECT_TRUE(closed("0C"));
}

TEST(HartingDeviceConfig, ABrokenBlockMakesEeInitModeUntilTheSecondReset) {
    Reader reader("config=CFG1.MODE=BufferedRead,CFG12.TRANSPONDER-VALID-TIME=3");
    reader.does("eeprom CFG12");
    EXPECT_EQ(reader.status(Command::get_input), Status::ok) << "it looks only when it starts";
    EXPECT_EQ(reader.status(Command::rf_controller_reset), Status::ok);
    reader.reconnects();
    EXPECT_EQ(reader.state_text("mode"), "EE-Init");
    for (auto command : {Command::get_input, Command::rf_controller_reset, Command::read_data_buffer_info})
        EXPECT_EQ(reader.status(command), Status::eeprom_failure);
    reader.waits(1s);
    EXPECT_EQ(reader.state("sets_stored"), reader.state("sets_lost_at_reset")) << "it does not read";
    EXPECT_EQ(reader.status(Command::system_reset, "00"), Status::ok);
    reader.reconnects();
    EXPECT_EQ(reader.state_text("mode"), "BufferedRead");
    EXPECT_EQ(to_hex(reader.ask(Command::read_configuration, "8C").data).substr(0, 4), "0037")
        << "the broken block, and only that, has its factory values";
}

TEST(HartingDeviceConfig, AResetTakesItsTimeAndPowerCanBeOff) {
    Reader reader("boot=3s");
    EXPECT_EQ(reader.status(Command::rf_controller_reset), Status::ok);
    EXPECT_TRUE(reader.device.finished());
    reader.device.link_lost(reader.now);
    reader.waits(2s);
    reader.device.start(reader.now);
    EXPECT_TRUE(reader.device.finished()) << "who dials too early is turned away";
    reader.device.link_lost(reader.now);
    reader.waits(1s);
    reader.device.start(reader.now);
    EXPECT_FALSE(reader.device.finished());
    reader.does("power off");
    EXPECT_TRUE(reader.device.finished());
    reader.device.link_lost(reader.now);
    reader.waits(1h);
    reader.device.start(reader.now);
    EXPECT_TRUE(reader.device.finished());
    reader.device.link_lost(reader.now);
    reader.does("power on");
    reader.waits(4s);
    reader.device.start(reader.now);
    EXPECT_EQ(reader.status(Command::get_input), Status::ok);
    EXPECT_EQ(to_hex(reader.ask(Command::get_system_timer).data), "00000FA0") << "4 s since power-on";
}

TEST(HartingDeviceConfig, OnASerialLineAResetOnlyKeepsItSilent) {
    Reader reader("serial=true");
    EXPECT_EQ(reader.status(Command::rf_controller_reset), Status::ok);
    EXPECT_FALSE(reader.device.finished());
    reader.gets(request(Command::get_input));
    reader.waits(1s);
    EXPECT_TRUE(reader.device.output().empty());
    reader.waits(2s);
    EXPECT_EQ(reader.status(Command::get_input), Status::ok);
}

// --- clock and lines ---------------------------------------------------------------------------------------

TEST(HartingDeviceClock, ItRunsFromPowerOnUntilItIsSet) {
    Reader reader;
    EXPECT_EQ(to_hex(reader.ask(Command::get_system_time_and_date).data),
              "1400010100"
              "000003E8");
    EXPECT_EQ(reader.status(Command::set_system_time_and_date, "141A0B1E02173AEA5F"), Status::ok);
    reader.waits(2min);
    EXPECT_EQ(to_hex(reader.ask(Command::get_system_time_and_date).data),
              "141A0C0102"
              "0000EA5F");
    EXPECT_EQ(reader.status(Command::set_system_timer, "05060007"), Status::ok);
    EXPECT_EQ(to_hex(reader.ask(Command::get_system_time_and_date).data),
              "141A0C0102"
              "05060007");
    reader.does("clock +1h");
    EXPECT_EQ(to_hex(reader.ask(Command::get_system_timer).data), "06060007");
    reader.does("clock -90min");
    EXPECT_EQ(to_hex(reader.ask(Command::get_system_timer).data), "04240007");
}

TEST(HartingDeviceLines, OutputsAreOnForTheirTimeOrUntilToldOtherwise) {
    Reader reader;
    EXPECT_EQ(reader.state_text("outputs"), "off off off");
    EXPECT_EQ(reader.status(Command::set_output,
                            "0103"
                            "01010014"
                            "020B0000"
                            "8101FFFF"),
              Status::ok);
    EXPECT_EQ(reader.state_text("outputs"), "on flash on");
    reader.waits(3s);
    EXPECT_EQ(reader.state_text("outputs"), "off flash on");
    EXPECT_EQ(reader.status(Command::set_output,
                            "0102"
                            "01000000"
                            "81020000"),
              Status::ok);
    EXPECT_EQ(reader.state_text("outputs"), "off flash off") << "mode 0 leaves an output as it is";
    reader.does("input 2=1");
    EXPECT_EQ(to_hex(reader.ask(Command::get_input).data), "02");
    reader.sets("CFG2.IN1-INVERTED", "1");
    EXPECT_EQ(to_hex(reader.ask(Command::get_input).data), "03");
}

// --- faults ------------------------------------------------------------------------------------------------

TEST(HartingDeviceFaults, TheyDoWhatTheyAreCalled) {
    Reader reader;
    reader.does("bad_crc");
    reader.gets(request(Command::get_input));
    auto bad = taken(reader.device);
    EXPECT_EQ(look_at(bad, wire::Direction::to_host).what, Look::What::wrong);
    reader.does("truncate");
    reader.gets(request(Command::get_input));
    EXPECT_EQ(taken(reader.device).size(), 4u);
    reader.does("duplicate");
    EXPECT_EQ(replies(taken(reader.device)).size(), 1u);
    reader.does("status 0x83");
    EXPECT_EQ(reader.status(Command::get_input), Status::rf_communication_error);
    reader.does("busy on");
    EXPECT_EQ(reader.status(Command::get_input), Status::busy);
    reader.does("busy off");
    reader.does("garbage 10");
    EXPECT_EQ(taken(reader.device).size(), 10u);
    reader.does("slow 500ms");
    reader.gets(request(Command::get_input));
    reader.waits(400ms);
    EXPECT_TRUE(reader.device.output().empty());
    reader.waits(100ms);
    EXPECT_EQ(replies(taken(reader.device)).size(), 1u);
    reader.does("slow off");
    for (std::string_view fault : {"silent", "half_open"}) {
        reader.does(std::string(fault) + " on");
        reader.gets(request(Command::get_input));
        reader.waits(1s);
        EXPECT_TRUE(reader.device.output().empty());
        reader.does(std::string(fault) + " off");
        EXPECT_EQ(reader.status(Command::get_input), Status::ok);
    }
    reader.does("antenna 1=bad");
    EXPECT_EQ(to_hex(reader.ask(Command::reader_diagnostic, "01").data), "0001");
    EXPECT_EQ(reader.status(Command::inventory, "00"), Status::rf_warning);
    reader.does("antenna 1=auto");
    reader.does("restart");
    EXPECT_TRUE(reader.device.finished());
}

TEST(HartingDeviceFaults, WordsThatItDoesNotKnowAreRefusedWithThoseItDoes) {
    Reader reader;
    for (std::string_view word :
         {"nonsense", "input 3=1", "input 1", "antenna 5=bad", "antenna 1=odd", "eeprom 12", "eeprom CFG64",
          "config CFG1.MODE=Odd", "config Nothing=1", "power", "clock later", "garbage 99999", "status x",
          "slow x", "busy perhaps"}) {
        auto done = reader.device.inject(word, reader.now);
        ASSERT_FALSE(done) << word;
        EXPECT_FALSE(done.error().what.empty());
    }
    EXPECT_NE(reader.device.inject("nonsense", reader.now).error().hint.find("eeprom CFGn"),
              std::string::npos);
    EXPECT_EQ(reader.status(Command::get_input), Status::ok);
}

// --- any bytes ---------------------------------------------------------------------------------------------

RC_GTEST_PROP(HartingDeviceProperty, AnyBytesDoNoHarmAndWhatItSaysIsFrames, ()) {
    auto mode = *rc::gen::element<std::string>("Host", "Scan", "BufferedRead", "Notification");
    auto dials = *rc::gen::arbitrary<bool>();
    Bench reader("config=CFG1.MODE=" + mode +
                 ",CFG12.TRANSPONDER-VALID-TIME=0 boot=10ms connect=" + (dials ? "127.0.0.1:1" : ""));
    reader.places(tag_1);
    reader.starts();
    auto rows = commands();
    auto pieces = *rc::gen::container<std::vector<Bytes>>(rc::gen::arbitrary<Bytes>());
    for (auto& piece : pieces) {
        auto& row = rows[piece.size() * 7 % rows.size()];
        if (piece.size() % 3 != 0) {  // half of it in good frames
            if (has_sub(row.control) && !piece.empty()) piece[0] = row.sub;
            piece = request(row.control, piece);
        }
        if (reader.device.wants_input()) reader.gets(piece);
        reader.waits(50ms);
        auto said = taken(reader.device);
        RC_ASSERT(said.size() < 10'000u);
        for (ByteView rest = said; !rest.empty();) {
            auto look = look_at(rest, wire::Direction::to_host);
            RC_ASSERT(look.what == Look::What::frame);
            rest = rest.subspan(look.size);
        }
        if (reader.device.finished()) {
            reader.device.link_lost(reader.now);
            reader.waits(20ms);
            reader.device.start(reader.now);
        }
    }
}

TEST(HartingDeviceProperty, AHostThatNeverReadsDoesNotMakeItGrow) {
    Reader reader;
    auto asks = request(Command::get_reader_info, "FF");
    std::size_t most = 0;
    for (int i = 0; i < 3000; ++i) {
        if (reader.device.wants_input()) reader.gets(asks);
        most = std::max(most, reader.device.output().size());
    }
    EXPECT_LT(most, 300'000u);
    EXPECT_FALSE(reader.device.wants_input());
}

}  // namespace
}  // namespace gantry::harting::device_test
