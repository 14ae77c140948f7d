#include "protocols/caen/message.hpp"

#include <gtest/gtest.h>

#include <rapidcheck/gtest.h>

#include "testkit/vectors.hpp"

namespace gantry::caen::test {

using testkit::hex;

namespace {

Bytes message(std::uint16_t fixed, std::uint16_t id, Command command) {
    Bytes out;
    Builder builder(out, fixed, id);
    builder.command(command);
    EXPECT_TRUE(builder.finish());
    return out;
}
void append(Bytes& to, const Bytes& more) {
    to.insert(to.end(), more.begin(), more.end());
}

struct Cut {
    std::vector<std::pair<Framer::What, Bytes>> items;
    Framer::Tally tally;
    std::size_t pending = 0;
};
Cut cut(std::uint16_t fixed, const std::vector<ByteView>& pieces) {
    Framer framer(fixed);
    Cut cut;
    for (auto piece : pieces) {
        framer.add(piece);
        while (auto item = framer.next())
            cut.items.emplace_back(item->what, Bytes(item->bytes.begin(), item->bytes.end()));
    }
    cut.tally = framer.tally();
    cut.pending = framer.pending();
    return cut;
}
std::string shape(const Cut& cut) {
    std::string text;
    for (auto& [what, bytes] : cut.items)
        text += "mspao"[static_cast<std::size_t>(what)];
    return text;
}

}  // namespace

// --- messages ----------------------------------------------------------------------------------------------

TEST(CaenMessage, IsBuiltAndTakenApart) {
    Bytes out = {0xEE};  // a buffer that holds more already
    Builder builder(out, to_host_head, 7);
    builder.command(Command::get_power).number(Attribute::power_get, 446).result(ResultCode::success);
    ASSERT_TRUE(builder.finish());
    EXPECT_EQ(to_hex(ByteView(out).subspan(1)),
              "0001000700005358002400000008000100730000000A0052000001BE0000000800020000");
    auto parsed = parse(ByteView(out).subspan(1));
    EXPECT_FALSE(parsed.fault);
    EXPECT_EQ(parsed.header.id, 7);
    EXPECT_EQ(parsed.header.length, 36);
    EXPECT_EQ(parsed.command, 0x73);
    EXPECT_EQ(parsed.result, 0);
    ASSERT_EQ(parsed.avps.size(), 1u);
    EXPECT_EQ(parsed.avps[0].offset, 18u);
    EXPECT_EQ(parsed.number(Attribute::power_get), 446u);
    EXPECT_FALSE(parsed.number(Attribute::power_set));
    EXPECT_FALSE(parsed.text(Attribute::source_name));
}

TEST(CaenMessage, KnowsTextWithAndWithoutItsNul) {
    Bytes out;
    Builder builder(out, to_reader_head, 0);
    builder.command(Command::raw_read_ids).text(Attribute::source_name, "Source_0");
    builder.raw(0x22, as_bytes("Ant0")).raw(0x20, hex("41004200"));
    ASSERT_TRUE(builder.finish());
    auto parsed = parse(out);
    EXPECT_EQ(parsed.text(Attribute::source_name), "Source_0");
    EXPECT_EQ(parsed.find(Attribute::source_name)->value.size(), 9u);
    EXPECT_EQ(parsed.text(Attribute::read_point_name), "Ant0");
    EXPECT_EQ(parsed.text(Attribute::trigger_name), "A");
}

TEST(CaenMessage, WritesTimesInSecondsFirst) {
    Bytes out;
    append_time(out, Attribute::time_stamp, 1'400'000'007);
    append_time(out, Attribute::time_stamp, -5);
    append_time(out, Attribute::time_stamp, INT64_MAX);
    AvpReader reader(out);
    EXPECT_EQ(to_hex(reader.next()->value), "0000057800000007");
    EXPECT_EQ(to_hex(reader.next()->value), "0000000000000000");
    EXPECT_EQ(to_hex(reader.next()->value.first(4)), "FFFFFFFF");
    EXPECT_FALSE(reader.next());
    EXPECT_FALSE(reader.fault());
}

TEST(CaenMessage, AnOverlongOneIsTakenBack) {
    Bytes out = {1, 2};
    Builder builder(out, to_host_head, 0);
    builder.command(Command::g2_read).bytes(Attribute::tag_value, Bytes(70'000));
    EXPECT_FALSE(builder.finish());
    EXPECT_EQ(out, (Bytes{1, 2}));
    Builder most(out, to_host_head, 0);
    most.command(Command::g2_read).bytes(Attribute::tag_value, Bytes(65535 - 10 - 8 - 6));
    EXPECT_TRUE(most.finish());
    EXPECT_EQ(out.size(), 2u + 65535u);
}

TEST(CaenMessage, AFaultSaysWhereAndKeepsWhatCameBefore) {
    auto good = message(to_host_head, 0, Command::get_power);
    auto fault_of = [&](std::string_view more) {
        auto bytes = good;
        append(bytes, hex(more));
        auto parsed = parse(bytes);
        EXPECT_EQ(parsed.command, 0x73);
        return parsed.fault ? parsed.fault->text() : "none";
    };
    EXPECT_EQ(fault_of("0000000300020000"), "AVP at 18: length 3 is below its header (6)");
    EXPECT_EQ(fault_of("0000000900020000"), "AVP at 18: length 9 is more than the 8 bytes that are left");
    EXPECT_EQ(fault_of("000000"), "AVP at 18: 3 bytes are left, too few for its header (6)");
    EXPECT_EQ(parse(hex("000100")).fault->text(),
              "header at 3: 3 bytes are too few for a message's header (10)");
}

TEST(CaenMessage, ACommandAndAResultAreSuchInTheirPlacesAlone) {
    Bytes out;
    Builder builder(out, to_host_head, 0);
    builder.result(ResultCode::success).number(Attribute::power_get, 1).command(Command::get_power);
    ASSERT_TRUE(builder.finish());
    auto parsed = parse(out);
    EXPECT_FALSE(parsed.command);
    EXPECT_FALSE(parsed.result);
    EXPECT_EQ(parsed.avps.size(), 3u);
}

// --- the framer --------------------------------------------------------------------------------------------

TEST(CaenFramer, GivesMessagesOneByOne) {
    Bytes bytes;
    for (std::uint16_t id = 0; id < 3; ++id)
        append(bytes, message(to_reader_head, id, Command::get_power));
    auto all = cut(to_reader_head, {bytes});
    EXPECT_EQ(shape(all), "mmm");
    EXPECT_EQ(read_header(all.items[2].second)->id, 2);
    EXPECT_EQ(all.pending, 0u);
}

TEST(CaenFramer, KnowsTheAbortByteAndTheTexts) {
    auto bytes = message(to_reader_head, 1, Command::inventory_tag);
    bytes.push_back(abort_byte);
    append(bytes, message(to_reader_head, 2, Command::get_power));
    append(bytes, Bytes(as_bytes(upgrade_text).begin(), as_bytes(upgrade_text).end()));
    append(bytes, Bytes(as_bytes(out_of_band_text).begin(), as_bytes(out_of_band_text).end()));
    bytes.push_back(abort_byte);
    auto all = cut(to_reader_head, {bytes});
    EXPECT_EQ(shape(all), "mamooa");
    EXPECT_EQ(all.tally.skipped_bytes, 0u);
    EXPECT_EQ(shape(cut(to_host_head, {ByteView(bytes)})), "") << "readers do not send these";
}

TEST(CaenFramer, GivesThePairsOfAStreamOneByOneUntilANewHeader) {
    Bytes bytes;
    Builder(bytes, to_host_head, 1).command(Command::inventory_tag).finish_undefined();
    append_text(bytes, Attribute::source_name, "Source_0");
    append_bytes(bytes, Attribute::tag_id, hex("AABB"));
    append(bytes, message(to_host_head, 2, Command::get_power));
    EXPECT_EQ(shape(cut(to_host_head, {bytes})), "spppm");
    Framer framer(to_host_head);
    framer.add(bytes);
    EXPECT_EQ(framer.next()->bytes.size(), header_size);
    EXPECT_TRUE(framer.in_stream());
    framer.next();
    framer.stream_over();
    EXPECT_EQ(framer.next()->what, Framer::What::message) << "its pairs are garbage once it is over";
    EXPECT_EQ(framer.tally().resyncs, 1u);
}

TEST(CaenFramer, FindsTheNextHeaderAfterGarbage) {
    auto good = message(to_host_head, 9, Command::get_power);
    for (auto* garbage : {"FF", "00", "0001", "00010000FFFF5358001A", "00010000000053580009",
                          "8001000000005358", "47455420"}) {
        SCOPED_TRACE(garbage);
        auto bytes = hex(garbage);
        auto size = bytes.size();
        append(bytes, good);
        append(bytes, good);
        auto all = cut(to_host_head, {bytes});
        EXPECT_EQ(shape(all), "mm");
        EXPECT_EQ(all.tally.skipped_bytes, size);
        EXPECT_EQ(all.tally.resyncs, 1u);
    }
}

TEST(CaenFramer, TakesEitherFirstFieldWhereThatIsAsked) {
    Bytes bytes = message(to_reader_head, 1, Command::report_buffer);
    append(bytes, message(to_host_head, 2, Command::report_buffer));
    Framer framer(to_host_head, true);
    framer.add(bytes);
    EXPECT_EQ(read_header(framer.next()->bytes)->id, 1);
    EXPECT_EQ(read_header(framer.next()->bytes)->id, 2);
    EXPECT_EQ(shape(cut(to_host_head, {bytes})), "m");
}

TEST(CaenFramer, HoldsNoMoreThanOneMessage) {
    Framer framer(to_host_head);
    Bytes head = hex("0001000000005358FFFF");
    framer.add(head);
    Bytes piece(1000);
    std::size_t most = 0;
    for (int i = 0; i < 200; ++i) {
        framer.add(piece);
        while (framer.next()) {
        }
        most = std::max(most, framer.pending());
    }
    EXPECT_LE(most, 65535u);
    framer.reset();
    EXPECT_EQ(framer.pending(), 0u);
}

static Bytes arbitrary_stream(std::uint16_t fixed) {
    Bytes bytes;
    auto parts = *rc::gen::inRange(0, 6);
    for (int i = 0; i < parts; ++i) {
        switch (*rc::gen::inRange(0, 6)) {
            case 0:
                append(bytes, *rc::gen::container<Bytes>(
                                  rc::gen::element<std::uint8_t>(0, 1, 0x80, 0x53, 0x58, 0xAB)));
                break;
            case 1:
                Builder(bytes, fixed, 5).command(Command::inventory_tag).finish_undefined();
                break;
            case 2:
                append_bytes(bytes, Attribute::tag_id,
                             *rc::gen::container<Bytes>(rc::gen::arbitrary<std::uint8_t>()));
                break;
            case 3:
                bytes.push_back(abort_byte);
                break;
            default:
                append(bytes, message(fixed, *rc::gen::arbitrary<std::uint16_t>(), Command::get_io));
        }
    }
    if (!bytes.empty() && *rc::gen::inRange(0, 3) == 0)
        bytes.resize(*rc::gen::inRange<std::size_t>(0, bytes.size()));
    return bytes;
}

RC_GTEST_PROP(CaenFramerProperty, AnySplitGivesTheSameItems, ()) {
    auto fixed = *rc::gen::element(to_reader_head, to_host_head);
    auto bytes = arbitrary_stream(fixed);
    auto whole = cut(fixed, {bytes});
    std::vector<ByteView> pieces;
    for (ByteView rest = bytes; !rest.empty();) {
        auto size = *rc::gen::inRange<std::size_t>(1, std::min<std::size_t>(rest.size(), 20) + 1);
        pieces.push_back(rest.first(size));
        rest = rest.subspan(size);
    }
    auto split = cut(fixed, pieces);
    RC_ASSERT(split.items == whole.items);
    RC_ASSERT(split.tally.resyncs == whole.tally.resyncs);
    RC_ASSERT(split.tally.skipped_bytes == whole.tally.skipped_bytes);
    std::size_t covered = whole.tally.skipped_bytes + whole.pending;
    for (auto& [what, item] : whole.items)
        covered += item.size();
    RC_ASSERT(covered == bytes.size());
}

}  // namespace gantry::caen::test
