#include "protocols/caen/plugin.hpp"

#include <algorithm>

#include "driver_support.hpp"
#include "protocols/caen/device_settings.hpp"

namespace gantry::caen::driver_test {

TEST(CaenPlugin, SaysWhatItIs) {
    EXPECT_EQ(plugin.name, "caen");
    ASSERT_EQ(plugin.schemes.size(), 2u);
    EXPECT_EQ(plugin.schemes[0].name, "caen");
    EXPECT_EQ(plugin.schemes[0].port, 1000);
    EXPECT_EQ(plugin.schemes[1].kind, LinkKind::serial);
    EXPECT_FALSE(plugin.device_dials);
    EXPECT_TRUE(plugin.notifies);
    EXPECT_EQ(plugin.antenna_name(0), "Ant0");
    EXPECT_EQ(plugin.antenna_name(0xFFFF), "");
}

TEST(CaenPlugin, ModelsAndParametersAreThoseOfTheTables) {
    ASSERT_EQ(plugin.models.size(), models().size());
    for (auto& model : models())
        EXPECT_NE(std::ranges::find(plugin.models, model.name), plugin.models.end()) << model.name;
    ASSERT_EQ(plugin.parameters.size(), parameters().size());
    for (auto& row : plugin.parameters) {
        ASSERT_NE(find_parameter(row.name), nullptr) << row.name;
        EXPECT_FALSE(row.help.empty()) << row.name;
    }
    auto protocol = std::ranges::find(plugin.parameters, "Protocol", &ParameterRow::name);
    ASSERT_NE(protocol, plugin.parameters.end());
    EXPECT_EQ(protocol->enumeration, &protocols);
    EXPECT_TRUE(protocol->writable);
    auto firmware = std::ranges::find(plugin.parameters, "Firmware", &ParameterRow::name);
    EXPECT_FALSE(firmware->writable);
}

TEST(CaenPlugin, TheChoicesOfSettingsAreTheNamesOfTheTables) {
    auto same = [](std::span<const std::string_view> choices, const wire::Enumeration& names) {
        ASSERT_EQ(choices.size(), names.rows.size() + 1);
        EXPECT_EQ(choices[0], "");
        for (auto& row : names.rows)
            EXPECT_NE(std::ranges::find(choices, row.name), choices.end()) << row.name;
    };
    same(protocol_choices, protocols);
    same(regulation_choices, rf_regulations);
    same(bit_rate_choices, bit_rates);
}

TEST(CaenPlugin, EverySettingHasAFallbackThatIsLegalAndAHelp) {
    for (auto rows : {plugin.driver_settings, plugin.device_settings})
        for (auto& row : rows) {
            EXPECT_FALSE(row.help.empty()) << row.name;
            if (row.fallback.empty()) continue;
            Given given = {{std::string(row.name), std::string(row.fallback)}};
            EXPECT_TRUE(Settings::make(rows, given)) << row.name;
        }
}

TEST(CaenPlugin, TheSampleNamesEveryDriverSetting) {
    EXPECT_NE(plugin.sample_toml.find("address = \"caen://"), std::string_view::npos);
    for (auto& row : plugin.driver_settings)
        EXPECT_NE(plugin.sample_toml.find(std::string(row.name) + " = "), std::string_view::npos) << row.name;
}

TEST(CaenPlugin, MakesADriver) {
    auto driver = plugin.make_driver(options_with());
    driver->start(testkit::script_start);
    EXPECT_EQ(to_hex(take_output(*driver)), "80010000000053580012000000080001009E");
}

TEST(CaenPlugin, WhatCannotBeUndoneIsKnownByEveryNameOfIt) {
    for (auto* name : {"G2Kill", "g2kill", "KillTag_EPC_C1G2", "G2Lock", "LockTag", "KillTag"})
        EXPECT_TRUE(plugin.is_final(name)) << name;
    for (auto* name : {"G2Write", "GetPower", ""})
        EXPECT_FALSE(plugin.is_final(name)) << name;
}

}  // namespace gantry::caen::driver_test
