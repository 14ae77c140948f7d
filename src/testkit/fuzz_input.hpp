#pragma once
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <vector>

#include "base/bytes.hpp"

// What fuzz targets that take a stream of bytes start from. Needs no library: fuzzers are built without
// GTest.
namespace gantry::testkit {

inline void demand(bool holds) {
    if (!holds) std::abort();
}

struct Random {
    std::uint64_t state;
    std::uint64_t next() {
        state += 0x9E3779B97F4A7C15u;
        auto x = state;
        x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9u;
        x = (x ^ (x >> 27)) * 0x94D049BB133111EBu;
        return x ^ (x >> 31);
    }
};

// An input is a seed for the cuts and the bytes of a stream.
struct Input {
    Random random;
    ByteView bytes;
    Input(const std::uint8_t* data, std::size_t size) : random{0} {
        std::memcpy(&random.state, data, std::min<std::size_t>(size, 8));
        bytes = ByteView(data, size).subspan(std::min<std::size_t>(size, 8));
    }
    std::vector<ByteView> pieces() {
        std::vector<ByteView> pieces;
        auto most = 1 + random.next() % 64;
        for (auto rest = bytes; !rest.empty();) {
            auto size = std::min<std::size_t>(rest.size(), 1 + random.next() % most);
            pieces.push_back(rest.first(size));
            rest = rest.subspan(size);
        }
        return pieces;
    }
};

}  // namespace gantry::testkit
