#include "protocols/dagprog/walker.hpp"

#include "support.hpp"

namespace gantry::dagprog::test {

namespace {

struct Walk {
    std::vector<Observation> seen;
    Bytes data;
    TagWalker walker;
    Steady now = testkit::script_start.steady;

    explicit Walk(bool serials, bool blocks, std::uint32_t count = 1) {
        walker.set_up(
            {.technology = event::Technology::iso15693, .serials = serials, .data = blocks, .blocks = count});
    }
    std::size_t takes(std::string_view text) {
        auto exact = bytes_of(text);  // a block of its own size: one byte too far is seen by the sanitizer
        exact.shrink_to_fit();
        return walker.walk(exact, now, seen, data);
    }
    std::string text() const {
        std::string out;
        for (auto& each : seen)
            out += to_hex(each.tag.view()) + "=" +
                   to_hex(ByteView(data).subspan(each.data_offset, each.data_size)) + " ";
        return out;
    }
};

const std::string sn_a = said({"SN\tE004010012345678"}), sn_b = said({"SN\tE0040100AABBCCDD"});
std::string block(std::string_view count, std::string_view data) {
    return said({"00\t" + std::string(count) + "\t" + std::string(data)});
}

}  // namespace

TEST(DagprogWalker, ANumberAndTheDataAfterItAreOneRead) {
    Walk walk(true, true);
    auto lines = sn_a + block("1A", "0012341F") + sn_b + block("1B", "DEADbeef");
    EXPECT_EQ(walk.takes(lines), lines.size());
    EXPECT_EQ(walk.text(), "E004010012345678=0012341F E0040100AABBCCDD=DEADBEEF ");
    EXPECT_EQ(walk.seen[0].technology, event::Technology::iso15693);
    EXPECT_EQ(walk.seen[0].antenna, Observation::no_antenna);
    EXPECT_EQ(walk.walker.tally().reads, 2u);
    EXPECT_EQ(walk.walker.lines(), 4u);
}

TEST(DagprogWalker, ANumberWhoseDataDoNotComeIsAReadWithoutThem) {
    Walk walk(true, true);
    walk.takes(sn_a);
    EXPECT_EQ(walk.text(), "");
    ASSERT_TRUE(walk.walker.deadline());
    walk.walker.time_passed(*walk.walker.deadline(), walk.seen, walk.data);
    EXPECT_EQ(walk.text(), "E004010012345678= ");
    walk.now += 200ms;
    walk.takes(block("01", "00000000"));  // too late for it, and whose it is nobody knows
    EXPECT_EQ(walk.seen.size(), 1u);
    walk.takes(sn_a + sn_b + block("02", "00000001"));
    EXPECT_EQ(walk.text(), "E004010012345678= E004010012345678= E0040100AABBCCDD=00000001 ");
    EXPECT_EQ(walk.walker.tally().stray, 1u);
}

TEST(DagprogWalker, NumbersAloneAndDataAloneAreReads) {
    Walk numbers(true, false);
    numbers.takes(sn_a + sn_a);
    EXPECT_EQ(numbers.text(), "E004010012345678= E004010012345678= ");
    Walk data(false, true);
    data.takes(block("01", "11223344") + block("02", "11223344"));
    EXPECT_EQ(data.text(), "11223344=11223344 11223344=11223344 ");
    Walk nothing(false, false);
    nothing.takes(block("01", "11223344"));
    EXPECT_EQ(nothing.seen.size(), 0u);
}

TEST(DagprogWalker, ARowOfBlocksCountsOnlyWhenItIsWhole) {
    Walk walk(false, true, 3);
    walk.takes(block("01", "00000001") + block("01", "00000002") + block("01", "00000003"));
    walk.takes(block("02", "00000004") + block("02", "00000005"));
    walk.takes(block("03", "00000006") + block("03", "00000007") + block("03", "00000008"));
    EXPECT_EQ(walk.text(),
              "000000010000000200000003=000000010000000200000003 "
              "000000060000000700000008=000000060000000700000008 ");
    EXPECT_EQ(walk.walker.tally().stray, 2u);
    Walk most(false, true, 16);
    for (int i = 0; i < 16; ++i)
        most.takes(block("01", "000000AA"));
    ASSERT_EQ(most.seen.size(), 1u);
    EXPECT_EQ(most.seen[0].tag.size, event::TagId::max_size);
    EXPECT_EQ(most.seen[0].data_size, 64u);
}

TEST(DagprogWalker, StopsAtWhatIsNoPlainTagLine) {
    for (const auto& odd :
         {said({"SO"}), said({"SN\t0000000000000001"}), said({"SN\t0000000000000000"}),
          said({"SN\tE00401001234567G"}), said({"00\t1G\t00000000"}), said({"00\t01\t0000000"}),
          std::string("SN\tE004010012345678\r"), std::string("\x02SN\tE0040100"), std::string()}) {
        Walk walk(true, true);
        auto before = sn_a + block("01", "00000000");
        EXPECT_EQ(walk.takes(before + odd), before.size()) << to_hex(as_bytes(odd));
        EXPECT_EQ(walk.seen.size(), 1u);
    }
}

TEST(DagprogWalker, NumbersComeOutMostSignificantByteFirst) {
    struct Case {
        ByteOrder order;
        event::Technology technology;
        std::string_view text, id;
    };
    for (auto& [order, technology, text, expected] : {
             Case{ByteOrder::automatic, event::Technology::iso15693, "E004010012345678", "E004010012345678"},
             Case{ByteOrder::automatic, event::Technology::iso15693, "78563412000104E0", "E004010012345678"},
             Case{ByteOrder::automatic, event::Technology::iso15693, "E0563412000104E0", "E0563412000104E0"},
             Case{ByteOrder::automatic, event::Technology::icode1, "78563412000104E0", "78563412000104E0"},
             Case{ByteOrder::msb, event::Technology::iso15693, "78563412000104E0", "78563412000104E0"},
             Case{ByteOrder::lsb, event::Technology::icode1, "0102030405060708", "0807060504030201"},
         }) {
        Walk walk(true, false);
        walk.walker.set_up({.technology = technology, .order = order});
        walk.takes(said({"SN\t" + std::string(text)}));
        EXPECT_EQ(walk.text(), std::string(expected) + "= ");
    }
}

TEST(DagprogWalker, RefusesBlocksWithAnotherCrc8WhenToldTo) {
    Walk walk(true, true);
    walk.walker.set_up({.serials = true, .data = true, .crc8 = find_crc8("i-code")});
    walk.takes(sn_a + block("01", "0012341F") + sn_a + block("02", "0012341E"));
    EXPECT_EQ(walk.text(), "E004010012345678=0012341F ");
    EXPECT_EQ(walk.walker.tally().bad_crc, 1u);
}

TEST(DagprogCrc8, TheCandidatesGiveThePublishedValues) {
    auto of = [](const Crc8Row& row, std::string_view text) { return crc8(row, hex(text)); };
    // Columns of the fact sheet: 00 00 00, 00 00 01, 00 12 34, 12 34 56.
    struct Case {
        std::string_view name;
        std::array<std::uint8_t, 4> values;
    };
    std::vector<Case> cases = {{"i-code", {0x0D, 0x10, 0x1F, 0x6A}}, {"maxim-dow", {0x00, 0x5E, 0xA2, 0x15}},
                               {"smbus", {0x00, 0x07, 0xF1, 0x7C}},  {"mifare-mad", {0x2A, 0x37, 0x38, 0x4D}},
                               {"hitag", {0x0E, 0x13, 0x1C, 0x69}},  {"tech-3250", {0x70, 0x14, 0xA5, 0x64}},
                               {"gsm-a", {0x00, 0x1D, 0x12, 0x67}},  {"sae-j1850", {0xF1, 0xEC, 0xE3, 0x96}},
                               {"rohc", {0xD4, 0x45, 0x38, 0xFD}},   {"i-432-1", {0x55, 0x52, 0xA4, 0x29}},
                               {"nrsc-5", {0x4B, 0x7A, 0xFD, 0x8A}}, {"dvb-s2", {0x00, 0xD5, 0xAE, 0xAD}}};
    EXPECT_EQ(cases.size(), crc8_rows().size());
    for (auto& [name, values] : cases) {
        auto* row = find_crc8(name);
        ASSERT_NE(row, nullptr) << name;
        EXPECT_EQ(crc8(*row, as_bytes("123456789")), row->check) << name;
        EXPECT_EQ(of(*row, "000000"), values[0]) << name;
        EXPECT_EQ(of(*row, "000001"), values[1]) << name;
        EXPECT_EQ(of(*row, "001234"), values[2]) << name;
        EXPECT_EQ(of(*row, "123456"), values[3]) << name;
    }
    EXPECT_EQ(find_crc8("auto"), nullptr);
}

TEST(DagprogCrc8, EveryVariantIsFoundFromFiveBlocks) {
    for (auto& row : crc8_rows())
        for (bool reversed : {false, true}) {
            Crc8Finder finder;
            for (std::string_view data : {"000001", "001234", "123456", "ABCDEF", "807060"}) {
                auto bytes = hex(data);
                auto covered = bytes;
                if (reversed) std::ranges::reverse(covered);
                bytes.push_back(crc8(row, covered));
                EXPECT_FALSE(finder.found());
                finder.sample(bytes);
                finder.sample(bytes);  // the same again is no other sample
            }
            ASSERT_TRUE(finder.found()) << row.name;
            EXPECT_EQ(finder.found()->row->name, row.name);
            EXPECT_EQ(finder.found()->reversed, reversed);
        }
    Crc8Finder none;
    for (std::uint8_t i = 0; i < 6; ++i)
        none.sample(Bytes{i, 2, 3, static_cast<std::uint8_t>(i * 37 + 5)});
    EXPECT_TRUE(none.left().empty());
    EXPECT_FALSE(none.found());
}

}  // namespace gantry::dagprog::test
