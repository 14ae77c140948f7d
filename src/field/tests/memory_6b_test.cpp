#include "field/memory_6b.hpp"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "field/tests/memory_support.hpp"

namespace gantry::field {
namespace {

TagSpec spec_6b(std::size_t user = 0) {
    auto made = spec_of(event::Technology::iso18000_6b, "E001105629FFFC01");
    made.user.resize(user);
    return made;
}
std::string read_hex(const TagMemory& tag, std::uint32_t address, std::uint32_t size) {
    auto bytes = tag.read_bytes(address, size);
    EXPECT_TRUE(bytes.has_value());
    return to_hex(bytes.value_or(Bytes{}));
}

TEST(Iso6bMemory, BeginsWithTheIdAndGoesOnWithTheUserData) {
    auto made = spec_6b();
    made.user = hex("0A0B0C");
    Iso6bMemory tag(made);
    EXPECT_EQ(read_hex(tag, 0, 11), "E001105629FFFC010A0B0C");
    EXPECT_EQ(read_hex(tag, 9, 1), "0B");
    EXPECT_EQ(error(tag.read_bytes(11, 1)), AirError::bad_address) << "it ends with them";
    EXPECT_EQ(to_hex(tag.id().view()), "E001105629FFFC01");
}

TEST(Iso6bMemory, HasTwoHundredAndTwentyFourBytesUnlessSaidOtherwiseAndNeverMoreThanItCanAddress) {
    struct Row {
        std::size_t user, size;
    };
    for (auto& row : {Row{0, 224}, Row{1, 9}, Row{248, 256}, Row{249, 256}, Row{5000, 256}}) {
        Iso6bMemory tag(spec_6b(row.user));
        auto last = static_cast<std::uint32_t>(row.size - 1);
        EXPECT_TRUE(tag.read_bytes(0, last + 1)) << row.user;
        EXPECT_TRUE(tag.write_bytes(last, hex("01"))) << row.user;
        EXPECT_EQ(error(tag.read_bytes(last, 2)), AirError::bad_address) << row.user;
        EXPECT_EQ(error(tag.read_bytes(last + 1, 1)), AirError::bad_address) << row.user;
        EXPECT_EQ(error(tag.read_bytes(0, last + 2)), AirError::bad_address) << row.user;
        EXPECT_EQ(error(tag.read_bytes(8, 0xFFFF'FFFF)), AirError::bad_address) << row.user;
        EXPECT_EQ(error(tag.read_bytes(0xFFFF'FFFF, 1)), AirError::bad_address) << row.user;
        EXPECT_EQ(error(tag.write_bytes(last, hex("0102"))), AirError::bad_address) << row.user;
        EXPECT_EQ(error(tag.lock_byte(last + 1)), AirError::bad_address) << row.user;
    }
    EXPECT_EQ(error(Iso6bMemory(spec_6b()).write_bytes(8, {})), AirError::bad_address);
}

TEST(Iso6bMemory, AnIdOfAnotherSizeIsMadeToFit) {
    EXPECT_EQ(read_hex(Iso6bMemory(spec_of(event::Technology::iso18000_6b, "E001")), 0, 9),
              "E00100000000000000");
    EXPECT_EQ(read_hex(Iso6bMemory(spec_of(event::Technology::iso18000_6b, "112233445566778899")), 0, 9),
              "112233445566778800");
}

TEST(Iso6bMemory, TheIdIsLockedByItsMaker) {
    Iso6bMemory tag(spec_6b());
    for (std::uint32_t address = 0; address < 8; ++address) {
        EXPECT_EQ(error(tag.write_bytes(address, hex("00"))), AirError::locked) << address;
        EXPECT_EQ(error(tag.lock_byte(address)), AirError::locked) << address;
    }
    EXPECT_EQ(error(tag.write_bytes(7, hex("0102"))), AirError::locked) << "its last byte and one more";
    EXPECT_EQ(read_hex(tag, 0, 9), "E001105629FFFC0100") << "nothing of that was written";
    EXPECT_TRUE(tag.write_bytes(8, hex("01")));
}

TEST(Iso6bMemory, ALockedByteStaysAsItIs) {
    Iso6bMemory tag(spec_6b());
    ASSERT_TRUE(tag.write_bytes(8, hex("0A0B0C0D")));
    ASSERT_TRUE(tag.lock_byte(10));
    EXPECT_EQ(error(tag.lock_byte(10)), AirError::locked) << "there is nothing to lock any more";
    EXPECT_EQ(error(tag.write_bytes(10, hex("FF"))), AirError::locked);
    EXPECT_EQ(error(tag.write_bytes(8, hex("FFFFFFFF"))), AirError::locked);
    EXPECT_EQ(read_hex(tag, 8, 4), "0A0B0C0D");
    EXPECT_TRUE(tag.write_bytes(8, hex("FFFF")));
    EXPECT_TRUE(tag.write_bytes(11, hex("FF")));
    EXPECT_EQ(read_hex(tag, 8, 4), "FFFF0CFF");
}

TEST(Iso6bMemory, WithTooLittlePowerItIsReadOnly) {
    Iso6bMemory tag(spec_6b());
    tag.power_up(false);
    EXPECT_EQ(error(tag.write_bytes(8, hex("01"))), AirError::insufficient_power);
    EXPECT_EQ(error(tag.lock_byte(8)), AirError::insufficient_power);
    EXPECT_EQ(error(tag.write_bytes(0, hex("01"))), AirError::locked);
    EXPECT_EQ(read_hex(tag, 7, 2), "0100");
    tag.power_up(true);
    EXPECT_TRUE(tag.write_bytes(8, hex("01"))) << "it was not locked";
}

TEST(Iso6bMemory, HearsNoCommandsOfOtherTechnologies) {
    Iso6bMemory tag(spec_6b());
    EXPECT_EQ(error(tag.read(Bank::user, 0, 1, 0)), AirError::no_tag);
    EXPECT_EQ(error(tag.write(Bank::user, 0, hex("0001"), 0)), AirError::no_tag);
    EXPECT_EQ(error(tag.lock({}, 0)), AirError::no_tag);
    EXPECT_EQ(error(tag.kill(0)), AirError::no_tag);
    EXPECT_EQ(error(tag.program(event::TagId(hex("1122334455667788")), 0, false)), AirError::no_tag);
}

// Against a model of single bytes.
RC_GTEST_PROP(Iso6bMemory, IsBytesOfWhichTheLockedKeepTheirValue, ()) {
    struct Byte {
        std::uint8_t value = 0;
        bool locked = false;
    };
    auto size = *rc::gen::inRange<std::size_t>(9, 40);
    Iso6bMemory tag(spec_6b(size - 8));
    std::vector<Byte> model(size);
    auto id = hex("E001105629FFFC01");
    for (std::size_t i = 0; i < id.size(); ++i)
        model[i] = {id[i], true};
    auto steps = *rc::gen::inRange(0, 60);
    for (int step = 0; step < steps; ++step) {
        auto address = *rc::gen::inRange(0u, 44u);
        if (*rc::gen::inRange(0, 4) == 0) {
            auto expected = address >= size         ? std::optional(AirError::bad_address)
                            : model[address].locked ? std::optional(AirError::locked)
                                                    : std::nullopt;
            RC_ASSERT(error(tag.lock_byte(address)) == expected);
            if (!expected) model[address].locked = true;
            continue;
        }
        auto data = *rc::gen::container<Bytes>(*rc::gen::inRange<std::size_t>(1, 6),
                                               rc::gen::arbitrary<std::uint8_t>());
        bool there = address + data.size() <= size, locked = false;
        for (std::size_t i = 0; there && i < data.size(); ++i)
            locked = locked || model[address + i].locked;
        auto expected = !there   ? std::optional(AirError::bad_address)
                        : locked ? std::optional(AirError::locked)
                                 : std::nullopt;
        RC_ASSERT(error(tag.write_bytes(address, data)) == expected);
        for (std::size_t i = 0; !expected && i < data.size(); ++i)
            model[address + i].value = data[i];
    }
    auto memory = tag.read_bytes(0, static_cast<std::uint32_t>(size));
    RC_ASSERT(memory.has_value());
    for (std::size_t i = 0; i < size; ++i)
        RC_ASSERT((*memory)[i] == model[i].value);
}

}  // namespace
}  // namespace gantry::field
