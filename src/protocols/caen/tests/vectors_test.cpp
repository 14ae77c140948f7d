#include "testkit/vectors.hpp"

#include <map>

#include <gtest/gtest.h>

#include "protocols/caen/codec.hpp"
#include "protocols/caen/message.hpp"

namespace gantry::caen::test {

using testkit::for_each_split;
using testkit::hex;
using testkit::read_vectors;
using testkit::Vector;
using wire::Direction;
using wire::Value;

static const std::vector<Vector>& vectors() {
    static const auto all = read_vectors(GANTRY_SOURCE_DIR "/src/protocols/caen/tests/vectors.tsv");
    return all;
}
static Direction direction(const Vector& vector) {
    return vector.direction == "to-reader" ? Direction::to_reader : Direction::to_host;
}
static std::uint16_t head(Direction direction) {
    return direction == Direction::to_reader ? to_reader_head : to_host_head;
}
static bool framed(const Vector& vector) {
    return vector.bytes.size() >= header_size && read_header(vector.bytes)->undefined_length();
}
static wire::Message message_of(std::string_view id) {
    for (auto& vector : vectors())
        if (vector.id == id) return *codec().decode(vector.bytes, direction(vector), true).message;
    ADD_FAILURE() << "no vector " << id;
    return {};
}

TEST(CaenVectors, AreAllThere) {
    EXPECT_EQ(vectors().size(), 28u);
}

TEST(CaenVectors, DecodeAndEncodeBackToTheSameBytes) {
    for (auto& vector : vectors()) {
        SCOPED_TRACE(vector.id + " " + vector.meaning);
        for (bool end : {false, true}) {
            auto decoded = codec().decode(vector.bytes, direction(vector), end);
            if (framed(vector) && !end) {
                EXPECT_TRUE(decoded.more) << "a stream has no end of its own";
                continue;
            }
            ASSERT_TRUE(decoded.message) << decoded.message.error().text();
            EXPECT_EQ(decoded.length, vector.bytes.size());
            Bytes again;
            auto encoded = codec().encode(*decoded.message, direction(vector), again);
            ASSERT_TRUE(encoded) << encoded.error().text();
            EXPECT_EQ(to_hex(again), to_hex(vector.bytes));
        }
    }
}

TEST(CaenVectors, AreLegal) {
    for (auto& vector : vectors()) {
        // The manual's own example sends the mask of a continuous inventory in full, and so do these.
        auto message = *codec().decode(vector.bytes, direction(vector), true).message;
        auto fine = codec().check(message, direction(vector));
        EXPECT_TRUE(fine) << vector.id << ": " << fine.error().text();
    }
}

TEST(CaenVectors, SayWhatTheirMeaningSays) {
    auto request = message_of("S1-req");
    EXPECT_EQ(request.name, "RawReadIDs");
    EXPECT_EQ(*wire::find(request.header, "id"), Value(0));
    EXPECT_EQ(request.fields, (wire::Fields{{"SourceName", Value(std::string("Source_0"))}}));
    auto answer = message_of("S1-rsp");
    ASSERT_EQ(answer.fields.size(), 7u);
    EXPECT_EQ(*wire::find(answer.fields, "ReadPointName"), Value(std::string("Ant0")));
    EXPECT_EQ(*wire::find(answer.fields, "TimeStamp"), Value(std::string("1400.000000")));
    EXPECT_EQ(*wire::find(answer.fields, "TagIDLen"), Value(8));
    EXPECT_EQ(answer.fields[4].value, Value(hex("05629FFFC0113001")));
    EXPECT_EQ(answer.fields[5].value, Value(hex("E0040F0E06010000")));
    EXPECT_EQ(answer.fields[6].name, "ResultCode");
    EXPECT_EQ(answer.fields[6].value, Value(std::string("success")));
    EXPECT_EQ(*wire::find(message_of("M1-req").fields, "Protocol"), Value(std::string("EPCC1G2")));
    EXPECT_EQ(*wire::find(message_of("M5-req").fields, "PowerSet"), Value(1000));
    EXPECT_EQ(*wire::find(message_of("M7a-req").fields, "ConfigParameter"), Value(std::string("ReadCycle")));
    EXPECT_EQ(*wire::find(message_of("M7b-req").fields, "TagID"), Value(Bytes{0}));
    EXPECT_EQ(*wire::find(message_of("M7b-rsp").header, "framed"), Value(true));
    EXPECT_EQ(message_of("M7c-abort").name, "Abort");
    EXPECT_EQ(*wire::find(message_of("D1-rsp").fields, "ReaderInfo"), Value(std::string("R4300P 0000123")));
    EXPECT_EQ(*wire::find(message_of("D5-rsp").fields, "ResultCode"), Value(std::string("tag not present")));
    EXPECT_EQ(*wire::find(message_of("D6-stream").fields, "TagID"), Value(hex("300833B2DDD9014035050000")));
    EXPECT_EQ(*wire::find(message_of("D10-req").fields, "Parity"), Value(std::string("None")));
}

TEST(CaenVectors, EveryTruncationWantsMoreAndIsAnErrorAtTheEnd) {
    for (auto& vector : vectors()) {
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
            if (framed(vector) && size >= header_size) {
                // What is whole of a stream is a message, and the rest is an error of its own.
                EXPECT_TRUE(ended.message) << size;
                continue;
            }
            ASSERT_FALSE(ended.message) << size;
            EXPECT_EQ(ended.message.error().code, wire::Errc::truncated) << size;
        }
    }
}

// Everything that the framer gives, put together again.
static Bytes framed_bytes(Framer& framer, const std::vector<ByteView>& pieces) {
    Bytes all;
    for (auto piece : pieces) {
        framer.add(piece);
        while (auto item = framer.next())
            all.insert(all.end(), item->bytes.begin(), item->bytes.end());
    }
    return all;
}

TEST(CaenVectors, EverySplitGivesTheSameMessages) {
    for (auto& vector : vectors()) {
        SCOPED_TRACE(vector.id);
        Bytes two = vector.bytes;
        two.insert(two.end(), vector.bytes.begin(), vector.bytes.end());
        for_each_split(two, [&](const std::vector<ByteView>& pieces) {
            Framer framer(head(direction(vector)));
            EXPECT_EQ(framed_bytes(framer, pieces), two);
            EXPECT_EQ(framer.tally().messages, framed(vector) || vector.bytes.size() == 1 ? 0u : 2u);
            EXPECT_EQ(framer.tally().skipped_bytes, 0u);
            EXPECT_EQ(framer.pending(), 0u);
        });
    }
}

TEST(CaenVectors, OneDirectionIsNotTakenForTheOther) {
    for (auto& vector : vectors()) {
        auto other = direction(vector) == Direction::to_host ? Direction::to_reader : Direction::to_host;
        EXPECT_FALSE(codec().decode(vector.bytes, other, true).message) << vector.id;
    }
}

// Frames of other makes of readers, and what else dials in.
TEST(CaenVectors, FramesOfOtherProtocolsAreRefused) {
    std::vector<Bytes> others = {
        hex("020007FF33DD56"),       hex("020008FF6EFF30D3"), hex("020009FF2200FF7969"),
        hex("02424B0930303030330D"), hex("626B0D"),           hex("160301020001000001FC0303"),
        hex("0400003D000000100000"),
    };
    auto http = as_bytes("GET / HTTP/1.1\r\nHost: gate\r\n\r\n");
    others.emplace_back(http.begin(), http.end());
    for (auto& vector : read_vectors(GANTRY_SOURCE_DIR "/src/protocols/silion/tests/vectors.tsv"))
        others.push_back(vector.bytes);
    for (auto& bytes : others)
        for (auto each : {Direction::to_host, Direction::to_reader}) {
            SCOPED_TRACE(to_hex(bytes));
            for (ByteView rest = bytes; !rest.empty();) {
                auto decoded = codec().decode(rest, each, true);
                ASSERT_GT(decoded.length, 0u);
                ASSERT_LE(decoded.length, rest.size());
                auto caen = rest.size() >= header_size && plausible_header(rest, head(each));
                EXPECT_EQ(decoded.message.has_value(), caen);
                rest = rest.subspan(decoded.length);
            }
        }
}

}  // namespace gantry::caen::test
