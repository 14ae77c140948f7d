// RawReadIDs and InventoryTag, their flags and masks, and the framed stream.
#include "device_support.hpp"

namespace gantry::caen::device_test {

using enum Attribute;
using event::Technology;

using Texts = std::vector<std::string>;
static constexpr std::string_view one = "300833B2DDD9014035050000", two = "300833B2DDD9014035050001";

static Bytes flags(unsigned which) {
    return number(bitmask, which);
}

TEST(CaenDeviceInventory, RawReadIdsTellsEachReadPointOnce) {
    Bench bench;
    bench.shelf->add(two);
    bench.shelf->add("3000000000000000000000AA", Technology::epc_gen2, 2);
    bench.sets(Command::add_read_point_to_source, {source(), point(1)});
    auto said = bench.ask(Command::raw_read_ids, {source()});
    auto group = std::vector<std::uint16_t>{0xFB, 0x22, 0x10, 0x0F, 0x11};
    auto wanted = group;
    wanted.push_back(0x11);
    wanted.insert(wanted.end(), group.begin(), group.end());
    EXPECT_EQ(said.types(), wanted);
    EXPECT_EQ(said.all(tag_id), (Texts{std::string(one), std::string(two), "3000000000000000000000AA"}));
    EXPECT_EQ(said.all(read_point_name), (Texts{"416E743000", "416E743100"})) << "with their NUL";
}

TEST(CaenDeviceInventory, IdsOfAnotherLengthMakeAnotherGroup) {
    Bench bench;
    bench.shelf->add("E2000001");
    auto said = bench.ask(Command::raw_read_ids, {source()});
    EXPECT_EQ(said.all(tag_id_len), (Texts{"000C", "0004"}));
}

TEST(CaenDeviceInventory, NobodyThereIsSuccessAndNothingElse) {
    Bench bench({}, false);
    for (auto command : {Command::raw_read_ids, Command::inventory_tag}) {
        auto said = bench.ask(command, {source()});
        EXPECT_EQ(said.result(), ResultCode::success);
        EXPECT_TRUE(said.parsed.avps.empty());
    }
}

TEST(CaenDeviceInventory, TakesARoundOnEachReadPoint) {
    Bench bench(Given{{"round", "40ms"}});
    bench.sets(Command::add_read_point_to_source, {source(), point(1)});
    bench.gets(request(Command::raw_read_ids, {source()}));
    bench.waits(79ms);
    EXPECT_TRUE(bench.says().empty());
    bench.waits(1ms);
    EXPECT_FALSE(bench.says().empty());
    bench.sets(Config::dwell_time, 200);
    bench.sets(Config::read_cycle, 3);
    bench.gets(request(Command::raw_read_ids, {source()}));
    bench.waits(1199ms);
    EXPECT_TRUE(bench.says().empty());
    bench.waits(1ms);
    auto said = messages(bench.says());
    ASSERT_EQ(said.size(), 1u);
    EXPECT_EQ(said[0].all(tag_id).size(), 1u) << "three cycles, one answer, each tag once";
}

TEST(CaenDeviceInventory, OnlyTagsOfTheProtocolInUseAnswer) {
    Bench bench;
    bench.shelf->add("0102030405060708", Technology::epc_gen1);
    bench.shelf->add("E0040F0E06010000", Technology::iso18000_6b);
    bench.shelf->add("A1A2A3A4A5A6A7A8", Technology::epc_1_19);
    bench.shelf->add("E004010000000001", Technology::iso15693);
    auto ids = [&](unsigned which) {
        bench.sets(Command::set_protocol, {number(protocol, which)});
        return bench.ask(Command::raw_read_ids, {source()}).all(tag_id);
    };
    EXPECT_EQ(ids(3), Texts{std::string(one)});
    EXPECT_EQ(ids(1), Texts{"0102030405060708"});
    EXPECT_EQ(ids(0), Texts{"E0040F0E06010000"});
    EXPECT_EQ(ids(2), Texts{});
    EXPECT_EQ(ids(5), Texts{"A1A2A3A4A5A6A7A8"});
    EXPECT_EQ(ids(4).size(), 4u) << "multiprotocol: all UHF tags";
    EXPECT_EQ(bench.ask(Command::inventory_tag, {source()}).all(tag_type),
              (Texts{"0003", "0001", "0000", "0005"}));
}

TEST(CaenDeviceInventory, EachFlagAddsItsAttributeInItsPlace) {
    using Types = std::vector<std::uint16_t>;
    Bench bench;
    auto types = [&](unsigned which) {
        return bench.ask(Command::inventory_tag, {source(), flags(which)}).types();
    };
    const Types plain{0xFB, 0x22, 0x10, 0x12, 0x0F, 0x11};
    auto with = [](Types base, const Types& more) {
        base.insert(base.end(), more.begin(), more.end());
        return base;
    };
    EXPECT_EQ(types(0), plain);
    EXPECT_EQ(types(flag_rssi), with(plain, {0x7A}));
    EXPECT_EQ(types(flag_tid), with(plain, {0x50, 0x4D}));
    EXPECT_EQ(types(flag_xpc), with(plain, {0x7C}));
    EXPECT_EQ(types(flag_pc), with(plain, {0x7D}));
    EXPECT_EQ(types(flag_match), plain);
    EXPECT_EQ(types(flag_rssi | flag_tid | flag_xpc | flag_pc), with(plain, {0x7A, 0x50, 0x4D, 0x7C, 0x7D}));
    EXPECT_EQ(types(flag_compact), Types{0x11});
    EXPECT_EQ(types(flag_compact | flag_rssi), (Types{0x11, 0x7A}));
    EXPECT_EQ(bench.result(Command::inventory_tag, {source(), flags(0x200)}),
              ResultCode::bad_parameter_value);
    for (auto odd : {flag_framed, flag_continuous, flag_event_trigger})
        EXPECT_EQ(bench.result(Command::inventory_tag, {source(), flags(odd)}),
                  ResultCode::invalid_parameter);
}

TEST(CaenDeviceInventory, WhatTheFlagsBringIsTheTags) {
    Bench bench;
    auto& tag = bench.shelf->tags[0];
    auto said = bench.ask(Command::inventory_tag, {source(), flags(0x151)});
    EXPECT_EQ(said.hex_of(rssi), "FE0C");  // -50.0 dBm
    EXPECT_EQ(said.hex_of(length), "000C");
    EXPECT_EQ(said.hex_of(tag_value), to_hex(tag.banks[Bank::tid]));
    EXPECT_EQ(said.hex_of(xpc), "00000000");
    EXPECT_EQ(said.hex_of(pc), "3000");
    bench.sets(Config::tid_length, 6);
    EXPECT_EQ(bench.ask(Command::inventory_tag, {source(), flags(flag_tid)}).hex_of(length), "0006");
    bench.sets(Config::tid_length, 40);
    EXPECT_EQ(bench.ask(Command::inventory_tag, {source(), flags(flag_tid)}).hex_of(length), "000C")
        << "what the tag has";
    // A tag with an XPC word.
    tag.banks[Bank::epc][2] |= 2;
    tag.banks[Bank::epc].resize(0x22 * 2);
    tag.banks[Bank::epc][0x42] = 0x12;
    EXPECT_EQ(bench.ask(Command::inventory_tag, {source(), flags(flag_xpc)}).hex_of(xpc), "12000000");
    Bench later(Given{{"pc_size", "4"}});
    EXPECT_EQ(later.ask(Command::inventory_tag, {source(), flags(flag_pc)}).hex_of(pc), "00003000");
}

TEST(CaenDeviceInventory, ATagThatSaysNoTidHasLengthZeroAndNoValue) {
    Bench bench;
    bench.shelf->tags[0].banks[Bank::tid].clear();
    auto said = bench.ask(Command::inventory_tag, {source(), flags(flag_tid)});
    EXPECT_EQ(said.hex_of(length), "0000");
    EXPECT_EQ(said.hex_of(tag_value), "-");
}

TEST(CaenDeviceInventory, MasksPickTags) {
    Bench bench;
    bench.shelf->add(two);
    bench.shelf->tags[1].banks[Bank::user][0] = 0xA0;
    auto ids = [&](const Pairs& mask) {
        return bench.ask(Command::inventory_tag, Pairs{source()} + mask).all(tag_id).size();
    };
    auto mask = [](unsigned bits, std::string_view what, unsigned first) {
        return Pairs{number(length, bits), bytes(tag_id, what), number(tag_address, first)};
    };
    auto bank = [](Bank which) { return Pairs{number(memory_bank, static_cast<unsigned>(which))}; };
    EXPECT_EQ(ids(mask(16, "3008", 0)), 2u);
    EXPECT_EQ(ids(mask(16, "3009", 0)), 0u);
    EXPECT_EQ(ids(mask(15, "3009", 0)), 2u) << "bits, not bytes";
    EXPECT_EQ(ids(mask(1, "80", 95)), 1u);
    EXPECT_EQ(ids(mask(8, "80", 95)), 0u) << "beyond the id";
    EXPECT_EQ(ids(bank(Bank::epc) + mask(16, "3008", 32)), 2u) << "with a bank from its start";
    EXPECT_EQ(ids(bank(Bank::user) + mask(3, "A0", 0)), 1u);
    EXPECT_EQ(ids(bank(Bank::tid) + mask(32, "E2801160", 0)), 2u);
    EXPECT_EQ(ids(mask(0, "", 0)), 2u) << "what clients send for no mask";
    EXPECT_EQ(ids(mask(0, "00", 0)), 2u);
    EXPECT_EQ(bench.result(Command::inventory_tag, Pairs{source()} + mask(9, "30", 0)),
              ResultCode::invalid_parameter);
    Bench other(Given{{"model", "R4300P"}});
    EXPECT_EQ(other.result(Command::inventory_tag, Pairs{source()} + mask(8, "30", 0)), ResultCode::success);
    EXPECT_EQ(other.result(Command::inventory_tag, Pairs{source()} + bank(Bank::epc) + mask(8, "30", 32)),
              ResultCode::invalid_parameter)
        << "a form of few models";
}

TEST(CaenDeviceInventory, OnALeptonModuleMatchBringsThePhaseAfterTheRssi) {
    for (auto model : {"R3100C", "R7100C", "R7101C", "R7104C", "R4320P", "all"}) {
        Bench bench(Given{{"model", model}});
        auto phase = [&](unsigned flags) {
            return bench.ask(Command::inventory_tag, {source(), number(Attribute::bitmask, flags)});
        };
        bool lepton = std::string_view(model).starts_with("R3") || std::string_view(model).starts_with("R7");
        auto said = phase(flag_rssi | flag_match);
        auto types = said.types();
        EXPECT_EQ(types.back(), lepton ? 0x7E : 0x7A) << model;
        if (lepton) {
            EXPECT_EQ(types[types.size() - 2], 0x7A);
            EXPECT_LT(said.number(Attribute::phase), 4096u);
            EXPECT_EQ(phase(flag_rssi | flag_match).hex_of(Attribute::phase), said.hex_of(Attribute::phase));
        }
        EXPECT_EQ(phase(flag_rssi).types().back(), 0x7A);
    }
}

TEST(CaenDeviceInventory, ASourceWithoutReadPointsIsDisabled) {
    Bench bench;
    bench.sets(Command::remove_read_point_from_source, {source(), point()});
    EXPECT_EQ(bench.result(Command::raw_read_ids, {source()}), ResultCode::source_disabled);
    EXPECT_EQ(bench.result(Command::g2_query, {source()}), ResultCode::source_disabled);
}

TEST(CaenDeviceInventory, WithoutASourceNameItIsTheFirst) {
    Bench bench;
    EXPECT_EQ(bench.ask(Command::inventory_tag).text(source_name), "Source_0");
}

TEST(CaenDeviceInventory, AnAnswerNeverOutgrowsItsLength) {
    Bench bench({}, false);
    for (unsigned i = 0; i < 3000; ++i) {
        char id[25];
        std::snprintf(id, sizeof id, "%024X", i + 1);
        bench.shelf->add(id);
    }
    for (auto command : {Command::inventory_tag, Command::raw_read_ids}) {
        auto said = bench.ask(command, {source()});
        EXPECT_EQ(said.result(), ResultCode::success);
        EXPECT_GT(said.all(tag_id).size(), 300u);
        EXPECT_LE(said.bytes.size(), 0x7FFFu) << "a client counts in 16 bits with a sign";
    }
}

// --- the framed stream -------------------------------------------------------------------------------------

static const Bytes start_stream = request(Command::inventory_tag, {source(), flags(0x0006)}, 2);
static constexpr std::string_view head =
                                      "0001000200005358000000000008000100"
                                      "13",
                                  success_pair = "0000000800020000";

// One tag as pairs without a header.
static std::size_t tags_in(ByteView stream) {
    AvpReader reader(stream);
    std::size_t tags = 0;
    while (auto avp = reader.next())
        tags += avp->is(tag_id) ? 1 : 0;
    EXPECT_FALSE(reader.fault());
    return tags;
}

TEST(CaenDeviceInventory, AFramedStreamIsAHeadAndBarePairs) {
    Bench bench;
    bench.sets(Config::read_cycle, 0);
    bench.gets(start_stream);
    EXPECT_EQ(to_hex(bench.says()), head);
    bench.waits(500ms);
    EXPECT_EQ(tags_in(bench.says()), 10u) << "once for each round";
    bench.waits(1h);
    EXPECT_GT(bench.state("tags_lost"), 0) << "nobody read it";
    EXPECT_LT(bench.says().size(), 300'000u);
    EXPECT_EQ(bench.state_text("inventory"), "streaming");
    bench.gets(Bytes{abort_byte});
    EXPECT_EQ(to_hex(bench.says()), success_pair);
    EXPECT_EQ(bench.ask(Command::get_power).result(), ResultCode::success);
}

TEST(CaenDeviceInventory, AStreamWithACountEndsByItself) {
    Bench bench;
    bench.sets(Config::read_cycle, 4);
    bench.gets(start_stream);
    bench.waits(1s);
    auto said = bench.says();
    EXPECT_EQ(to_hex(ByteView(said).first(18)), head);
    EXPECT_EQ(to_hex(ByteView(said).last(8)), success_pair);
    EXPECT_EQ(tags_in(ByteView(said).subspan(18)), 4u);
    bench.waits(1s);
    EXPECT_TRUE(bench.says().empty());
    EXPECT_EQ(bench.ask(Command::get_power).result(), ResultCode::success);
}

TEST(CaenDeviceInventory, AStreamMayStartWithAResultAndEndInSilence) {
    Bench bench(Given{{"stream_start", "result"}, {"stream_end", "none"}});
    bench.sets(Config::read_cycle, 0);
    bench.gets(start_stream);
    EXPECT_EQ(to_hex(bench.says()), std::string(head) + std::string(success_pair)) << "M7b of vectors.tsv";
    bench.gets(Bytes{abort_byte});
    EXPECT_TRUE(bench.says().empty());
    EXPECT_EQ(bench.ask(Command::get_power).result(), ResultCode::success);
}

TEST(CaenDeviceInventory, DuringAStreamNothingButTheAbortCounts) {
    Bench bench({}, false);
    bench.sets(Config::read_cycle, 0);
    bench.gets(start_stream);
    bench.says();
    bench.gets(request(Command::get_power));
    bench.waits(1s);
    EXPECT_TRUE(bench.says().empty());
    auto ask = request(Command::get_power);
    Bytes more{0x80, 0x01, abort_byte};
    more.insert(more.end(), ask.begin(), ask.end());
    bench.gets(more);
    auto said = bench.says();
    EXPECT_EQ(to_hex(ByteView(said).first(8)), success_pair);
    EXPECT_EQ(messages(ByteView(said).subspan(8)).size(), 1u) << "what comes after it is heard";
}

TEST(CaenDeviceInventory, TheAbortMayComeWithTheRequest) {
    Bench bench;
    bench.sets(Config::read_cycle, 0);
    auto ask = request(Command::get_power);
    Bytes all = start_stream;
    all.insert(all.end(), ask.begin(), ask.end());
    all.push_back(abort_byte);
    all.insert(all.end(), ask.begin(), ask.end());
    bench.gets(all);
    auto said = bench.says();
    EXPECT_EQ(to_hex(ByteView(said).first(26)), std::string(head) + std::string(success_pair));
    EXPECT_EQ(messages(ByteView(said).subspan(26)).size(), 1u);
}

TEST(CaenDeviceInventory, TheAbortIsTakenAtAnyTimeAndTheStreamStaysWhole) {
    for (auto wait = 0ms; wait < 300ms; wait += 7ms) {
        Bench bench;
        bench.shelf->add(two);
        bench.sets(Config::read_cycle, 0);
        bench.gets(start_stream);
        bench.waits(wait);
        bench.gets(Bytes{abort_byte});
        auto said = bench.says();
        tags_in(ByteView(said).subspan(18));
        EXPECT_EQ(to_hex(ByteView(said).last(8)), success_pair);
        EXPECT_EQ(bench.ask(Command::get_power).result(), ResultCode::success);
    }
}

TEST(CaenDeviceInventory, AnAbortThatNothingWaitsForIsIgnored) {
    Bench bench;
    bench.gets(Bytes{abort_byte});
    EXPECT_TRUE(bench.says().empty());
    bench.gets(request(Command::raw_read_ids, {source()}));
    bench.gets(Bytes{abort_byte});
    bench.waits(1s);
    EXPECT_EQ(messages(bench.says()).size(), 1u);
}

TEST(CaenDeviceInventory, TheEventTriggerWaitsForTheKey) {
    Bench bench;
    bench.sets(Config::read_cycle, 1);
    bench.gets(request(Command::inventory_tag, {source(), flags(0x0026)}, 2));
    EXPECT_EQ(to_hex(bench.says()), head);
    bench.waits(10s);
    EXPECT_TRUE(bench.says().empty());
    bench.does("trigger");
    bench.waits(1s);
    auto said = bench.says();
    EXPECT_EQ(tags_in(said), 1u);
    EXPECT_EQ(to_hex(ByteView(said).last(8)), success_pair);
    EXPECT_TRUE(bench.device.inject("trigger", bench.now)) << "a key is a key";
}

TEST(CaenDeviceInventory, ALostLinkEndsTheStream) {
    Bench bench;
    bench.sets(Config::read_cycle, 0);
    bench.gets(start_stream);
    bench.waits(200ms);
    bench.device.link_lost(bench.now);
    bench.waits(1s);
    bench.device.start(bench.now);
    EXPECT_TRUE(bench.says().empty());
    EXPECT_EQ(bench.ask(Command::get_power).result(), ResultCode::success);
}

TEST(CaenDeviceInventory, AWrongRequestForAStreamIsAnsweredWithALength) {
    Bench bench;
    auto said = bench.ask(Command::inventory_tag, {text(source_name, "Source_7"), flags(0x0006)});
    EXPECT_EQ(said.result(), ResultCode::source_not_found);
    EXPECT_EQ(said.parsed.header.length, 26);
}

TEST(CaenDeviceInventory, QuietTimeIsKeptBetweenCycles) {
    Bench bench;
    bench.sets(Config::read_cycle, 0);
    bench.sets(Config::quiet_time, 950);
    bench.gets(start_stream);
    bench.says();
    bench.waits(10s);
    EXPECT_EQ(tags_in(bench.says()), 10u);
}

}  // namespace gantry::caen::device_test
