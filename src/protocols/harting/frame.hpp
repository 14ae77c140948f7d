#pragma once
#include <cstdint>
#include <optional>

#include "base/bytes.hpp"
#include "wire/cursor.hpp"
#include "wire/message.hpp"

// The frames of the protocol (section 1 of docs/protocols/harting.md). No I/O, no copies.
namespace gantry::harting {

inline constexpr std::uint8_t stx = 0x02;
inline constexpr std::uint8_t any_address = 0xFF;             // every reader takes it for its own
inline constexpr std::size_t min_request = 7, min_reply = 8;  // bytes of a frame without data
inline constexpr std::size_t max_frame = 0xFFFF;
inline constexpr std::size_t min_short_request = 5, min_short_reply = 6;

// CRC16 of the frame but for its last two bytes; sent low half first.
std::uint16_t crc_of(ByteView covered);

// A whole frame; borrowed bytes.
struct Frame {
    ByteView bytes;  // all of it
    ByteView data;   // what follows CONTROL, in a reply what follows STATUS
    std::uint8_t address = 0;
    std::uint8_t control = 0;
    std::uint8_t status = 0;  // replies
    bool is_short = false;

    std::size_t data_offset() const { return static_cast<std::size_t>(data.data() - bytes.data()); }
};

// What stands at the front of a stream.
struct Look {
    enum class What : std::uint8_t {
        frame,  // `size` bytes, in `frame`
        more,   // a good beginning; `size` bytes are needed to know more
        wrong,  // no good frame starts here
    };
    What what = What::more;
    std::size_t size = 0;
    Frame frame{};
    wire::Errc why{};     // wrong
    bool framed = false;  // wrong: only the CRC is; the frame would have had `size` bytes
};
// The advanced frame, the only one that the reader takes and sends.
Look look_at(ByteView in, wire::Direction direction);
// The short frame of older readers: for inspection only.
Look look_at_short(ByteView in, wire::Direction direction);

// Appends a frame. The data must fit (ALENGTH has 16 bits).
void append_request(Bytes& out, std::uint8_t address, std::uint8_t control, ByteView data);
void append_reply(Bytes& out, std::uint8_t address, std::uint8_t control, std::uint8_t status, ByteView data);

// Cuts a stream into good frames and throws the rest away. Bounded: keeps at most one frame and what the last
// piece brought. Frames live until the next call.
class Framer {
public:
    explicit Framer(wire::Direction direction, std::size_t longest = max_frame)
        : direction_(direction), longest_(longest) {}

    void add(ByteView bytes);
    std::optional<Frame> next();
    void put_back(const Frame& frame);  // the last one: next() will return it again
    // The beginning of a frame waits for its rest. After a pause that no sender makes within a frame call
    // drop(): on a serial line 12 ms (section 1), on TCP seconds.
    bool partial() const { return taken_ < buffer_.size(); }
    ByteView rest() const { return ByteView(buffer_).subspan(taken_); }
    void drop();
    void reset();  // a new link

    struct Tally {
        std::uint64_t frames = 0;
        std::uint64_t skipped_bytes = 0;  // belong to no good frame
        std::uint64_t resyncs = 0;        // times the next frame was not where it had to be
        std::uint64_t bad_checksum = 0;   // of the resyncs: all of a frame but for its CRC
        std::uint64_t bad_length = 0;     // of the resyncs: STX and a length that no frame has
    };
    const Tally& tally() const { return tally_; }
    std::uint64_t astray() const { return astray_; }  // bytes skipped since the last good frame

private:
    // Bytes whose CRC one call may compute while it looks for the next frame: whatever arrives, time is
    // bounded.
    static constexpr std::size_t search_budget = 1024 * 1024;

    void skip(std::size_t size);

    wire::Direction direction_;
    std::size_t longest_;
    Bytes buffer_;
    std::size_t taken_ = 0;
    bool in_step_ = true;  // the next byte must start a frame
    Tally tally_;
    std::uint64_t astray_ = 0;
};

}  // namespace gantry::harting
