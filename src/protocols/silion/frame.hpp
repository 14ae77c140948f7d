#pragma once
#include <array>
#include <optional>

#include "protocols/silion/tables.hpp"

namespace gantry::silion {

// The ways a reader may compute its CRC (docs/protocols/silion.md section 4). The guide names none.
enum class CrcKind : std::uint8_t {
    modbus,          // over all bytes, low half first: gen 2
    modbus_swapped,  // the same, high half first: what gen 1 seems to do
    ccitt,           // the RF module's own: from the second byte, high half first
};
using CrcBytes = std::array<std::uint8_t, 2>;  // as on the wire
CrcBytes crc_bytes(CrcKind kind, ByteView covered);

// Which CRCs are good.
class CrcRule {
public:
    static CrcRule only(CrcKind kind) { return {kind, true, false}; }
    static CrcRule unchecked() { return {CrcKind::modbus, false, false}; }
    static CrcRule any() { return {CrcKind::modbus, true, true}; }  // until learn() fixed one

    bool accepts(ByteView covered, ByteView crc) const {
        return !check_ || kind_of(covered, crc).has_value();
    }
    void learn(ByteView covered, ByteView crc);
    CrcKind kind() const { return kind_; }  // for what we send

private:
    CrcRule(CrcKind kind, bool check, bool any) : kind_(kind), check_(check), any_(any) {}
    std::optional<CrcKind> kind_of(ByteView covered, ByteView crc) const;

    CrcKind kind_;
    bool check_;
    bool any_;
};

// A whole frame; borrowed bytes.
struct Frame {
    ByteView bytes, name, data;
    std::uint32_t status = 0;
    std::uint8_t code = 0;
    std::uint8_t flags = 0;
    const MessageRow* row = nullptr;  // nullptr: unknown code

    bool is(Code wanted) const { return code == static_cast<std::uint8_t>(wanted); }
    bool wants_answer() const { return (flags & flag_answer) != 0; }
    bool has_crc() const { return (flags & flag_crc) != 0; }
    std::size_t data_offset() const { return static_cast<std::size_t>(data.data() - bytes.data()); }
    ByteView covered() const { return has_crc() ? bytes.first(bytes.size() - 2) : bytes; }
    ByteView crc() const { return has_crc() ? bytes.last(2) : ByteView{}; }
};
inline constexpr std::size_t max_frame_size = 10 + 255 + 65535 + 2;

// What stands at the front of a stream.
struct Look {
    enum class What : std::uint8_t {
        frame,  // `size` bytes, in `frame`
        more,   // a good beginning; at least `size` bytes are needed to know more
        wrong,  // no frame starts here; the next place that may start one is `size` bytes on
    };
    What what = What::more;
    std::size_t size = 0;
    Frame frame{};
    wire::Errc why{};  // wrong: the reason, and where
    std::string_view field{};
    std::size_t offset = 0;
};

// What the stream has told so far about the frames to come.
struct Expected {
    ByteView name;        // of the reader, once it is known; empty: not known
    bool in_step = true;  // the bytes before were a good frame
};
Look look_at(ByteView in, wire::Direction direction, const CrcRule& crc, Expected expected = {});

// The next place at or after `from` where a frame may start, as far as the bytes can tell; else the end.
std::size_t find_start(ByteView in, std::size_t from, wire::Direction direction, ByteView name = {});

// Appends a frame; its CRC where `flags` has the bit. Name and data must fit their length fields.
void append_to_host(Bytes& out, std::uint8_t code, std::uint8_t flags, std::uint32_t status, ByteView name,
                    ByteView data, CrcKind crc);
void append_to_reader(Bytes& out, std::uint8_t code, std::uint8_t flags, ByteView data, CrcKind crc);

}  // namespace gantry::silion
