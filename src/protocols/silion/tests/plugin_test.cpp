#include "protocols/silion/plugin.hpp"

#include "support.hpp"

namespace gantry::silion::test {

TEST(SilionPlugin, SaysWhatItIs) {
    EXPECT_EQ(plugin.name, "silion");
    ASSERT_EQ(plugin.schemes.size(), 2u);
    EXPECT_EQ(plugin.schemes[0].name, "silion-listen");
    EXPECT_EQ(plugin.schemes[0].kind, LinkKind::listen);
    EXPECT_EQ(plugin.schemes[1].name, "silion+serial");
    EXPECT_EQ(plugin.schemes[1].kind, LinkKind::serial);
    EXPECT_TRUE(plugin.device_dials);
    EXPECT_EQ(plugin.antenna_name(1), "Ant1");
    EXPECT_EQ(plugin.antenna_name(0xFFFF), "");
    EXPECT_EQ(plugin.codec().names(wire::Direction::to_reader).front(), "TagAck");
}

TEST(SilionPlugin, EverySettingHasAFallbackThatIsLegalAndAHelp) {
    for (auto rows : {plugin.driver_settings, plugin.device_settings})
        for (auto& row : rows) {
            EXPECT_FALSE(row.help.empty()) << row.name;
            if (row.fallback.empty()) continue;
            Given given = {{std::string(row.name), std::string(row.fallback)}};
            EXPECT_TRUE(Settings::make(rows, given)) << row.name;
        }
    EXPECT_FALSE(Settings::make(plugin.driver_settings, Given{{"hartbeat", "5s"}}));
}

TEST(SilionPlugin, TheSampleNamesEveryDriverSetting) {
    EXPECT_NE(plugin.sample_toml.find("address = \"silion-listen://"), std::string_view::npos);
    for (auto& row : plugin.driver_settings) {
        EXPECT_NE(plugin.sample_toml.find(std::string(row.name) + " = \"" + std::string(row.fallback) + "\""),
                  std::string_view::npos)
            << row.name;
    }
}

TEST(SilionPlugin, MakesBothEnds) {
    TestAir air;
    auto driver = plugin.make_driver({.settings = driver_with()});
    auto device = plugin.make_device({"gate-1", 1, device_with()}, air);
    device->power_on(testkit::script_start);
    link::MemoryLink link(*driver, *device);
    link.connect();
    ASSERT_FALSE(driver->signals().empty());
    EXPECT_EQ(std::get<Identified>(driver->signals()[0]).name, "gate-1");
}

}  // namespace gantry::silion::test
