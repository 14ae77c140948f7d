#include "protocols/caen/tables.hpp"

#include <map>
#include <set>

#include <gtest/gtest.h>

namespace gantry::caen::test {

static ModelSet bit(std::string_view model) {
    const auto* row = find_model(model);
    if (row == nullptr) {
        ADD_FAILURE() << "no model " << model;
        return 0;
    }
    return ModelSet{1} << row->bit;
}

TEST(CaenTables, HaveOneRowAnAttribute) {
    std::set<std::uint16_t> codes;
    std::set<std::string_view> names;
    for (auto& row : attributes()) {
        SCOPED_TRACE(row.name);
        EXPECT_TRUE(codes.insert(row.code).second);
        EXPECT_TRUE(names.insert(row.name).second);
        EXPECT_EQ(find_attribute(row.code), &row);
        EXPECT_EQ(find_attribute(row.name), &row);
        EXPECT_FALSE(row.note.empty()) << "no source";
        if (row.kind == Kind::number || row.kind == Kind::integer) {
            EXPECT_TRUE(row.size == 1 || row.size == 2 || row.size == 4) << row.size;
        }
        if (row.kind == Kind::timestamp) {
            EXPECT_EQ(row.size, 8);
        }
    }
    EXPECT_EQ(find_attribute("sourcename")->code, 0xFB);
    EXPECT_EQ(find_attribute(std::uint16_t{0x1234}), nullptr);
    EXPECT_EQ(find_attribute(std::uint16_t{0x03}), nullptr);
}

TEST(CaenTables, HaveEveryAttributeOfTheFactSheet) {
    std::set<std::uint16_t> wanted = {0x01, 0x02, 0x0E, 0x0F, 0x10, 0x11, 0x12, 0x1E, 0x1F, 0x20, 0x21, 0x22};
    for (std::uint16_t code = 0x4D; code <= 0x83; ++code)
        wanted.insert(code);
    wanted.insert(0x96);
    wanted.insert(0xFB);
    std::set<std::uint16_t> found;
    for (auto& row : attributes())
        found.insert(row.code);
    EXPECT_EQ(found, wanted);
}

TEST(CaenTables, HaveOneRowACommand) {
    std::set<std::uint16_t> codes;
    std::set<std::string_view> names;
    for (auto& row : commands()) {
        SCOPED_TRACE(row.name);
        EXPECT_TRUE(codes.insert(row.code).second);
        EXPECT_TRUE(names.insert(row.name).second);
        if (!row.later_name.empty()) {
            EXPECT_TRUE(names.insert(row.later_name).second);
        }
        EXPECT_EQ(find_command(row.code), &row);
        EXPECT_EQ(find_command(row.name), &row);
        EXPECT_FALSE(row.source.empty());
        for (auto params : {row.in, row.out})
            for (auto& param : params)
                EXPECT_NE(find_attribute(static_cast<std::uint16_t>(param.attribute)), nullptr);
        if (!row.parameters_known) {
            EXPECT_TRUE(row.in.empty() && row.out.empty());
        }
        EXPECT_EQ(row.models == 0, row.reserved) << "a command that no model has";
    }
    EXPECT_EQ(find_command("query_epc_c1g2"), &row_of(Command::g2_query));
    EXPECT_EQ(find_command("NewRawReadIDs"), &row_of(Command::inventory_tag));
    EXPECT_EQ(find_command(""), nullptr);
    EXPECT_EQ(find_command(std::uint16_t{0x1234}), nullptr);
    EXPECT_EQ(find_command(std::uint16_t{0x14}), nullptr);
}

TEST(CaenTables, HaveThe67CommandsOfTheManualAndWhatCameLater) {
    unsigned manual = 0, later = 0, reserved = 0, notifications = 0;
    for (auto& row : commands()) {
        if (row.reserved)
            ++reserved;
        else if (row.notification)
            ++notifications;
        else if (row.code <= 0xA4 && row.code != 0x13)
            ++manual;
        else
            ++later;
    }
    EXPECT_EQ(manual, 67u);
    EXPECT_EQ(later, 1u + 27u) << "InventoryTag, and section 6.1";
    EXPECT_EQ(reserved, 2u) << "0xFFFF is the third: the code that we chose for the kill message";
    EXPECT_EQ(notifications, 2u);
    EXPECT_EQ(find_command(std::uint16_t{0x71})->reserved, true);
    EXPECT_EQ(find_command(std::uint16_t{0x75})->reserved, true);
    EXPECT_EQ(find_command(std::uint16_t{0xFFFF})->notification, true);
}

TEST(CaenTables, SayWhichModelHasWhichCommand) {
    std::map<std::string_view, std::size_t> counts;
    for (auto& model : models())
        for (auto& row : commands())
            counts[model.name] += has(model, row) ? 1 : 0;
    for (auto& row : commands())
        EXPECT_EQ(has(*find_model("all"), row), !row.reserved) << row.name;
    auto models_of = [](Command command) { return row_of(command).models; };
    EXPECT_NE(models_of(Command::raw_read_ids) & bit("A828US"), 0u);
    EXPECT_EQ(models_of(Command::inventory_tag) & bit("A828US"), 0u);
    EXPECT_NE(models_of(Command::inventory_tag) & bit("A948"), 0u);
    EXPECT_EQ(models_of(Command::set_power) & bit("A828EU"), 0u);
    EXPECT_NE(models_of(Command::set_power) & bit("A946EU"), 0u);
    EXPECT_EQ(models_of(Command::get_lbt_mode) & bit("A928EU"), 0u);
    EXPECT_EQ(models_of(Command::set_io_direction) & bit("A928EU"), 0u);
    EXPECT_EQ(models_of(Command::allocate_trigger) & bit("A946EU"), 0u);
    EXPECT_EQ(models_of(Command::allocate_trigger) & bit("R4300P"), 0u);
    EXPECT_EQ(models_of(Command::get_reader_info) & bit("R1260E"), 0u);
    EXPECT_EQ(models_of(Command::rf_on_off) & bit("A941M"), 0u);
    EXPECT_EQ(models_of(Command::set_rs232) & bit("R1240IE"), 0u);
    EXPECT_NE(models_of(Command::set_rs232) & bit("R4300P"), 0u);
    EXPECT_EQ(models_of(Command::set_rf_regulation) & bit("R4300P"), 0u);
    EXPECT_NE(models_of(Command::set_date_time) & bit("A941M"), 0u);
    // Counted by hand in revision 4's column of models, the two blank cells as revision 5 fills them.
    EXPECT_EQ(counts["A928EU"],
              67u - 5u /* LBT */ - 1u /* SetLBTMode */ - 2u /* DIR */ + 1u /* InventoryTag */ + 2u);
    EXPECT_EQ(find_model("a948")->name, "A948EU");
    EXPECT_EQ(find_model("A82"), nullptr);
    EXPECT_EQ(find_model("R9999"), nullptr);
}

TEST(CaenTables, HaveOneRowAModel) {
    std::set<std::uint8_t> bits;
    std::set<std::string_view> names;
    for (auto& row : models()) {
        SCOPED_TRACE(row.name);
        EXPECT_TRUE(bits.insert(row.bit).second);
        EXPECT_TRUE(names.insert(row.name).second);
        EXPECT_LT(row.bit, 64);
        EXPECT_EQ(find_model(row.name), &row);
        EXPECT_GE(row.sources, 1);
        EXPECT_LE(row.sources, 4);
        EXPECT_LE(row.read_points, 4);
        EXPECT_LT(row.power_min_mw, row.power_max_mw);
        EXPECT_GE(row.power_default_mw, row.power_min_mw);
        EXPECT_LE(row.power_default_mw, row.power_max_mw);
        EXPECT_LE(row.inputs + row.outputs, 32);
        EXPECT_EQ(row.notifies, has(row, row_of(Command::allocate_channel)));
        EXPECT_EQ(row.io_directions, has(row, row_of(Command::set_io_direction)));
        EXPECT_EQ(row.listens_before_talking, has(row, row_of(Command::get_lbt_mode)));
    }
}

TEST(CaenTables, EnumerationsNameEachValueOnce) {
    for (const auto* enumeration :
         {&result_codes, &event_types, &tag_types, &bit_rates, &protocols, &read_point_states, &parities,
          &flow_controls, &sel_unsel_ops, &config_parameters, &event_modes, &upgrade_types, &memory_banks,
          &rf_regulations}) {
        std::set<std::int64_t> values;
        std::set<std::string_view> names;
        for (auto& row : enumeration->rows) {
            EXPECT_TRUE(values.insert(row.value).second) << enumeration->name << " " << row.value;
            EXPECT_TRUE(names.insert(row.name).second) << enumeration->name << " " << row.name;
            EXPECT_EQ(enumeration->find(row.name), &row);
        }
    }
    EXPECT_EQ(bit_rates.rows.size(), 26u);
    EXPECT_EQ(config_parameters.rows.size(), 16u);
    EXPECT_EQ(rf_regulations.rows.size(), 16u);
    EXPECT_EQ(result_codes.rows.size(), 46u);
    EXPECT_EQ(describe(202), "tag not present (202)");
    EXPECT_EQ(describe(108), "108");
    EXPECT_EQ(describe(static_cast<std::uint16_t>(ResultCode::power_out_of_range)),
              "power out of range (183)");
}

TEST(CaenTables, TagTypesAreTechnologiesBothWays) {
    for (auto type : {0, 1, 2, 3, 5})
        EXPECT_EQ(tag_type_of(technology_of(type)), type);
    EXPECT_EQ(technology_of(3), event::Technology::epc_gen2);
    for (auto type : {-1, 4, 6, 255})
        EXPECT_EQ(technology_of(type), event::Technology::unknown) << type;
    EXPECT_EQ(tag_type_of(event::Technology::unknown), -1);
    EXPECT_EQ(tag_type_of(event::Technology::iso15693), -1);
}

TEST(CaenTables, EveryParameterIsInTheAnswerAndTheRequestOfItsCommands) {
    auto among = [](std::span<const Param> params, Attribute attribute) {
        for (auto& param : params)
            if (param.attribute == attribute) return true;
        return false;
    };
    std::set<std::string_view> names;
    for (auto& row : parameters()) {
        SCOPED_TRACE(row.name);
        EXPECT_TRUE(names.insert(row.name).second);
        EXPECT_EQ(find_parameter(row.name), &row);
        EXPECT_TRUE(among(row_of(row.get).out, row.answer));
        if (row.get != row.set) {
            EXPECT_TRUE(among(row_of(row.set).in, row.argument));
        }
        EXPECT_FALSE(row.help.empty());
        EXPECT_EQ(row.source.empty(), row.config_parameter < 0);
        if (row.config_parameter >= 0) {
            EXPECT_NE(config_parameters.find(row.config_parameter), nullptr);
        }
    }
    EXPECT_EQ(names.size(), 13u + 4u * 15u);
    EXPECT_EQ(find_parameter("source_3.session")->config_parameter, 4);
    EXPECT_EQ(find_parameter("Source_4.Session"), nullptr);
}

}  // namespace gantry::caen::test
