#pragma once
#include <cstdint>
#include <cstring>

#include "base/bytes.hpp"

namespace gantry::epc {

// Reads bit fields most significant bit first. The caller has checked that the bits are there.
class BitReader {
public:
    explicit BitReader(ByteView in) : in_(in) {}
    std::uint64_t take(unsigned bits) {  // 0 to 64
        std::uint64_t value = 0;
        if (bits != 0 && bits <= 56 && at_ / 8 + 8 <= in_.size()) {  // whole in one load: the usual case
            std::memcpy(&value, in_.data() + at_ / 8, 8);
            value = __builtin_bswap64(value) << at_ % 8 >> (64 - bits);
            at_ += bits;
            return value;
        }
        while (bits > 0) {
            unsigned in_byte = 8 - at_ % 8;
            unsigned now = bits < in_byte ? bits : in_byte;
            auto byte = static_cast<std::uint64_t>(in_[at_ / 8]);
            value = value << now | (byte >> (in_byte - now) & ((1u << now) - 1));
            at_ += now;
            bits -= now;
        }
        return value;
    }

private:
    ByteView in_;
    unsigned at_ = 0;
};

// Writes them; what is left of the last byte is zero.
class BitWriter {
public:
    void put(std::uint64_t value, unsigned bits) {  // 0 to 64; value must fit
        for (unsigned i = bits; i-- > 0;) {
            if (at_ % 8 == 0) out_.push_back(0);
            out_.back() = static_cast<std::uint8_t>(out_.back() | (value >> i & 1) << (7 - at_ % 8));
            ++at_;
        }
    }
    Bytes take() && { return std::move(out_); }

private:
    Bytes out_;
    unsigned at_ = 0;
};

}  // namespace gantry::epc
