// Every command of the table: once well, once ill.
#include "device_cases.hpp"

namespace gantry::caen::device_test {

static void answers_as(const Case& wanted, const Ask& ask) {
    Bench bench;
    fill(*bench.shelf);
    for (auto& [command, pairs] : wanted.before)
        bench.sets(command, pairs);
    auto said = bench.ask(wanted.command, ask.pairs);
    EXPECT_EQ(said.result(), ask.result) << describe(said.parsed.result.value_or(0xFFFF));
    EXPECT_EQ(said.parsed.command, static_cast<std::uint16_t>(wanted.command));
    EXPECT_FALSE(said.parsed.fault);
    if (ask.result != ResultCode::success) {
        EXPECT_TRUE(said.parsed.avps.empty()) << "a failure brings nothing";
        return;
    }
    // In the row's order: what comes is in the row, and what must come came.
    const auto& row = row_of(wanted.command);
    for (auto& avp : said.parsed.avps)
        EXPECT_TRUE(std::ranges::any_of(row.out, [&](auto& param) { return avp.is(param.attribute); }))
            << avp.type;
    for (auto attribute : ask.answers)
        EXPECT_NE(said.parsed.find(attribute), nullptr) << row_of(attribute).name;
    if (ask.answers.empty()) {
        EXPECT_TRUE(said.parsed.avps.empty());
    }
}

TEST(CaenDeviceCommands, WhatPublicProgramsSendWhenTheyStartSucceeds) {
    Bench bench(Given{{"model", "R3100C"}});
    for (std::uint16_t code : {std::uint16_t{0xB8}, std::uint16_t{0xA5}}) {
        EXPECT_EQ(bench.ask(request(code)).result(), ResultCode::success) << code;
        EXPECT_EQ(bench.ask(request(code, {source()})).result(), ResultCode::unsupported);
        Bench old(Given{{"model", "A528B"}});
        EXPECT_EQ(old.ask(request(code)).result(), ResultCode::invalid_function);
    }
    for (unsigned which : {0u, 1u})
        bench.sets(Command::add_read_point_to_source, {source(which), point(which)});
    for (std::uint32_t power : {1u, 316u})
        bench.sets(Command::set_power, {number(Attribute::power_set, power)});
    EXPECT_EQ(bench.result(Command::set_power, {number(Attribute::power_set, 317)}),
              ResultCode::power_out_of_range);
}

TEST(CaenDeviceCommands, APasswordWithoutBytesIsLeftOut) {
    Bench bench;
    auto read = Pairs{source()} + tag_pairs("300833B2DDD9014035050000") +
                Pairs{number(Attribute::memory_bank, 3), number(Attribute::tag_address, 0),
                      number(Attribute::length, 2)};
    EXPECT_EQ(bench.result(Command::g2_read, read + Pairs{bytes(Attribute::g2_password, "")}),
              ResultCode::success);
    EXPECT_EQ(bench.result(Command::g2_read, read + Pairs{bytes(Attribute::g2_password, "0102")}),
              ResultCode::invalid_parameter);
    EXPECT_EQ(bench.result(Command::set_power, {bytes(Attribute::power_set, "")}),
              ResultCode::invalid_parameter);
}

TEST(CaenDeviceCommands, NamesThatClientsCannotHoldAreRefused) {
    for (auto [name, most] : {std::pair{"serial", 19u}, {"firmware", 29u}}) {
        auto given = [setting = std::string(name)](std::size_t size) {
            return Settings::make(device_settings, Given{{setting, std::string(size, '7')}});
        };
        EXPECT_TRUE(given(most));
        ASSERT_FALSE(given(most + 1));
        EXPECT_NE(given(most + 1).error().text().find("characters"), std::string::npos);
    }
}

TEST(CaenDeviceCommands, EveryRowIsAnsweredWellAndIll) {
    unsigned cases = 0;
    for (auto& row : commands()) {
        SCOPED_TRACE(std::string(row.name));
        if (row.reserved || row.notification) {
            Bench bench;
            EXPECT_EQ(bench.ask(request(row.code)).result(), ResultCode::invalid_command);
            continue;
        }
        if (!row.parameters_known) {
            Bench bench;
            bool plain = row.code == 0xA5 || row.code == 0xB8;  // these mean something without parameters
            EXPECT_EQ(bench.ask(request(row.code)).result(),
                      plain ? ResultCode::success : ResultCode::unsupported);
            continue;
        }
        const auto* found = find_case(row.code);
        ASSERT_NE(found, nullptr) << "no case for this row";
        answers_as(*found, found->well);
        answers_as(*found, found->ill);
        ++cases;
    }
    EXPECT_EQ(cases, settings_cases().size() + tag_cases().size() + notify_cases().size());
}

TEST(CaenDeviceCommands, AModelThatLacksACommandSaysInvalidFunction) {
    for (auto& model : models()) {
        Bench bench(Given{{"model", std::string(model.name)}});
        for (auto& row : commands()) {
            SCOPED_TRACE(std::string(model.name) + " " + std::string(row.name));
            if (row.reserved || row.notification || has(model, row)) continue;
            const auto* found = find_case(row.code);
            auto pairs = found != nullptr ? found->well.pairs : Pairs{};
            EXPECT_EQ(bench.ask(request(row.code, pairs)).result(), ResultCode::invalid_function);
        }
    }
}

TEST(CaenDeviceCommands, EachModelHasAllItsCommands) {
    for (auto& model : models()) {
        Bench bench(Given{{"model", std::string(model.name)}});
        for (auto& row : commands()) {
            if (row.reserved || row.notification || !row.parameters_known || !has(model, row)) continue;
            // With an attribute too many: known, and refused for that.
            auto said = bench.ask(request(row.code, {number(event_type, 0)}));
            EXPECT_EQ(said.result(), ResultCode::invalid_parameter) << model.name << " " << row.name;
        }
    }
}

TEST(CaenDeviceCommands, TheSettingsKnowEveryModel) {
    std::vector<std::string_view> names;
    for (auto& model : models())
        names.push_back(model.name);
    EXPECT_TRUE(std::ranges::equal(names, model_choices));
}

// --- wrong input, by its kind ------------------------------------------------------------------------------

TEST(CaenDeviceCommands, UnknownCodesAreInvalidCommands) {
    Bench bench;
    for (std::uint16_t code : std::vector<std::uint16_t>{0x00, 0x11, 0x7777, 0xFFFD}) {
        auto said = bench.ask(request(code, {source()}));
        EXPECT_EQ(said.result(), ResultCode::invalid_command) << code;
        EXPECT_EQ(said.parsed.command, code);
    }
}

TEST(CaenDeviceCommands, AMissingAttributeIsRefused) {
    Bench bench;
    for (auto& row : commands()) {
        if (row.reserved || row.notification || !row.parameters_known) continue;
        const auto* found = find_case(row.code);
        ASSERT_NE(found, nullptr) << row.name;
        for (std::size_t i = 0; i < found->well.pairs.size(); ++i) {
            auto pairs = found->well.pairs;
            pairs.erase(pairs.begin() + static_cast<std::ptrdiff_t>(i));
            bool optional = i < row.in.size() && row.in[i].optional;
            if (optional) continue;
            EXPECT_EQ(bench.ask(request(row.code, pairs)).result(), ResultCode::invalid_parameter)
                << row.name << " without attribute " << i;
        }
    }
}

TEST(CaenDeviceCommands, ADoubledAttributeIsRefused) {
    Bench bench;
    for (auto& row : commands()) {
        const auto* found = find_case(row.code);
        if (found == nullptr) continue;
        for (std::size_t i = 0; i < found->well.pairs.size(); ++i) {
            auto pairs = found->well.pairs;
            pairs.push_back(pairs[i]);
            EXPECT_EQ(bench.ask(request(row.code, pairs)).result(), ResultCode::invalid_parameter)
                << row.name << " with attribute " << i << " twice";
        }
    }
}

TEST(CaenDeviceCommands, AValueOfAnotherSizeIsRefused) {
    Bench bench;
    EXPECT_EQ(bench.result(Command::set_power, {hex("00000008009603E8")}), ResultCode::invalid_parameter);
    EXPECT_EQ(bench.result(Command::g2_set_q, {hex("0000000A007500000003")}), ResultCode::invalid_parameter);
    EXPECT_EQ(bench.result(Command::check_read_point_status, {text(read_point_name, "Antenna0")}),
              ResultCode::invalid_parameter);
    EXPECT_EQ(bench.result(Command::raw_read_ids, {text(source_name, std::string(30, 'S'))}),
              ResultCode::invalid_parameter);
}

TEST(CaenDeviceCommands, AnAttributeOfAnotherTypeIsRefused) {
    Bench bench;
    EXPECT_EQ(bench.result(Command::set_power, {number(power_get, 1000)}), ResultCode::invalid_parameter);
    EXPECT_EQ(bench.result(Command::set_power, {hex("0000000A999900000001")}), ResultCode::invalid_parameter);
}

TEST(CaenDeviceCommands, TheOrderCountsUnlessTheSettingSaysOtherwise) {
    Pairs turned{point(0), source()};
    Bench strict;
    EXPECT_EQ(strict.result(Command::add_read_point_to_source, turned), ResultCode::invalid_parameter);
    EXPECT_EQ(strict.result(Command::check_read_point_in_source, turned), ResultCode::success);
    Bench any(Given{{"attribute_order", "any"}});
    EXPECT_EQ(any.result(Command::add_read_point_to_source, turned), ResultCode::success);
    // Attributes that a row has twice still find their places.
    auto memory = memory_of(gen2, Bank::user, 2, 4);
    std::ranges::reverse(memory);
    EXPECT_EQ(any.result(Command::g2_read, memory), ResultCode::success);
    EXPECT_EQ(any.result(Command::g2_read, Pairs(memory.begin() + 1, memory.end())),
              ResultCode::invalid_parameter);
}

TEST(CaenDeviceCommands, BrokenPairsAreRefusedAndTheLinkGoesOn) {
    Bench bench;
    auto broken = request(Command::set_power, {number(power_set, 1000)});
    broken[21] = 3;  // the pair's length, below its header
    EXPECT_EQ(bench.ask(broken).result(), ResultCode::invalid_parameter);
    EXPECT_EQ(bench.result(Command::get_power), ResultCode::success);
}

TEST(CaenDeviceCommands, AMessageWithoutACommandIsAnInvalidCommand) {
    Bench bench;
    auto said = bench.ask(hex("8001000900005358000A"));
    EXPECT_EQ(said.result(), ResultCode::invalid_command);
    EXPECT_FALSE(said.parsed.command);
    EXPECT_EQ(said.parsed.header.id, 9);
}

TEST(CaenDeviceCommands, TextCountsUpToItsNul) {
    Bench bench;
    EXPECT_EQ(bench.result(Command::raw_read_ids, {hex("0000000E00FB536F757263655F30")}), ResultCode::success)
        << "without a NUL";
    EXPECT_EQ(bench.result(Command::raw_read_ids, {hex("0000001100FB536F757263655F30005A5A")}),
              ResultCode::success)
        << "and more behind it";
}

}  // namespace gantry::caen::device_test
