#include "journal/checksum.hpp"

#include <array>
#include <cstring>

namespace gantry::journal {

namespace {
// Eight tables, so that eight bytes go in one step.
using Tables = std::array<std::array<std::uint32_t, 256>, 8>;

constexpr Tables make_tables() {
    Tables tables{};
    for (std::uint32_t byte = 0; byte < 256; ++byte) {
        std::uint32_t crc = byte;
        for (int bit = 0; bit < 8; ++bit)
            crc = crc >> 1 ^ ((crc & 1) != 0 ? 0x82F63B78u : 0u);
        tables[0][byte] = crc;
    }
    for (std::size_t step = 1; step < 8; ++step)
        for (std::size_t byte = 0; byte < 256; ++byte) {
            auto before = tables[step - 1][byte];
            tables[step][byte] = before >> 8 ^ tables[0][before & 0xFF];
        }
    return tables;
}
constexpr Tables tables = make_tables();

std::uint32_t eight_bytes(std::uint32_t state, std::uint64_t bytes) {
    bytes ^= state;
    std::uint32_t next = 0;
    for (std::size_t i = 0; i < 8; ++i)
        next ^= tables[7 - i][bytes >> (8 * i) & 0xFF];
    return next;
}
}  // namespace

Checksum& Checksum::add(std::uint64_t number) {
    state_ = eight_bytes(state_, number);
    return *this;
}

Checksum& Checksum::add(ByteView bytes) {
    add(std::uint64_t{bytes.size()});
    while (bytes.size() >= 8) {
        std::uint64_t chunk = 0;
        for (std::size_t i = 0; i < 8; ++i)
            chunk |= std::uint64_t{bytes[i]} << (8 * i);
        state_ = eight_bytes(state_, chunk);
        bytes = bytes.subspan(8);
    }
    for (auto byte : bytes)
        state_ = state_ >> 8 ^ tables[0][(state_ ^ byte) & 0xFF];
    return *this;
}

}  // namespace gantry::journal
