#include "reader/digest.hpp"

#include <algorithm>
#include <bit>
#include <cstring>

#include "wire/cursor.hpp"

namespace gantry {

// Each step of a lane is a bijection of the lane, so frames that differ in one place never meet.
static std::uint64_t step(std::uint64_t lane, std::uint64_t word, std::uint64_t odd, int turn) {
    return std::rotl((lane ^ word) * odd, turn);
}

Digest Digest::of(ByteView frame) {
    Digest digest{0x6A09E667F3BCC908u, 0xBB67AE8584CAA73Bu, static_cast<std::uint32_t>(frame.size())};
    auto mix = [&](std::uint64_t word) {
        digest.a = step(digest.a, word, 0xD6E8FEB86659FD93u, 29);
        digest.b = step(digest.b, word, 0xA0761D6478BD642Fu, 37);
    };
    for (; !frame.empty(); frame = frame.subspan(std::min<std::size_t>(8, frame.size()))) {
        std::uint64_t word = 0;
        std::memcpy(&word, frame.data(), std::min<std::size_t>(8, frame.size()));
        mix(word);
    }
    mix(digest.size);  // the tail is padded with zeros; and the last word gets its turn through both
    mix(0);
    return digest;
}

Bytes Digest::mark() const {
    Bytes mark;
    wire::Writer writer(mark);
    writer.big_endian(a, 8);
    writer.big_endian(b, 8);
    writer.u32(size);
    return mark;
}

std::optional<Digest> Digest::from_mark(ByteView mark) {
    if (mark.size() != 20) return {};
    wire::Reader in(mark);
    Digest digest;
    digest.a = in.big_endian(8, "a");
    digest.b = in.big_endian(8, "b");
    digest.size = in.u32("size");
    return digest;
}

}  // namespace gantry
