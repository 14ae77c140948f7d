#include <fmt/format.h>
#include <gtest/gtest.h>

#include "protocols/dagprog/crc8.hpp"
#include "protocols/dagprog/tables.hpp"
#include "testkit/table_page.hpp"

namespace gantry::dagprog::test {

namespace {

std::string_view yes(bool it_does) {
    return it_does ? "yes" : "";
}

std::string parts_text(const MessageRow& row) {
    std::string text;
    for (auto& part : row.parts)
        text += fmt::format("{}`{}`", text.empty() ? "" : " ", part.name);
    return text;
}

std::string message_table(wire::Direction way) {
    std::string text = "| code | name | fields | ICODE1 | ISO 15693 | manual |\n|---|---|---|---|---|---|\n";
    for (auto& row : messages()) {
        if (row.direction != way) continue;
        auto code = row.word.empty() ? std::string("(empty)") : fmt::format("`{}`", row.word);
        if (!row.alias.empty()) code += fmt::format(", also `{}`", row.alias);
        text += fmt::format("| {} | {} | {} | {} | {} | {} |\n", code, row.name, parts_text(row),
                            yes(row.icode1), yes(row.iso15693), row.source);
    }
    return text;
}

std::string size_text(const PartRow& part) {
    switch (part.kind) {
        case Kind::decimal:
            return fmt::format("{} decimal digits", part.size);
        case Kind::hex:
            return fmt::format("{} hex digits", part.size);
        case Kind::bytes:
        case Kind::serial:
            return fmt::format("{}{} hex digits", part.shorter ? "up to " : "", part.size);
        case Kind::text:
            break;
    }
    return part.size == 0 ? "text" : fmt::format("text of {}", part.size);
}

std::string field_table() {
    std::string text = "| field | of | written | ICODE1 | ISO 15693 | |\n|---|---|---|---|---|---|\n";
    auto range = [](bool known, std::int64_t most) {
        return known && most >= 0 ? fmt::format("0 to {}", most) : std::string();
    };
    std::map<std::string_view, bool> seen;
    for (auto& row : messages())
        for (auto& part : row.parts) {
            auto key = part.name == "Data" ? row.name : part.name;
            if (std::exchange(seen[key], true)) continue;
            text += fmt::format("| `{}` | {} | {} | {} | {} | {} |\n", part.name, row.name, size_text(part),
                                range(row.icode1, part.icode1_max), range(row.iso15693, part.iso15693_max),
                                part.note);
        }
    return text;
}

std::string mode_table() {
    std::string text = "| field | value | name | |\n|---|---|---|---|\n";
    for (const auto* each : {&transmit_modes, &power_up_modes, &errors})
        for (auto& row : each->rows)
            text += fmt::format("| `{}` | {} | {} | {} |\n", each->name, row.value, row.name, row.note);
    return text;
}

std::string crc8_table() {
    std::string text =
        "| `crc8` | polynomial | start | reflected | xor | \"123456789\" | why "
        "|\n|---|---|---|---|---|---|---|\n";
    for (auto& row : crc8_rows())
        text +=
            fmt::format("| {} | {:02X} | {:02X} | {} | {:02X} | {:02X} | {} |\n", row.name, row.polynomial,
                        row.initial, yes(row.reflected), row.final_xor, row.check, row.why);
    return text;
}

const testkit::PageTables tables = {
    {"commands", [] { return message_table(wire::Direction::to_reader); }},
    {"answers", [] { return message_table(wire::Direction::to_host); }},
    {"fields", field_table},
    {"modes", mode_table},
    {"crc8", crc8_table},
};

}  // namespace

TEST(DagprogDocs, SayWhatTheTablesSay) {
    testkit::check_table_page(GANTRY_SOURCE_DIR "/docs/protocols/dagprog.md", tables);
}

}  // namespace gantry::dagprog::test
