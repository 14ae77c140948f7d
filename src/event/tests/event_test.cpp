#include "event/event.hpp"

#include <set>

#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <rapidcheck/gtest.h>

#include "testkit/vectors.hpp"

namespace gantry::event {

using testkit::hex;

TEST(Event, EveryTypeHasANameThatLeadsBackToIt) {
    std::set<std::string_view> names;
    for (auto& [type, name] : all_types()) {
        EXPECT_EQ(to_text(type), name);
        EXPECT_EQ(parse_type(name), type);
        names.insert(name);
    }
    EXPECT_EQ(names.size(), all_types().size());
    EXPECT_EQ(parse_type("tag.New"), std::nullopt);
    EXPECT_EQ(parse_type(""), std::nullopt);
    EXPECT_EQ(to_text(Type{99}), "unknown");
}

TEST(Event, TheStoredNumbersOfTypesNeverChange) {
    std::vector<std::pair<int, std::string_view>> stored;
    for (auto& [type, name] : all_types())
        stored.emplace_back(static_cast<int>(type), name);
    std::vector<std::pair<int, std::string_view>> expected = {
        {1, "tag.new"},       {2, "tag.observed"},      {3, "tag.lost"},
        {4, "tag.purged"},    {5, "tag.moved"},         {6, "tag.glimpsed"},
        {7, "tag.read"},      {20, "reader.connected"}, {21, "reader.disconnected"},
        {22, "reader.fault"}, {23, "gpi.changed"},      {24, "overflow"},
        {25, "clock.jumped"}};
    EXPECT_EQ(stored, expected);
}

TEST(Event, EveryTechnologyHasANameThatLeadsBackToIt) {
    EXPECT_EQ(all_technologies().size(), 8u);
    for (auto& [technology, name] : all_technologies()) {
        EXPECT_EQ(to_text(technology), name);
        EXPECT_EQ(parse_technology(name), technology);
    }
    EXPECT_EQ(parse_technology("gen2"), std::nullopt);
}

TEST(Event, OnlyTagTypesAreTagTypes) {
    for (auto& [type, name] : all_types())
        EXPECT_EQ(is_tag(type), name.starts_with("tag.")) << name;
}

TEST(TagId, HoldsUpToTheLongestIdThatAPcWordCanSay) {
    EXPECT_EQ(TagId().view().size(), 0u);
    Bytes longest(TagId::max_size, 0x5A);
    EXPECT_EQ(to_hex(TagId(longest).view()), to_hex(longest));
}

TEST(TagId, IdsThatDifferInLengthOnlyAreDifferent) {
    EXPECT_FALSE(TagId(hex("00")) == TagId(hex("0000")));
    EXPECT_FALSE(TagId(hex("00")) == TagId());
    EXPECT_NE(TagIdHash{}(TagId(hex("00"))), TagIdHash{}(TagId(hex("0000"))));
}

RC_GTEST_PROP(TagId, EqualBytesAreEqualIdsWithEqualHashes, ()) {
    auto bytes = *rc::gen::resize(static_cast<int>(TagId::max_size), rc::gen::arbitrary<Bytes>());
    RC_ASSERT(TagId(bytes) == TagId(bytes));
    RC_ASSERT(TagIdHash{}(TagId(bytes)) == TagIdHash{}(TagId(bytes)));
    RC_ASSERT(to_hex(TagId(bytes).view()) == to_hex(bytes));
}

TEST(TagId, SerialsOfOneProductFillTheLowAndTheHighBitsOfTheHash) {
    std::set<std::size_t> low, high;
    for (unsigned serial = 0; serial < 4096; ++serial) {
        auto bytes = hex("3074257BF7194E4000000000");
        bytes[10] = static_cast<std::uint8_t>(serial >> 8);
        bytes[11] = static_cast<std::uint8_t>(serial);
        auto hash = TagIdHash{}(TagId(bytes));
        low.insert(hash & 0xFFF);
        high.insert(hash >> 52);
    }
    // 4,096 balls into 4,096 bins leave about 63 % of them hit.
    EXPECT_GT(low.size(), 2400u);
    EXPECT_GT(high.size(), 2400u);
}

}  // namespace gantry::event
