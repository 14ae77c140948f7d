#include "field/memory_id.hpp"

#include <gtest/gtest.h>

#include "field/tests/memory_support.hpp"

namespace gantry::field {
namespace {

using event::TagId;
using event::Technology;

constexpr std::string_view old_id = "111122223333444455556666", new_id = "AAAABBBBCCCCDDDDEEEEFFFF";

TagSpec spec_gen1(std::uint32_t kill_password = 0) {
    auto made = spec_of(Technology::epc_gen1, old_id);
    made.kill_password = kill_password;
    return made;
}

TEST(EpcGen1Memory, IsProgrammedUntilItsIdIsLocked) {
    EpcGen1Memory tag(spec_gen1());
    ASSERT_TRUE(tag.program(TagId(hex(new_id)), 0, false));
    EXPECT_EQ(to_hex(tag.id().view()), new_id);
    ASSERT_TRUE(tag.program(TagId(hex(old_id)), 0, true)) << "this one is to stay";
    EXPECT_EQ(error(tag.program(TagId(hex(new_id)), 0, false)), AirError::locked);
    EXPECT_EQ(to_hex(tag.id().view()), old_id);
}

TEST(EpcGen1Memory, TakesOnlyIdsOfItsLength) {
    EpcGen1Memory tag(spec_gen1());
    for (auto id : {"", "1111", "1111222233334444", "11112222333344445555666677778888"})
        EXPECT_EQ(error(tag.program(TagId(hex(id)), 9, true)), AirError::bad_address) << id;
    EXPECT_EQ(to_hex(tag.id().view()), old_id);
    EXPECT_EQ(error(tag.kill(9)), AirError::locked) << "the kill code is not taken either";
    EXPECT_TRUE(tag.program(TagId(hex(new_id)), 0, false)) << "nor the lock";
}

TEST(EpcGen1Memory, IsKilledWithTheCodeThatWasProgrammedLast) {
    EpcGen1Memory tag(spec_gen1(0xBEEF));
    EXPECT_EQ(error(tag.kill(0)), AirError::locked);
    EXPECT_EQ(error(tag.kill(0xBEEE)), AirError::locked);
    EXPECT_EQ(error(tag.kill(0x1'BEEF)), AirError::locked) << "more than 16 bits";
    ASSERT_TRUE(tag.program(TagId(hex(new_id)), 0x1234, true));
    EXPECT_EQ(error(tag.kill(0xBEEF)), AirError::locked);
    EXPECT_FALSE(tag.is_killed());
    EXPECT_TRUE(tag.kill(0x1234)) << "a locked id does not protect from that";
    EXPECT_TRUE(tag.is_killed());
}

TEST(EpcGen1Memory, WithoutACodeItCannotBeKilled) {
    EpcGen1Memory tag(spec_gen1());
    EXPECT_EQ(error(tag.kill(0)), AirError::locked);
    EXPECT_FALSE(tag.is_killed());
}

TEST(EpcGen1Memory, TooLittlePowerChangesNothing) {
    EpcGen1Memory tag(spec_gen1(7));
    tag.power_up(false);
    EXPECT_EQ(error(tag.program(TagId(hex(new_id)), 8, true)), AirError::insufficient_power);
    EXPECT_EQ(error(tag.kill(8)), AirError::locked);
    EXPECT_EQ(error(tag.kill(7)), AirError::insufficient_power);
    EXPECT_EQ(to_hex(tag.id().view()), old_id);
    EXPECT_FALSE(tag.is_killed());
    tag.power_up(true);
    EXPECT_TRUE(tag.program(TagId(hex(new_id)), 8, true));
}

TEST(EpcGen1Memory, HearsNoCommandsOfOtherTechnologies) {
    EpcGen1Memory tag(spec_gen1());
    EXPECT_EQ(error(tag.read(Bank::epc, 0, 1, 0)), AirError::no_tag);
    EXPECT_EQ(error(tag.write(Bank::epc, 2, hex("0001"), 0)), AirError::no_tag);
    EXPECT_EQ(error(tag.lock({}, 0)), AirError::no_tag);
    EXPECT_EQ(error(tag.read_bytes(0, 1)), AirError::no_tag);
    EXPECT_EQ(error(tag.write_bytes(8, hex("01"))), AirError::no_tag);
    EXPECT_EQ(error(tag.lock_byte(8)), AirError::no_tag);
}

TEST(Epc119Memory, IsProgrammedAsOftenAsOneLikes) {
    Epc119Memory tag(spec_of(Technology::epc_1_19, old_id));
    ASSERT_TRUE(tag.program(TagId(hex(new_id)), 7, true));
    EXPECT_EQ(to_hex(tag.id().view()), new_id);
    ASSERT_TRUE(tag.program(TagId(hex(old_id)), 0, false)) << "it knows no lock";
    EXPECT_EQ(to_hex(tag.id().view()), old_id);
    EXPECT_EQ(error(tag.program(TagId(hex("1111")), 0, false)), AirError::bad_address);
    EXPECT_EQ(error(tag.kill(7)), AirError::no_tag) << "nor a kill code";
    tag.power_up(false);
    EXPECT_EQ(error(tag.program(TagId(hex(new_id)), 0, false)), AirError::insufficient_power);
    EXPECT_EQ(to_hex(tag.id().view()), old_id);
}

TEST(MakeMemory, GivesEachTechnologyItsOwn) {
    struct Row {
        Technology technology;
        std::optional<AirError> read, read_bytes, program;
    };
    constexpr std::optional<AirError> good;
    constexpr auto silent = AirError::no_tag;
    for (auto& row :
         {Row{Technology::epc_gen2, good, silent, silent}, Row{Technology::iso18000_6b, silent, good, silent},
          Row{Technology::epc_gen1, silent, silent, good}, Row{Technology::epc_1_19, silent, silent, good},
          Row{Technology::iso18000_6a, good, silent, silent}, Row{Technology::iso15693, good, silent, silent},
          Row{Technology::icode1, good, silent, silent}, Row{Technology::unknown, good, silent, silent}}) {
        auto tag = make_memory(spec_of(row.technology, "E004010012345678"));
        auto name = event::to_text(row.technology);
        EXPECT_EQ(tag->technology(), row.technology) << name;
        EXPECT_EQ(to_hex(tag->id().view()), "E004010012345678") << name;
        EXPECT_EQ(error(tag->read(Bank::user, 0, 1, 0)), row.read) << name;
        EXPECT_EQ(error(tag->read_bytes(0, 8)), row.read_bytes) << name;
        EXPECT_EQ(error(tag->program(TagId(hex("1122334455667788")), 0, false)), row.program) << name;
    }
}

}  // namespace
}  // namespace gantry::field
