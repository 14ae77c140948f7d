#include <algorithm>
#include <array>

#include <fmt/format.h>

#include "protocols/harting/shapes.hpp"

// The records of Get Reader Info and Reader Diagnostic (sections 4 and 5).
namespace gantry::harting {

using namespace shapes;
using wire::Errc;
using wire::Fault;
using wire::Value;

namespace {

constexpr std::array firmware = {number("SW-REV", 2, "major and minor"),
                                 number("D-REV", 1, "development"),
                                 number("HW-TYPE", 1),
                                 number("SW-TYPE", 1, "which reader it is: 91 is the sister of an RF-R400"),
                                 number("TR-TYPE", 2, "the kinds of tags it has drivers for"),
                                 number("RX-BUF", 2, "the longest request it takes"),
                                 number("TX-BUF", 2, "the longest reply it sends"),
                                 number("UHF-TR", 2, "this and the next three: newer firmware"),
                                 number("CLASS-GEN", 1),
                                 number("TYPE-OF-CLASS", 1),
                                 raw("RFU", 1)};
constexpr std::array hardware = {
    number("HW-INFO", 2),
    number("D-HW", 2, "digital part"),
    number("A-HW", 2, "analogue part"),
    number("FREQUENCY", 1, "0x80 HF, 0x40 UHF, 0x04 region locked, 0x02 FCC, 0x01 EU"),
    number("PORT-TYPE", 1, "0x01 RS232, 0x02 RS485, 0x04 LAN, 0x08 WLAN, 0x10 USB, 0x20 Bluetooth"),
    raw("RESERVED", 3)};
constexpr std::array permission = {number("NR-OF-PAGES", 2),
                                   raw("PERMISSION", 0, "bit 7 of the first byte: CFG0, bit 6: CFG1 ...")};
constexpr std::array lan = {number("FLAGS", 1), raw("MAC", 6),
                            number("LINK", 1, "bit 0 no autonegotiation, 1 full duplex, 2 100 Mbit/s")};
constexpr std::array ip = {number("FLAGS", 1, "bit 1: IPv4 is there"),
                           FieldRow{.name = "IPv4", .type = Type::version, .size = 4}, raw("IPv6", 16)};
constexpr std::array io = {number("INPUTS", 1, "how many"), number("OUTPUTS", 1), number("RELAYS", 1)};
constexpr std::array device = {raw("DEV-ID", 4, "the serial number"), raw("CUSTOM-LICENCE", 4),
                               raw("FW-LICENCE", 2), raw("TR-DRIVER", 2), raw("FUNCTIONS", 2)};

constexpr std::array infos = {
    RecordRow{0x00, "Firmware", firmware, Confidence::confirmed, "the last four fields rest on one source"},
    RecordRow{0x10, "Hardware", hardware, Confidence::confirmed, "the bits rest on one source"},
    RecordRow{0x40, "ReadPermission", permission, Confidence::confirmed, "which blocks can be read"},
    RecordRow{0x41, "WritePermission", permission, Confidence::confirmed, "which blocks can be written"},
    RecordRow{0x50, "Lan", lan, Confidence::confirmed, "the bits of LINK rest on one source"},
    RecordRow{0x51, "IpAddress", ip, Confidence::confirmed, "the bit of FLAGS rests on one source"},
    RecordRow{0x52, "NetMask", ip},
    RecordRow{0x53, "Gateway", ip},
    RecordRow{0x60, "InputsAndOutputs", io},
    RecordRow{0x80, "Device", device, Confidence::confirmed, "captured with two bytes more: Rest"},
};

constexpr std::array rf_status = {
    number("FLAGS-A", 1,
           "0x01 RF hardware, 0x02 noise, 0x10 wrong power, 0x20 temperature warning, 0x40 synchronisation, "
           "0x80 temperature alarm"),
    number("FLAGS-B", 1, "bit 0: impedance of antenna 1 is not 50 ohms ... bit 3: of antenna 4")};
constexpr std::array errors = {
    number("INT-ERROR-A", 1, "0x01 I/O expander, 0x02 DC out, 0x04 USB current"),
    number("INT-ERROR-B", 1,
           "0x01 and 0x02 EEPROM, 0x04 HF filter or decoder (sources differ), 0x10 parameters, 0x40 clock, "
           "0x80 ADC")};
constexpr std::array impedances = {raw("OUTPUT-1", 3, "first byte, bit 0: channel 1 is bad"),
                                   raw("OUTPUT-2", 3), raw("OUTPUT-3", 3), raw("OUTPUT-4", 3)};
constexpr std::array firmware_text = {
    FieldRow{.name = "TEXT", .type = Type::text, .size = padded_record, .note = "filled up with zeros"}};

constexpr std::array diagnostics = {
    RecordRow{0x01, "RfStatus", rf_status, Confidence::confirmed, "0x20 differs by model"},
    RecordRow{0x04, "Hardware", errors},
    RecordRow{0x05, "Impedance", impedances, Confidence::confirmed,
              "of the antenna multiplexers; some readers send the first output alone"},
    RecordRow{0x20, "FirmwareStatus", firmware_text, Confidence::single, {}},
};

template <std::size_t size>
constexpr auto modes_of(const std::array<RecordRow, size>& rows) {
    std::array<wire::EnumRow, size + 1> modes{};
    for (std::size_t i = 0; i < size; ++i)
        modes[i] = {rows[i].mode, rows[i].name};
    modes[size] = {all_records, "All"};
    return modes;
}
constexpr auto info_mode_rows = modes_of(infos);
constexpr auto diagnostic_mode_rows = modes_of(diagnostics);

constexpr std::string_view data_sets = "DATASETS", keepalive_sets = "REC-CNT";

bool all_zero(ByteView bytes) {
    return std::ranges::all_of(bytes, [](auto byte) { return byte == 0; });
}

// A list of (MODE, 30 bytes). `in` stands before the count.
void decode_padded(std::string_view name, std::span<const RecordRow> rows, const Enumeration& modes,
                   wire::Reader& in, Fields& out) {
    Value::List list;
    auto count = in.u8(name);
    if (in.left() != count * (padded_record + 1)) in.fail(Errc::bad_length, name);
    for (; count > 0 && !in.fault(); --count) {
        Fields fields;
        auto mode = in.u8("MODE");
        const auto* known = modes.find(mode);
        fields.push_back({"MODE", known != nullptr ? Value(std::string(known->name)) : Value(mode)});
        wire::Reader record(in.bytes(padded_record, "record"));
        const auto* row = find_record(rows, mode);
        decode_record(row != nullptr ? row->layout : wire::Layout{}, record, fields);
        if (fields.back().name == rest_field && all_zero(*fields.back().value.get<Bytes>()))
            fields.pop_back();
        list.emplace_back(std::move(fields));
    }
    out.push_back({std::string(name), Value(std::move(list))});
}

wire::Result<void> encode_padded(std::string_view name, std::span<const RecordRow> rows,
                                 const Enumeration& modes, const Value& value, Bytes& out) {
    const auto* list = value.get<Value::List>();
    if (list == nullptr || list->size() > 0xFF)
        return tl::unexpected(Fault{Errc::bad_value, out.size(), name, "expected a list of records"});
    out.push_back(static_cast<std::uint8_t>(list->size()));
    for (auto& item : *list) {
        const auto* fields = item.get<Fields>();
        if (fields == nullptr)
            return tl::unexpected(Fault{Errc::bad_value, out.size(), name, "expected a record"});
        auto mode_row = number("MODE", 1, {}, &modes);
        if (auto done = put(mode_row, *fields, out); !done) return done;
        const auto* row = find_record(rows, out.back());
        Fields others;
        for (auto& field : *fields)
            if (field.name != "MODE") others.push_back(field);
        auto start = out.size();
        if (auto done = encode_record(row != nullptr ? row->layout : wire::Layout{}, others, out); !done)
            return done;
        if (out.size() - start > padded_record)
            return tl::unexpected(Fault{Errc::too_big, start, name, "a record has at most 30 bytes here"});
        out.resize(start + padded_record);
    }
    return {};
}

// The first layout that has all of the fields.
wire::Result<void> encode_single(std::span<const RecordRow> rows, const Fields& fields, Bytes& out) {
    auto has_all = [&](const RecordRow& row) {
        return std::ranges::all_of(fields, [&](auto& field) {
            return field.name == rest_field ||
                   std::ranges::find(row.layout, field.name, &FieldRow::name) != row.layout.end();
        });
    };
    auto row = std::ranges::find_if(rows, has_all);
    if (row == rows.end() || fields.empty())
        return tl::unexpected(Fault{Errc::unknown_code, out.size(), "field",
                                    "no record has these fields together; the records are those of MODE"});
    return encode_record(row->layout, fields, out);
}

}  // namespace

constinit const Enumeration info_modes{"MODE", info_mode_rows};
constinit const Enumeration diagnostic_modes{"MODE", diagnostic_mode_rows};

static constexpr std::array reader_type_rows = {
    wire::EnumRow{50, "MU02"},    wire::EnumRow{54, "MRU102"},
    wire::EnumRow{55, "MRU200"},  wire::EnumRow{91, "RF-R400", "as its sister LRU1002"},
    wire::EnumRow{92, "LRU1000"}, wire::EnumRow{93, "LRU2000"},
    wire::EnumRow{94, "LRU3000"}, wire::EnumRow{95, "LRU500i"}};
constinit const wire::Enumeration reader_types{"SW-TYPE", reader_type_rows};

std::span<const RecordRow> info_records() {
    return infos;
}
std::span<const RecordRow> diagnostic_records() {
    return diagnostics;
}
const RecordRow* find_record(std::span<const RecordRow> rows, std::uint8_t mode) {
    auto row = std::ranges::find(rows, mode, &RecordRow::mode);
    return row == rows.end() ? nullptr : &*row;
}

void decode_record(wire::Layout layout, wire::Reader& in, Fields& out) {
    for (auto& row : layout) {
        if (in.fault() || in.left() == 0 || in.left() < row.size) break;
        if (row.type != Type::text) {
            wire::decode(wire::Layout(&row, 1), in, out);
            continue;
        }
        auto text = in.bytes(row.size, row.name);
        while (!text.empty() && text.back() == 0)
            text = text.first(text.size() - 1);
        out.push_back({std::string(row.name), wire::text_value(text)});
    }
    if (in.fault() || in.left() == 0) return;
    auto rest = in.rest();
    out.push_back({std::string(rest_field), Value(Bytes(rest.begin(), rest.end()))});
}

wire::Result<void> encode_record(wire::Layout layout, const Fields& fields, Bytes& out) {
    auto row = layout.begin();
    for (; row != layout.end() && wire::find(fields, row->name) != nullptr; ++row) {
        auto start = out.size();
        if (row->type != Type::text) {
            if (auto done = put(*row, fields, out); !done) return done;
            continue;
        }
        auto text = wire::as_text_bytes(*wire::find(fields, row->name));
        if (!text || text->size() > row->size)
            return tl::unexpected(Fault{Errc::bad_value, start, row->name,
                                        fmt::format("expected text of at most {} characters", row->size)});
        out.insert(out.end(), text->begin(), text->end());
        out.resize(start + row->size);
    }
    std::size_t used = static_cast<std::size_t>(row - layout.begin());
    if (const auto* rest = wire::find(fields, rest_field)) {
        auto bytes = wire::as_raw(*rest);
        if (!bytes)
            return tl::unexpected(Fault{Errc::bad_value, out.size(), rest_field, "expected hex digits"});
        out.insert(out.end(), bytes->begin(), bytes->end());
        ++used;
    }
    if (used == fields.size()) return {};
    if (row == layout.end())
        return tl::unexpected(
            Fault{Errc::unknown_code, out.size(), "field", "a field is not in this record"});
    return tl::unexpected(Fault{Errc::bad_value, out.size(), row->name,
                                "missing: only the last fields of a record may be left out"});
}

namespace shapes {

static void decode_single(std::span<const RecordRow> rows, std::uint8_t mode, wire::Reader& in, Fields& out) {
    const auto* row = find_record(rows, mode);
    if (row == nullptr)
        in.fail(Errc::unknown_code, "MODE");
    else if (in.left() == 0)
        in.fail(Errc::truncated, row->layout[0].name);
    else
        decode_record(row->layout, in, out);
}

// Without the request only the list of all records can be told from the others.
void decode_info_reply(wire::Reader& in, const Asked& asked, Fields& out) {
    if (asked.request.empty() || asked.request[0] == all_records)
        decode_padded(data_sets, infos, info_modes, in, out);
    else
        decode_single(infos, asked.request[0], in, out);
}

wire::Result<void> encode_info_reply(const Fields& fields, Bytes& out) {
    if (const auto* list = wire::find(fields, data_sets); list != nullptr && fields.size() == 1)
        return encode_padded(data_sets, infos, info_modes, *list, out);
    return encode_single(infos, fields, out);
}

// A reply that nobody asked for is a keepalive: the two bytes of the RF status, or READER-TYPE and records.
// Neither has a size that the other forms have.
void decode_diagnostic_reply(wire::Reader& in, const Asked& asked, Fields& out) {
    constexpr std::size_t head = 5, record = padded_record + 1;
    if (!asked.request.empty() && asked.request[0] != all_records)
        return decode_single(diagnostics, asked.request[0], in, out);
    if (asked.request.empty() && in.left() == 2) return decode_single(diagnostics, 0x01, in, out);
    if (asked.request.empty() && in.left() >= head && in.left() % record == head % record) {
        auto type = in.bytes(4, "READER-TYPE");
        out.push_back({"READER-TYPE", Value(Bytes(type.begin(), type.end()))});
        return decode_padded(keepalive_sets, diagnostics, diagnostic_modes, in, out);
    }
    decode_padded(data_sets, diagnostics, diagnostic_modes, in, out);
}

wire::Result<void> encode_diagnostic_reply(const Fields& fields, Bytes& out) {
    if (const auto* list = wire::find(fields, data_sets); list != nullptr && fields.size() == 1)
        return encode_padded(data_sets, diagnostics, diagnostic_modes, *list, out);
    const auto* list = wire::find(fields, keepalive_sets);
    if (list == nullptr || fields.size() != 2) return encode_single(diagnostics, fields, out);
    if (auto done = put(raw("READER-TYPE", 4), fields, out); !done) return done;
    return encode_padded(keepalive_sets, diagnostics, diagnostic_modes, *list, out);
}

}  // namespace shapes

}  // namespace gantry::harting
