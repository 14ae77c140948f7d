// Tag commands: results by what the air says, address rules, masks, passwords, and a whole tag's life in the
// field.
#include "device_support.hpp"
#include "field/field.hpp"

namespace gantry::caen::device_test {

using enum Attribute;
using event::Technology;

static constexpr std::string_view one = "300833B2DDD9014035050000", two = "300833B2DDD9014035050001",
                                  iso_b = "E0040F0E06010000";

static Pairs memory(std::string_view id, Bank bank, std::uint32_t address, std::uint32_t size) {
    return Pairs{source()} + tag_pairs(id) +
           Pairs{number(memory_bank, static_cast<std::uint64_t>(bank)), number(tag_address, address),
                 number(length, size)};
}

TEST(CaenDeviceTags, EachRefusalOfATagHasItsResult) {
    Bench bench;
    bench.shelf->add(iso_b, Technology::iso18000_6b);
    bench.shelf->add("0102030405060708", Technology::epc_gen1);
    auto value = Pairs{bytes(tag_value, "CAFE")};
    auto read = memory(one, Bank::user, 0, 2);
    auto kill = Pairs{source()} + tag_pairs(one) + Pairs{number(g2_password, 1)};
    auto lock = Pairs{source()} + tag_pairs(one) + Pairs{number(payload, 0xC02)};
    auto bytes_read = Pairs{source()} + tag_pairs(iso_b) + Pairs{number(tag_address, 8), number(length, 2)};
    auto byte_lock = Pairs{source()} + tag_pairs(iso_b) + Pairs{number(tag_address, 8)};
    auto gen1_kill = Pairs{source()} + tag_pairs("0102030405060708") + Pairs{number(epc_password, 1)};
    const std::map<AirError, ResultCode> results = {
        {AirError::no_tag, ResultCode::tag_not_present},
        {AirError::locked, ResultCode::tag_locked},
        {AirError::bad_address, ResultCode::bad_tag_address},
        {AirError::insufficient_power, ResultCode::insufficient_power},
        {AirError::unsupported, ResultCode::unsupported},
    };
    for (auto [error, result] : results) {
        bench.shelf->refuses = error;
        EXPECT_EQ(bench.result(Command::g2_read, read), result);
        EXPECT_EQ(bench.result(Command::g2_write, read + value), result);
        EXPECT_EQ(bench.result(Command::g2_lock, lock), result);
        EXPECT_EQ(bench.result(Command::read_tag_data, bytes_read), result);
        EXPECT_EQ(bench.result(Command::write_tag_data, bytes_read + value), result);
        EXPECT_EQ(bench.result(Command::lock_tag, byte_lock), result);
        auto killed = error == AirError::locked ? ResultCode::kill_error : result;
        EXPECT_EQ(bench.result(Command::g2_kill, kill), killed);
        EXPECT_EQ(bench.result(Command::kill_tag, gen1_kill), killed);
    }
}

TEST(CaenDeviceTags, Gen2AddressesAndLengthsAreEvenBytes) {
    Bench bench;
    auto& user = bench.shelf->tags[0].banks[Bank::user];
    for (std::size_t i = 0; i < user.size(); ++i)
        user[i] = static_cast<std::uint8_t>(i);
    EXPECT_EQ(bench.ask(Command::g2_read, memory(one, Bank::user, 4, 6)).hex_of(tag_value), "040506070809");
    EXPECT_EQ(bench.result(Command::g2_read, memory(one, Bank::user, 3, 2)), ResultCode::bad_tag_address);
    EXPECT_EQ(bench.result(Command::g2_read, memory(one, Bank::user, 4, 3)), ResultCode::invalid_parameter);
    EXPECT_EQ(bench.result(Command::g2_read, memory(one, Bank::user, 4, 0)), ResultCode::invalid_parameter);
    EXPECT_EQ(bench.result(Command::g2_read, memory(one, Bank::user, 0, 130)), ResultCode::invalid_parameter);
    EXPECT_EQ(bench.result(Command::g2_read, memory(one, Bank::user, 30, 4)), ResultCode::bad_tag_address);
    EXPECT_EQ(
        bench.result(Command::g2_read, memory(one, Bank::epc, 4, 12) + Pairs{number(g2_password, 0xABCD)}),
        ResultCode::success);
    EXPECT_EQ(bench.shelf->last_password, 0xABCDu);
    auto four = memory(one, Bank::user, 4, 2);
    four[3] = number(memory_bank, 4);
    EXPECT_EQ(bench.result(Command::g2_read, four), ResultCode::bad_parameter_value);
}

TEST(CaenDeviceTags, ATagIdMustBeAsLongAsItsLengthSays) {
    Bench bench;
    auto pairs = memory(one, Bank::user, 0, 2);
    pairs[1] = number(tag_id_len, 11);
    EXPECT_EQ(bench.result(Command::g2_read, pairs), ResultCode::invalid_parameter);
    pairs[1] = number(tag_id_len, 65);
    EXPECT_EQ(bench.result(Command::g2_read, pairs), ResultCode::invalid_parameter);
    EXPECT_EQ(bench.result(Command::g2_read, memory("", Bank::user, 0, 2)), ResultCode::tag_not_present);
}

TEST(CaenDeviceTags, AMaskPicksTheTag) {
    Bench bench;
    bench.shelf->add(two).banks[Bank::user] = Bytes(4, 0x77);
    auto masked = [](std::string_view mask, std::uint32_t first) {
        return Pairs{source(), number(memory_bank, 1), number(tag_address, first),
                     number(tag_id_len, mask.size() / 2), bytes(tag_id, mask)};
    };
    auto range = Pairs{number(memory_bank, 3), number(tag_address, 0), number(length, 4)};
    auto said = bench.ask(Command::g2_read, masked("0001", 32 + 80) + range);
    EXPECT_EQ(said.hex_of(tag_value), "77777777");
    EXPECT_EQ(bench.result(Command::g2_read, masked("0002", 32 + 80) + range), ResultCode::tag_not_present);
    bench.sets(Command::g2_lock, masked("0001", 32 + 80) + Pairs{number(payload, 0xC02)});
    EXPECT_EQ(bench.shelf->tags[1].lock_mask, 3);
    EXPECT_EQ(bench.shelf->tags[1].lock_action, 2);
    bench.sets(Command::g2_kill, masked("0001", 32 + 80) + Pairs{number(g2_password, 0)});
    EXPECT_TRUE(bench.shelf->tags[1].away);
    Bench other(Given{{"model", "R4300P"}});
    EXPECT_EQ(other.result(Command::g2_lock, masked("0000", 32 + 80) + Pairs{number(payload, 0xC02)}),
              ResultCode::invalid_parameter)
        << "a form of the A528B";
}

TEST(CaenDeviceTags, Revision4KnowsNoAccessPassword) {
    Bench bench(Given{{"model", "A948EU"}});
    EXPECT_EQ(bench.result(Command::g2_read, memory(one, Bank::user, 0, 2)), ResultCode::success);
    EXPECT_EQ(bench.result(Command::g2_read, memory(one, Bank::user, 0, 2) + Pairs{number(g2_password, 1)}),
              ResultCode::invalid_parameter);
}

TEST(CaenDeviceTags, ATagIsReachedThroughAnyReadPointOfItsSource) {
    Bench bench;
    bench.shelf->add(two, Technology::epc_gen2, 2);
    EXPECT_EQ(bench.result(Command::g2_read, memory(two, Bank::user, 0, 2)), ResultCode::tag_not_present);
    bench.sets(Command::add_read_point_to_source, {source(), point(1)});
    EXPECT_EQ(bench.result(Command::g2_read, memory(two, Bank::user, 0, 2)), ResultCode::success);
    bench.does("antenna Ant1=bad");
    EXPECT_EQ(bench.result(Command::g2_read, memory(two, Bank::user, 0, 2)), ResultCode::tag_not_present);
}

TEST(CaenDeviceTags, ProgramIdWritesTheNearestTag) {
    Bench bench;
    bench.shelf->add(two).rssi = -300;
    bench.sets(Command::g2_program_id,
               Pairs{source()} + tag_pairs("E00000000000000000000001") + Pairs{number(g2_nsi, 0x1A5)});
    EXPECT_EQ(to_hex(bench.shelf->tags[1].id.view()), "E00000000000000000000001");
    EXPECT_EQ(to_hex(ByteView(bench.shelf->tags[1].banks[Bank::epc]).subspan(2, 2)), "31A5");
    EXPECT_EQ(bench.ask(Command::g2_query_ack, {source()}).hex_of(tag_id), "E00000000000000000000001");
    EXPECT_EQ(bench.result(Command::g2_program_id, Pairs{source()} + tag_pairs("E00000000000000000000001") +
                                                       Pairs{number(g2_nsi, 0x200)}),
              ResultCode::bad_parameter_value);
}

TEST(CaenDeviceTags, Iso18000ReadsWritesAndLocksBytes) {
    Bench bench;
    bench.shelf->add(iso_b, Technology::iso18000_6b);
    auto at = [](std::uint32_t address, std::uint32_t size) {
        return Pairs{source()} + tag_pairs(iso_b) + Pairs{number(tag_address, address), number(length, size)};
    };
    EXPECT_EQ(bench.ask(Command::read_tag_data, at(0, 8)).hex_of(tag_value), iso_b);
    bench.sets(Command::write_tag_data, at(21, 3) + Pairs{bytes(tag_value, "ABCDEF")});
    EXPECT_EQ(bench.ask(Command::read_tag_data, at(20, 5)).hex_of(tag_value), "00ABCDEF00");
    bench.sets(Command::lock_tag, Pairs{source()} + tag_pairs(iso_b) + Pairs{number(tag_address, 22)});
    EXPECT_EQ(bench.result(Command::block_write_tag, at(20, 4) + Pairs{bytes(tag_value, "01020304")}),
              ResultCode::tag_locked);
    EXPECT_EQ(bench.result(Command::block_write_tag, at(24, 4) + Pairs{bytes(tag_value, "01020304")}),
              ResultCode::success);
}

TEST(CaenDeviceTags, GroupSelectComparesMaskedBytes) {
    Bench bench({}, false);
    auto none = [&] {
        return bench.result(Command::group_select_unselect, {number(sel_unsel_op, 0), number(bitmask, 0x80),
                                                             number(tag_address, 0), bytes(tag_value, "E0")});
    };
    EXPECT_EQ(none(), ResultCode::tag_not_present);
    bench.shelf->add("E000000000000001", Technology::iso18000_6b);
    bench.shelf->add("E000000000000005", Technology::iso18000_6b);
    auto ask = [&](unsigned operation, unsigned mask, std::string_view value) {
        return bench.ask(Command::group_select_unselect,
                         {number(sel_unsel_op, operation), number(bitmask, mask), number(tag_address, 0),
                          bytes(tag_value, value)});
    };
    using Texts = std::vector<std::string>;
    const std::string first = "E000000000000001", second = "E000000000000005";
    EXPECT_EQ(ask(0, 0x01, "FFFFFFFFFFFFFF05").all(tag_id), Texts{second}) << "only the last byte counts";
    EXPECT_EQ(ask(1, 0x01, "0000000000000005").all(tag_id), Texts{first});
    EXPECT_EQ(ask(2, 0xFF, "E000000000000002").all(tag_id), Texts{second});
    EXPECT_EQ(ask(3, 0xFF, "E000000000000002").all(tag_id), Texts{first});
    EXPECT_EQ(ask(4, 0x01, "0000000000000005").all(tag_id), Texts{first}) << "unselect leaves the others";
    EXPECT_EQ(ask(7, 0xFF, "E000000000000002").all(tag_id), Texts{second});
    EXPECT_EQ(ask(0, 0x80, "E1").result(), ResultCode::select_error);
    EXPECT_EQ(ask(0, 0x80, "E00000000000000000").result(), ResultCode::invalid_parameter);
}

TEST(CaenDeviceTags, Gen1AndEpc119AreProgrammed) {
    Bench bench({}, false);
    bench.shelf->add("0102030405060708", Technology::epc_gen1);
    bench.shelf->add("A1A2A3A4A5A6A7A8", Technology::epc_1_19);
    bench.sets(Command::program_id, Pairs{source()} + tag_pairs("1112131415161718") +
                                        Pairs{number(epc_password, 0x77), number(boolean, 1)});
    EXPECT_EQ(to_hex(bench.shelf->tags[0].id.view()), "1112131415161718");
    EXPECT_EQ(bench.shelf->tags[0].kill_password, 0x77u);
    bench.sets(Command::e119_program_id,
               {source(), bytes(tag_id, "A1A2A3A4A5A6A7A8"), bytes(tag_value, "B1B2B3B4B5B6B7B8")});
    EXPECT_EQ(to_hex(bench.shelf->tags[1].id.view()), "B1B2B3B4B5B6B7B8");
    bench.sets(Command::kill_tag,
               Pairs{source()} + tag_pairs("1112131415161718") + Pairs{number(epc_password, 0x77)});
    EXPECT_TRUE(bench.shelf->tags[0].away);
}

// The same reader before the field's own tags, with passwords and locks as the standard has them.
TEST(CaenDeviceTags, ATagsLifeInTheField) {
    field::Field field;
    auto& air = field.add_reader("bench", 4, 20);
    field::PlacedTag tag;
    tag.tag.id = id_of(one);
    tag.rssi_dbm = -40;
    tag.tag.access_password = 0x11223344;
    tag.tag.kill_password = 0x55667788;
    field.place(air, tag);
    CaenDevice device({"caen", 1, device_with()}, air);
    Now now = testkit::script_start;
    device.power_on(now);
    device.start(now);
    auto ask = [&](Command command, const Pairs& pairs) {
        device.received(request(command, pairs), now);
        while (auto due = device.deadline()) {
            now = now + std::chrono::ceil<std::chrono::microseconds>(*due - now.steady);
            device.time_passed(now);
        }
        auto all = messages(take_output(device));
        EXPECT_EQ(all.size(), 1u);
        return all.front();
    };
    auto with = [](std::uint32_t password) { return Pairs{number(g2_password, password)}; };
    EXPECT_EQ(ask(Command::raw_read_ids, {source()}).hex_of(tag_id), one);
    EXPECT_EQ(ask(Command::g2_query, {source()}).result(), ResultCode::success);
    auto word = memory(one, Bank::user, 0, 2);
    EXPECT_EQ(ask(Command::g2_write, word + Pairs{bytes(tag_value, "BEEF")}).result(), ResultCode::success);
    EXPECT_EQ(ask(Command::g2_read, word).hex_of(tag_value), "BEEF");
    auto lock_user = Pairs{source()} + tag_pairs(one) + Pairs{number(payload, 0x0C02)};
    EXPECT_EQ(ask(Command::g2_lock, lock_user).result(), ResultCode::tag_locked) << "without the password";
    EXPECT_EQ(ask(Command::g2_lock, lock_user + with(0x11223344)).result(), ResultCode::success);
    EXPECT_EQ(ask(Command::g2_write, word + Pairs{bytes(tag_value, "0000")}).result(),
              ResultCode::tag_locked);
    EXPECT_EQ(ask(Command::g2_write, word + Pairs{bytes(tag_value, "0000")} + with(0x11223344)).result(),
              ResultCode::success);
    EXPECT_EQ(
        ask(Command::g2_program_id, Pairs{source()} + tag_pairs(two) + Pairs{number(g2_nsi, 0)}).result(),
        ResultCode::success);
    EXPECT_EQ(ask(Command::raw_read_ids, {source()}).hex_of(tag_id), two);
    auto kill = Pairs{source()} + tag_pairs(two);
    EXPECT_EQ(ask(Command::g2_kill, kill + with(1)).result(), ResultCode::kill_error);
    EXPECT_EQ(ask(Command::g2_kill, kill + with(0x55667788)).result(), ResultCode::success);
    EXPECT_EQ(ask(Command::g2_query, {source()}).result(), ResultCode::tag_not_present);
    EXPECT_TRUE(ask(Command::raw_read_ids, {source()}).parsed.avps.empty());
}

}  // namespace gantry::caen::device_test
