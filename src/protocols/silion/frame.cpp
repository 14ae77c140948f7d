#include "protocols/silion/frame.hpp"

#include <algorithm>
#include <cstring>

#include "base/text.hpp"
#include "wire/crc.hpp"
#include "wire/cursor.hpp"

namespace gantry::silion {

using wire::Direction;
using wire::Errc;

CrcBytes crc_bytes(CrcKind kind, ByteView covered) {
    std::uint16_t crc =
        kind == CrcKind::ccitt ? wire::crc16_ccitt_register(covered.subspan(1)) : wire::crc16_modbus(covered);
    auto low = static_cast<std::uint8_t>(crc & 0xFF);
    auto high = static_cast<std::uint8_t>(crc >> 8);
    return kind == CrcKind::modbus ? CrcBytes{low, high} : CrcBytes{high, low};
}

std::optional<CrcKind> CrcRule::kind_of(ByteView covered, ByteView crc) const {
    for (auto kind : {CrcKind::modbus, CrcKind::modbus_swapped, CrcKind::ccitt})
        if ((any_ || kind == kind_) && std::ranges::equal(crc_bytes(kind, covered), crc)) return kind;
    return {};
}

void CrcRule::learn(ByteView covered, ByteView crc) {
    if (!any_) return;
    if (auto kind = kind_of(covered, crc)) {
        kind_ = *kind;
        any_ = false;
    }
}

static constexpr std::uint8_t first_byte(Direction direction) {
    return direction == Direction::to_host ? 0xFF : 0xEE;
}

// Why no frame can start here, as far as the bytes that are there can tell.
struct Refusal {
    Errc why;
    std::string_view field;
    std::size_t offset;
};

// The name is the best guard there is: a reader has one. In step, another readable name is another reader,
// for the owner to judge; out of step it is no frame. Gen 2 leaves its name out of some answers, codes from
// 0x10 on.
static bool wrong_name(ByteView in, Expected expected) {
    if (expected.name.empty() || in.size() < 2) return false;
    if (in[1] == 0) return in.size() > 4 && in[4] < 0x10;
    auto name = in.subspan(std::min<std::size_t>(10, in.size()));
    name = name.first(std::min<std::size_t>(in[1], name.size()));
    bool same = in[1] == expected.name.size() && std::ranges::equal(name, expected.name.first(name.size()));
    if (same) return false;
    return !expected.in_step || !is_printable_ascii(as_text(name));
}

static std::optional<Refusal> refusal(ByteView in, Direction direction, Expected expected) {
    if (in[0] != first_byte(direction)) return Refusal{Errc::bad_value, "header", 0};
    if (in.size() > 1 && direction == Direction::to_reader && in[1] != 0)
        return Refusal{Errc::bad_length, "name length", 1};
    if (direction == Direction::to_host && wrong_name(in, expected))
        return Refusal{Errc::bad_value, "reader", 10};
    if (in.size() < 5) return {};
    auto size = static_cast<unsigned>(in[2] << 8 | in[3]);
    auto* row = find_message(in[4], direction);
    if (size > (row != nullptr ? row->max_data : max_unknown_data))
        return Refusal{Errc::bad_length, "data length", 2};
    if (row != nullptr || direction == Direction::to_reader) return {};
    // 0xFF is a common byte: an unknown command is believed only with a name that can be read (section 3).
    if (in[1] == 0) return Refusal{Errc::unknown_code, "command", 4};
    if (in.size() <= 10) return {};
    auto name = in.subspan(10, std::min<std::size_t>(in[1], in.size() - 10));
    if (!is_printable_ascii(as_text(name))) return Refusal{Errc::unknown_code, "command", 4};
    return {};
}

std::size_t find_start(ByteView in, std::size_t from, Direction direction, ByteView name) {
    while (from < in.size()) {
        auto* at = std::memchr(in.data() + from, first_byte(direction), in.size() - from);
        if (at == nullptr) break;
        from = static_cast<std::size_t>(static_cast<const std::uint8_t*>(at) - in.data());
        if (!refusal(in.subspan(from), direction, {name, false})) return from;
        ++from;
    }
    return in.size();
}

static Look wrong(ByteView in, Direction direction, Expected expected, const Refusal& refusal) {
    Look look;
    look.what = Look::What::wrong;
    look.size = find_start(in, 1, direction, expected.name);
    look.why = refusal.why;
    look.field = refusal.field;
    look.offset = refusal.offset;
    return look;
}

Look look_at(ByteView in, Direction direction, const CrcRule& crc, Expected expected) {
    Look look;
    std::size_t head = direction == Direction::to_host ? 10 : 6;
    look.size = head;
    if (in.empty()) return look;
    if (auto no = refusal(in, direction, expected)) return wrong(in, direction, expected, *no);
    if (in.size() < head) return look;
    std::size_t name = in[1];
    auto data = static_cast<std::size_t>(in[2] << 8 | in[3]);
    auto flags = in[5];
    // The name first: it may still show that this is no frame, long before all of the claimed data came.
    look.size = head + name;
    if (in.size() < look.size) return look;
    look.size += data + ((flags & flag_crc) != 0 ? 2 : 0);
    if (in.size() < look.size) return look;
    auto& frame = look.frame;
    frame.bytes = in.first(look.size);
    frame.code = in[4];
    frame.flags = flags;
    frame.row = find_message(frame.code, direction);
    if (direction == Direction::to_host)
        frame.status = static_cast<std::uint32_t>(in[6]) << 24 | static_cast<std::uint32_t>(in[7]) << 16 |
                       static_cast<std::uint32_t>(in[8]) << 8 | in[9];
    frame.name = in.subspan(head, name);
    frame.data = in.subspan(head + name, data);
    if (frame.has_crc() && !crc.accepts(frame.covered(), frame.crc()))
        return wrong(in, direction, expected, {Errc::bad_checksum, "crc", look.size - 2});
    look.what = Look::What::frame;
    return look;
}

static void append_crc(Bytes& out, std::size_t start, CrcKind crc) {
    auto bytes = crc_bytes(crc, ByteView(out).subspan(start));
    out.insert(out.end(), bytes.begin(), bytes.end());
}

void append_to_host(Bytes& out, std::uint8_t code, std::uint8_t flags, std::uint32_t status, ByteView name,
                    ByteView data, CrcKind crc) {
    auto start = out.size();
    wire::Writer writer(out);
    writer.u8(first_byte(Direction::to_host));
    writer.u8(name.size());
    writer.u16(data.size());
    writer.u8(code);
    writer.u8(flags);
    writer.u32(status);
    writer.bytes(name);
    writer.bytes(data);
    if ((flags & flag_crc) != 0) append_crc(out, start, crc);
}

void append_to_reader(Bytes& out, std::uint8_t code, std::uint8_t flags, ByteView data, CrcKind crc) {
    auto start = out.size();
    wire::Writer writer(out);
    writer.u8(first_byte(Direction::to_reader));
    writer.u8(0);
    writer.u16(data.size());
    writer.u8(code);
    writer.u8(flags);
    writer.bytes(data);
    if ((flags & flag_crc) != 0) append_crc(out, start, crc);
}

}  // namespace gantry::silion
