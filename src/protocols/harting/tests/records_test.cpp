#include "protocols/harting/records.hpp"

#include <algorithm>
#include <bit>

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "protocols/harting/tables.hpp"
#include "testkit/vectors.hpp"
#include "wire/cursor.hpp"

namespace gantry::harting::test {

using event::Technology;
using testkit::hex;
using namespace std::chrono_literals;

namespace {

constexpr std::size_t base = 6;  // where data start in a reply
constexpr std::string_view epc = "3074257BF7194E4000001A85", tid = "E28011052000";

Wall at(std::string_view text) {
    return *parse_rfc3339(text);
}

struct Walk {
    std::vector<Observation> seen;
    Bytes bank;
    std::vector<InputEvent> inputs;
    Walked walked;
    // An exact block on the heap: one byte too far is seen by the address sanitizer.
    explicit Walk(ByteView data, const WalkOptions& options = {}) {
        Bytes exact(data.begin(), data.end());
        exact.shrink_to_fit();
        walked = walk_buffer(exact, base, options, seen, bank, inputs);
    }
    std::string data_of(std::size_t i) const {
        return to_hex(ByteView(bank).subspan(seen.at(i).data_offset, seen.at(i).data_size));
    }
};
Walk walk(std::string_view data, const WalkOptions& options = {}) {
    return Walk(hex(data), options);
}

Walk walk_records(std::vector<TagRecord> records, std::uint8_t tr1, std::uint8_t tr2,
                  const WalkOptions& options = {}) {
    Bytes data;
    append_buffer_head(tr1, tr2, static_cast<std::uint16_t>(records.size()), data);
    for (auto& record : records)
        append_record(record, tr1, tr2, hex("001122334455"), data);
    return Walk(data, options);
}

TagRecord tag(std::string_view its_epc = epc, std::string_view its_tid = "") {
    TagRecord record;
    record.iddt = its_tid.empty() ? 0 : 2;
    record.idd = gen2_idd(hex(its_epc), {}, hex(its_tid));
    return record;
}

}  // namespace

// --- identifiers -------------------------------------------------------------------------------------------

TEST(HartingIdentity, EpcTidAndXpcAreTakenApart) {
    struct Case {
        std::string_view idd;
        std::uint8_t iddt;
        std::string_view epc, tid;
        std::optional<std::uint16_t> xpc;
    };
    for (auto& each : std::initializer_list<Case>{
             {"3000 3074257BF7194E4000001A85", 0, epc, "", {}},
             {"3000 3074257BF7194E4000001A85 E28011052000", 2, epc, tid, {}},
             {"3A00 8001 3074257BF7194E4000001A85", 0, epc, "", 0x8001},
             // Here the PC does not count the XPC word.
             {"3200 8001 3074257BF7194E4000001A85", 0, epc, "", 0x8001},
             {"3A00 8001 3074257BF7194E4000001A85 E28011052000", 2, epc, tid, 0x8001},
             {"0800 1234", 0, "1234", "", {}},
             {"0000", 0, "", "", {}},
             {"0000 E28011052000", 2, "", tid, {}},
         }) {
        SCOPED_TRACE(each.idd);
        auto idd = hex(each.idd);
        auto found = take_apart(type_epc_gen2, each.iddt, idd);
        ASSERT_TRUE(found);
        EXPECT_EQ(to_hex(found->epc), each.epc);
        EXPECT_EQ(to_hex(found->tid), each.tid);
        EXPECT_EQ(found->xpc, each.xpc);
        EXPECT_EQ(found->pc, idd[0] << 8 | idd[1]);
    }
    auto other = hex("E004010012345678");
    EXPECT_EQ(to_hex(take_apart(0x03, 0, other)->epc), "E004010012345678");
    for (const auto* broken : {"", "30", "3000", "3000 30", "0200", "3200 8001 30"})
        EXPECT_FALSE(take_apart(type_epc_gen2, 0, hex(broken))) << broken;
}

RC_GTEST_PROP(HartingIdentity, WhatIsPutTogetherIsTakenApartAgain, ()) {
    auto words = [](int max) {
        auto size = *rc::gen::inRange(0, max + 1) * 2;
        return *rc::gen::container<Bytes>(static_cast<std::size_t>(size), rc::gen::arbitrary<std::uint8_t>());
    };
    auto its_epc = words(29);
    auto its_tid = words(12);
    auto xpc = *rc::gen::maybe(rc::gen::arbitrary<std::uint16_t>());
    std::optional<std::uint16_t> its_xpc;
    if (xpc) its_xpc = *xpc;
    auto idd = gen2_idd(its_epc, its_xpc, its_tid);
    auto found = take_apart(type_epc_gen2, its_tid.empty() ? 0 : 2, idd);
    RC_ASSERT(found.has_value());
    RC_ASSERT(std::ranges::equal(found->epc, its_epc));
    RC_ASSERT(std::ranges::equal(found->tid, its_tid));
    RC_ASSERT(found->xpc == its_xpc);
}

// --- records of the buffer ---------------------------------------------------------------------------------

// As captured from a sister reader: IDD, timer, MAC; the length counts itself.
TEST(HartingRecords, TheCapturedShapeIsRead) {
    auto found = walk("A1 02 0001 001D 84 00 0E 3000 3074257BF7194E4000001A85 0013DF75 001122334455 ",
                      {.now = at("2026-11-21T12:00:00Z")});
    ASSERT_FALSE(found.walked.fault) << found.walked.fault->text();
    ASSERT_EQ(found.seen.size(), 1u);
    EXPECT_EQ(found.seen[0].tag, event::TagId(hex(epc)));
    EXPECT_EQ(found.seen[0].technology, Technology::epc_gen2);
    EXPECT_EQ(found.seen[0].antenna, Observation::no_antenna);
    EXPECT_EQ(found.seen[0].rssi, Observation::no_rssi);
    EXPECT_EQ(from_us(found.seen[0].reader_time_us), at("2026-11-21T00:19:57.205Z"));
}

TEST(HartingRecords, PcAndXpcReachTheObservationOfEachAntenna) {
    auto plain = tag(), with_xpc = tag(), other = tag();
    with_xpc.idd = gen2_idd(hex(epc), 0x8001, hex(tid));
    with_xpc.iddt = 2;
    with_xpc.antennas = {{.number = 1}, {.number = 2}};
    other.transponder_type = 0x03;  // an ISO 15693 tag has neither
    other.idd = hex("E004010012345678");
    auto found = walk_records({plain, with_xpc, other}, tr1_idd | tr1_antenna, 0);
    ASSERT_FALSE(found.walked.fault);
    ASSERT_EQ(found.seen.size(), 4u);
    EXPECT_EQ(found.seen[0].pc, 0x3000);
    EXPECT_EQ(found.seen[0].xpc, 0u) << "the PC says that there is none";
    for (std::size_t i : {1u, 2u}) {
        EXPECT_EQ(found.seen[i].pc, 0x3A00);
        EXPECT_EQ(found.seen[i].xpc, 0x80010000u);
    }
    EXPECT_EQ(found.seen[3].pc, 0);
    EXPECT_EQ(found.seen[3].xpc, Observation::no_xpc);
}

TEST(HartingRecords, EachAntennaOfTheBitFieldIsAnObservation) {
    auto found = walk("11 0002  000A 84 00 04 0800 1234 05  000A 84 00 04 0800 5678 00");
    ASSERT_FALSE(found.walked.fault);
    EXPECT_EQ(found.walked.records, 2u);
    ASSERT_EQ(found.seen.size(), 3u);
    EXPECT_EQ(found.seen[0].antenna, 1);
    EXPECT_EQ(found.seen[1].antenna, 3);
    EXPECT_EQ(found.seen[1].tag, event::TagId(hex("1234")));
    EXPECT_EQ(found.seen[2].antenna, Observation::no_antenna);
}

TEST(HartingRecords, TheExtendedAntennasSayStrengthEach) {
    auto found = walk("91 10 0001 0017 84 00 04 0800 1234 01 02 01 37 0400 0000 04 28 0000 0000");
    ASSERT_FALSE(found.walked.fault);
    ASSERT_EQ(found.seen.size(), 2u);
    EXPECT_EQ(found.seen[0].antenna, 1);
    EXPECT_EQ(found.seen[0].rssi, -550);
    EXPECT_EQ(found.seen[1].antenna, 4);
    EXPECT_EQ(found.seen[1].rssi, -400);
}

TEST(HartingRecords, StatisticsGiveTheNumberOfReads) {
    auto found = walk("91 08 0001 0011 84 00 04 0800 1234 03 0011 28 2D 000000");
    ASSERT_FALSE(found.walked.fault);
    ASSERT_EQ(found.seen.size(), 2u);
    EXPECT_EQ(found.seen[0].reads + found.seen[1].reads, 17);
    EXPECT_EQ(found.seen[0].rssi, -400);
}

TEST(HartingRecords, DataBlocksComeInTheOrderOfTheMemory) {
    auto found = walk("03 0001 0010 84 00 04 0800 1234 0002 02 AABB CCDD");
    ASSERT_FALSE(found.walked.fault);
    EXPECT_EQ(found.data_of(0), "AABBCCDD");
    EXPECT_EQ(found.seen[0].data_bank, Bank::user);
    EXPECT_EQ(found.seen[0].tid_size, 0);
    found = walk("0B 0001 0010 84 00 04 0800 1234 0002 02 BBAA DDCC");
    EXPECT_EQ(found.data_of(0), "AABBCCDD");
    // Passwords or an EPC have no place in an event.
    found = walk("03 0001 0010 84 00 04 0800 1234 0002 02 AABB CCDD", {.block_bank = Bank::epc});
    ASSERT_EQ(found.seen.size(), 1u);
    EXPECT_EQ(found.seen[0].data_size, 0);
}

TEST(HartingRecords, ATidAndUserDataBothReachTheEvent) {
    auto record = tag(epc, tid);
    record.blocks = hex("AABBCCDD");
    record.antennas = {{.number = 1}, {.number = 2}};
    for (std::uint8_t order : {std::uint8_t{0}, tr1_lsb_first}) {
        auto found = walk_records({record}, tr1_idd | tr1_blocks | tr1_antenna | order, 0);
        ASSERT_EQ(found.seen.size(), 2u);
        for (std::size_t i : {0u, 1u}) {
            EXPECT_EQ(found.data_of(i), std::string(tid) + "AABBCCDD");
            EXPECT_EQ(found.seen[i].tid_size, 6);
            EXPECT_EQ(found.seen[i].data_bank, Bank::user);
        }
    }
    auto found = walk_records({tag(epc, tid)}, tr1_idd, 0);
    EXPECT_EQ(found.data_of(0), tid);
    EXPECT_EQ(found.seen[0].data_bank, Bank::tid);
    EXPECT_EQ(found.seen[0].tid_size, 0);
    record.blocks = hex("E28011052000AABB");  // both say the TID, one of them more of it
    found = walk_records({record}, tr1_idd | tr1_blocks, 0, {.block_bank = Bank::tid});
    EXPECT_EQ(found.data_of(0), "E28011052000AABB");
    EXPECT_EQ(found.seen[0].data_bank, Bank::tid);
}

TEST(HartingRecords, TheReadersClockBecomesUtc) {
    struct Case {
        std::string_view what, parts, now, time;
        std::chrono::minutes offset{};
        std::uint8_t tr1 = tr1_idd | tr1_timer;
    };
    constexpr std::uint8_t dated = tr1_idd | tr1_timer | tr1_date;
    for (auto& each : std::initializer_list<Case>{
             {"date and time", "0C22 7531 14 1A 0B 15 00", "1970-01-01T00:00:00Z", "2026-11-21T12:34:30.001Z",
              0min, dated},
             {"local time", "0C22 7531 14 1A 0B 15 00", "1970-01-01T00:00:00Z", "2026-11-21T11:34:30.001Z",
              60min, dated},
             {"no date", "0C22 7531", "2026-11-21T12:40:00Z", "2026-11-21T12:34:30.001Z"},
             {"just before midnight", "173B E678", "2026-11-22T00:00:05Z", "2026-11-21T23:59:59Z"},
             {"just after midnight", "0000 03E8", "2026-11-21T23:59:58Z", "2026-11-22T00:00:01Z"},
             {"midnight elsewhere", "0000 03E8", "2026-11-21T22:59:58Z", "2026-11-21T23:00:01Z", 60min},
             {"a clock never set", "0000 03E8 00 00 00 00 00", "2026-11-21T00:10:00Z", "2026-11-21T00:00:01Z",
              0min, dated},
             {"no such day", "0000 03E8 14 1A 02 1E 00", "2026-11-21T00:10:00Z", "2026-11-21T00:00:01Z", 0min,
              dated},
         }) {
        SCOPED_TRACE(each.what);
        auto rest = hex(each.parts);
        Bytes data = {each.tr1, 0, 1, 0, static_cast<std::uint8_t>(9 + rest.size())};
        for (auto byte : hex("84 00 04 0800 1234"))
            data.push_back(byte);
        data.insert(data.end(), rest.begin(), rest.end());
        Walk found(data, {.now = at(each.now), .utc_offset = each.offset});
        ASSERT_FALSE(found.walked.fault);
        ASSERT_EQ(found.seen.size(), 1u);
        EXPECT_EQ(to_rfc3339(from_us(found.seen[0].reader_time_us)), to_rfc3339(at(each.time)));
    }
    EXPECT_EQ(walk("41 0001 000E 84 00 04 0800 1234 14 1A 0B 15 00").seen.at(0).reader_time_us, 0);
}

TEST(HartingRecords, InputsAreEventsWithAndWithoutATag) {
    auto found = walk("A1 01 0002  000B 00 00 00 0C22 0000 02 01  000F 84 00 04 0800 1234 0C22 0000 00 00",
                      {.now = at("2026-11-21T12:40:00Z")});
    ASSERT_FALSE(found.walked.fault) << found.walked.fault->text();
    EXPECT_EQ(found.seen.size(), 1u);
    EXPECT_EQ(found.walked.unusable, 0u);
    ASSERT_EQ(found.inputs.size(), 2u);
    EXPECT_EQ(found.inputs[0].inputs, 2);
    EXPECT_EQ(found.inputs[0].status, 1);
    EXPECT_EQ(from_us(found.inputs[0].reader_time_us), at("2026-11-21T12:34:00Z"));
}

TEST(HartingRecords, NewerPartsAreSkippedAndBrokenRecordsCostThemselvesAlone) {
    auto found =
        walk("01 0003  000C 84 00 04 0800 1234 FFFFFF  0008 84 00 04 0800 12  0009 84 00 04 0800 5678");
    ASSERT_FALSE(found.walked.fault);
    EXPECT_EQ(found.walked.records, 3u);
    EXPECT_EQ(found.walked.unusable, 1u);
    ASSERT_EQ(found.seen.size(), 2u);
    EXPECT_EQ(found.seen[1].tag, event::TagId(hex("5678")));
    found = walk("81 80 01 0001  0009 84 00 04 0800 5678");  // a third byte of parts
    ASSERT_FALSE(found.walked.fault);
    EXPECT_EQ(found.seen.size(), 1u);
    found = walk("01 0002  0005 84 00 00  0005 84 00 00");  // tags without an id
    EXPECT_EQ(found.walked.unusable, 2u);
    found = walk("20 0001  0006 0C22 0000");  // nothing but a time
    EXPECT_EQ(found.walked.unusable, 1u);
}

TEST(HartingRecords, WhatIsCutShortIsAFaultAndWhatCameBeforeIsDelivered) {
    auto whole = hex("01 0002  0009 84 00 04 0800 1234  0009 84 00 04 0800 5678");
    for (std::size_t size = 0; size < whole.size(); ++size) {
        Walk found(ByteView(whole).first(size));
        ASSERT_TRUE(found.walked.fault) << size;
        EXPECT_EQ(found.walked.fault->code, wire::Errc::truncated);
        EXPECT_GE(found.walked.fault->offset, base);
        EXPECT_EQ(found.seen.size(), size >= 12 ? 1u : 0u) << size;
    }
    EXPECT_EQ(walk("01 0001 0001 84").walked.fault->code, wire::Errc::bad_length);
    EXPECT_EQ(walk("01 0000 00").walked.fault->code, wire::Errc::trailing_bytes);
    EXPECT_FALSE(walk("01 0000").walked.fault);
}

// Every combination of parts, with antennas, times, inputs and identifiers of all kinds.
RC_GTEST_PROP(HartingRecords, EveryCombinationOfPartsComesBack,
              (std::uint8_t tr1, std::uint8_t tr2, std::uint8_t newer, bool with_tid)) {
    tr2 &= static_cast<std::uint8_t>(~tr2_extension);
    TagRecord record = tag(epc, with_tid ? tid : "");
    record.block_size = *rc::gen::inRange<std::uint8_t>(1, 5);
    record.blocks = *rc::gen::container<Bytes>(*rc::gen::inRange<std::size_t>(0, 6) * record.block_size,
                                               rc::gen::arbitrary<std::uint8_t>());
    for (std::uint8_t number = 1; number <= 4; ++number)
        if (*rc::gen::arbitrary<bool>())
            record.antennas.push_back({.number = number,
                                       .rssi = *rc::gen::inRange<std::uint8_t>(1, 90),
                                       .count = *rc::gen::inRange<std::uint16_t>(1, 9)});
    record.time = at("2026-11-21T12:34:56.789Z");
    record.input = InputEvent{3, 1, to_us(record.time)};
    constexpr std::uint16_t count = 3;
    Bytes data;
    append_buffer_head(tr1, tr2, count, data);
    for (int i = 0; i < count; ++i) {
        auto start = data.size();
        append_record(record, tr1, tr2, {}, data);
        if (i != 1) continue;
        // Later firmware adds a part at the end.
        data.insert(data.end(), newer, 0x5A);
        wire::Writer(data).patch_big_endian(start, data.size() - start, 2);
    }
    Walk found(data, {.now = record.time + 1h});
    if ((tr1 & tr1_extension) == 0) tr2 = 0;
    bool has_input = (tr2 & tr2_input) != 0, has_tag = (tr1 & tr1_idd) != 0;
    RC_ASSERT(!found.walked.fault.has_value());
    RC_ASSERT(found.walked.records == count);
    RC_ASSERT(found.inputs.size() == (has_input ? count : 0u));
    RC_ASSERT(found.walked.unusable == (has_tag || has_input ? 0u : count));
    bool has_time = (tr1 & tr1_timer) != 0;
    for (auto& input : found.inputs)
        RC_ASSERT(input.inputs == 3 && input.status == 1 &&
                  input.reader_time_us == (has_time ? to_us(record.time) : 0));
    bool ext = (tr2 & tr2_antennas) != 0, field = (tr1 & tr1_antenna) != 0;
    bool statistics = field && (tr2 & tr2_statistics) != 0;
    auto antennas = ext || field ? std::max<std::size_t>(record.antennas.size(), 1) : 1;
    RC_ASSERT(found.seen.size() == (has_tag ? antennas * count : 0));
    unsigned reads = 0, expected_reads = 0;
    for (auto& antenna : record.antennas)
        expected_reads += antenna.count;
    auto blocks = (tr1 & tr1_blocks) != 0 ? to_hex(record.blocks) : "";
    for (std::size_t i = 0; i < found.seen.size(); ++i) {
        auto& seen = found.seen[i];
        RC_ASSERT(seen.tag == event::TagId(hex(epc)));
        RC_ASSERT(seen.technology == Technology::epc_gen2);
        RC_ASSERT(seen.reader_time_us == (has_time ? to_us(record.time) : 0));
        RC_ASSERT(found.data_of(i) == (with_tid ? std::string(tid) : std::string()) + blocks);
        RC_ASSERT(seen.tid_size == (with_tid && !blocks.empty() ? tid.size() / 2 : 0u));
        RC_ASSERT((seen.data_bank == Bank::tid) == (with_tid && blocks.empty()));
        reads += seen.reads;
        if ((!ext && !field) || record.antennas.empty()) {
            RC_ASSERT(seen.antenna == Observation::no_antenna);
            continue;
        }
        auto& antenna = record.antennas[i % antennas];
        RC_ASSERT(seen.antenna == antenna.number);
        if (ext) RC_ASSERT(seen.rssi == -10 * antenna.rssi);
    }
    if (has_tag && statistics && !record.antennas.empty()) RC_ASSERT(reads == expected_reads * count);
}

// --- records of Inventory ----------------------------------------------------------------------------------

TEST(HartingInventory, BothFormsAreRead) {
    std::vector<Observation> seen;
    Bytes bank;
    auto plain = hex("02 84 00 04 0800 1234 84 02 0A 0800 5678 E28011052000");
    auto walked = walk_inventory(plain, base, false, seen, bank);
    ASSERT_FALSE(walked.fault);
    EXPECT_EQ(walked.records, 2u);
    ASSERT_EQ(seen.size(), 2u);
    EXPECT_EQ(seen[0].tag, event::TagId(hex("1234")));
    EXPECT_EQ(seen[1].data_bank, Bank::tid);
    EXPECT_EQ(to_hex(ByteView(bank).subspan(seen[1].data_offset, seen[1].data_size)), tid);
    EXPECT_EQ(seen[1].reader_time_us, 0);
    seen.clear();
    // A tag on two antennas, an antenna without a tag, a tag without antennas.
    auto antennas =
        hex("03 11 84 00 04 0800 1234 02 01 00 37 0000 0000 02 00 38 0000 0000"
            "   10 03 84 00 0000 0000   01 84 00 04 0800 5678");
    walked = walk_inventory(antennas, base, true, seen, bank);
    ASSERT_FALSE(walked.fault) << walked.fault->text();
    ASSERT_EQ(seen.size(), 3u);
    EXPECT_EQ(seen[0].rssi, -550);
    EXPECT_EQ(seen[1].antenna, 2);
    EXPECT_EQ(seen[2].antenna, Observation::no_antenna);
    for (std::size_t size = 0; size < antennas.size(); ++size) {
        Bytes exact(antennas.begin(), antennas.begin() + static_cast<std::ptrdiff_t>(size));
        exact.shrink_to_fit();
        std::vector<Observation> some;
        EXPECT_TRUE(walk_inventory(exact, base, true, some, bank).fault) << size;
    }
    EXPECT_EQ(walk_inventory(hex("00 00"), base, false, seen, bank).fault->code, wire::Errc::trailing_bytes);
}

RC_GTEST_PROP(HartingInventory, WhatIsAppendedIsWalkedAgain, (bool with_antennas, bool with_tid)) {
    auto record = tag(epc, with_tid ? tid : "");
    auto count = *rc::gen::inRange<std::uint8_t>(0, 5);
    for (std::uint8_t i = 1; i <= count; ++i)
        record.antennas.push_back({.number = i, .rssi = static_cast<std::uint8_t>(40 + i)});
    Bytes data = {2};
    append_inventory_tag(record, with_antennas, data);
    append_inventory_tag(record, with_antennas, data);
    std::vector<Observation> seen;
    Bytes bank;
    auto walked = walk_inventory(data, base, with_antennas, seen, bank);
    RC_ASSERT(!walked.fault.has_value());
    std::size_t each = with_antennas ? std::max<std::size_t>(count, 1) : 1;
    RC_ASSERT(seen.size() == 2 * each);
    for (std::size_t i = 0; i < seen.size(); ++i) {
        RC_ASSERT(seen[i].tag == event::TagId(hex(epc)));
        RC_ASSERT(seen[i].data_size == (with_tid ? tid.size() / 2 : 0u));
        if (with_antennas && count > 0) RC_ASSERT(seen[i].antenna == i % each + 1);
    }
}

}  // namespace gantry::harting::test
