#include "testkit/vectors.hpp"

#include <algorithm>

#include <gtest/gtest.h>

#include "protocols/harting/codec.hpp"
#include "protocols/harting/frame.hpp"
#include "protocols/harting/tables.hpp"

namespace gantry::harting::test {

using testkit::for_each_split;
using testkit::hex;
using testkit::read_vectors;
using testkit::Vector;
using wire::Direction;
using wire::Fields;
using wire::Value;

static const std::vector<Vector>& vectors() {
    static const auto all = read_vectors(GANTRY_SOURCE_DIR "/src/protocols/harting/tests/vectors.tsv");
    return all;
}
static Direction direction(const Vector& vector) {
    return vector.direction == "to-reader" ? Direction::to_reader : Direction::to_host;
}
static bool negative(const Vector& vector) {
    return vector.origin == "negative";
}
static bool short_one(const Vector& vector) {
    return !negative(vector) && vector.bytes[0] != stx;
}
static wire::Message message_of(std::string_view id) {
    for (auto& vector : vectors())
        if (vector.id == id) return *codec().decode(vector.bytes, direction(vector), true).message;
    ADD_FAILURE() << "no vector " << id;
    return {};
}

TEST(HartingVectors, AreAllThere) {
    EXPECT_EQ(vectors().size(), 25u);
    EXPECT_EQ(std::ranges::count_if(vectors(), negative), 2);
}

TEST(HartingVectors, DecodeAndEncodeBackToTheSameBytes) {
    for (auto& vector : vectors()) {
        if (negative(vector)) continue;
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

TEST(HartingVectors, NegativeOnesAreRefusedAndTheErrorsCoverThem) {
    for (auto& vector : vectors()) {
        if (!negative(vector)) continue;
        SCOPED_TRACE(vector.id);
        auto decoded = codec().decode(vector.bytes, direction(vector), true);
        ASSERT_FALSE(decoded.message);
        EXPECT_EQ(decoded.length, vector.bytes.size());
        EXPECT_EQ(decoded.message.error().code,
                  vector.id == "HAR-30" ? wire::Errc::bad_value : wire::Errc::bad_checksum);
        Framer framer(direction(vector));
        framer.add(vector.bytes);
        EXPECT_FALSE(framer.next());
    }
}

// What a person may send; a reply has no rules, and the short frame no reader of today takes.
TEST(HartingVectors, RequestsAreLegal) {
    for (auto& vector : vectors()) {
        if (direction(vector) != Direction::to_reader || negative(vector)) continue;
        auto message = *codec().decode(vector.bytes, direction(vector), true).message;
        auto fine = codec().check(message, direction(vector));
        EXPECT_EQ(fine.has_value(), !short_one(vector)) << vector.id;
    }
}

TEST(HartingVectors, SayWhatTheirMeaningSays) {
    EXPECT_EQ(message_of("HAR-01").name, "InitializeBuffer");
    EXPECT_EQ(message_of("HAR-02").name, "ClearDataBuffer");
    EXPECT_EQ(message_of("HAR-03").name, "ReadDataBufferInfo");
    EXPECT_EQ(message_of("HAR-04").name, "ReadBuffer");
    EXPECT_EQ(message_of("HAR-04").fields, (Fields{{"DATA-SETS", Value(255)}}));
    EXPECT_EQ(message_of("HAR-04").header, (Fields{{"address", Value(255)}}));
    EXPECT_EQ(message_of("HAR-05").name, "RfControllerReset");
    EXPECT_EQ(message_of("HAR-06").name, "RfReset");
    EXPECT_EQ(message_of("HAR-07").name, "GetInput");
    EXPECT_EQ(message_of("HAR-08").fields, (Fields{{"MODE", Value(std::string("Firmware"))}}));
    EXPECT_EQ(message_of("HAR-09").fields, (Fields{{"MODE", Value(std::string("All"))}}));
    EXPECT_EQ(message_of("HAR-10").name, "GetSoftwareVersion");
    EXPECT_EQ(message_of("HAR-12").name, "Inventory");
    EXPECT_EQ(message_of("HAR-12").fields, (Fields{{"MODE", Value(0)}}));
    auto outputs = *wire::find(message_of("HAR-13").fields, "OUT-N")->get<Value::List>();
    ASSERT_EQ(outputs.size(), 1u);
    EXPECT_EQ(outputs[0],
              Value(Fields{{"OUT-NR", Value(0x81)}, {"OUT-S", Value(1)}, {"OUT-TIME", Value(25)}}));
    EXPECT_EQ(message_of("HAR-15").name, "HostCommand");
    EXPECT_EQ(*wire::find(message_of("HAR-15").header, "status"), Value(std::string("rf-warning")));
    auto keepalive = message_of("HAR-16");
    EXPECT_EQ(keepalive.name, "ReaderDiagnostic");
    EXPECT_EQ(keepalive.header, (Fields{{"address", Value(0)}, {"status", Value(std::string("ok"))}}));
    EXPECT_EQ(keepalive.fields, (Fields{{"FLAGS-A", Value(0)}, {"FLAGS-B", Value(0)}}));
    EXPECT_EQ(message_of("HAR-22").fields, (Fields{{"MODE", Value(std::string("Device"))}}));
    EXPECT_EQ(message_of("HAR-23").fields,
              (Fields{{"Data", Value(hex("17E33DD00000000000002D3800000000"))}}));
}

TEST(HartingVectors, CommandsOfSisterReadersDecodeGenerically) {
    EXPECT_EQ(message_of("HAR-19").name, "HostCommand");
    EXPECT_EQ(message_of("HAR-19").fields, (Fields{{"Data", Value(hex("0105710000000053511071"))}}));
    EXPECT_EQ(message_of("HAR-21").fields, (Fields{{"Data", Value(hex("02B3717000"))}}));
    EXPECT_EQ(message_of("HAR-25").name, "Unknown");
    EXPECT_EQ(*wire::find(message_of("HAR-25").header, "code"), Value(0xB2));
    EXPECT_EQ(message_of("HAR-26").name, "Unknown");
    EXPECT_EQ(*wire::find(message_of("HAR-26").header, "code"), Value(0x2B));
    EXPECT_EQ(message_of("HAR-27").fields, (Fields{{"Data", Value(hex("00FFFF"))}}));
    EXPECT_EQ(message_of("HAR-28").fields,
              (Fields{{"SUB-COMMAND", Value(0x2B)}, {"Data", Value(hex("00"))}}));
    EXPECT_EQ(message_of("HAR-29").name, "Inventory");
    EXPECT_EQ(*wire::find(message_of("HAR-29").header, "frame"), Value(std::string("short")));
}

TEST(HartingVectors, TheRequestSaysWhatAnInfoReplyMeans) {
    for (auto& vector : vectors()) {
        if (vector.id != "HAR-23") continue;
        auto frame = look_at(vector.bytes, Direction::to_host).frame;
        Fields fields;
        auto& row = row_of(Command::get_reader_info);
        EXPECT_TRUE(decode_reply(row, hex("80"), frame.status, frame.data, fields));
        EXPECT_EQ(fields, (Fields{{"DEV-ID", Value(hex("17E33DD0"))},
                                  {"CUSTOM-LICENCE", Value(hex("00000000"))},
                                  {"FW-LICENCE", Value(hex("0000"))},
                                  {"TR-DRIVER", Value(hex("2D38"))},
                                  {"FUNCTIONS", Value(hex("0000"))},
                                  {"Rest", Value(hex("0000"))}}));
        Bytes again;
        EXPECT_TRUE(encode_reply(row, frame.status, fields, again));
        EXPECT_EQ(to_hex(again), to_hex(frame.data));
    }
}

TEST(HartingVectors, EveryTruncationWantsMoreAndIsAnErrorAtTheEnd) {
    for (auto& vector : vectors()) {
        if (negative(vector)) continue;
        SCOPED_TRACE(vector.id);
        for (std::size_t size = 0; size < vector.bytes.size(); ++size) {
            Bytes exact(vector.bytes.begin(), vector.bytes.begin() + static_cast<std::ptrdiff_t>(size));
            auto open = codec().decode(exact, direction(vector), false);
            EXPECT_TRUE(open.more) << size;
            EXPECT_EQ(open.length, 0u) << size;
            auto ended = codec().decode(exact, direction(vector), true);
            EXPECT_LE(ended.length, size);
            if (size == 0) continue;
            EXPECT_GE(ended.length, 1u);
            ASSERT_FALSE(ended.message) << size;
            EXPECT_EQ(ended.message.error().code, wire::Errc::truncated) << size;
        }
    }
}

TEST(HartingVectors, EverySplitGivesTheSameFrames) {
    for (auto& vector : vectors()) {
        if (negative(vector) || short_one(vector)) continue;
        SCOPED_TRACE(vector.id);
        Bytes two = vector.bytes;
        two.insert(two.end(), vector.bytes.begin(), vector.bytes.end());
        for_each_split(two, [&](const std::vector<ByteView>& pieces) {
            Framer framer(direction(vector));
            Bytes all;
            for (auto piece : pieces) {
                framer.add(piece);
                while (auto frame = framer.next())
                    all.insert(all.end(), frame->bytes.begin(), frame->bytes.end());
            }
            EXPECT_EQ(all, two);
            EXPECT_EQ(framer.tally().frames, 2u);
            EXPECT_EQ(framer.tally().skipped_bytes, 0u);
            EXPECT_FALSE(framer.partial());
        });
    }
}

// Frames of other makes of readers, and what else dials in.
TEST(HartingVectors, FramesOfOtherProtocolsAreRefused) {
    std::vector<Bytes> others = {
        hex("02424B0930303030330D"),
        hex("626B0D"),
        hex("160301020001000001FC0303"),
        hex("0400003D000000100000"),
    };
    auto http = as_bytes("GET / HTTP/1.1\r\nHost: gate\r\n\r\n");
    others.emplace_back(http.begin(), http.end());
    for (const auto* make : {"caen", "silion"})
        for (auto& vector :
             read_vectors(std::string(GANTRY_SOURCE_DIR "/src/protocols/") + make + "/tests/vectors.tsv"))
            others.push_back(vector.bytes);
    for (auto& bytes : others)
        for (auto each : {Direction::to_host, Direction::to_reader}) {
            SCOPED_TRACE(to_hex(bytes));
            for (ByteView rest = bytes; !rest.empty();) {
                auto decoded = codec().decode(rest, each, true);
                ASSERT_GT(decoded.length, 0u);
                ASSERT_LE(decoded.length, rest.size());
                EXPECT_FALSE(decoded.message);
                rest = rest.subspan(decoded.length);
            }
            Framer framer(each);
            framer.add(bytes);
            EXPECT_FALSE(framer.next());
        }
}

}  // namespace gantry::harting::test
