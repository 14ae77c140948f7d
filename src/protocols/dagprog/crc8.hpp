#pragma once
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "base/bytes.hpp"

namespace gantry::dagprog {

// The CRC8 over the first three bytes of a block, which stands in the fourth. Nothing published says which
// one the units compute: these are the candidates, the likeliest first (docs/protocols/dagprog.md section 8).
struct Crc8Row {
    std::string_view name;
    std::uint8_t polynomial, initial;
    bool reflected;
    std::uint8_t final_xor;
    std::uint8_t check;  // of "123456789"
    std::string_view why;
};
std::span<const Crc8Row> crc8_rows();
const Crc8Row* find_crc8(std::string_view name);
std::uint8_t crc8(const Crc8Row& row, ByteView bytes);
// Is the last of the four bytes the CRC8 of the others?
bool crc8_fits(const Crc8Row& row, ByteView block);

// Narrows the candidates down with blocks that a unit wrote, also with the three bytes in reverse order.
class Crc8Finder {
public:
    static constexpr unsigned samples_to_trust = 5;  // each rules out 255 of 256

    struct Candidate {
        const Crc8Row* row = nullptr;
        bool reversed = false;
    };
    Crc8Finder();
    void sample(ByteView block);
    unsigned samples() const { return samples_; }
    const std::vector<Candidate>& left() const { return left_; }
    std::optional<Candidate> found() const;  // one is left, and there were enough samples

private:
    std::vector<Candidate> left_;
    unsigned samples_ = 0;
    std::vector<Bytes> seen_;  // equal samples teach nothing
};

}  // namespace gantry::dagprog
