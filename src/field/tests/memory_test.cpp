#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <array>
#include <string>

#include "field/memory_gen2.hpp"
#include "field/memory_plain.hpp"
#include "field/tests/memory_support.hpp"

namespace gantry::field {
namespace {

// The ten bits of AirLock: pairs of (lock, permanent) for kill, access, EPC, TID, user.
constexpr AirLock lock_user{0b00'00'00'00'10, 0b00'00'00'00'10};
constexpr AirLock unlock_user{0b00'00'00'00'10, 0};
constexpr AirLock lock_user_for_ever{0b00'00'00'00'11, 0b00'00'00'00'11};
constexpr AirLock open_user_for_ever{0b00'00'00'00'11, 0b00'00'00'00'01};
constexpr AirLock lock_passwords{0b10'10'00'00'00, 0b10'10'00'00'00};

TEST(TagMemory, TheEpcBankHoldsCrcPcAndEpc) {
    // The stored CRC-16 of tags with 0 to 6 words of EPC, as ISO/IEC 18000-63 lists them.
    struct Row {
        std::string_view epc, pc, crc;
    };
    for (auto& row :
         {Row{"", "0000", "E2F0"}, Row{"1111", "0800", "CCAE"}, Row{"11112222", "1000", "968F"},
          Row{"111122223333", "1800", "78F6"}, Row{"1111222233334444", "2000", "C241"},
          Row{"11112222333344445555", "2800", "2A91"}, Row{"111122223333444455556666", "3000", "1835"}}) {
        Gen2Memory tag(spec(row.epc));
        EXPECT_EQ(to_hex(read(tag, Bank::epc, 0, 1)), row.crc) << row.epc;
        EXPECT_EQ(to_hex(read(tag, Bank::epc, 1, 1)), row.pc) << row.epc;
        EXPECT_TRUE(to_hex(read(tag, Bank::epc, 2, 0)).starts_with(row.epc));
        EXPECT_EQ(read(tag, Bank::epc, 0, 0).size(), 16u) << "room for 96 bits";
        EXPECT_EQ(to_hex(tag.id().view()), row.epc);
    }
}

TEST(TagMemory, ThePcWordSaysThatThereIsUserData) {
    auto with_user = spec("111122223333444455556666");
    with_user.user = hex("0001");
    Gen2Memory tag(with_user);
    EXPECT_EQ(to_hex(read(tag, Bank::epc, 1, 1)), "3400");
    ASSERT_TRUE(tag.write(Bank::user, 0, hex("0000"), 0));
    EXPECT_EQ(to_hex(read(tag, Bank::epc, 0, 2)), "18353000");
}

TEST(TagMemory, WhatIsLeftOutGetsSensibleValues) {
    Gen2Memory tag(spec("30742B4484080BC000001A2C"));
    EXPECT_EQ(read(tag, Bank::user, 0, 0), Bytes(32));
    EXPECT_EQ(read(tag, Bank::reserved, 0, 0), Bytes(8));
    auto tid = read(tag, Bank::tid, 0, 0);
    EXPECT_EQ(tid.size(), 12u);
    EXPECT_EQ(tid[0], 0xE2);
    EXPECT_EQ(tid, read(Gen2Memory(spec("30742B4484080BC000001A2C")), Bank::tid, 0, 0));
    EXPECT_NE(tid, read(Gen2Memory(spec("30742B4484080BC000001A2D")), Bank::tid, 0, 0));
}

TEST(TagMemory, WritingTheEpcChangesWhatTheTagAnswersWith) {
    Gen2Memory tag(spec("111122223333444455556666"));
    ASSERT_TRUE(tag.write(Bank::epc, 2, hex("AAAABBBB"), 0));
    EXPECT_EQ(to_hex(tag.id().view()), "AAAABBBB3333444455556666");
    // A PC word of two words: the rest of the memory stays, but is no longer part of the EPC.
    ASSERT_TRUE(tag.write(Bank::epc, 1, hex("1000 1111 2222"), 0));
    EXPECT_EQ(to_hex(tag.id().view()), "11112222");
    EXPECT_EQ(to_hex(read(tag, Bank::epc, 0, 0)), "968F1000111122223333444455556666");
    EXPECT_EQ(error(tag.write(Bank::epc, 1, hex("3800"), 0)), AirError::bad_address)
        << "seven words do not fit into six";
    EXPECT_EQ(error(tag.write(Bank::epc, 0, hex("0000"), 0)), AirError::locked) << "the CRC is the tag's own";
}

TEST(TagMemory, AddressesBeyondTheMemoryAreRefused) {
    auto small = spec("111122223333444455556666");
    small.user = hex("00010002");
    Gen2Memory tag(small);
    EXPECT_EQ(to_hex(read(tag, Bank::user, 1, 1)), "0002");
    EXPECT_EQ(to_hex(read(tag, Bank::user, 1, 0)), "0002") << "zero words: up to the end";
    EXPECT_EQ(error(tag.read(Bank::user, 1, 2, 0)), AirError::bad_address);
    EXPECT_EQ(error(tag.read(Bank::user, 2, 0, 0)), AirError::bad_address);
    EXPECT_EQ(error(tag.read(Bank::user, 1, 0xFFFF'FFFF, 0)), AirError::bad_address);
    EXPECT_EQ(error(tag.read(Bank::user, 0xFFFF'FFFF, 1, 0)), AirError::bad_address);
    EXPECT_EQ(error(tag.write(Bank::user, 1, hex("00010002"), 0)), AirError::bad_address);
    EXPECT_EQ(error(tag.write(Bank::user, 2, hex("0001"), 0)), AirError::bad_address);
    EXPECT_EQ(error(tag.write(Bank::user, 0, hex("01"), 0)), AirError::bad_address) << "half a word";
    EXPECT_EQ(error(tag.write(Bank::user, 0, {}, 0)), AirError::bad_address);
    EXPECT_EQ(to_hex(read(tag, Bank::user, 0, 0)), "00010002");
}

TEST(TagMemory, TheTidCannotBeWritten) {
    Gen2Memory tag(spec("111122223333444455556666"));
    EXPECT_EQ(error(tag.write(Bank::tid, 0, hex("E200"), 0)), AirError::locked);
}

TEST(TagMemory, AWrongPasswordIsRefusedEvenWhereNoneIsNeeded) {
    Gen2Memory tag(spec("111122223333444455556666", 0x1234'5678));
    EXPECT_TRUE(tag.read(Bank::user, 0, 1, 0));
    EXPECT_TRUE(tag.read(Bank::user, 0, 1, 0x1234'5678));
    EXPECT_EQ(error(tag.read(Bank::user, 0, 1, 0x1234'5679)), AirError::locked);
    EXPECT_EQ(error(tag.write(Bank::user, 0, hex("0001"), 1)), AirError::locked);
}

TEST(TagMemory, LockedMemoryIsWrittenWithThePasswordOnly) {
    Gen2Memory tag(spec("111122223333444455556666", 0x1234'5678));
    EXPECT_EQ(error(tag.lock(lock_user, 0)), AirError::locked) << "locking needs the password";
    ASSERT_TRUE(tag.write(Bank::user, 0, hex("0001"), 0));
    ASSERT_TRUE(tag.lock(lock_user, 0x1234'5678));
    EXPECT_EQ(error(tag.write(Bank::user, 0, hex("0002"), 0)), AirError::locked);
    EXPECT_TRUE(tag.write(Bank::user, 0, hex("0003"), 0x1234'5678));
    EXPECT_EQ(to_hex(read(tag, Bank::user, 0, 1)), "0003") << "reading stays free";
    EXPECT_TRUE(tag.write(Bank::epc, 2, hex("0001"), 0)) << "other banks are not locked";
    ASSERT_TRUE(tag.lock(unlock_user, 0x1234'5678));
    EXPECT_TRUE(tag.write(Bank::user, 0, hex("0004"), 0));
}

TEST(TagMemory, APermanentLockNeverOpens) {
    Gen2Memory tag(spec("111122223333444455556666", 0x1234'5678));
    ASSERT_TRUE(tag.lock(lock_user_for_ever, 0x1234'5678));
    EXPECT_EQ(error(tag.write(Bank::user, 0, hex("0002"), 0x1234'5678)), AirError::locked);
    EXPECT_EQ(error(tag.lock(unlock_user, 0x1234'5678)), AirError::locked);
    EXPECT_TRUE(tag.lock(lock_user_for_ever, 0x1234'5678)) << "the same once more is no change";
    // A payload that breaks one permanent pair changes nothing at all.
    AirLock epc_too{0b00'00'10'00'10, 0b00'00'10'00'00};
    EXPECT_EQ(error(tag.lock(epc_too, 0x1234'5678)), AirError::locked);
    EXPECT_TRUE(tag.write(Bank::epc, 2, hex("0001"), 0));
}

TEST(TagMemory, WhatIsOpenForEverCannotBeLocked) {
    Gen2Memory tag(spec("111122223333444455556666", 0x1234'5678));
    ASSERT_TRUE(tag.lock(open_user_for_ever, 0x1234'5678));
    EXPECT_EQ(error(tag.lock(lock_user, 0x1234'5678)), AirError::locked);
    EXPECT_TRUE(tag.write(Bank::user, 0, hex("0002"), 0));
}

TEST(TagMemory, LockedPasswordsAreReadWithThePasswordOnly) {
    Gen2Memory tag(spec("111122223333444455556666", 0x1234'5678, 0x9ABC'DEF0));
    EXPECT_EQ(to_hex(read(tag, Bank::reserved, 0, 4)), "9ABCDEF012345678")
        << "open at first, as from the maker";
    ASSERT_TRUE(tag.lock(lock_passwords, 0x1234'5678));
    EXPECT_EQ(error(tag.read(Bank::reserved, 0, 1, 0)), AirError::locked);
    EXPECT_EQ(error(tag.read(Bank::reserved, 3, 1, 0)), AirError::locked);
    EXPECT_EQ(to_hex(read(tag, Bank::reserved, 0, 4, 0x1234'5678)), "9ABCDEF012345678");
    EXPECT_EQ(error(tag.write(Bank::reserved, 2, hex("00000000"), 0)), AirError::locked);
    ASSERT_TRUE(tag.write(Bank::reserved, 2, hex("00000001"), 0x1234'5678));
    EXPECT_EQ(error(tag.read(Bank::reserved, 0, 1, 0x1234'5678)), AirError::locked)
        << "the password is another";
    EXPECT_TRUE(tag.read(Bank::reserved, 0, 1, 1));
}

TEST(TagMemory, OnePasswordCanBeLockedWithoutTheOther) {
    Gen2Memory tag(spec("111122223333444455556666", 0x1234'5678, 0x9ABC'DEF0));
    ASSERT_TRUE(tag.lock({0b11'00'00'00'00, 0b11'00'00'00'00}, 0x1234'5678));
    EXPECT_EQ(error(tag.read(Bank::reserved, 1, 2, 0x1234'5678)), AirError::locked)
        << "for ever, from anybody";
    EXPECT_EQ(to_hex(read(tag, Bank::reserved, 2, 2)), "12345678");
}

// Every lock state of a memory against every password: no password given, the right one, a wrong one.
struct LockRow {
    std::string_view state;
    unsigned bits;  // a pair of lock bits: locked, for ever
    std::array<bool, 3> can_write;
    std::array<bool, 3> can_read_password;  // all other memory is always open to reading
};
constexpr std::array lock_rows = {
    LockRow{"open", 0b00, {true, true, false}, {true, true, false}},
    LockRow{"open for ever", 0b01, {true, true, false}, {true, true, false}},
    LockRow{"locked", 0b10, {false, true, false}, {false, true, false}},
    LockRow{"locked for ever", 0b11, {false, false, false}, {false, false, false}},
};
struct LockedPlace {
    std::string_view name;
    Bank bank;
    std::uint32_t word;
    unsigned shift;  // of its pair of bits
};
constexpr std::array locked_places = {
    LockedPlace{"kill password", Bank::reserved, 0, 8}, LockedPlace{"access password", Bank::reserved, 2, 6},
    LockedPlace{"EPC", Bank::epc, 2, 4}, LockedPlace{"user memory", Bank::user, 0, 0}};
constexpr std::uint32_t right_password = 0x1234'5678;
constexpr std::array<std::uint32_t, 3> given_passwords = {0, right_password, 0x8765'4321};

TEST(TagMemory, EveryLockStateAgainstEveryPassword) {
    for (auto& place : locked_places)
        for (auto& row : lock_rows)
            for (std::size_t i = 0; i < given_passwords.size(); ++i) {
                SCOPED_TRACE(std::string(place.name) + ", " + std::string(row.state) + ", password " +
                             std::to_string(i));
                Gen2Memory tag(spec("111122223333444455556666", right_password));
                AirLock lock{static_cast<std::uint16_t>(3u << place.shift),
                             static_cast<std::uint16_t>(row.bits << place.shift)};
                ASSERT_TRUE(tag.lock(lock, right_password));
                auto password = given_passwords[i];
                bool can_read = place.bank == Bank::reserved ? row.can_read_password[i] : i != 2;
                EXPECT_EQ(tag.read(place.bank, place.word, 1, password).has_value(), can_read);
                auto before = tag.read(place.bank, place.word, 1, right_password);
                auto written = tag.write(place.bank, place.word, hex("ABCD"), password);
                EXPECT_EQ(written.has_value(), row.can_write[i]);
                if (!written) {
                    EXPECT_EQ(written.error(), AirError::locked);
                    EXPECT_EQ(tag.read(place.bank, place.word, 1, right_password), before);
                }
            }
}

TEST(TagMemory, EveryLockStateAgainstEveryNextOne) {
    for (auto& place : locked_places)
        for (unsigned now = 0; now < 4; ++now)
            for (unsigned mask = 0; mask < 4; ++mask)
                for (unsigned action = 0; action < 4; ++action) {
                    Gen2Memory tag(spec("111122223333444455556666", right_password));
                    auto payload = [&](unsigned which, unsigned value) {
                        return AirLock{static_cast<std::uint16_t>(which << place.shift),
                                       static_cast<std::uint16_t>(value << place.shift)};
                    };
                    ASSERT_TRUE(tag.lock(payload(3, now), right_password));
                    auto next = (now & ~mask) | (action & mask);
                    bool allowed = (now & 1) == 0 || next == now;
                    EXPECT_EQ(tag.lock(payload(mask, action), right_password).has_value(), allowed)
                        << place.name << ' ' << now << ' ' << mask << ' ' << action;
                    EXPECT_EQ(error(tag.lock(payload(mask, action), 0)), AirError::locked)
                        << "never without the password";
                }
}

TEST(TagMemory, WithoutAnAccessPasswordEverybodyMayLockAndWriteWhatIsLocked) {
    Gen2Memory tag(spec("111122223333444455556666"));
    ASSERT_TRUE(tag.lock(lock_user, 0));
    EXPECT_TRUE(tag.write(Bank::user, 0, hex("0001"), 0));
    EXPECT_EQ(error(tag.write(Bank::user, 0, hex("0002"), 1)), AirError::locked) << "1 is a wrong password";
    ASSERT_TRUE(tag.lock(lock_user_for_ever, 0));
    EXPECT_EQ(error(tag.write(Bank::user, 0, hex("0003"), 0)), AirError::locked);
}

TEST(TagMemory, TheXpcWordIsThereWhereTheTagHasOneAndSaysSoInThePcWord) {
    Gen2Memory without(spec("111122223333444455556666"));
    EXPECT_EQ(error(without.read(Bank::epc, 0x21, 1, 0)), AirError::bad_address);

    auto zero = spec("111122223333444455556666");
    zero.xpc = 0;
    Gen2Memory silent(zero);
    EXPECT_EQ(to_hex(read(silent, Bank::epc, 0x21, 1)), "0000");
    EXPECT_EQ(to_hex(read(silent, Bank::epc, 0x21, 0)), "0000") << "it ends the bank";
    EXPECT_EQ(to_hex(read(silent, Bank::epc, 0, 2)), "18353000");

    auto some = zero;
    some.xpc = 0x0800;
    Gen2Memory tag(some);
    EXPECT_EQ(to_hex(read(tag, Bank::epc, 0x21, 1)), "0800");
    EXPECT_EQ(to_hex(read(tag, Bank::epc, 1, 1)), "3200");
    EXPECT_EQ(to_hex(tag.id().view()), "111122223333444455556666");
    EXPECT_EQ(read(tag, Bank::epc, 0, 0).size(), 16u) << "the EPC memory ends before it";
    EXPECT_EQ(error(tag.read(Bank::epc, 8, 1, 0)), AirError::bad_address);
    EXPECT_EQ(error(tag.read(Bank::epc, 7, 2, 0)), AirError::bad_address);
    EXPECT_EQ(error(tag.read(Bank::epc, 0x22, 1, 0)), AirError::bad_address);
    EXPECT_EQ(error(tag.write(Bank::epc, 0x21, hex("0000"), 0)), AirError::locked) << "the tag's own";
    EXPECT_EQ(error(tag.write(Bank::epc, 8, hex("0000"), 0)), AirError::bad_address);
    ASSERT_TRUE(tag.write(Bank::epc, 1, hex("1000"), 0));
    EXPECT_EQ(to_hex(read(tag, Bank::epc, 1, 1)), "1200") << "no writing changes the indicator";
}

TEST(TagMemory, ThePcWordKeepsTheNumberingSystemThatIsWritten) {
    Gen2Memory tag(spec("111122223333444455556666"));
    ASSERT_TRUE(tag.write(Bank::epc, 1, hex("27FF AAAA"), 0));  // all bits below the length
    EXPECT_EQ(to_hex(read(tag, Bank::epc, 1, 1)), "21FF") << "but not the tag's two indicators";
    EXPECT_EQ(to_hex(tag.id().view()), "AAAA222233334444");
}

RC_GTEST_PROP(TagMemory, WhateverIsWrittenTheTagAnswersWithWhatItsPcWordSays, ()) {
    auto of_size = [](std::size_t most) {
        return *rc::gen::resize(static_cast<int>(most), rc::gen::arbitrary<Bytes>());
    };
    auto id = of_size(event::TagId::max_size);
    id.resize(std::min(id.size() / 2 * 2, event::TagId::max_size));
    auto made = spec("");
    made.id = event::TagId(id);
    if (*rc::gen::arbitrary<bool>()) made.xpc = *rc::gen::arbitrary<std::uint16_t>();
    Gen2Memory tag(made);
    auto count = *rc::gen::inRange(0, 20);
    for (int i = 0; i < count; ++i) {
        auto word = *rc::gen::inRange(0u, 40u);
        auto data = of_size(16);
        auto before = read(tag, Bank::epc, 0, 0);
        auto done = tag.write(Bank::epc, word, data, 0);
        auto after = read(tag, Bank::epc, 0, 0);
        if (!done) {
            RC_ASSERT(after == before);
            continue;
        }
        auto size = static_cast<std::size_t>(after[2] >> 3u) * 2;
        RC_ASSERT(4 + size <= after.size());
        RC_ASSERT(Bytes(after.begin() + 4, after.begin() + 4 + static_cast<std::ptrdiff_t>(size)) ==
                  Bytes(tag.id().view().begin(), tag.id().view().end()));
    }
}

TEST(TagMemory, TooLittlePowerIsToldLastAndChangesNothing) {
    Gen2Memory tag(spec("111122223333444455556666", right_password, 7));
    ASSERT_TRUE(tag.lock(lock_user, right_password));
    tag.power_up(false);
    EXPECT_EQ(error(tag.write(Bank::user, 0, hex("0001"), 0)), AirError::locked);
    EXPECT_EQ(error(tag.write(Bank::user, 99, hex("0001"), right_password)), AirError::bad_address);
    EXPECT_EQ(error(tag.write(Bank::user, 0, hex("0001"), right_password)), AirError::insufficient_power);
    EXPECT_EQ(error(tag.lock(unlock_user, right_password)), AirError::insufficient_power);
    EXPECT_EQ(error(tag.kill(8)), AirError::locked);
    EXPECT_EQ(error(tag.kill(7)), AirError::insufficient_power);
    EXPECT_EQ(to_hex(read(tag, Bank::user, 0, 1)), "0000") << "reading needs no more";
    tag.power_up(true);
    EXPECT_EQ(error(tag.write(Bank::user, 0, hex("0001"), 0)), AirError::locked) << "it is locked as it was";
    EXPECT_TRUE(tag.kill(7));
}

TEST(TagMemory, PermalockedBlocksOfUserMemoryAreReadOnlyForEver) {
    auto with_password = spec("E200", 0x1234);
    with_password.user = Bytes(40, 0x11);  // five blocks of four words
    Gen2Memory tag(with_password);
    EXPECT_EQ(error(tag.permalock(Bank::user, 0, hex("4000"), 0)), AirError::locked) << "needs the password";
    EXPECT_EQ(error(tag.permalock(Bank::epc, 0, hex("4000"), 0x1234)), AirError::unsupported);
    EXPECT_EQ(error(tag.permalock(Bank::user, 5, hex("0000"), 0x1234)), AirError::bad_address);
    EXPECT_EQ(error(tag.permalock(Bank::user, 0, hex("4400"), 0x1234)), AirError::bad_address);
    ASSERT_TRUE(tag.permalock(Bank::user, 0, hex("4000"), 0x1234));
    ASSERT_TRUE(tag.permalock(Bank::user, 0, hex("0800"), 0x1234)) << "what is locked stays so";
    EXPECT_EQ(tag.permalocked(Bank::user, 0, 2, 0x1234).value(), hex("4800"));
    EXPECT_EQ(tag.permalocked(Bank::user, 1, 2, 0x1234).value(), hex("9000"));
    EXPECT_EQ(error(tag.permalocked(Bank::user, 0, 2, 0)), AirError::locked);
    EXPECT_TRUE(tag.write(Bank::user, 3, hex("2222"), 0));
    EXPECT_EQ(error(tag.write(Bank::user, 3, hex("33333333"), 0x1234)), AirError::locked);
    EXPECT_EQ(error(tag.write(Bank::user, 16, hex("3333"), 0x1234)), AirError::locked);
    EXPECT_TRUE(tag.write(Bank::user, 12, hex("3333"), 0));
    EXPECT_EQ(to_hex(read(tag, Bank::user, 3, 2)), "22221111");
    tag.power_up(false);
    EXPECT_EQ(error(tag.permalock(Bank::user, 0, hex("8000"), 0x1234)), AirError::insufficient_power);
}

TEST(TagMemory, OnlyTheKillPasswordKillsAndZeroIsNone) {
    Gen2Memory tag(spec("111122223333444455556666", 0, 0x9ABC'DEF0));
    EXPECT_EQ(error(tag.kill(0)), AirError::locked);
    EXPECT_EQ(error(tag.kill(1)), AirError::locked);
    EXPECT_FALSE(tag.is_killed());
    EXPECT_TRUE(tag.kill(0x9ABC'DEF0));
    EXPECT_TRUE(tag.is_killed());
    Gen2Memory immortal(spec("111122223333444455556666"));
    EXPECT_EQ(error(immortal.kill(0)), AirError::locked);
    EXPECT_FALSE(immortal.is_killed());
}

TEST(TagMemory, AGen2TagHearsNoCommandsOfOtherTechnologies) {
    Gen2Memory tag(spec("111122223333444455556666"));
    EXPECT_EQ(error(tag.read_bytes(0, 1)), AirError::no_tag);
    EXPECT_EQ(error(tag.write_bytes(8, hex("01"))), AirError::no_tag);
    EXPECT_EQ(error(tag.lock_byte(8)), AirError::no_tag);
    EXPECT_EQ(error(tag.program(event::TagId(hex("666655554444333322221111")), 0, false)), AirError::no_tag);
    EXPECT_EQ(to_hex(tag.id().view()), "111122223333444455556666");
}

TEST(TagMemory, OtherTechnologiesHaveUserMemoryOnly) {
    auto hf = spec("E004010012345678");
    hf.technology = event::Technology::iso15693;
    hf.user = hex("0102030405060708");
    PlainMemory tag(hf);
    EXPECT_EQ(to_hex(tag.id().view()), "E004010012345678");
    EXPECT_EQ(to_hex(read(tag, Bank::user, 2, 2)), "05060708");
    EXPECT_TRUE(tag.write(Bank::user, 0, hex("FFFF"), 0));
    EXPECT_EQ(error(tag.read(Bank::epc, 0, 1, 0)), AirError::bad_address);
    EXPECT_EQ(error(tag.lock(lock_user, 0)), AirError::unsupported);
    EXPECT_EQ(error(tag.kill(0)), AirError::unsupported);
}

}  // namespace
}  // namespace gantry::field
