#pragma once
#include <optional>

#include "base/bytes.hpp"

namespace gantry {

// A frame's fingerprint: two independent 64-bit lanes and the length, so that two different frames are never
// taken for one by accident. A reader that builds a collision on purpose only hides its own reads.
struct Digest {
    std::uint64_t a = 0, b = 0;
    std::uint32_t size = 0;
    static Digest of(ByteView frame);
    Bytes mark() const;  // as Report::mark keeps it
    static std::optional<Digest> from_mark(ByteView mark);
    friend bool operator==(const Digest&, const Digest&) = default;
};

}  // namespace gantry
