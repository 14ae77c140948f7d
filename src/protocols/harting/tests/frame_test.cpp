#include "protocols/harting/frame.hpp"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "testkit/vectors.hpp"

namespace gantry::harting::test {

using testkit::hex;
using wire::Direction;
using wire::Errc;

namespace {

// As the manual's own listing does it: a bit at a time.
std::uint16_t bitwise_crc(ByteView bytes) {
    std::uint16_t crc = 0xFFFF;
    for (auto byte : bytes) {
        crc = static_cast<std::uint16_t>(crc ^ byte);
        for (int bit = 0; bit < 8; ++bit)
            crc = static_cast<std::uint16_t>((crc & 1) != 0 ? (crc >> 1) ^ 0x8408 : crc >> 1);
    }
    return crc;
}

Bytes request(std::uint8_t control, std::string_view data = "") {
    Bytes out;
    append_request(out, any_address, control, hex(data));
    return out;
}
Bytes joined(std::initializer_list<Bytes> parts) {
    Bytes out;
    for (auto& part : parts)
        out.insert(out.end(), part.begin(), part.end());
    return out;
}

// The controls of all frames that come out.
Bytes controls(Framer& framer) {
    Bytes found;
    while (auto frame = framer.next())
        found.push_back(frame->control);
    return found;
}

}  // namespace

RC_GTEST_PROP(HartingFrame, TheCrcIsTheBitwiseOne, ()) {
    auto bytes = *rc::gen::container<Bytes>(rc::gen::arbitrary<std::uint8_t>());
    RC_ASSERT(crc_of(bytes) == bitwise_crc(bytes));
}

RC_GTEST_PROP(HartingFrame, WhatIsAppendedIsLookedAtAgain, ()) {
    auto data = *rc::gen::container<Bytes>(rc::gen::arbitrary<std::uint8_t>());
    auto [address, control, status] =
        *rc::gen::arbitrary<std::tuple<std::uint8_t, std::uint8_t, std::uint8_t>>();
    Bytes asks, gives;
    append_request(asks, address, control, data);
    append_reply(gives, address, control, status, data);
    auto asked = look_at(asks, Direction::to_reader);
    auto given = look_at(gives, Direction::to_host);
    RC_ASSERT(asked.what == Look::What::frame && given.what == Look::What::frame);
    RC_ASSERT(asked.size == asks.size() && given.size == gives.size());
    for (auto& frame : {asked.frame, given.frame}) {
        RC_ASSERT(std::ranges::equal(frame.data, data));
        RC_ASSERT(frame.address == address && frame.control == control);
    }
    RC_ASSERT(given.frame.status == status);
    RC_ASSERT(given.frame.data_offset() == 6u && asked.frame.data_offset() == 5u);
    // One wrong bit, wherever it is, is seen.
    auto at = *rc::gen::inRange<std::size_t>(0, gives.size());
    gives[at] = static_cast<std::uint8_t>(gives[at] ^ 1u << *rc::gen::inRange(0, 8));
    RC_ASSERT(look_at(gives, Direction::to_host).what != Look::What::frame);
}

TEST(HartingFrame, TheLongestOneIsTaken) {
    Bytes longest;
    append_reply(longest, 0, 0x22, 0, Bytes(max_frame - min_reply, 0x5A));
    ASSERT_EQ(longest.size(), max_frame);
    EXPECT_EQ(look_at(longest, Direction::to_host).what, Look::What::frame);
    EXPECT_EQ(look_at(ByteView(longest).first(3), Direction::to_host).size, max_frame);
}

TEST(HartingFrame, ALengthThatNoFrameHasIsRefused) {
    EXPECT_EQ(look_at(hex("020006"), Direction::to_reader).why, Errc::bad_length);
    EXPECT_EQ(look_at(hex("020007"), Direction::to_reader).what, Look::What::more);
    EXPECT_EQ(look_at(hex("020007"), Direction::to_host).why, Errc::bad_length);
    EXPECT_EQ(look_at(hex("03"), Direction::to_host).why, Errc::bad_value);
}

TEST(HartingFramer, AfterRubbishTheNextGoodFrameIsFound) {
    auto good = request(0x33);
    auto bad = request(0x22, "00FF");
    bad[5] ^= 1;
    Framer framer(Direction::to_reader);
    framer.add(joined({request(0x31), hex("4711 02 0003 02"), bad, good, hex("FFFF"), request(0x32)}));
    EXPECT_EQ(to_hex(controls(framer)), "313332");
    EXPECT_EQ(framer.tally().resyncs, 2u);
    EXPECT_EQ(framer.tally().skipped_bytes, 6u + bad.size() + 2u);
    EXPECT_EQ(framer.astray(), 0u);
}

TEST(HartingFramer, AWrongChecksumIsCountedAsSuchAndCostsItsFrameAlone) {
    auto bad = request(0x22, "00FF");
    bad.back() ^= 0x10;
    Framer framer(Direction::to_reader);
    framer.add(joined({bad, request(0x33)}));
    EXPECT_EQ(to_hex(controls(framer)), "33");
    EXPECT_EQ(framer.tally().bad_checksum, 1u);
    EXPECT_EQ(framer.tally().skipped_bytes, bad.size());
}

// A length that is too big by a broken bit must not swallow what follows.
TEST(HartingFramer, AFrameInsideWhatOnlyLooksLikeOneIsFoundAtOnce) {
    Framer framer(Direction::to_reader);
    framer.add(hex("47"));
    framer.add(joined({hex("02FFFF"), request(0x33)}));
    EXPECT_EQ(to_hex(controls(framer)), "33");
}

TEST(HartingFramer, TheRestOfAFrameCanBeDroppedAfterAPause) {
    auto whole = request(0x33);
    Framer framer(Direction::to_reader);
    framer.add(ByteView(whole).first(5));
    EXPECT_TRUE(controls(framer).empty());
    EXPECT_TRUE(framer.partial());
    framer.drop();
    EXPECT_FALSE(framer.partial());
    EXPECT_EQ(framer.astray(), 5u);
    framer.add(whole);
    EXPECT_EQ(to_hex(controls(framer)), "33");
    EXPECT_EQ(framer.astray(), 0u);
    framer.add(ByteView(whole).first(2));
    framer.reset();
    EXPECT_FALSE(framer.partial());
}

TEST(HartingFramer, AFrameLongerThanTheOtherSideMaySendIsNoFrame) {
    Bytes longer;
    append_request(longer, any_address, 0x80, Bytes(100, 1));
    Framer framer(Direction::to_reader, 64);
    framer.add(longer);
    framer.add(request(0x33));
    EXPECT_EQ(to_hex(controls(framer)), "33");
    EXPECT_EQ(framer.tally().bad_length, 1u);
}

// Every byte starts a frame of 514 bytes: looking for the good one must not take for ever or keep all.
TEST(HartingFramer, StaysBoundedWhateverArrives) {
    Framer framer(Direction::to_host);
    Bytes twos(100'000, stx);
    for (int i = 0; i < 20; ++i) {
        framer.add(twos);
        EXPECT_FALSE(framer.next());
        EXPECT_LE(framer.rest().size(), max_frame);
    }
    Bytes good;
    append_reply(good, 0, 0x22, 0, {});
    framer.drop();
    framer.add(good);
    EXPECT_TRUE(framer.next());
}

}  // namespace gantry::harting::test
