#include "field/memory_icode1.hpp"

#include "field/memory_plain.hpp"
#include "field/tests/memory_support.hpp"

namespace gantry::field {

static TagSpec icode1(std::string_view user = {}) {
    auto made = spec_of(event::Technology::icode1, "0102030405060708");
    made.user = hex(user);
    return made;
}

TEST(Icode1Memory, HoldsItsNumberLowByteFirstAndCannotChangeIt) {
    Icode1Memory tag(icode1());
    EXPECT_EQ(to_hex(read(tag, Bank::user, 0, 6)), "0807060504030201F0FFFFFF");
    EXPECT_EQ(read(tag, Bank::user, 0, 0).size(), 64u);
    EXPECT_EQ(error(tag.write(Bank::user, 0, hex("11223344"), 0)), AirError::locked);
    EXPECT_EQ(error(tag.write(Bank::user, 3, hex("11223344"), 0)), AirError::locked) << "half of it";
    EXPECT_EQ(error(tag.write(Bank::user, 8, hex("11223344"), 0)), std::nullopt);
    EXPECT_EQ(to_hex(read(tag, Bank::user, 8, 2)), "11223344");
    EXPECT_EQ(error(tag.write(Bank::user, 31, hex("11223344"), 0)), AirError::bad_address);
    EXPECT_EQ(error(tag.read(Bank::epc, 0, 1, 0)), AirError::bad_address);
    EXPECT_EQ(error(tag.lock({}, 0)), AirError::unsupported);
    EXPECT_EQ(error(tag.kill(0)), AirError::unsupported);
}

TEST(Icode1Memory, ABlockWhoseWriteAccessBitsAreClearedIsLockedForEver) {
    Icode1Memory tag(icode1());
    EXPECT_EQ(error(tag.write(Bank::user, 4, hex("FFF3FFFF"), 0)), std::nullopt);
    EXPECT_EQ(to_hex(read(tag, Bank::user, 4, 2)), "F0F3FFFF") << "bits can only be cleared";
    EXPECT_EQ(error(tag.write(Bank::user, 10, hex("11223344"), 0)), AirError::locked) << "block 5";
    EXPECT_EQ(error(tag.write(Bank::user, 12, hex("11223344"), 0)), std::nullopt);
    EXPECT_EQ(error(tag.write(Bank::user, 4, hex("FFFFFFFF"), 0)), std::nullopt);
    EXPECT_EQ(error(tag.write(Bank::user, 10, hex("11223344"), 0)), AirError::locked);
    tag.power_up(false);
    EXPECT_EQ(error(tag.write(Bank::user, 12, hex("11223344"), 0)), AirError::insufficient_power);
}

TEST(Icode1Memory, TakesTheBlocksThatAreGiven) {
    Icode1Memory tag(icode1("0000000000000000F0FFFFFC000000000000AABB"));
    EXPECT_EQ(to_hex(read(tag, Bank::user, 0, 10)), "0807060504030201F0FFFFFC000000000000AABB");
    EXPECT_EQ(error(tag.write(Bank::user, 24, hex("11223344"), 0)), AirError::locked) << "block 12";
}

TEST(HfTags, HaveNumbersOfTheirKindAndNoTwoTheSame) {
    for (auto kind : {event::Technology::iso15693, event::Technology::icode1}) {
        auto tags = hf_tags(kind, 7, 50);
        for (std::size_t i = 0; i < tags.size(); ++i) {
            EXPECT_EQ(tags[i].technology, kind);
            EXPECT_EQ(tags[i].id.size, 8);
            EXPECT_EQ(tags[i].id.data[0] == 0xE0, kind == event::Technology::iso15693);
            for (std::size_t other = 0; other < i; ++other)
                EXPECT_FALSE(tags[i].id == tags[other].id);
        }
        EXPECT_EQ(default_hf_tags(kind).size(), 1u) << "their readers read one at a time";
        EXPECT_FALSE(default_hf_tags(kind, 1)[0].tag.id == default_hf_tags(kind, 2)[0].tag.id);
    }
    PlainMemory iso(hf_tags(event::Technology::iso15693, 1, 1)[0]);
    EXPECT_EQ(read(iso, Bank::user, 0, 0).size(), 112u);
}

}  // namespace gantry::field
