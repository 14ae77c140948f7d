#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gtest/gtest.h>

#include "protocols/harting/config.hpp"
#include "protocols/harting/tables.hpp"
#include "testkit/table_page.hpp"

namespace gantry::harting::test {

namespace {

std::string size_text(const wire::FieldRow& row) {
    switch (row.type) {
        case wire::Type::list:
            return fmt::format("u{} of", row.size * 8);
        case wire::Type::sized:
            return fmt::format("u{} and bytes", row.size * 8);
        case wire::Type::version:
            return "4 bytes, a.b.c.d";
        case wire::Type::text:
        case wire::Type::bytes:
            return row.size == 0 ? "bytes" : fmt::format("{} bytes", row.size);
        default:
            return fmt::format("u{}", row.size * 8);
    }
}

// "MODE u8, CFG-DATA 14 bytes"
std::string layout_text(wire::Layout layout) {
    std::vector<std::string> fields;
    for (auto& row : layout) {
        auto text = fmt::format("`{}` {}", row.name, size_text(row));
        if (row.type == wire::Type::list) text += fmt::format(" ({})", layout_text(row.record));
        fields.push_back(std::move(text));
    }
    return fmt::format("{}", fmt::join(fields, ", "));
}
std::string shape_text(const Shape& shape) {
    return shape.opaque ? "not published: raw bytes" : layout_text(shape.layout);
}

std::string when_text(When when) {
    switch (when) {
        case When::always:
            return "";
        case When::host_mode:
            return "host mode";
        case When::buffer_mode:
            return "buffered read, notification";
    }
    return "";
}

// The commands of one section.
std::string command_table(const std::function<bool(const CommandRow&)>& wanted) {
    std::string text =
        "| code | name | request | reply | only in | meaning | source |\n|---|---|---|---|---|---|---|\n";
    for (auto& row : commands()) {
        if (!wanted(row)) continue;
        auto code = has_sub(row.control) ? fmt::format("0x{:02X} 0x{:02X}", row.control, row.sub)
                                         : fmt::format("0x{:02X}", row.control);
        text +=
            fmt::format("| {} | `{}` | {} | {} | {} | {} | {} |\n", code, row.name, shape_text(row.request),
                        shape_text(row.reply), when_text(row.when), row.note, to_text(row.confidence));
    }
    return text;
}
bool of_the_buffer(const CommandRow& row) {
    return row.when == When::buffer_mode || row.control == control_of(Command::force_notify_trigger);
}

// All fields that have something to be said of, once.
std::string field_table() {
    std::string text = "| field | of | meaning |\n|---|---|---|\n";
    std::map<std::pair<std::string_view, std::string_view>, std::vector<std::string_view>> seen;
    std::vector<std::pair<std::string_view, std::string_view>> order;
    std::function<void(wire::Layout, std::string_view)> add = [&](wire::Layout layout,
                                                                  std::string_view command) {
        for (auto& row : layout) {
            std::string_view note = row.note;
            if (!note.empty()) {
                auto& users = seen[{row.name, note}];
                if (users.empty()) order.emplace_back(row.name, note);
                if (users.empty() || users.back() != command) users.push_back(command);
            }
            add(row.record, command);
        }
    };
    for (auto& row : commands()) {
        if (!row.request.opaque) add(row.request.layout, row.name);
        if (!row.reply.opaque && &row != &row_of(Command::read_buffer)) add(row.reply.layout, row.name);
    }
    for (auto& each : order)
        text += fmt::format("| `{}` | {} | {} |\n", each.first, fmt::join(seen[each], ", "), each.second);
    return text;
}

// Of one reply: its rows as they come.
std::string record_part_table() {
    std::string text = "| field | size | when, and what |\n|---|---|---|\n";
    auto layout = row_of(Command::read_buffer).reply.layout;
    for (auto& row : layout)
        text += fmt::format("| `{}` | {} | {} |\n", row.name, size_text(row), row.note);
    text += "| record length | u16 | of each record; counts itself |\n";
    for (auto& row : layout.back().record) {
        auto size = row.type == wire::Type::list
                        ? fmt::format("{} {}", size_text(row), layout_text(row.record))
                        : size_text(row);
        text += fmt::format("| `{}` | {} | {} |\n", row.name, size, row.note);
    }
    return text;
}

std::string record_table(std::span<const RecordRow> rows) {
    std::string text = "| MODE | name | fields | notes | source |\n|---|---|---|---|---|\n";
    for (auto& row : rows) {
        std::vector<std::string> notes;
        for (auto& field : row.layout)
            if (!field.note.empty()) notes.push_back(fmt::format("`{}`: {}", field.name, field.note));
        if (!row.note.empty()) notes.emplace_back(row.note);
        text += fmt::format("| 0x{:02X} | `{}` | {} | {} | {} |\n", row.mode, row.name,
                            layout_text(row.layout), fmt::join(notes, "; "), to_text(row.confidence));
    }
    return text;
}

std::string enumeration_table(const wire::Enumeration& enumeration) {
    std::string text = fmt::format("| `{}` | name | |\n|---|---|---|\n", enumeration.name);
    for (auto& row : enumeration.rows)
        text += fmt::format("| 0x{:02X} | `{}` | {} |\n", row.value, row.name, row.note);
    return text;
}

std::string transponder_table() {
    std::string text = "| `TR-TYPE` | name | technology in events |\n|---|---|---|\n";
    for (auto& row : transponder_types.rows)
        text += fmt::format("| 0x{:02X} | `{}` | {} |\n", row.value, row.name,
                            event::to_text(technology_of(static_cast<std::uint8_t>(row.value))));
    return text;
}

std::string block_table() {
    std::string text =
        "| block | name | takes effect | factory value of the virtual reader | |\n"
        "|---|---|---|---|---|\n";
    for (auto& row : blocks()) {
        if (row.reserved) continue;
        text += fmt::format("| CFG{} | {} | {} | {} | {} |\n", row.number, row.name,
                            row.needs_reset ? "after EEPROM and reset" : "at once", to_hex(row.factory),
                            row.note);
    }
    std::vector<std::string> reserved;
    for (auto& row : blocks())
        if (row.reserved) reserved.push_back(fmt::format("{}", row.number));
    return text + fmt::format("\nReserved: {}.\n", fmt::join(reserved, ", "));
}

std::string config_table() {
    std::string text = "| parameter | place | value | meaning | source |\n|---|---|---|---|---|\n";
    for (auto& row : config_rows()) {
        std::string place = fmt::format("{}", row.byte), value;
        if (row.bits % 8 != 0 || row.bit != 0)
            place += row.bits == 1 ? fmt::format(".{}", row.bit)
                                   : fmt::format(".{}-{}", row.bit, row.bit + row.bits - 1);
        else if (row.bits > 8)
            place += fmt::format(", {} bytes", row.bits / 8);
        if (row.enumeration != nullptr) {
            std::vector<std::string_view> names;
            for (auto& each : row.enumeration->rows)
                names.push_back(each.name);
            value = fmt::format("{}", fmt::join(names, ", "));
        } else if (row.min <= row.max) {
            value = fmt::format("{} to {}", row.min, row.max);
        }
        if (!row.unit.empty()) value += fmt::format("{}{}", value.empty() ? "" : " x ", row.unit);
        if (row.secret) value += value.empty() ? "secret" : ", secret";
        text += fmt::format("| `{}` | {} | {} | {} | {} |\n", row.name, place, value, row.help,
                            to_text(row.confidence));
    }
    return text;
}

const testkit::PageTables tables = {
    {"status", [] { return enumeration_table(statuses); }},
    {"tag errors", [] { return enumeration_table(tag_errors); }},
    {"control commands",
     [] { return command_table([](auto& row) { return !has_sub(row.control) && !of_the_buffer(row); }); }},
    {"host commands", [] { return command_table([](auto& row) { return row.control == host_command; }); }},
    {"epc commands", [] { return command_table([](auto& row) { return row.control == epc_command; }); }},
    {"buffer commands", [] { return command_table(of_the_buffer); }},
    {"fields", field_table},
    {"buffer reply", record_part_table},
    {"info records", [] { return record_table(info_records()); }},
    {"diagnostic records", [] { return record_table(diagnostic_records()); }},
    {"transponder types", transponder_table},
    {"blocks", block_table},
    {"configuration", config_table},
};

}  // namespace

TEST(HartingDocs, SayWhatTheTablesSay) {
    testkit::check_table_page(GANTRY_SOURCE_DIR "/docs/protocols/harting.md", tables);
}

}  // namespace gantry::harting::test
