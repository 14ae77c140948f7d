#include "bench/tag_frame.hpp"

#include <algorithm>
#include <array>

#include "protocols/silion/frame.hpp"
#include "wire/cursor.hpp"

namespace gantry::bench {

namespace {
constexpr std::size_t head_size = 10;  // before the name
constexpr std::size_t record_size = 18;
constexpr std::uint8_t code(silion::Code code) {
    return static_cast<std::uint8_t>(code);
}
}  // namespace

event::TagId tag_of(std::uint32_t number) {
    // Company prefix 0614141, item 812345; the last four bytes lie within the serial number.
    constexpr std::array<std::uint8_t, 8> prefix = {0x30, 0x74, 0x25, 0x7B, 0xF7, 0x19, 0x4E, 0x40};
    event::TagId tag;
    tag.size = 12;
    std::ranges::copy(prefix, tag.data.begin());
    for (std::size_t i = 0; i < 4; ++i)
        tag.data[8 + i] = static_cast<std::uint8_t>(number >> (24 - 8 * i));
    return tag;
}

Bytes tag_frame(std::string_view reader, const TagFrame& what) {
    Bytes data;
    wire::Writer writer(data);
    writer.u16(what.records);
    for (std::uint16_t i = 0; i < what.records; ++i) {
        writer.u8(1);  // antenna
        writer.u8(1);  // reads
        writer.u8(static_cast<std::uint8_t>(what.rssi));
        writer.u8(5);  // Gen2
        auto tag = tag_of(what.first_tag + i);
        writer.u8(tag.size);
        writer.bytes(tag.view());
        writer.u8(0);  // no bank data
    }
    Bytes frame;
    auto flags = static_cast<std::uint8_t>(silion::flag_answer | (what.crc ? silion::flag_crc : 0));
    silion::append_to_host(frame, code(silion::Code::tags), flags, 0, as_bytes(reader), data,
                           silion::CrcKind::modbus);
    return frame;
}

void set_rssi(Bytes& frame, std::string_view reader, std::int8_t rssi) {
    for (auto at = head_size + reader.size() + 2 + 2; at < frame.size() - 2; at += record_size)
        frame[at] = static_cast<std::uint8_t>(rssi);
    auto crc = silion::crc_bytes(silion::CrcKind::modbus, ByteView(frame).first(frame.size() - 2));
    std::ranges::copy(crc, frame.end() - 2);
}

Bytes heartbeat_frame(std::string_view reader, std::uint32_t count) {
    Bytes data;
    wire::Writer writer(data);
    writer.u8(1);            // main board
    writer.u8(10);           // SLR1100
    writer.u32(0x0A000000);  // software 10.0.0.0
    writer.u8(1);            // one antenna,
    writer.u8(1);            // number 1
    writer.u32(count);
    Bytes frame;
    silion::append_to_host(frame, code(silion::Code::heartbeat), silion::flag_crc, 0, as_bytes(reader), data,
                           silion::CrcKind::modbus);
    return frame;
}

Bytes acknowledgement() {
    Bytes frame;
    silion::append_to_reader(frame, code(silion::Code::tags), silion::flag_crc, {}, silion::CrcKind::modbus);
    return frame;
}

}  // namespace gantry::bench
