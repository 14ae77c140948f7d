#pragma once
#include <optional>

#include "base/bytes.hpp"
#include "wire/error.hpp"

namespace gantry::wire {

// A cursor over borrowed bytes. The first failure sticks and later reads yield zeros, so a decoder reads
// straight down the layout and asks once, at the end. Views it returns live as long as the input.
class Reader {
public:
    explicit Reader(ByteView in, std::size_t base = 0) : in_(in), base_(base) {}

    std::uint8_t u8(std::string_view field) { return static_cast<std::uint8_t>(big_endian(1, field)); }
    std::int8_t s8(std::string_view field) { return static_cast<std::int8_t>(u8(field)); }
    std::uint16_t u16(std::string_view field) { return static_cast<std::uint16_t>(big_endian(2, field)); }
    std::uint32_t u32(std::string_view field) { return static_cast<std::uint32_t>(big_endian(4, field)); }
    std::uint64_t big_endian(std::size_t size, std::string_view field) {  // size 1 to 8
        std::uint64_t value = 0;
        for (auto byte : bytes(size, field))
            value = value << 8 | byte;
        return value;
    }
    std::uint64_t little_endian(std::size_t size, std::string_view field) {
        std::uint64_t value = 0;
        auto view = bytes(size, field);
        for (std::size_t i = view.size(); i-- > 0;)
            value = value << 8 | view[i];
        return value;
    }

    ByteView bytes(std::size_t size, std::string_view field) {
        if (fault_) return {};
        if (size > left()) {
            fail(Errc::truncated, field);
            return {};
        }
        auto out = in_.subspan(at_, size);
        at_ += size;
        return out;
    }
    ByteView rest() { return bytes(left(), "rest"); }

    std::size_t left() const { return in_.size() - at_; }
    std::size_t offset() const { return base_ + at_; }  // from the start of the frame

    void fail(Errc code, std::string_view field, std::string detail = {}) {
        if (!fault_) fault_ = Fault{code, offset(), field, std::move(detail)};
    }
    const std::optional<Fault>& fault() const { return fault_; }

private:
    ByteView in_;
    std::size_t base_;
    std::size_t at_ = 0;
    std::optional<Fault> fault_;
};

// Appends to a caller-owned buffer, so one buffer serves a whole connection.
class Writer {
public:
    explicit Writer(Bytes& out) : out_(out), start_(out.size()) {}

    void u8(std::uint64_t value) { big_endian(value, 1); }
    void u16(std::uint64_t value) { big_endian(value, 2); }
    void u32(std::uint64_t value) { big_endian(value, 4); }
    void big_endian(std::uint64_t value, std::size_t size) {
        while (size-- > 0)
            out_.push_back(static_cast<std::uint8_t>(value >> (8 * size)));
    }
    void little_endian(std::uint64_t value, std::size_t size) {
        for (std::size_t i = 0; i < size; ++i)
            out_.push_back(static_cast<std::uint8_t>(value >> (8 * i)));
    }
    void bytes(ByteView bytes) { out_.insert(out_.end(), bytes.begin(), bytes.end()); }

    // Leaves room for a length that is known only later; patch_big_endian fills it in.
    [[nodiscard]] std::size_t hole(std::size_t size) {
        auto at = out_.size();
        big_endian(0, size);
        return at;
    }
    void patch_big_endian(std::size_t at, std::uint64_t value, std::size_t size) {
        for (std::size_t i = 0; i < size; ++i)
            out_[at + i] = static_cast<std::uint8_t>(value >> (8 * (size - 1 - i)));
    }
    std::size_t written() const { return out_.size() - start_; }
    ByteView since_start() const { return ByteView(out_).subspan(start_); }

private:
    Bytes& out_;
    std::size_t start_;
};

}  // namespace gantry::wire
