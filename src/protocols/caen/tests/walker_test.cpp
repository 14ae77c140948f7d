#include "protocols/caen/walker.hpp"

#include <gtest/gtest.h>

#include "protocols/caen/message.hpp"
#include "testkit/vectors.hpp"

namespace gantry::caen::test {

using event::Technology;
using testkit::hex;

namespace {

// Pairs as they follow each other in an answer.
struct Pairs {
    Bytes bytes;
    Pairs& number(Attribute attribute, std::uint64_t value) {
        append_number(bytes, attribute, value);
        return *this;
    }
    Pairs& text(Attribute attribute, std::string_view value) {
        append_text(bytes, attribute, value);
        return *this;
    }
    Pairs& raw(Attribute attribute, std::string_view digits) {
        append_bytes(bytes, attribute, hex(digits));
        return *this;
    }
    Pairs& at(std::string_view read_point, std::int64_t micros) {
        text(Attribute::source_name, "Source_0").text(Attribute::read_point_name, read_point);
        append_time(bytes, Attribute::time_stamp, micros);
        return *this;
    }
    Pairs& tag(std::string_view id) {
        number(Attribute::tag_id_len, id.size() / 2);
        return raw(Attribute::tag_id, id);
    }
};

struct Walk {
    std::vector<Observation> seen;
    Bytes data;
    std::vector<std::uint8_t> events;
    Walked walked;
    explicit Walk(const Pairs& pairs, Technology fallback = Technology::unknown) {
        // An exact block on the heap: one byte too far is seen by the address sanitizer.
        Bytes exact = pairs.bytes;
        exact.shrink_to_fit();
        TagWalker walker(fallback);
        walked = walker.walk(exact, header_size, seen, data, &events);
    }
};

event::TagId id(std::string_view digits) {
    return event::TagId(hex(digits));
}

}  // namespace

TEST(CaenWalker, ReadsEveryTagOfAnInventory) {
    Pairs pairs;
    pairs.at("Ant1", 1'400'000'250).number(Attribute::tag_type, 3).tag("300833B2DDD9014035050000");
    pairs.number(Attribute::rssi, 0xFDF0);
    pairs.at("Ant3", 1'500'000'000).number(Attribute::tag_type, 0).tag("E0040F0E06010000");
    pairs.number(Attribute::rssi, 0xFE00).number(Attribute::result_code, 0);
    Walk walk(pairs);
    ASSERT_FALSE(walk.walked.fault);
    EXPECT_EQ(walk.walked.tags, 2u);
    EXPECT_EQ(walk.walked.result, 0);
    ASSERT_EQ(walk.seen.size(), 2u);
    EXPECT_EQ(walk.seen[0].tag, id("300833B2DDD9014035050000"));
    EXPECT_EQ(walk.seen[0].technology, Technology::epc_gen2);
    EXPECT_EQ(walk.seen[0].antenna, 1);
    EXPECT_EQ(walk.seen[0].rssi, -528);
    EXPECT_EQ(walk.seen[0].reads, 1);
    EXPECT_EQ(walk.seen[0].reader_time_us, 1'400'000'250);
    EXPECT_EQ(walk.seen[1].technology, Technology::iso18000_6b);
    EXPECT_EQ(walk.seen[1].antenna, 3);
    EXPECT_EQ(walk.seen[1].rssi, -512);
    EXPECT_EQ(walk.seen[1].reader_time_us, 1'500'000'000);
}

TEST(CaenWalker, RawReadIdsNamesAReadPointOnceForAllItsTags) {
    Pairs pairs;
    pairs.at("Ant0", 0).tag("05629FFFC0113001").raw(Attribute::tag_id, "E0040F0E06010000");
    pairs.at("Ant2", 0).tag("1122334455667788").number(Attribute::result_code, 0);
    Walk walk(pairs, Technology::iso18000_6b);
    ASSERT_EQ(walk.seen.size(), 3u);
    EXPECT_EQ(walk.seen[0].antenna, 0);
    EXPECT_EQ(walk.seen[1].antenna, 0);
    EXPECT_EQ(walk.seen[2].antenna, 2);
    for (auto& each : walk.seen) {
        EXPECT_EQ(each.technology, Technology::iso18000_6b);
        EXPECT_EQ(each.rssi, Observation::no_rssi);
        EXPECT_EQ(each.reader_time_us, 0) << "the clock is not set";
    }
}

TEST(CaenWalker, CompactAnswersHaveIdsAlone) {
    Pairs pairs;
    pairs.raw(Attribute::tag_id, "AABB").raw(Attribute::tag_id, "CCDD").number(Attribute::result_code, 0);
    Walk walk(pairs, Technology::epc_gen2);
    ASSERT_EQ(walk.seen.size(), 2u);
    EXPECT_EQ(walk.seen[1].tag, id("CCDD"));
    EXPECT_EQ(walk.seen[1].antenna, Observation::no_antenna);
    EXPECT_EQ(walk.seen[1].technology, Technology::epc_gen2);
}

TEST(CaenWalker, WhatFollowsATagIsItsOwn) {
    Pairs pairs;
    pairs.at("Ant0", 0).number(Attribute::tag_type, 3).tag("AABB");
    pairs.number(Attribute::rssi, 0xFE00).number(Attribute::phase, 100).number(Attribute::length, 4);
    pairs.raw(Attribute::tag_value, "E2801105").raw(Attribute::xpc, "00000000").raw(Attribute::pc, "3000");
    pairs.at("Ant0", 0).number(Attribute::tag_type, 3).tag("CCDD").number(Attribute::length, 0);
    Walk walk(pairs);
    ASSERT_EQ(walk.seen.size(), 2u);
    EXPECT_EQ(to_hex(ByteView(walk.data).subspan(walk.seen[0].data_offset, walk.seen[0].data_size)),
              "E2801105");
    EXPECT_EQ(walk.seen[0].data_bank, Bank::tid);
    EXPECT_EQ(walk.seen[0].rssi, -512);
    EXPECT_EQ(walk.seen[1].data_size, 0);
    EXPECT_EQ(walk.seen[1].rssi, Observation::no_rssi);
    EXPECT_FALSE(walk.walked.result);
}

// Whichever way the pairs of a tag come.
TEST(CaenWalker, PcAndXpcAreTheTagsTheyFollow) {
    for (bool compact : {false, true}) {
        SCOPED_TRACE(compact);
        Pairs pairs;
        auto add = [&](std::string_view its_id) -> Pairs& {
            if (compact) return pairs.raw(Attribute::tag_id, its_id);
            return pairs.at("Ant0", 0).number(Attribute::tag_type, 3).tag(its_id);
        };
        add("AABB").raw(Attribute::xpc, "08000000").raw(Attribute::pc, "0A00");
        add("CCDD").raw(Attribute::xpc, "00000000");
        add("EEFF").raw(Attribute::pc, "0800").number(Attribute::result_code, 0);
        auto check = [](const std::vector<Observation>& seen) {
            ASSERT_EQ(seen.size(), 3u);
            EXPECT_EQ(seen[0].pc, 0x0A00);
            EXPECT_EQ(seen[0].xpc, 0x08000000u);
            EXPECT_EQ(seen[1].pc, 0) << "not said";
            EXPECT_EQ(seen[1].xpc, 0u) << "the tag sends none";
            EXPECT_EQ(seen[2].pc, 0x0800);
            EXPECT_EQ(seen[2].xpc, Observation::no_xpc) << "not said";
        };
        check(Walk(pairs, Technology::epc_gen2).seen);
        // As a framed stream brings them.
        TagWalker walker(Technology::epc_gen2);
        std::vector<Observation> seen;
        Bytes data;
        for (AvpReader reader(pairs.bytes); auto avp = reader.next();)
            walker.walk({avp->value.data() - avp_header_size, avp->value.size() + avp_header_size}, 0, seen,
                        data);
        check(seen);
    }
}

TEST(CaenWalker, PcAndXpcAreTakenInTheSizesThatTheSourcesNameAndNoOthers) {
    struct Case {
        std::string_view value;
        std::uint16_t pc;
        std::uint32_t xpc;
    };
    for (auto& each : std::initializer_list<Case>{
             {"3000", 0x3000, 0x30000000},
             {"00003000", 0x3000, 0x30000000},
             {"30000000", 0x3000, 0x30000000},
             {"00000000", 0, 0},
             {"0000", 0, 0},
             {"80003000", 0, 0x80003000},  // two words: no PC can be told from that
             {"", 0, Observation::no_xpc},
             {"30", 0, Observation::no_xpc},
             {"003000", 0, Observation::no_xpc},
             {"0000300000", 0, Observation::no_xpc},
         }) {
        SCOPED_TRACE(each.value);
        Pairs pairs;
        pairs.raw(Attribute::pc, "1111").raw(Attribute::xpc, "11111111");  // before any tag: nobody's
        pairs.raw(Attribute::tag_id, "AABB").raw(Attribute::xpc, each.value).raw(Attribute::pc, each.value);
        Walk walk(pairs);
        ASSERT_EQ(walk.seen.size(), 1u);
        EXPECT_EQ(walk.seen[0].pc, each.pc);
        EXPECT_EQ(walk.seen[0].xpc, each.xpc);
    }
}

TEST(CaenWalker, NotificationsSayTheirEventAfterTheTag) {
    Pairs pairs;
    append_time(pairs.bytes, Attribute::time_stamp, 7'000'000);
    pairs.tag("AABB").text(Attribute::source_name, "Source_1").number(Attribute::event_type, 2);
    append_time(pairs.bytes, Attribute::time_stamp, 8'000'000);
    pairs.tag("CCDD").text(Attribute::source_name, "Source_1").number(Attribute::event_type, 0x10004);
    pairs.tag("EEFF").number(Attribute::result_code, 0);
    Walk walk(pairs);
    ASSERT_EQ(walk.seen.size(), 3u);
    EXPECT_EQ(walk.events, (std::vector<std::uint8_t>{2, 255, 0}));
    EXPECT_EQ(walk.seen[1].reader_time_us, 8'000'000);
}

TEST(CaenWalker, AStreamMayComeInPiecesOfWholePairs) {
    Pairs pairs;
    pairs.number(Attribute::command_name, 0x13).number(Attribute::result_code, 0);
    pairs.at("Ant1", 5'000'000).number(Attribute::tag_type, 3).tag("AABB").number(Attribute::rssi, 0xFE00);
    pairs.at("Ant2", 6'000'000).number(Attribute::tag_type, 3).tag("CCDD").number(Attribute::rssi, 0xFD00);
    Walk whole(pairs);
    TagWalker walker;
    std::vector<Observation> seen;
    Bytes data;
    std::optional<std::uint16_t> result;
    for (AvpReader reader(pairs.bytes); auto avp = reader.next();) {
        ByteView pair(avp->value.data() - avp_header_size, avp->value.size() + avp_header_size);
        auto walked = walker.walk(pair, 0, seen, data);
        ASSERT_FALSE(walked.fault);
        if (walked.result) result = walked.result;
    }
    EXPECT_EQ(result, 0);
    ASSERT_EQ(seen.size(), 2u);
    for (std::size_t i = 0; i < 2; ++i) {
        EXPECT_EQ(seen[i].tag, whole.seen[i].tag);
        EXPECT_EQ(seen[i].antenna, i + 1);
        EXPECT_EQ(seen[i].rssi, whole.seen[i].rssi);
        EXPECT_EQ(seen[i].reader_time_us, whole.seen[i].reader_time_us);
    }
    // Its tags are gone from `seen`: nobody else's may get what follows.
    seen.assign(1, Observation{});
    Bytes late;
    append_number(late, Attribute::rssi, 0x0001);
    walker.walk(late, 0, seen, data);
    EXPECT_EQ(seen[0].rssi, Observation::no_rssi);
    walker.restart();
    Bytes next;
    append_bytes(next, Attribute::tag_id, hex("AABB"));
    walker.walk(next, 0, seen, data);
    EXPECT_EQ(seen[1].antenna, Observation::no_antenna);
    EXPECT_EQ(seen[1].technology, Technology::unknown);
    EXPECT_EQ(seen[1].reader_time_us, 0);
}

TEST(CaenWalker, IdsThatNoTagHasAreCountedAndNothingOfTheirsGoesToTheTagBefore) {
    Pairs pairs;
    pairs.raw(Attribute::tag_id, "AABB").raw(Attribute::tag_id, "").number(Attribute::rssi, 0xFE00);
    pairs.raw(Attribute::tag_id, std::string(126, 'A')).raw(Attribute::tag_value, "11");
    pairs.raw(Attribute::tag_id, std::string(124, 'B'));
    Walk walk(pairs);
    EXPECT_EQ(walk.walked.tags, 2u);
    EXPECT_EQ(walk.walked.unusable, 2u);
    ASSERT_EQ(walk.seen.size(), 2u);
    EXPECT_EQ(walk.seen[0].rssi, Observation::no_rssi);
    EXPECT_EQ(walk.seen[0].data_size, 0);
    EXPECT_EQ(walk.seen[1].tag.size, 62);
}

TEST(CaenWalker, TagIdLenCutsPaddedIdsAndThoseThatAreShorterAreCounted) {
    Pairs pairs;  // revision 4 pads ids of ISO 18000-6B to 12 bytes
    pairs.number(Attribute::tag_id_len, 8).raw(Attribute::tag_id, "E0040F0E0601000000000000");
    pairs.raw(Attribute::tag_id, "E0040F0E0601000100000000").raw(Attribute::tag_id, "E0040F0E");
    pairs.number(Attribute::rssi, 0xFE00).number(Attribute::tag_id_len, 0).raw(Attribute::tag_id, "AABB");
    pairs.number(Attribute::tag_id_len, 0xFFFF).raw(Attribute::tag_id, "AABB").tag("CCDD");
    Walk walk(pairs);
    EXPECT_EQ(walk.walked.tags, 3u);
    EXPECT_EQ(walk.walked.unusable, 3u);
    ASSERT_EQ(walk.seen.size(), 3u);
    EXPECT_EQ(walk.seen[0].tag, id("E0040F0E06010000"));
    EXPECT_EQ(walk.seen[1].tag, id("E0040F0E06010001"));
    EXPECT_EQ(walk.seen[1].rssi, Observation::no_rssi);
    EXPECT_EQ(walk.seen[2].tag, id("CCDD"));
}

TEST(CaenWalker, TagIdLenIsForgottenInTheNextMessage) {
    TagWalker walker;
    std::vector<Observation> seen;
    Bytes data;
    Pairs first, next;
    first.tag("AABB");
    next.raw(Attribute::tag_id, "AABBCCDD");
    walker.walk(first.bytes, 0, seen, data);
    walker.restart();
    walker.walk(next.bytes, 0, seen, data);
    ASSERT_EQ(seen.size(), 2u);
    EXPECT_EQ(seen[1].tag, id("AABBCCDD"));
}

TEST(CaenWalker, LyingLengthsNeverLeadOutside) {
    Pairs good;
    good.at("Ant0", 0).tag("AABB");
    for (auto* bad : {"0000", "00000005000F", "0000000300110000", "0000FFFF001100", "00000009001100"}) {
        SCOPED_TRACE(bad);
        auto pairs = good;
        auto more = hex(bad);
        pairs.bytes.insert(pairs.bytes.end(), more.begin(), more.end());
        Walk walk(pairs);
        EXPECT_EQ(walk.seen.size(), 1u) << "what came before is delivered";
        ASSERT_TRUE(walk.walked.fault);
        EXPECT_EQ(walk.walked.fault->offset, header_size + good.bytes.size());
    }
    auto pairs = good;
    pairs.bytes.insert(pairs.bytes.end(), {0, 0, 0, 3, 0, 0x11});
    EXPECT_EQ(Walk(pairs).walked.fault->text(), "AVP at 66: length 3 is below its header (6)");
}

TEST(CaenWalker, ValuesOfAWrongSizeArePassedOver) {
    Pairs pairs;
    pairs.raw(Attribute::time_stamp, "0102")
        .raw(Attribute::tag_type, "03")
        .raw(Attribute::read_point_name, "");
    pairs.raw(Attribute::tag_id, "AABB").raw(Attribute::rssi, "FFFFFE00").raw(Attribute::result_code, "00");
    pairs.raw(Attribute::event_type, "02");
    Walk walk(pairs);
    ASSERT_EQ(walk.seen.size(), 1u);
    EXPECT_FALSE(walk.walked.fault);
    EXPECT_FALSE(walk.walked.result);
    EXPECT_EQ(walk.seen[0].rssi, Observation::no_rssi);
    EXPECT_EQ(walk.events[0], 0);
    EXPECT_EQ(walk.seen[0].antenna, Observation::no_antenna);
}

TEST(CaenWalker, ReadsTheNumberOfAnAntenna) {
    EXPECT_EQ(antenna_number("Ant0"), 0);
    EXPECT_EQ(antenna_number("Ant3"), 3);
    EXPECT_EQ(antenna_number("Ant12"), 12);
    for (auto* none : {"", "Ant", "Ant-1", "Ant01", "ant0", "AntX", "Ant1234", "Source_0"})
        EXPECT_EQ(antenna_number(none), Observation::no_antenna) << none;
}

}  // namespace gantry::caen::test
