#include "protocols/silion/walker.hpp"

#include "support.hpp"

namespace gantry::silion::test {

struct Walk {
    std::vector<Observation> seen;
    Bytes bank;
    Walked walked;
    explicit Walk(std::string_view data) {
        // An exact block on the heap: one byte too far is seen by the address sanitizer.
        Bytes exact = hex(data);
        exact.shrink_to_fit();
        walked = walk_tags(exact, 16, seen, bank);
    }
};

TEST(SilionWalker, ReadsEveryFieldOfARecord) {
    Walk walk(
        "0001"
        "04C8FB050C3034257BF7194E4000001A8506E28011052000");
    ASSERT_FALSE(walk.walked.fault);
    ASSERT_EQ(walk.seen.size(), 1u);
    auto& o = walk.seen[0];
    EXPECT_EQ(o.tag, epc("3034257BF7194E4000001A85"));
    EXPECT_EQ(o.technology, event::Technology::epc_gen2);
    EXPECT_EQ(o.antenna, 4);
    EXPECT_EQ(o.rssi, -50);
    EXPECT_EQ(o.reads, 200);
    EXPECT_EQ(to_hex(ByteView(walk.bank).subspan(o.data_offset, o.data_size)), "E28011052000");
    EXPECT_EQ(walk.walked.reads, 200u);
}

TEST(SilionWalker, KnowsTheAirProtocolsAndAcceptsAnyNumber) {
    Walk walk(
        "0004"
        "0101D80301AA00"
        "0101D80601BB00"
        "0101D80101CC00"
        "0101D81D01DD00");
    ASSERT_EQ(walk.seen.size(), 4u);
    EXPECT_EQ(walk.seen[0].technology, event::Technology::iso18000_6b);
    EXPECT_EQ(walk.seen[1].technology, event::Technology::iso18000_6b);
    EXPECT_EQ(walk.seen[2].technology, event::Technology::unknown);
    EXPECT_EQ(walk.seen[3].technology, event::Technology::unknown);
}

TEST(SilionWalker, ACountOfNoReadsIsOneRead) {
    Walk walk(
        "0001"
        "0100D80501AA00");
    EXPECT_EQ(walk.seen[0].reads, 1);
}

TEST(SilionWalker, TriesTwoBytesOfBankLengthWhenOneDoesNotFit) {
    Walk walk(
        "0001"
        "0201D8050CE20041453116003820703FB7"
        "0002"
        "AABB");
    EXPECT_FALSE(walk.walked.fault);
    EXPECT_TRUE(walk.walked.wide);
    ASSERT_EQ(walk.seen.size(), 1u);
    EXPECT_EQ(to_hex(walk.bank), "AABB");
}

TEST(SilionWalker, DeliversTheWholeRecordsOfAMalformedFrame) {
    Walk cut(
        "0002"
        "0201D80502ABCD00"
        "0201D80502AB");
    ASSERT_TRUE(cut.walked.fault);
    EXPECT_EQ(cut.walked.fault->text(), "Epc at 26: record 2 of the tags is cut off");
    ASSERT_EQ(cut.seen.size(), 1u);
    EXPECT_EQ(cut.seen[0].tag, epc("ABCD"));

    Walk more(
        "0001"
        "0201D80502ABCD00"
        "010203");
    ASSERT_TRUE(more.walked.fault);
    EXPECT_EQ(more.walked.fault->text(), "Tags at 26: 3 bytes after the last tag");
    EXPECT_EQ(more.seen.size(), 1u);
}

TEST(SilionWalker, ACountThatLiesCostsNothing) {
    Walk walk(
        "FFFF"
        "0201D80502ABCD00");
    ASSERT_TRUE(walk.walked.fault);
    EXPECT_EQ(walk.seen.size(), 1u);
    EXPECT_LT(walk.seen.capacity(), 16u);
    EXPECT_TRUE(Walk("").walked.fault);
    EXPECT_TRUE(Walk("00").walked.fault);
    EXPECT_FALSE(Walk("0000").walked.fault);
}

TEST(SilionWalker, NeverMakesAnIdShorter) {
    std::string id63, id62;
    for (int i = 0; i < 63; ++i)
        id63 += "A1";
    id62 = id63.substr(2);
    Walk walk(
        "0003"
        "0101D8053F" +
        id63 + "00" +
        "0101D80500"
        "00" +
        "0101D8053E" + id62 + "00");
    EXPECT_FALSE(walk.walked.fault);
    EXPECT_EQ(walk.walked.records, 3u);
    EXPECT_EQ(walk.walked.unusable, 2u);
    ASSERT_EQ(walk.seen.size(), 1u);
    EXPECT_EQ(walk.seen[0].tag.size, 62);
}

TEST(SilionWalker, AppendsToWhatIsThere) {
    std::vector<Observation> seen;
    Bytes bank;
    auto data =
        hex("0001"
            "0101D80501AA02BEEF");
    walk_tags(data, 0, seen, bank);
    walk_tags(data, 0, seen, bank);
    ASSERT_EQ(seen.size(), 2u);
    EXPECT_EQ(seen[1].data_offset, 2u);
    EXPECT_EQ(to_hex(bank), "BEEFBEEF");
}

TEST(SilionWalker, SurvivesEveryTruncation) {
    auto data =
        hex("0003"
            "0201D8050CE20041453116003820703FB700"
            "0201C10502ABCD03112233"
            "0201C2050200FF00");
    for (std::size_t size = 0; size <= data.size(); ++size) {
        Walk walk(to_hex(ByteView(data).first(size)));
        EXPECT_EQ(walk.walked.fault.has_value(), size != data.size()) << size;
        EXPECT_LE(walk.seen.size(), 3u);
    }
}

}  // namespace gantry::silion::test
