#include "protocols/harting/frame.hpp"

#include <algorithm>

#include "wire/crc.hpp"

namespace gantry::harting {

using wire::Direction;
using wire::Errc;

static constinit const wire::Crc16 crc16{0x8408, 0xFFFF};

std::uint16_t crc_of(ByteView covered) {
    return crc16(covered);
}

static bool crc_fits(ByteView frame) {
    auto crc = crc_of(frame.first(frame.size() - 2));
    return frame[frame.size() - 2] == (crc & 0xFF) && frame[frame.size() - 1] == crc >> 8;
}

static Frame take_apart(ByteView bytes, std::size_t head, Direction direction, bool is_short) {
    Frame frame{.bytes = bytes, .data = {}, .is_short = is_short};
    frame.address = bytes[head];
    frame.control = bytes[head + 1];
    auto data = head + 2;
    if (direction == Direction::to_host) frame.status = bytes[data++];
    frame.data = bytes.subspan(data, bytes.size() - 2 - data);
    return frame;
}

Look look_at(ByteView in, Direction direction) {
    auto least = direction == Direction::to_host ? min_reply : min_request;
    if (in.empty()) return {.what = Look::What::more, .size = least};
    if (in[0] != stx) return {.what = Look::What::wrong, .size = 1, .why = Errc::bad_value};
    if (in.size() < 3) return {.what = Look::What::more, .size = least};
    auto length = static_cast<std::size_t>(in[1] << 8 | in[2]);
    if (length < least) return {.what = Look::What::wrong, .size = 1, .why = Errc::bad_length};
    if (in.size() < length) return {.what = Look::What::more, .size = length};
    auto bytes = in.first(length);
    if (!crc_fits(bytes))
        return {.what = Look::What::wrong, .size = length, .why = Errc::bad_checksum, .framed = true};
    return {.what = Look::What::frame, .size = length, .frame = take_apart(bytes, 3, direction, false)};
}

Look look_at_short(ByteView in, Direction direction) {
    auto least = direction == Direction::to_host ? min_short_reply : min_short_request;
    if (in.empty()) return {.what = Look::What::more, .size = least};
    std::size_t length = in[0];
    if (length < least) return {.what = Look::What::wrong, .size = 1, .why = Errc::bad_length};
    if (in.size() < length) return {.what = Look::What::more, .size = length};
    auto bytes = in.first(length);
    if (!crc_fits(bytes))
        return {.what = Look::What::wrong, .size = length, .why = Errc::bad_checksum, .framed = true};
    return {.what = Look::What::frame, .size = length, .frame = take_apart(bytes, 1, direction, true)};
}

static void append_crc(Bytes& out, std::size_t start) {
    auto crc = crc_of(ByteView(out).subspan(start));
    out.push_back(static_cast<std::uint8_t>(crc & 0xFF));
    out.push_back(static_cast<std::uint8_t>(crc >> 8));
}

void append_request(Bytes& out, std::uint8_t address, std::uint8_t control, ByteView data) {
    auto start = out.size();
    wire::Writer writer(out);
    writer.u8(stx);
    writer.u16(min_request + data.size());
    writer.u8(address);
    writer.u8(control);
    writer.bytes(data);
    append_crc(out, start);
}

void append_reply(Bytes& out, std::uint8_t address, std::uint8_t control, std::uint8_t status,
                  ByteView data) {
    auto start = out.size();
    wire::Writer writer(out);
    writer.u8(stx);
    writer.u16(min_reply + data.size());
    writer.u8(address);
    writer.u8(control);
    writer.u8(status);
    writer.bytes(data);
    append_crc(out, start);
}

void Framer::add(ByteView bytes) {
    if (taken_ > 0) {
        buffer_.erase(buffer_.begin(), buffer_.begin() + static_cast<std::ptrdiff_t>(taken_));
        taken_ = 0;
    }
    buffer_.insert(buffer_.end(), bytes.begin(), bytes.end());
}

void Framer::skip(std::size_t size) {
    taken_ += size;
    tally_.skipped_bytes += size;
    astray_ += size;
}

std::optional<Frame> Framer::next() {
    std::size_t budget = search_budget;
    auto at = taken_;  // out of step a later place is looked at while an earlier one waits for more
    while (at < buffer_.size()) {
        auto look = look_at(ByteView(buffer_).subspan(at), direction_);
        bool too_long = look.what != Look::What::wrong && look.size > longest_;
        if (look.what == Look::What::frame && !too_long) {
            if (at > taken_) skip(at - taken_);
            taken_ += look.size;
            in_step_ = true;
            astray_ = 0;
            ++tally_.frames;
            return look.frame;
        }
        if (look.what == Look::What::more && !too_long) {
            // In step it is the frame that comes. Else a good frame may stand behind what only looks like
            // one.
            if (in_step_) return {};
            ++at;
        } else {
            if (in_step_) {
                in_step_ = false;
                ++tally_.resyncs;
                if (look.framed) ++tally_.bad_checksum;
                if (too_long || look.why == Errc::bad_length) ++tally_.bad_length;
            }
            if (look.framed) budget -= std::min(budget, look.size);
            if (at == taken_) skip(1);
            ++at;
        }
        auto from = buffer_.begin() + static_cast<std::ptrdiff_t>(at);
        at = static_cast<std::size_t>(std::find(from, buffer_.end(), stx) - buffer_.begin());
        if (budget == 0) break;
    }
    if (budget == 0) {
        drop();
        return {};
    }
    // What is kept starts with the first place that may still become a frame.
    while (taken_ < buffer_.size()) {
        auto look = look_at(ByteView(buffer_).subspan(taken_), direction_);
        if (look.what == Look::What::more && look.size <= longest_) break;
        skip(1);
        auto from = buffer_.begin() + static_cast<std::ptrdiff_t>(taken_);
        skip(static_cast<std::size_t>(std::find(from, buffer_.end(), stx) - from));
    }
    return {};
}

void Framer::put_back(const Frame& frame) {
    taken_ -= frame.bytes.size();
    --tally_.frames;
}

void Framer::drop() {
    skip(buffer_.size() - taken_);
    if (in_step_) ++tally_.resyncs;
    in_step_ = true;  // after a pause the next byte starts a frame
}

void Framer::reset() {
    buffer_.clear();
    taken_ = 0;
    in_step_ = true;
    astray_ = 0;
}

}  // namespace gantry::harting
