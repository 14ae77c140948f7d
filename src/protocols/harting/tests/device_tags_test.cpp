#include "protocols/harting/tests/device_support.hpp"

namespace gantry::harting::device_test {
namespace {

// --- reading and writing -----------------------------------------------------------------------------------

// MODE, UID-LNG, UID of a tag that is addressed.
std::string addressed_to(std::string_view epc, std::string_view mode = "31") {
    return fmt::format("{}{:02X}{}", mode, epc.size() / 2, epc);
}

struct Step {
    Command command;
    std::string data;
    Status status;
    std::string answer = {};
};
void run(Bench& reader, std::initializer_list<Step> steps) {
    for (auto& step : steps) {
        auto reply = reader.ask(step.command, step.data);
        EXPECT_EQ(describe(static_cast<std::uint8_t>(reply.status)),
                  describe(static_cast<std::uint8_t>(step.status)))
            << row_of(step.command).name << " " << step.data;
        EXPECT_EQ(to_hex(reply.data), step.answer) << row_of(step.command).name << " " << step.data;
    }
}

TEST(HartingDeviceTags, BlocksAreReadAndWritten) {
    using enum Command;
    using enum Status;
    Reader reader;
    auto tag = addressed_to(tag_1), other = addressed_to(tag_3);
    run(reader, {
                    {read_multiple_blocks,
                     tag + "03"
                           "0001"
                           "02",
                     ok,
                     "0202"
                     "000203"
                     "000405"},
                    {read_multiple_blocks,
                     "20"
                     "03"
                     "0000"
                     "01",
                     ok,
                     "0102"
                     "000001"},
                    {read_multiple_blocks,
                     tag + "01"
                           "0001"
                           "07",
                     ok,
                     "0702"
                     "003400"
                     "003008"
                     "0033B2"
                     "00DDD9"
                     "000140"
                     "003505"
                     "000001"},
                    {read_multiple_blocks,
                     tag + "03"
                           "0007"
                           "02",
                     tag_error, "03"},
                    {read_multiple_blocks,
                     tag + "03"
                           "FFFF"
                           "02",
                     address_error},
                    {read_multiple_blocks,
                     tag + "03"
                           "0000"
                           "00",
                     parameter_range},
                    {read_multiple_blocks,
                     tag + "07"
                           "0000"
                           "01",
                     parameter_range},
                    {read_multiple_blocks,
                     other + "03"
                             "0000"
                             "01",
                     no_transponder},
                    {read_multiple_blocks,
                     addressed_to(tag_1, "32") + "03"
                                                 "0000"
                                                 "01",
                     length_error},
                    {read_multiple_blocks,
                     "22"
                     "03"
                     "0000"
                     "01",
                     parameter_range},
                    {read_multiple_blocks,
                     "00"
                     "00"
                     "01",
                     parameter_range},
                    {read_multiple_blocks,
                     "21"
                     "300833B2DDD90140"
                     "03"
                     "0000"
                     "01",
                     parameter_range},
                    {read_multiple_blocks,
                     tag + "03"
                           "0000",
                     length_error},
                    {read_multiple_blocks,
                     tag + "03"
                           "0000"
                           "01"
                           "00",
                     length_error},
                    {read_multiple_blocks,
                     tag + "83"
                           "02"
                           "0000"
                           "0000"
                           "01",
                     parameter_range},
                    {read_multiple_blocks,
                     addressed_to(tag_1, "71") + "03"
                                                 "0006"
                                                 "00",
                     ok,
                     "0202"
                     "000C0D"
                     "000E0F"},
                    {read_multiple_blocks,
                     addressed_to(tag_1, "F1") + "03"
                                                 "0000"
                                                 "00",
                     no_valid_data},
                    {write_multiple_blocks,
                     tag + "03"
                           "0001"
                           "02"
                           "02"
                           "AABBCCDD",
                     ok},
                    {read_multiple_blocks,
                     tag + "03"
                           "0000"
                           "04",
                     ok,
                     "0402"
                     "000001"
                     "00AABB"
                     "00CCDD"
                     "000607"},
                    {write_multiple_blocks,
                     tag + "03"
                           "0007"
                           "02"
                           "02"
                           "AABBCCDD",
                     tag_error,
                     "03"
                     "0008"},
                    {write_multiple_blocks,
                     tag + "02"
                           "0002"
                           "01"
                           "02"
                           "AABB",
                     tag_error,
                     "04"
                     "0002"},
                    {write_multiple_blocks,
                     tag + "03"
                           "0001"
                           "02"
                           "01"
                           "AABB",
                     parameter_range},
                    {write_multiple_blocks,
                     tag + "03"
                           "0001"
                           "02"
                           "02"
                           "AABBCC",
                     length_error},
                    {write_multiple_blocks,
                     tag + "03"
                           "0001"
                           "00"
                           "02",
                     parameter_range},
                    {write_multiple_blocks,
                     addressed_to(tag_1, "71") + "03"
                                                 "0001"
                                                 "01"
                                                 "02"
                                                 "AABB",
                     parameter_range},
                    // Another EPC, from word 2 on.
                    {write_multiple_blocks,
                     tag + "01"
                           "0007"
                           "01"
                           "02"
                           "0003",
                     ok},
                    {read_multiple_blocks,
                     tag + "03"
                           "0000"
                           "01",
                     no_transponder},
                    {read_multiple_blocks,
                     other + "03"
                             "0000"
                             "01",
                     ok,
                     "0102"
                     "000001"},
                });
}

TEST(HartingDeviceTags, ALongBankComesInPieces) {
    Reader reader("tx_buf=512", false);
    reader.places(tag_1, 1, -50, [](auto& spec) { spec.user = Bytes(600, 0x77); });
    auto first = reader.ask(Command::read_multiple_blocks, addressed_to(tag_1, "71") + "03000000");
    EXPECT_EQ(first.status, Status::more_data);
    EXPECT_EQ(first.data[0], 167) << "(512 - 10) / 3";
    EXPECT_LE(first.data.size() + min_reply, 512u);
    auto second = reader.ask(Command::read_multiple_blocks, addressed_to(tag_1, "F1") + "03000000");
    EXPECT_EQ(second.status, Status::ok);
    EXPECT_EQ(second.data[0], 300 - 167);
    EXPECT_EQ(reader.status(Command::read_multiple_blocks, addressed_to(tag_1) + "030000"
                                                                                 "A8"),
              Status::parameter_range);
}

TEST(HartingDeviceTags, PasswordsLocksAndWeakTagsAreToldApart) {
    using enum Command;
    using enum Status;
    Reader reader({}, false);
    reader.places(tag_1, 1, -50, [](auto& spec) {
        spec.access_password = 0x11223344;
        spec.kill_password = 0x55667788;
        spec.user = Bytes(40, 0x10);
    });
    reader.places(tag_2, 1, -74);  // answers, and cannot write
    auto tag = addressed_to(tag_1), weak = addressed_to(tag_2);
    std::string password = "0411223344", wrong = "0411223345",
                user =
                    "0000"
                    "01";
    run(reader, {
                    {lock,
                     tag +
                         "84"
                         "03"
                         "008020" +
                         wrong,
                     authentication_error},
                    {lock,
                     tag + "84"
                           "03"
                           "008020"
                           "0400000000",
                     tag_error, "04"},
                    {lock,
                     tag +
                         "81"
                         "03"
                         "008020" +
                         password,
                     wrong_transponder_type},
                    {lock,
                     tag +
                         "84"
                         "02"
                         "0080" +
                         password,
                     parameter_range},
                    {lock,
                     tag + "84"
                           "03"
                           "008020",
                     length_error},
                    {lock,
                     "20"
                     "84"
                     "03"
                     "008020" +
                         password,
                     parameter_range},
                    {lock,
                     tag +
                         "84"
                         "03"
                         "008020" +
                         password,
                     ok},
                    {read_multiple_blocks, tag + "03" + user, ok, "0102001010"},
                    {write_multiple_blocks,
                     tag + "03" + user +
                         "02"
                         "AABB",
                     tag_error, "040000"},
                    {write_multiple_blocks,
                     tag + "83" + wrong + user +
                         "02"
                         "AABB",
                     authentication_error},
                    {write_multiple_blocks,
                     tag + "83" + password + user +
                         "02"
                         "AABB",
                     ok},
                    {read_multiple_blocks, tag + "83" + wrong + user, authentication_error},
                    // Blocks of four words: the second and the fifth.
                    {block_permalock,
                     tag + "83" + password +
                         "0000"
                         "01"
                         "4800",
                     ok},
                    {block_permalock,
                     tag + "83" + password +
                         "0000"
                         "01"
                         "0400",
                     tag_error, "03"},
                    {block_permalock,
                     tag + "81" + password +
                         "0000"
                         "01"
                         "4800",
                     parameter_range},
                    {block_permalock,
                     tag + "83" + password +
                         "0000"
                         "00",
                     parameter_range},
                    {block_permalock,
                     tag + "03"
                           "0000"
                           "01"
                           "4800",
                     tag_error, "04"},
                    {block_permalock,
                     addressed_to(tag_1, "11") + "83" + password +
                         "0000"
                         "01"
                         "4800",
                     parameter_range},
                    {read_permalock_status,
                     tag + "83" + password +
                         "0000"
                         "02",
                     ok, "48000000"},
                    {read_permalock_status,
                     tag + "83" + password +
                         "0001"
                         "01",
                     tag_error, "03"},
                    {read_permalock_status,
                     tag + "83" + password +
                         "0000"
                         "05",
                     parameter_range},
                    {read_permalock_status, tag + "83" + password + "0000", length_error},
                    {write_multiple_blocks,
                     tag + "83" + password +
                         "0004"
                         "01"
                         "02"
                         "AABB",
                     tag_error, "040004"},
                    {write_multiple_blocks,
                     weak + "03" + user +
                         "02"
                         "AABB",
                     write_error, "0000"},
                    {lock,
                     weak + "84"
                            "03"
                            "008020"
                            "00",
                     tag_error, "0B"},
                    {kill, tag + "0455667789", authentication_error},
                    {kill, tag + "0200", length_error},
                    {kill, tag + "020000", parameter_range},
                    {kill,
                     "20"
                     "0455667788",
                     parameter_range},
                    {kill,
                     addressed_to(tag_1, "39") + "0455667788"
                                                 "01",
                     tag_error, "00"},
                    {kill, tag + "0455667788", ok},
                    {kill, tag + "0455667788", no_transponder},
                    {kill, weak + "0400000000", authentication_error},
                });
}

TEST(HartingDeviceTags, TagsOfOtherKindsAreSaidToBeOfTheWrongType) {
    Reader reader({}, false);
    reader.places("E004000011223344", 1, -50,
                  [](auto& spec) { spec.technology = event::Technology::iso18000_6b; });
    EXPECT_EQ(reader.status(Command::inventory, "00"), Status::no_transponder);
    EXPECT_EQ(reader.status(Command::read_multiple_blocks, addressed_to("E004000011223344") + "03000001"),
              Status::wrong_transponder_type);
    reader.does("antenna 1=bad");
    EXPECT_EQ(reader.status(Command::read_multiple_blocks, addressed_to("E004000011223344") + "03000001"),
              Status::rf_warning);
}

}  // namespace
}  // namespace gantry::harting::device_test
