#include "protocols/dagprog/plugin.hpp"

#include <set>

#include "protocols/dagprog/settings.hpp"
#include "support.hpp"

namespace gantry::dagprog::test {

TEST(DagprogPlugin, SaysWhatItIs) {
    EXPECT_EQ(plugin.name, "dagprog");
    ASSERT_EQ(plugin.schemes.size(), 1u);
    EXPECT_EQ(plugin.schemes[0].kind, LinkKind::serial);
    EXPECT_EQ(plugin.schemes[0].line, "baud=38400");
    EXPECT_FALSE(plugin.device_dials);
    EXPECT_EQ(plugin.antenna_name(1), "");
    EXPECT_EQ(plugin.parameters.size(), 5u);
    EXPECT_EQ(plugin.device_tags(device_with()), event::Technology::iso15693);
    EXPECT_EQ(plugin.device_tags(device_with({{"family", "icode1"}})), event::Technology::icode1);
}

TEST(DagprogPlugin, SettingsAreLegalAndTheSampleNamesEveryOne) {
    for (auto rows : {plugin.driver_settings, plugin.device_settings})
        for (auto& row : rows) {
            EXPECT_FALSE(row.help.empty()) << row.name;
            if (row.fallback.empty()) continue;
            Given given = {{std::string(row.name), std::string(row.fallback)}};
            EXPECT_TRUE(Settings::make(rows, given)) << row.name;
        }
    for (auto& row : plugin.driver_settings)
        EXPECT_NE(
            plugin.sample_toml.find("\n" + std::string(row.name) + " = ") != std::string_view::npos ||
                plugin.sample_toml.find("\n# " + std::string(row.name) + " = ") != std::string_view::npos,
            false)
            << row.name;
    EXPECT_EQ(crc8_choices.size(), crc8_rows().size() + 1);
    for (std::size_t i = 0; i < crc8_rows().size(); ++i)
        EXPECT_EQ(crc8_choices[i + 1], crc8_rows()[i].name);
}

TEST(DagprogPlugin, TheTableHasEachWordOnceEachWay) {
    for (auto way : {wire::Direction::to_reader, wire::Direction::to_host}) {
        std::set<std::string_view> words, names;
        for (auto& row : messages()) {
            if (row.direction != way) continue;
            EXPECT_TRUE(words.insert(row.word).second) << row.word;
            EXPECT_TRUE(names.insert(row.name).second) << row.name;
            EXPECT_LE(row.parts.size(), Line::max_parts);
            EXPECT_EQ(find_word(row.word, way), &row);
        }
    }
    for (auto& row : messages()) {
        if (row.direction != wire::Direction::to_reader || row.answer == Answer::none) continue;
        auto answers = std::ranges::any_of(messages(), [&](auto& each) {
            return each.direction == wire::Direction::to_host && each.code == row.code;
        });
        EXPECT_EQ(answers, row.answer != Answer::write) << row.name;
    }
}

}  // namespace gantry::dagprog::test
