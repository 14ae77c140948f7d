#include "field/tags.hpp"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <set>

#include "epc/epc.hpp"
#include "field/memory.hpp"
#include "testkit/vectors.hpp"

namespace gantry::field {
namespace {

std::string errors_of(std::string_view csv) {
    auto tags = read_tags_csv(csv, "tags.csv");
    return tags ? "" : tags.error().text();
}

TEST(Tags, EachReaderHasAHandfulOfSgtin96TagsOfItsOwn) {
    std::set<std::string> ids;
    for (std::uint32_t reader = 0; reader < 100; ++reader)
        for (auto& placed : default_tags(reader)) {
            auto epc = epc::decode(placed.tag.id.view());
            ASSERT_TRUE(epc) << epc.error().text();
            EXPECT_EQ(epc->scheme, "sgtin-96");
            EXPECT_TRUE(epc->uri.starts_with("urn:epc:id:sgtin:0614141.812345.")) << epc->uri;
            EXPECT_TRUE(ids.insert(epc->uri).second) << epc->uri;
        }
    EXPECT_EQ(ids.size(), 500u);
}

TEST(Tags, ThoseOfTrafficAreSgtin96AndDifferentForEachSeed) {
    std::set<std::string> ids;
    for (std::uint64_t seed : {1u, 2u, 3u})
        for (auto& tag : traffic_tags(seed, 1000)) {
            auto epc = epc::decode(tag.id.view());
            ASSERT_TRUE(epc) << epc.error().text();
            EXPECT_EQ(epc->scheme, "sgtin-96");
            ids.insert(epc->uri);
        }
    EXPECT_EQ(ids.size(), 3000u);
}

TEST(TagsCsv, AllColumnsInAnyOrder) {
    auto tags = read_tags_csv(
        "antenna,epc,tid,user,access_password,kill_password,technology,rssi_dbm,xpc\n"
        "3,3074 257B F719 4E40 0000 1A85,E280 1160,\"0001 0002\",12345678,9ABC DEF0,epc-gen2,-48.5,0800\n",
        "tags.csv");
    ASSERT_TRUE(tags) << tags.error().text();
    ASSERT_EQ(tags->size(), 1u);
    auto& placed = tags->front();
    EXPECT_EQ(to_hex(placed.tag.id.view()), "3074257BF7194E4000001A85");
    EXPECT_EQ(to_hex(placed.tag.tid), "E2801160");
    EXPECT_EQ(to_hex(placed.tag.user), "00010002");
    EXPECT_EQ(placed.tag.access_password, 0x1234'5678u);
    EXPECT_EQ(placed.tag.kill_password, 0x9ABC'DEF0u);
    EXPECT_EQ(placed.tag.technology, event::Technology::epc_gen2);
    EXPECT_EQ(placed.antenna, 3);
    EXPECT_EQ(placed.rssi_dbm, -48.5);
    EXPECT_EQ(placed.tag.xpc, 0x0800);
}

TEST(TagsCsv, WhatIsLeftOutGetsSensibleValues) {
    auto tags = read_tags_csv(
        "\xEF\xBB\xBF"
        "epc,antenna,technology\r\n"
        "\r\n"
        "3074257BF7194E4000001A85\r\n"
        ",2\r\n"
        ",,iso15693\r\n"
        "E004010012345678, ,icode1",
        "tags.csv");
    ASSERT_TRUE(tags) << tags.error().text();
    ASSERT_EQ(tags->size(), 4u);
    EXPECT_EQ((*tags)[0].antenna, 1);
    EXPECT_FALSE((*tags)[0].rssi_dbm);
    EXPECT_FALSE((*tags)[0].tag.xpc);
    EXPECT_TRUE(epc::decode((*tags)[1].tag.id.view())) << "an SGTIN-96 is made";
    EXPECT_EQ((*tags)[1].antenna, 2);
    EXPECT_EQ((*tags)[2].tag.technology, event::Technology::iso15693);
    EXPECT_EQ((*tags)[2].tag.id.size, 8);
    EXPECT_EQ((*tags)[2].tag.id.data[0], 0xE0);
    EXPECT_EQ((*tags)[3].tag.technology, event::Technology::icode1);
}

TEST(TagsCsv, EveryTechnologyIsAccepted) {
    std::string csv = "technology,epc\n";
    for (auto& each : event::all_technologies())
        csv += std::string(each.name) + ",\n" + std::string(each.name) + ",E0040100000100" +
               to_hex(Bytes{static_cast<std::uint8_t>(each.technology)}) + "\n";
    auto tags = read_tags_csv(csv, "tags.csv");
    ASSERT_TRUE(tags) << tags.error().text();
    ASSERT_EQ(tags->size(), 2 * event::all_technologies().size());
    for (std::size_t i = 0; i < tags->size(); ++i) {
        EXPECT_EQ((*tags)[i].tag.technology, event::all_technologies()[i / 2].technology);
        if (i % 2 != 0) {
            EXPECT_EQ((*tags)[i].tag.id.size, 8);
        }
    }
}

TEST(TagsCsv, UserMemoryOfA6bTagIsWhatFollowsItsId) {
    auto tags = read_tags_csv(
        "epc,user,technology\n"
        "E001105629FFFC01,0A0B0C,iso18000-6b\n"
        ",,iso18000-6b\n",
        "tags.csv");
    ASSERT_TRUE(tags) << tags.error().text();
    EXPECT_EQ(to_hex(make_memory((*tags)[0].tag)->read_bytes(0, 11).value_or(Bytes{})),
              "E001105629FFFC010A0B0C");
    EXPECT_EQ(to_hex((*tags)[1].tag.id.view()), "E004010000000003") << "made from the line";
    EXPECT_TRUE(make_memory((*tags)[1].tag)->read_bytes(0, 224));
}

TEST(TagsCsv, WhatATechnologyCannotHoldIsToldAtOnce) {
    EXPECT_EQ(errors_of("epc,technology\nE00401,iso18000-6b\n"),
              "tags.csv:2: epc: 3 bytes; the UID of an iso18000-6b tag has 8");
    EXPECT_EQ(errors_of("user,technology\n" + std::string(2 * 248, '0') + ",iso18000-6b\n"), "");
    EXPECT_EQ(errors_of("user,technology\n" + std::string(2 * 249, '0') + ",iso18000-6b\n"),
              "tags.csv:2: user: 249 bytes; after the UID an iso18000-6b tag has 248 at most");
    EXPECT_EQ(errors_of("xpc,technology\n0800,iso15693\n"),
              "tags.csv:2: xpc: an iso15693 tag has none; only epc-gen2 tags do");
    EXPECT_EQ(errors_of("kill_password,technology\n0000BEEF,epc-gen1\n"), "");
    EXPECT_EQ(
        errors_of("kill_password,technology\n0001BEEF,epc-gen1\n"),
        "tags.csv:2: kill_password: the kill code of an epc-gen1 tag has 16 bits; write 0000 and then its "
        "4 hex digits");
}

TEST(TagsCsv, ErrorsNameFileLineAndColumn) {
    EXPECT_EQ(errors_of("epc,antena\n"),
              "tags.csv:1: antena: there is no such column; did you mean antenna?");
    EXPECT_EQ(errors_of("epc,epc\n"), "tags.csv:1: epc: this column is named twice");
    EXPECT_EQ(errors_of("epc\n30742\n"),
              "tags.csv:2: epc: \"30742\" is not hex; write two digits for each byte");
    EXPECT_EQ(errors_of("epc\n\nxyz\n"),
              "tags.csv:3: epc: \"xyz\" is not hex; write two digits for each byte");
    EXPECT_EQ(errors_of("epc\n307425\n"),
              "tags.csv:2: epc: 3 bytes; the memory of an epc-gen2 tag comes in words of two");
    EXPECT_EQ(errors_of("user\n01\n"),
              "tags.csv:2: user: 1 bytes; the memory of an epc-gen2 tag comes in words of two");
    EXPECT_EQ(errors_of("epc,technology\nE00401,iso15693\n"),
              "tags.csv:2: epc: 3 bytes; the UID of an iso15693 tag has 8");
    EXPECT_EQ(errors_of("epc\n" + std::string(128, '0') + "\n"),
              "tags.csv:2: epc: 64 bytes; a tag can hold 62 at most");
    EXPECT_EQ(errors_of("access_password\nsecret\n"),
              "tags.csv:2: access_password: a password is 8 hex digits");
    EXPECT_EQ(errors_of("kill_password\n1234\n"), "tags.csv:2: kill_password: a password is 8 hex digits");
    EXPECT_EQ(errors_of("xpc\n08000000\n"),
              "tags.csv:2: xpc: \"08000000\" is no XPC_W1; it has 4 hex digits");
    EXPECT_EQ(errors_of("antenna\n0\n"), "tags.csv:2: antenna: \"0\" is no antenna; they count from 1");
    EXPECT_EQ(errors_of("antenna\n1x\n"), "tags.csv:2: antenna: \"1x\" is no antenna; they count from 1");
    EXPECT_EQ(errors_of("antenna\n70000\n"),
              "tags.csv:2: antenna: \"70000\" is no antenna; they count from 1");
    EXPECT_EQ(errors_of("rssi_dbm\nloud\n"),
              "tags.csv:2: rssi_dbm: \"loud\" is no strength in dBm from -120 to 20");
    EXPECT_EQ(errors_of("rssi_dbm\nnan\n"),
              "tags.csv:2: rssi_dbm: \"nan\" is no strength in dBm from -120 to 20");
    EXPECT_NE(
        errors_of("technology\nuhf\n").find("tags.csv:2: technology: \"uhf\" is no technology; known are "),
        std::string::npos);
    EXPECT_EQ(errors_of("epc\n1111,2\n"), "tags.csv:2: 2 fields, but the header names 1");
    EXPECT_EQ(errors_of("epc\n1111\n2222\n11 11\n"), "tags.csv:4: epc: 1111 is on line 2 already");
    EXPECT_NE(errors_of("").find("the file is empty"), std::string::npos);
}

TEST(TagsCsv, AllErrorsOfAFileAreToldButNotWithoutEnd) {
    EXPECT_EQ(errors_of("epc,antenna\nxx,0\n1111,1\nyy,\n"),
              "tags.csv:2: epc: \"xx\" is not hex; write two digits for each byte\n"
              "tags.csv:2: antenna: \"0\" is no antenna; they count from 1\n"
              "tags.csv:4: epc: \"yy\" is not hex; write two digits for each byte");
    std::string csv = "epc\n";
    for (int line = 0; line < 1000; ++line)
        csv += "xx\n";
    auto errors = errors_of(csv);
    EXPECT_EQ(std::ranges::count(errors, '\n'), 19);
}

TEST(TagsCsv, WhatAFileSaysIsShownSafely) {
    EXPECT_EQ(errors_of("epc\n\x1B[2J\n"),
              "tags.csv:2: epc: \"\\x1B[2J\" is not hex; write two digits for each byte");
}

RC_GTEST_PROP(TagsCsv, AnyTextGivesTagsOrAnError, ()) {
    auto cell =
        rc::gen::oneOf(rc::gen::element<std::string>("epc", "antenna", "user", "1111", "3", "", "\"", "\n"),
                       rc::gen::string<std::string>());
    std::string csv;
    for (auto& each : *rc::gen::container<std::vector<std::string>>(cell))
        csv += each + *rc::gen::element<std::string>(",", "\n", "\r\n");
    auto tags = read_tags_csv(csv, "tags.csv");
    if (tags)
        for (auto& placed : *tags)
            RC_ASSERT(placed.antenna >= 1u);
    else
        RC_ASSERT(tags.error().what.starts_with("tags.csv:"));
}

}  // namespace
}  // namespace gantry::field
