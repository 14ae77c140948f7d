#include "protocols/harting/tests/device_support.hpp"

namespace gantry::harting::device_test {
namespace {

struct Found {
    std::vector<Observation> tags;
    Bytes bank;
    Walked walked;
};
Found found(const Reply& reply, bool antennas = false) {
    Found found;
    if (reply.data.empty()) return found;
    found.walked = walk_inventory(reply.data, 0, antennas, found.tags, found.bank);
    EXPECT_FALSE(found.walked.fault);
    return found;
}

// --- Inventory ---------------------------------------------------------------------------------------------

TEST(HartingDeviceInventory, ItFindsTheTagsOfTheAntennasInUse) {
    Reader reader;
    reader.places(tag_2, 2);
    auto reply = reader.ask(Command::inventory, "00");
    EXPECT_EQ(reply.status, Status::ok);
    EXPECT_EQ(to_hex(reply.data),
              "01"
              "84000E3000" +
                  std::string(tag_1))
        << "antenna 1 alone";
    reader.sets("CFG15.ENABLE", "1");
    reader.sets("CFG15.ANTENNAS", "4");
    EXPECT_EQ(found(reader.ask(Command::inventory, "00")).tags.size(), 2u);
    reader.sets("CFG15.SELECTION-MODE", "1");
    reader.sets("CFG15.ANTENNA-SELECTION", "2");
    auto second = found(reader.ask(Command::inventory, "00"));
    ASSERT_EQ(second.tags.size(), 1u);
    EXPECT_EQ(to_hex(second.tags[0].tag.view()), tag_2);
    auto third = reader.ask(Command::inventory, "1007");
    auto both = found(third, true);
    ASSERT_EQ(both.tags.size(), 2u) << "the command chooses itself";
    EXPECT_EQ(both.tags[0].antenna, 1);
    EXPECT_EQ(both.tags[1].antenna, 2);
    EXPECT_NEAR(both.tags[0].rssi, -500, 30);
    reader.removes(tag_1);
    reader.removes(tag_2);
    reader.waits(1s);
    EXPECT_EQ(reader.status(Command::inventory, "00"), Status::no_transponder);
}

TEST(HartingDeviceInventory, WithTheFieldOffThereIsNothing) {
    Reader reader;
    EXPECT_EQ(reader.status(Command::rf_output, "00"), Status::ok);
    EXPECT_EQ(reader.status(Command::inventory, "00"), Status::no_transponder);
    EXPECT_EQ(reader.status(Command::inventory, "1001"), Status::no_transponder);
    EXPECT_EQ(reader.status(Command::rf_output, "02"), Status::ok);
    EXPECT_EQ(reader.status(Command::inventory, "00"), Status::no_transponder) << "antenna 2 sees none";
    EXPECT_EQ(reader.status(Command::rf_output, "01"), Status::ok);
    EXPECT_EQ(reader.status(Command::inventory, "00"), Status::ok);
}

TEST(HartingDeviceInventory, ABrokenAntennaIsAWarningWithWhatTheOthersHear) {
    Reader reader("config=CFG15.ENABLE=1,CFG15.ANTENNAS=2");
    reader.does("antenna 2=bad");
    auto reply = reader.ask(Command::inventory, "00");
    EXPECT_EQ(reply.status, Status::rf_warning);
    EXPECT_EQ(found(reply).tags.size(), 1u);
    reader.does("antenna 1=bad");
    reply = reader.ask(Command::inventory, "00");
    EXPECT_EQ(reply.status, Status::rf_warning);
    EXPECT_TRUE(reply.data.empty());
}

TEST(HartingDeviceInventory, WhatDoesNotFitIsFetchedWithMore) {
    Reader reader("tx_buf=512", false);
    for (int i = 0; i < 70; ++i)
        reader.places(fmt::format("{:024X}", 0x1000 + i));
    std::set<std::string> seen;
    auto reply = reader.ask(Command::inventory, "00");
    int replies = 1;
    for (;; ++replies) {
        EXPECT_LE(reply.data.size() + min_reply, 512u);
        for (auto& tag : found(reply).tags)
            EXPECT_TRUE(seen.insert(to_hex(tag.tag.view())).second) << "told once";
        if (reply.status != Status::more_data) break;
        reply = reader.ask(Command::inventory, "80");
    }
    EXPECT_EQ(reply.status, Status::ok);
    EXPECT_EQ(seen.size(), 70u);
    EXPECT_EQ(replies, 3);
    EXPECT_EQ(reader.status(Command::inventory, "80"), Status::no_valid_data);
}

TEST(HartingDeviceInventory, TagsTellTheirTidAndXpcWhereTheyAreAskedFor) {
    Reader reader("config=CFG4.IDENTIFIER=2", false);
    reader.places("E2001122", 1, -50, [](auto& spec) { spec.xpc = 0x8001; });
    auto reply = reader.ask(Command::inventory, "00");
    auto identity = take_apart(reply.data[1], reply.data[2], ByteView(reply.data).subspan(4));
    ASSERT_TRUE(identity);
    EXPECT_EQ(to_hex(identity->epc), "E2001122");
    EXPECT_EQ(identity->xpc, 0x8001);
    EXPECT_EQ(to_hex(identity->tid), "E280116060000205E2001122");
    // Then the TID is what the tag is addressed by.
    EXPECT_EQ(reader.status(Command::read_multiple_blocks, "310CE280116060000205E200112203000001"),
              Status::ok);
    EXPECT_EQ(reader.status(Command::read_multiple_blocks, "3104E200112203000001"), Status::no_transponder);
}

TEST(HartingDeviceInventory, FiltersAndMasksKeepTagsOut) {
    struct Row {
        std::string_view config;
        std::vector<std::string_view> found;
    };
    for (auto& row : std::initializer_list<Row>{
             {"CFG12.TRANSPONDER-VALID-TIME=0", {tag_1, tag_2}},
             {"CFG3.TAG-DRV=0x0008", {}},
             {"CFG20.RSSI-FILTER-1=60", {tag_1}},
             {"CFG20.RSSI-FILTER-1=80", {tag_1, tag_2}},
             // The last byte of the EPC: bits 32 + 88 to 32 + 95 of the bank.
             {"CFG22.MASK-LENGTH=8,CFG22.BANK=epc,CFG22.FIRST-BIT=120,CFG22.MASK=02", {tag_2}},
             {"CFG22.MASK-LENGTH=8,CFG22.NEGATION=1,CFG22.BANK=epc,CFG22.FIRST-BIT=120,CFG22.MASK=02",
              {tag_1}},
             {"CFG22.MASK-LENGTH=8,CFG22.BANK=epc,CFG22.FIRST-BIT=120,CFG22.MASK=02,"
              "CFG24.MASK-LENGTH=3,CFG24.BANK=epc,CFG24.FIRST-BIT=125,CFG24.MASK=20",
              {tag_1, tag_2}},
             {"CFG26.MASK-LENGTH=16,CFG26.BANK=user,CFG26.FIRST-BIT=4,CFG26.MASK=0010", {tag_1, tag_2}},
             {"CFG26.MASK-LENGTH=16,CFG26.BANK=user,CFG26.FIRST-BIT=4,CFG26.MASK=0011", {}},
         }) {
        Reader reader("config=" + std::string(row.config));
        reader.places(tag_2, 1, -70);
        reader.waits(500ms);
        auto tags = found(reader.ask(Command::inventory, "00")).tags;
        std::set<std::string> ids;
        for (auto& tag : tags)
            ids.insert(to_hex(tag.tag.view()));
        EXPECT_EQ(ids, std::set<std::string>(row.found.begin(), row.found.end())) << row.config;
    }
}

TEST(HartingDeviceInventory, ThePowerOfAnAntennaDecidesHowFarItHears) {
    Reader reader("config=CFG3.RF-POWER-1=100mW", false);  // 20 dBm: 7 dB less than usual
    reader.places(tag_1, 1, -70);
    EXPECT_EQ(reader.status(Command::inventory, "00"), Status::no_transponder);
    reader.sets("CFG3.RF-POWER-1", "1000mW");
    EXPECT_EQ(reader.status(Command::inventory, "00"), Status::ok);
}

}  // namespace
}  // namespace gantry::harting::device_test
