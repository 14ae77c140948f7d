#pragma once
#include <optional>

#include "protocols/dagprog/line.hpp"

namespace gantry::dagprog {

// Cuts a stream into lines: STX starts one, CR ends it, and what makes no sense is dropped and counted
// (section 9.3). Give bytes, take lines until there are none, then settle().
class Framer {
public:
    struct Tally {
        std::uint64_t lines = 0, line_bytes = 0;  // line feeds and what was taken by hand are among the bytes
        std::uint64_t skipped = 0, resyncs = 0;   // bytes, and how often some had to be skipped
        std::uint64_t too_long = 0;
    };

    explicit Framer(wire::Direction direction) : direction_(direction) {}

    void give(ByteView bytes);
    std::optional<Line> next();  // its views live until settle() or give()
    // The front of what waits, where a line begins, for who knows a shorter way; took() is what it used.
    ByteView front() const { return astray_ ? ByteView{} : ByteView(buffer_).subspan(at_); }
    void took(std::size_t bytes, std::size_t lines);
    void settle();  // forgets what was taken
    std::size_t kept() const { return buffer_.size() - at_; }
    ByteView line_bytes() const { return ByteView(buffer_).subspan(line_at_, at_ - line_at_); }  // of next()
    const Tally& tally() const { return tally_; }

private:
    void skip(std::size_t bytes);

    wire::Direction direction_;
    Bytes buffer_;
    std::size_t at_ = 0, line_at_ = 0;
    bool astray_ = false;  // within a line that was given up
    Tally tally_;
};

}  // namespace gantry::dagprog
