#pragma once
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/bytes.hpp"
#include "protocols/caen/tables.hpp"
#include "wire/error.hpp"

// Messages and their attribute-value pairs (sections 2 and 3 of docs/protocols/caen.md). No I/O, no copies.
namespace gantry::caen {

inline constexpr std::size_t header_size = 10;
inline constexpr std::size_t avp_header_size = 6;

struct Header {
    std::uint16_t fixed = 0;  // 0x8001 or 0x0001
    std::uint16_t id = 0;
    std::uint32_t vendor = caen::vendor;
    std::uint16_t length = 0;  // of the whole message; 0: a framed stream follows

    bool undefined_length() const { return length == 0; }
};
// Reads ten bytes; nullopt: fewer are there. Judges nothing.
std::optional<Header> read_header(ByteView bytes);
// Could these bytes start a message that travels this way: first field, vendor, a length of 0 or at least 10?
// Fewer than ten bytes: could they still become one?
bool plausible_header(ByteView bytes, std::uint16_t fixed);
// The next place from `from` on that plausible_header believes; the end if there is none.
std::size_t find_header(ByteView bytes, std::size_t from, std::uint16_t fixed);
// One of the ten-byte texts of section 1, or the beginning of one?
bool out_of_band(ByteView bytes);
inline constexpr std::string_view upgrade_text = "@#UpGrEq#@", out_of_band_text = "$%OoBcMd%$";

// One attribute-value pair, a view into the message.
struct Avp {
    std::uint16_t reserved = 0;
    std::uint16_t type = 0;
    ByteView value;
    std::size_t offset = 0;  // of the pair, from the start of the frame

    bool is(Attribute attribute) const { return type == static_cast<std::uint16_t>(attribute); }
    // Unsigned, of the size that it has (1, 2, 4 bytes); nullopt: another size.
    std::optional<std::uint32_t> number() const;
    // Up to the first NUL.
    std::string_view text() const;
};

// Walks the pairs of a message. Stops at the first fault; `fault` says which.
class AvpReader {
public:
    // `offset` of `bytes` in the frame, for faults.
    explicit AvpReader(ByteView bytes, std::size_t offset = header_size) : bytes_(bytes), base_(offset) {}
    std::optional<Avp> next();  // nothing: the end, or a fault
    const std::optional<wire::Fault>& fault() const { return fault_; }
    std::size_t offset() const { return base_ + at_; }

private:
    ByteView bytes_;
    std::size_t base_;
    std::size_t at_ = 0;
    std::optional<wire::Fault> fault_;
};

// A whole message, taken apart once: its command, result and the pairs between. For control traffic; tag
// reports are walked (walker.hpp).
struct Parsed {
    Header header;
    std::optional<std::uint16_t> command;  // of the first pair, if that is a CommandName
    std::optional<std::uint16_t> result;   // of the last pair, if that is a ResultCode
    std::vector<Avp> avps;                 // the rest, in order
    std::optional<wire::Fault> fault;      // in the pairs; what came before it is there

    const Avp* find(Attribute attribute) const;  // the first of that type
    std::optional<std::uint32_t> number(Attribute attribute) const;
    std::optional<std::string_view> text(Attribute attribute) const;
};
Parsed parse(ByteView message);  // header and all; header.length is not looked at

// Appends a message to a buffer. The length is filled in by finish().
class Builder {
public:
    Builder(Bytes& out, std::uint16_t fixed, std::uint16_t id);
    Builder& command(std::uint16_t code);
    Builder& command(Command code) { return command(static_cast<std::uint16_t>(code)); }
    Builder& number(Attribute attribute, std::uint64_t value);  // in the size of the attribute's row
    Builder& text(Attribute attribute, std::string_view text);  // with its NUL
    Builder& bytes(Attribute attribute, ByteView value);
    Builder& time(Attribute attribute, std::int64_t micros);  // since 1970; below 0 as 0
    Builder& raw(std::uint16_t type, ByteView value);
    Builder& result(ResultCode code) {
        return number(Attribute::result_code, static_cast<std::uint64_t>(code));
    }
    // False: over 65535 bytes, and what was appended is taken back.
    [[nodiscard]] bool finish();
    void finish_undefined() {}  // leaves the length 0: the head of a framed stream

private:
    Bytes& out_;
    std::size_t start_;
};
// A pair outside a message: the tags of a framed stream.
void append_number(Bytes& out, Attribute attribute, std::uint64_t value);
void append_text(Bytes& out, Attribute attribute, std::string_view text);
void append_bytes(Bytes& out, Attribute attribute, ByteView value);
void append_time(Bytes& out, Attribute attribute, std::int64_t micros);

// Cuts a stream into messages. Bounded: holds at most one message and what the last read brought.
class Framer {
public:
    enum class What : std::uint8_t {
        message,      // a whole message with a length
        stream_head,  // a header with length 0: pairs follow, to be taken with next_avp() until stream_over()
        avp,          // a pair of a stream
        abort,        // to the reader: the raw byte 0xAB
        out_of_band,  // to the reader: one of the ten-byte texts of section 1
    };
    struct Item {
        What what;
        ByteView bytes;  // valid until the next call
    };
    // `either`: the first field may be the other direction's, too. That of notifications is not published.
    explicit Framer(std::uint16_t fixed, bool either = false) : fixed_(fixed), either_(either) {}

    void add(ByteView bytes);
    // The next thing in the stream; nothing: more bytes are needed. In a stream pairs come one by one.
    std::optional<Item> next();
    // The caller has seen the end of the framed stream: messages again.
    void stream_over() { in_stream_ = false; }
    bool in_stream() const { return in_stream_; }
    std::size_t pending() const { return buffer_.size() - taken_; }
    // What came and was not taken: the beginning of something.
    ByteView rest() const { return ByteView(buffer_).subspan(taken_); }
    // The rest but for its first `used` is skipped bytes; the next thing is a message.
    void drop(std::size_t used = 0);
    void reset();

    struct Tally {
        std::uint64_t messages = 0, skipped_bytes = 0, resyncs = 0;
    };
    const Tally& tally() const { return tally_; }

private:
    bool may_start(ByteView bytes) const;
    Item take(What what, std::size_t size);
    void skip();

    // The longest pair of a stream is a TID of 255 bytes: a longer one is lost step, not worth waiting for.
    static constexpr std::size_t most_stream_pair = 300;
    static constexpr std::uint16_t request_bit = to_reader_head ^ to_host_head;

    std::uint16_t fixed_;
    bool either_;
    Bytes buffer_;
    std::size_t taken_ = 0;
    bool in_stream_ = false, lost_ = false;
    Tally tally_;
};

}  // namespace gantry::caen
