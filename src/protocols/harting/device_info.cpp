#include "protocols/harting/device_info.hpp"

#include <algorithm>
#include <array>

#include "protocols/harting/device_call.hpp"
#include "wire/cursor.hpp"

namespace gantry::harting {

// --- [0x66] ------------------------------------------------------------------------------------------------

static void firmware(const ReaderState& reader, Bytes& out) {
    wire::Writer writer(out);
    writer.u16(0x0203);  // SW-REV 2.3
    writer.u8(0);        // D-REV
    writer.u8(0);        // HW-TYPE
    writer.u8(reader.sw_type);
    writer.u16(0x0010);  // TR-TYPE: as the drivers of CFG3
    writer.u16(reader.rx_buf);
    writer.u16(reader.tx_buf);
}

static void hardware(const ReaderState&, Bytes& out) {
    static constexpr std::uint8_t uhf_eu = 0x41, rs232_lan_usb = 0x15;
    wire::Writer writer(out);
    writer.u16(0x0100);  // HW-INFO
    writer.u16(0x0100);  // D-HW
    writer.u16(0x0100);  // A-HW
    writer.u8(uhf_eu);
    writer.u8(rs232_lan_usb);
    writer.big_endian(0, 3);
}

// A bit for each block: which may be read, or written, now.
static void permissions(const ReaderState& reader, Bytes& out) {
    wire::Writer writer(out);
    writer.u16(block_count);
    std::uint64_t bits = 0;
    for (std::size_t i = 0; i < block_count; ++i)
        bits = bits << 1 | (blocks()[i].reserved || is_locked(reader, i) ? 0u : 1u);
    writer.big_endian(bits, block_count / 8);
}

static void mac(const ReaderState& reader, Bytes& out) {
    static constexpr std::uint8_t full_duplex_100 = 0x06;
    wire::Writer writer(out);
    writer.u8(0);
    writer.bytes(reader.mac);
    writer.u8(full_duplex_100);
}

static void address(const ReaderState& reader, std::string_view name, Bytes& out) {
    static constexpr std::uint8_t has_ipv4 = 0x02;
    wire::Writer writer(out);
    writer.u8(has_ipv4);
    writer.bytes(reader.config.bytes(name));
    writer.bytes(Bytes(16));
}
static void ip_address(const ReaderState& reader, Bytes& out) {
    address(reader, "CFG40.IP-ADDRESS", out);
}
static void net_mask(const ReaderState& reader, Bytes& out) {
    address(reader, "CFG41.SUBNET-MASK", out);
}
static void gateway(const ReaderState& reader, Bytes& out) {
    address(reader, "CFG41.GATEWAY-ADDRESS", out);
}

static void lines(const ReaderState&, Bytes& out) {
    static constexpr std::size_t relays = 1;
    out.insert(out.end(), {input_count, output_count - relays, relays});
}

static void device(const ReaderState& reader, Bytes& out) {
    wire::Writer writer(out);
    writer.u32(0x48000000u | (reader.seed & 0xFFFFFF));  // DEV-ID
    writer.u32(0);                                       // CUSTOM-LICENCE
    writer.u16(0);                                       // FW-LICENCE
    writer.u16(0x0010);                                  // TR-DRIVER
    writer.u16(0);                                       // FUNCTIONS
}

static constexpr std::array info_table = {
    InfoRow{0x00, firmware},    InfoRow{0x10, hardware}, InfoRow{0x40, permissions},
    InfoRow{0x41, permissions}, InfoRow{0x50, mac},      InfoRow{0x51, ip_address},
    InfoRow{0x52, net_mask},    InfoRow{0x53, gateway},  InfoRow{0x60, lines},
    InfoRow{0x80, device},
};
std::span<const InfoRow> info_rows() {
    return info_table;
}

// --- [0x6E] ------------------------------------------------------------------------------------------------

static void rf_status(const ReaderState& reader, Bytes& out) {
    out.insert(out.end(), {0, reader.antenna_flags()});
}

static void hardware_status(const ReaderState& reader, Bytes& out) {
    static constexpr std::uint8_t eeprom_1 = 0x01;
    out.insert(out.end(), {0, reader.config.eeprom_failed() ? eeprom_1 : std::uint8_t{0}});
}

static void multiplexer(const ReaderState&, Bytes& out) {  // none is connected
    out.insert(out.end(), 12, 0);
}

static void firmware_status(const ReaderState&, Bytes& out) {
    Bytes text(padded_record);
    std::ranges::copy(std::string_view("OK"), text.begin());
    out.insert(out.end(), text.begin(), text.end());
}

static constexpr std::array diagnostic_table = {
    InfoRow{0x01, rf_status},
    InfoRow{0x04, hardware_status},
    InfoRow{0x05, multiplexer},
    InfoRow{0x20, firmware_status},
};
std::span<const InfoRow> diagnostic_rows() {
    return diagnostic_table;
}

// --- both --------------------------------------------------------------------------------------------------

static void append_padded(const InfoRow& row, const ReaderState& reader, Bytes& out) {
    out.push_back(row.mode);
    auto start = out.size();
    row.append(reader, out);
    out.resize(start + padded_record);
}

static Status answer_record(std::span<const InfoRow> rows, Call& call) {
    if (call.data.size() != 1) return Status::length_error;
    if (call.data[0] == all_records) {
        call.answer.push_back(static_cast<std::uint8_t>(rows.size()));
        for (auto& row : rows)
            append_padded(row, call.reader, call.answer);
        return Status::ok;
    }
    auto row = std::ranges::find(rows, call.data[0], &InfoRow::mode);
    if (row == rows.end()) return Status::parameter_range;
    row->append(call.reader, call.answer);
    return Status::ok;
}

static Status get_reader_info(Call& call) {
    return answer_record(info_table, call);
}
static Status reader_diagnostic(Call& call) {
    return answer_record(diagnostic_table, call);
}

static constexpr std::array handlers = {
    HandlerRow{Command::get_reader_info, get_reader_info},
    HandlerRow{Command::reader_diagnostic, reader_diagnostic},
};
std::span<const HandlerRow> info_handlers() {
    return handlers;
}

// --- keepalive ---------------------------------------------------------------------------------------------

Bytes keepalive_flags(const ReaderState& reader) {
    Bytes data;
    rf_status(reader, data);
    return data;
}

// READER-TYPE, then records.
Bytes keepalive_records(const ReaderState& reader) {
    Bytes data;
    wire::Writer writer(data);
    writer.u32(reader.sw_type);
    writer.u8(2);
    append_padded(diagnostic_table[0], reader, data);
    append_padded(diagnostic_table[1], reader, data);
    return data;
}

}  // namespace gantry::harting
