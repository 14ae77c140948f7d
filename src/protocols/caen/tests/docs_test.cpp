#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gtest/gtest.h>

#include "protocols/caen/params.hpp"
#include "testkit/table_page.hpp"

namespace gantry::caen::test {

namespace {

std::string kind_text(const AttributeRow& row) {
    if (row.size == 0) return "?";
    switch (row.kind) {
        case Kind::number:
            return fmt::format("u{}", row.size * 8);
        case Kind::integer:
            return fmt::format("s{}", row.size * 8);
        case Kind::real:
            return "float";
        case Kind::bytes:
            return fmt::format("bytes, at most {}", row.size);
        case Kind::text:
            return fmt::format("text, at most {}", row.size);
        case Kind::timestamp:
            return "2 x u32";
    }
    return "";
}

std::string attribute_table() {
    std::string text = "| code | name | value | legal | meaning and source |\n|---|---|---|---|---|\n";
    for (auto& row : attributes()) {
        std::string legal;
        if (row.enumeration != nullptr)
            legal = row.enumeration == &result_codes ? "section 5" : "by name";
        else if (row.min <= row.max)
            legal = fmt::format("{} to {}", row.min, row.max);
        if (!row.unit.empty()) legal += fmt::format("{}{}", legal.empty() ? "" : " ", row.unit);
        text += fmt::format("| 0x{:02X} | `{}` | {} | {} | {} |\n", row.code, row.name, kind_text(row), legal,
                            row.note);
    }
    return text;
}

std::string enumeration_table(const wire::Enumeration& enumeration) {
    std::string text = fmt::format("| `{}` | name | |\n|---|---|---|\n", enumeration.name);
    for (auto& row : enumeration.rows)
        text += fmt::format("| {} | {} | {} |\n", row.value, row.name, row.note);
    return text;
}

std::string small_enumerations() {
    std::string text = "| attribute | values |\n|---|---|\n";
    for (const auto* enumeration :
         {&event_types, &tag_types, &protocols, &read_point_states, &parities, &flow_controls, &sel_unsel_ops,
          &event_modes, &upgrade_types, &memory_banks}) {
        std::vector<std::string> values;
        for (auto& row : enumeration->rows)
            values.push_back(fmt::format("{} {}", row.value, row.name));
        text += fmt::format("| `{}` | {} |\n", enumeration->name, fmt::join(values, ", "));
    }
    return text;
}

// The models that have a command, by the sets of section 6; what is left is named.
std::string models_text(const CommandRow& row) {
    std::vector<std::string_view> have;
    std::vector<std::string_view> lack;
    for (auto& model : models())
        if (model.name != "all") (has(model, row) ? have : lack).push_back(model.name);
    if (row.reserved) return "";
    if (lack.empty()) return "every model";
    if (have.empty()) return "none";
    if (lack.size() < 8) return fmt::format("every model but {}", fmt::join(lack, " "));
    return fmt::format("{}", fmt::join(have, " "));
}

std::string command_table() {
    std::string text = "| code | name | takes | answers | models | source |\n|---|---|---|---|---|---|\n";
    for (auto& row : commands()) {
        std::string name = fmt::format("`{}`", row.name);
        if (!row.later_name.empty()) name += fmt::format(", also `{}`", row.later_name);
        auto in = row.in.empty() ? "" : params_text(row.in);
        auto out = row.out.empty() ? "" : params_text(row.out);
        if (row.out_repeats) out += ", all repeated";
        if (!row.parameters_known) in = row.reserved ? "reserved" : "not published";
        if (row.notification) in = "sent by the reader";
        text += fmt::format("| 0x{:02X} | {} | {} | {} | {} | {}{} |\n", row.code, name, in, out,
                            models_text(row), row.source, row.obsolete ? "; obsolete in rev 19" : "");
    }
    return text;
}

std::string model_table() {
    std::string text =
        "| model | manual | sources | read points | power, mW | I/O lines | LBT | notifications | network | "
        "figures |\n|---|---|---|---|---|---|---|---|---|---|\n";
    auto yes = [](bool it_has) { return it_has ? "yes" : ""; };
    for (auto& row : models())
        text +=
            fmt::format("| {} | rev {} | {} | {} | {} to {} | {} in, {} out{} | {} | {} | {} | {} |\n",
                        row.name, row.revision, row.sources, row.read_points, row.power_min_mw,
                        row.power_max_mw, row.inputs, row.outputs, row.io_directions ? "; can be turned" : "",
                        yes(row.listens_before_talking), yes(row.notifies), yes(row.network), row.note);
    return text;
}

std::string parameter_table() {
    std::string text = "| parameter | asked for with | set with | meaning |\n|---|---|---|---|\n";
    for (auto& row : parameters()) {
        if (!row.source.empty() && row.source != "Source_0") continue;
        std::string name(row.name);
        if (!row.source.empty()) name.replace(7, 1, "n");
        text += fmt::format("| `{}` | {} | {} | {} |\n", name, row_of(row.get).name,
                            row.get == row.set ? "" : row_of(row.set).name, row.help);
    }
    return text;
}

const testkit::PageTables tables = {
    {"attributes", attribute_table},
    {"enumerations", small_enumerations},
    {"bit rates", [] { return enumeration_table(bit_rates); }},
    {"config parameters", [] { return enumeration_table(config_parameters); }},
    {"regulations", [] { return enumeration_table(rf_regulations); }},
    {"result codes", [] { return enumeration_table(result_codes); }},
    {"commands", command_table},
    {"models", model_table},
    {"parameters", parameter_table},
};

}  // namespace

TEST(CaenDocs, SayWhatTheTablesSay) {
    testkit::check_table_page(GANTRY_SOURCE_DIR "/docs/protocols/caen.md", tables);
}

}  // namespace gantry::caen::test
