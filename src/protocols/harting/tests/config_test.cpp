#include "protocols/harting/config.hpp"

#include <algorithm>
#include <bitset>
#include <map>
#include <set>

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "base/text.hpp"

namespace gantry::harting {
namespace {

using wire::Value;
using Kind = ConfigRow::Kind;
constexpr std::size_t all_bytes = block_size * block_count;
using Bits = std::bitset<8 * all_bytes>;

// Every bit that a row covers, of all blocks in a row.
Bits covered(const ConfigRow& row) {
    Bits bits;
    auto size = std::size_t{row.bit} + row.bits;
    auto bytes = (size + 7) / 8;
    auto first = row.block * block_size + row.byte;
    for (std::size_t i = row.bit; i < size; ++i)
        bits.set(8 * (first + bytes - 1 - i / 8) + i % 8);
    if (row.kind == Kind::text)
        for (std::size_t i = 0; i < 8; ++i)
            bits.set(8 * (first - 1) + i);
    return bits;
}

TEST(HartingConfig, ThereAreSixtyFourBlocksAndTheReservedOnesAreTheManuals) {
    ASSERT_EQ(blocks().size(), block_count);
    const std::set<int> reserved{6,  7,  8,  14, 17, 18, 19, 21, 28, 29, 30, 31, 32, 35, 36, 37, 38, 39, 42,
                                 43, 44, 45, 46, 47, 48, 50, 51, 52, 53, 54, 55, 56, 57, 58, 59, 60, 61, 62};
    for (std::size_t i = 0; i < block_count; ++i) {
        EXPECT_EQ(blocks()[i].number, i);
        EXPECT_FALSE(blocks()[i].name.empty());
        EXPECT_EQ(blocks()[i].reserved, reserved.contains(static_cast<int>(i))) << i;
    }
    EXPECT_EQ(get(config_row("CFG12.TRANSPONDER-VALID-TIME"), blocks()[12].factory), Value(55));
    EXPECT_EQ(get(config_row("CFG49.HOLD-TIME"), blocks()[49].factory), Value(5));
    EXPECT_EQ(get(config_row("CFG1.MODE"), blocks()[1].factory), Value(std::string("Host")));
    EXPECT_EQ(get(config_row("CFG1.BAUD"), blocks()[1].factory), Value(std::string("38400")));
    EXPECT_EQ(get(config_row("CFG1.PARITY"), blocks()[1].factory), Value(std::string("even")));
}

TEST(HartingConfig, EveryRowHasBitsOfItsOwnInBlocksThatExist) {
    std::set<std::string_view> names;
    Bits taken;
    for (auto& row : config_rows()) {
        SCOPED_TRACE(row.name);
        EXPECT_TRUE(names.insert(row.name).second);
        EXPECT_TRUE(row.name.starts_with("CFG" + std::to_string(row.block) + "."));
        EXPECT_FALSE(row.help.empty());
        EXPECT_LT(row.byte, block_size);
        ASSERT_LE(row.block + blocks_of(row), block_count);
        for (std::size_t i = 0; i < blocks_of(row); ++i)
            EXPECT_FALSE(blocks()[row.block + i].reserved);
        if (row.kind == Kind::number) {
            EXPECT_LE(row.bits, 32);
            bool whole = row.bit == 0 && row.bits % 8 == 0;
            EXPECT_TRUE(whole || row.bit + row.bits <= 8);
        } else {
            EXPECT_TRUE(row.kind != Kind::address || row.bits == 32);
            EXPECT_TRUE(row.kind != Kind::text || row.byte > 0);
        }
        EXPECT_TRUE((taken & covered(row)).none());
        taken |= covered(row);
        if (row.enumeration == nullptr) continue;
        for (auto& each : row.enumeration->rows)
            EXPECT_LT(each.value, std::int64_t{1} << row.bits);
    }
}

TEST(HartingConfig, NamesAreFoundInAnyCaseAndSlipsAreNamed) {
    EXPECT_EQ(find_config("cfg1.mode"), &config_row("CFG1.MODE"));
    ASSERT_NE(find_config("CFG12.RAW"), nullptr);
    EXPECT_EQ(find_config("CFG6.RAW"), nullptr);  // reserved
    EXPECT_EQ(find_config("CFG1.NOD"), nullptr);
    EXPECT_EQ(nearest_config("CFG1.MODUS"), "CFG1.MODE");
}

RC_GTEST_PROP(HartingConfig, SettingANumberGivesItBackAndChangesNothingElse, ()) {
    auto& row = **rc::gen::map(rc::gen::inRange<std::size_t>(0, config_rows().size()),
                               [](std::size_t i) { return &config_rows()[i]; });
    if (row.kind != Kind::number) return;
    auto before = *rc::gen::container<Bytes>(all_bytes, rc::gen::arbitrary<std::uint8_t>());
    auto most = row.min <= row.max ? row.max : (std::int64_t{1} << row.bits) - 1;
    auto number = *rc::gen::inRange<std::int64_t>(row.min <= row.max ? row.min : 0, most + 1);
    auto after = before;
    auto blocks_on = std::span(after).subspan(row.block * block_size);
    RC_ASSERT(set(row, Value(number), blocks_on).has_value());
    RC_ASSERT(get_number(row, blocks_on) == number);
    auto shown = get(row, blocks_on);
    auto again = after;
    RC_ASSERT(set(row, shown, std::span(again).subspan(row.block * block_size)).has_value());
    RC_ASSERT(again == after);  // what get() shows, set() takes
    auto mine = covered(row);
    for (std::size_t i = 0; i < all_bytes; ++i)
        for (std::size_t bit = 0; bit < 8; ++bit)
            if (!mine[8 * i + bit]) RC_ASSERT(((before[i] ^ after[i]) >> bit & 1) == 0);
}

TEST(HartingConfig, BytesAddressesAndTextsLieWhereTheyBelong) {
    Bytes bytes(all_bytes, 0xEE);
    auto from = [&](int block) { return std::span(bytes).subspan(static_cast<std::size_t>(block) * 14); };
    ASSERT_TRUE(set(config_row("CFG49.DESTINATION"), Value(std::string("10.1.2.3")), from(49)));
    EXPECT_EQ(to_hex(from(49).first(14)), "EEEEEEEEEEEEEE0A010203EEEEEE");
    EXPECT_EQ(get(config_row("CFG49.DESTINATION"), from(49)), Value(std::string("10.1.2.3")));

    // The mask runs over into the next block; what is not given is zero.
    auto& mask = config_row("CFG22.MASK");
    EXPECT_EQ(blocks_of(mask), 2);
    ASSERT_TRUE(set(mask, Value(std::string("E2 80 0102030405060708090A")), from(22)));
    EXPECT_EQ(to_hex(from(22).first(28)),
              "EEEEEEEEE28001020304050607080"
              "90A000000000000000000000000");

    auto& hostname = config_row("CFG33.HOSTNAME");
    ASSERT_TRUE(set(hostname, Value(std::string("dock-2-by-the-river")), from(33)));
    EXPECT_EQ(from(33)[0], 19);
    EXPECT_EQ(get(hostname, from(33)), Value(std::string("dock-2-by-the-river")));
    from(33)[0] = 200;  // a reader's word is not trusted
    EXPECT_EQ(get(hostname, from(33)), Value(std::string("dock-2-by-the-river")));

    auto& raw = *find_config("CFG63.RAW");
    ASSERT_TRUE(set(raw, Value(std::string("000102030405060708090A0B0C0D")), from(63)));
    EXPECT_EQ(get(raw, from(63)), Value(Bytes{0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13}));
}

TEST(HartingConfig, WhatDoesNotFitIsRefusedAndChangesNothing) {
    struct Case {
        std::string_view name, value, says;
    };
    const Case cases[] = {
        {"CFG1.COM-ADR", "255", "0 to 254"},
        {"CFG1.MODE", "Hots", "one of Host, Scan, BufferedRead, Notification"},
        {"CFG1.MODE", "256", "a number 0 to 255"},
        {"CFG49.ACK", "2", "one of off, on"},
        {"CFG49.DESTINATION", "10.1.2", "192.168.0.10"},
        {"CFG49.DESTINATION", "10.1.2.256", "192.168.0.10"},
        {"CFG49.DESTINATION", "10.1.2.3.4", "192.168.0.10"},
        {"CFG63.RAW", "0001", "hex digits of 14 bytes"},
        {"CFG22.MASK", "00010203040506070809000102030405060708090001020304", "at most 24 bytes"},
        {"CFG33.HOSTNAME", "a-name-of-more-than-27-letters", "at most 27 characters"},
        {"CFG12.TRANSPONDER-VALID-TIME", "5.5", "0 to 65535"},
    };
    for (auto& each : cases) {
        SCOPED_TRACE(each.name);
        Bytes bytes(2 * block_size, 0x55);
        auto done = set(*find_config(each.name), Value(std::string(each.value)), bytes);
        ASSERT_FALSE(done.has_value());
        EXPECT_NE(done.error().text().find(each.says), std::string::npos) << done.error().text();
        EXPECT_EQ(bytes, Bytes(2 * block_size, 0x55));
    }
    Bytes one(block_size, 0);
    EXPECT_FALSE(set(config_row("CFG22.MASK"), Value(std::string("E2")), one));  // half of it
}

TEST(HartingConfig, EverybodySeesRawBlocksFirstAndPasswordsNever) {
    std::map<std::string_view, const ParameterRow*> rows;
    for (auto& row : parameter_rows())
        EXPECT_TRUE(rows.emplace(row.name, &row).second) << row.name;
    EXPECT_EQ(rows.size(), config_rows().size() + 25);
    EXPECT_TRUE(rows.at("CFG0.PASSWORD")->secret);
    EXPECT_FALSE(rows.contains("CFG0.RAW"));  // it would tell the password
    EXPECT_TRUE(rows.at("CFG1.BAUD")->needs_restart);
    EXPECT_FALSE(rows.at("CFG1.MODE")->needs_restart);
    EXPECT_TRUE(rows.at("CFG23.RAW")->raw);
    EXPECT_FALSE(rows.at("CFG63.RAW")->raw);
    EXPECT_LT(rows.at("CFG1.RAW")->order, rows.at("CFG1.BAUD")->order);
    EXPECT_LT(rows.at("CFG49.ACK")->order, rows.at("CFG1.MODE")->order);
    EXPECT_LT(rows.at("CFG1.MODE")->order, rows.at("CFG0.PASSWORD")->order);
    EXPECT_TRUE(std::ranges::all_of(parameter_rows(), &ParameterRow::permanent));
    // What a person types, as the reader shows it afterwards.
    EXPECT_EQ(*parse_parameter(*rows.at("CFG1.MODE"), "0xC0"), Value(std::string("Notification")));
    EXPECT_EQ(*parse_parameter(*rows.at("CFG13.END-USER"), "0d0a"), Value(Bytes{0x0D, 0x0A, 0}));
    EXPECT_EQ(parse_parameter(*rows.at("CFG1.COM-ADR"), "255").error().what,
              "CFG1.COM-ADR: \"255\" does not fit; expected 0 to 254");
}

}  // namespace
}  // namespace gantry::harting
