#include "protocols/silion/codec.hpp"
#include "protocols/silion/framer.hpp"
#include "support.hpp"

namespace gantry::silion::test {

using testkit::for_each_split;
using testkit::read_vectors;
using testkit::Vector;
using wire::Direction;

static std::vector<Vector> vectors() {
    static const auto all = read_vectors(GANTRY_SOURCE_DIR "/src/protocols/silion/tests/vectors.tsv");
    return all;
}
static Direction direction(const Vector& vector) {
    return vector.direction == "to-reader" ? Direction::to_reader : Direction::to_host;
}
static bool whole(const Vector& vector) {
    return vector.direction != "other" && vector.id != "SIL-62";
}

TEST(SilionVectors, AreAllThere) {
    EXPECT_EQ(vectors().size(), 31u);
}

TEST(SilionVectors, DecodeAndEncodeBackToTheSameBytes) {
    for (auto& vector : vectors()) {
        if (!whole(vector)) continue;
        SCOPED_TRACE(vector.id + " " + vector.meaning);
        for (bool end : {false, true}) {
            auto decoded = codec().decode(vector.bytes, direction(vector), end);
            ASSERT_TRUE(decoded.message) << decoded.message.error().text();
            EXPECT_EQ(decoded.length, vector.bytes.size());
            Bytes again;
            auto encoded = codec().encode(*decoded.message, direction(vector), again);
            ASSERT_TRUE(encoded) << encoded.error().text();
            EXPECT_EQ(to_hex(again), to_hex(vector.bytes));
        }
    }
}

TEST(SilionVectors, HaveTheNamesOfTheContract) {
    std::map<std::string, std::string> names;
    for (auto& vector : vectors())
        if (whole(vector))
            names[vector.id] = codec().decode(vector.bytes, direction(vector), true).message->name;
    EXPECT_EQ(names["SIL-01"], "Heartbeat");
    EXPECT_EQ(names["SIL-02"], "TagUpload");
    EXPECT_EQ(names["SIL-03"], "Fault");
    EXPECT_EQ(names["SIL-04"], "GpiUpload");
    EXPECT_EQ(names["SIL-05"], "SetGpo");
    EXPECT_EQ(names["SIL-06"], "SetGpo");
    EXPECT_EQ(names["SIL-11"], "TagAck");
    EXPECT_EQ(names["SIL-13"], "GpiAck");
    EXPECT_EQ(names["SIL-14"], "GetGpi");
    EXPECT_EQ(names["SIL-15"], "GetGpi");
    EXPECT_EQ(names["SIL-16"], "Restart");
    EXPECT_EQ(names["SIL-17"], "Restart");
    EXPECT_EQ(names["SIL-66"], "TimeRequest");
}

TEST(SilionVectors, SayWhatTheirMeaningSays) {
    std::map<std::string, wire::Message> messages;
    for (auto& vector : vectors())
        if (whole(vector))
            messages[vector.id] = *codec().decode(vector.bytes, direction(vector), true).message;
    auto& heartbeat = messages["SIL-01"];
    EXPECT_EQ(*wire::find(heartbeat.header, "reader"), wire::Value(std::string("silion")));
    EXPECT_EQ(*wire::find(heartbeat.fields, "Module"), wire::Value(std::string("SLR1100")));
    EXPECT_EQ(*wire::find(heartbeat.fields, "Software"), wire::Value(std::string("10.0.0.0")));
    auto& tags = messages["SIL-02"];
    auto list = *wire::find(tags.fields, "Tags")->get<wire::Value::List>();
    ASSERT_EQ(list.size(), 3u);
    auto& second = *list[1].get<wire::Fields>();
    EXPECT_EQ(*wire::find(second, "Antenna"), wire::Value(2));
    EXPECT_EQ(*wire::find(second, "Rssi"), wire::Value(-63));
    EXPECT_EQ(*wire::find(second, "Protocol"), wire::Value(std::string("Gen2")));
    EXPECT_EQ(*wire::find(second, "Epc"), wire::Value(hex("E20041453116004520703F9B")));
    EXPECT_EQ(*wire::find(messages["SIL-22"].header, "status"), wire::Value(100011));
    EXPECT_EQ(*wire::find(messages["SIL-22"].header, "status_text"),
              wire::Value(std::string("alarm: no antennas connected")));
    EXPECT_EQ(*wire::find(messages["SIL-03"].header, "status_text"),
              wire::Value(std::string("unknown status 0x00000186")));
    EXPECT_EQ(*wire::find(messages["SIL-40"].header, "crc"), wire::Value(std::string("FA5D")));
    EXPECT_EQ(*wire::find(messages["SIL-65"].header, "bank_length_bytes"), wire::Value(2));
}

TEST(SilionVectors, EveryTruncationWantsMoreAndIsAnErrorAtTheEnd) {
    for (auto& vector : vectors()) {
        if (!whole(vector)) continue;
        SCOPED_TRACE(vector.id);
        for (std::size_t size = 0; size < vector.bytes.size(); ++size) {
            Bytes exact(vector.bytes.begin(), vector.bytes.begin() + static_cast<std::ptrdiff_t>(size));
            auto open = codec().decode(exact, direction(vector), false);
            EXPECT_TRUE(open.more) << size;
            EXPECT_EQ(open.length, 0u) << size;
            auto ended = codec().decode(exact, direction(vector), true);
            if (size == 0) continue;
            ASSERT_FALSE(ended.message) << size;
            EXPECT_EQ(ended.message.error().code, wire::Errc::truncated) << size;
            EXPECT_GE(ended.length, 1u);
            EXPECT_LE(ended.length, size);
        }
    }
}

TEST(SilionVectors, EverySplitGivesTheSameFrames) {
    for (auto& vector : vectors()) {
        if (!whole(vector)) continue;
        SCOPED_TRACE(vector.id);
        Bytes two = vector.bytes;
        two.insert(two.end(), vector.bytes.begin(), vector.bytes.end());
        for_each_split(two, [&](const std::vector<ByteView>& pieces) {
            Framer framer(direction(vector), CrcRule::any());
            unsigned frames = 0;
            for (auto piece : pieces) {
                framer.give(piece);
                while (auto frame = framer.next()) {
                    ++frames;
                    EXPECT_EQ(to_hex(frame->bytes), to_hex(vector.bytes));
                }
                EXPECT_TRUE(framer.settle());
            }
            EXPECT_EQ(frames, 2u);
            EXPECT_EQ(framer.tally().skipped, 0u);
        });
    }
}

// Frames of other protocols: an RF module's own, and some of other makes of readers.
TEST(SilionVectors, FramesOfOtherProtocolsAreRefused) {
    std::vector<Bytes> others = {
        hex("8001000000005358002100000008000100120000000F00FB536F757263655F3000"),
        hex("0001000000005358001A00000008000100640000000800020000"),
        hex("020007FF33DD56"),
        hex("020008FF6EFF30D3"),
        hex("020009FF2200FF7969"),
        hex("02424B0930303030330D"),
        hex("626B0D"),
        Bytes(as_bytes("GET / HTTP/1.1\r\nHost: gate\r\n\r\n").begin(),
              as_bytes("GET / HTTP/1.1\r\nHost: gate\r\n\r\n").end()),
        hex("160301020001000001FC0303"),
        hex("0400003D000000100000000000"),
    };
    for (auto& vector : vectors())
        if (vector.direction == "other" || vector.id == "SIL-62") others.push_back(vector.bytes);
    for (auto& bytes : others)
        for (auto each : {Direction::to_host, Direction::to_reader}) {
            SCOPED_TRACE(to_hex(bytes));
            for (ByteView rest = bytes; !rest.empty();) {
                auto decoded = codec().decode(rest, each, true);
                EXPECT_FALSE(decoded.message);
                ASSERT_GT(decoded.length, 0u);
                rest = rest.subspan(decoded.length);
            }
            Framer framer(each, CrcRule::any());
            framer.give(bytes);
            EXPECT_FALSE(framer.next());
            framer.settle();
            EXPECT_EQ(framer.kept().size() + framer.tally().skipped, bytes.size());
        }
}

TEST(SilionVectors, OneDirectionIsNotTakenForTheOther) {
    for (auto& vector : vectors()) {
        if (!whole(vector)) continue;
        auto other = direction(vector) == Direction::to_host ? Direction::to_reader : Direction::to_host;
        EXPECT_FALSE(codec().decode(vector.bytes, other, true).message) << vector.id;
    }
}

}  // namespace gantry::silion::test
