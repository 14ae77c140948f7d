#pragma once
#include "protocols/silion/frame.hpp"

namespace gantry::silion {

// Cuts a byte stream into frames. Give it what arrived, take frames until there are none, then settle. A
// frame that lies whole in what was given is not copied. Frames live until the next call.
class Framer {
public:
    // What may wait in here between calls: one frame and a piece that the owner did not take.
    static constexpr std::size_t max_kept = 64 * 1024 + max_frame_size;

    Framer(wire::Direction direction, CrcRule crc) : direction_(direction), crc_(crc) {}

    void give(ByteView in) { in_ = in; }  // must live until settle()
    std::optional<Frame> next();
    void put_back() { taken_ = 0; }  // next() will return the same frame again
    void give_up();                  // after settle(): the frame that is not whole never will be
    bool settle();                   // keeps what was not taken; false: it is more than max_kept

    // The reader's name, once it is known: the surest way back into step.
    void expect_name(std::string_view name) { name_.assign(name.begin(), name.end()); }

    const CrcRule& crc() const { return crc_; }
    ByteView kept() const { return ByteView(kept_).subspan(start_); }

    // All since the beginning.
    struct Tally {
        std::uint64_t frames = 0;
        std::uint64_t frame_bytes = 0;
        std::uint64_t skipped = 0;       // bytes that belong to no frame
        std::uint64_t resyncs = 0;       // times the start of the next frame was not where it had to be
        std::uint64_t bad_checksum = 0;  // whole frames but for their CRC
        std::uint64_t bad_length = 0;    // of the resyncs: for a length that no such frame has
    };
    const Tally& tally() const { return tally_; }
    // Resynchronisations and bad CRCs of late; a good while without one forgives them.
    std::uint64_t astray() const { return astray_; }  // bytes skipped since the last good frame
    unsigned trouble() const { return trouble_; }

private:
    void drop(std::size_t size);
    void skip(const Look& look);

    static constexpr unsigned forgiven_after = 16;  // good frames

    wire::Direction direction_;
    CrcRule crc_;
    Bytes name_;
    ByteView in_;
    Bytes kept_;  // bytes before in_, from start_ on
    std::size_t start_ = 0;
    std::size_t taken_ = 0;  // size of the frame that next() returned last
    bool in_step_ = true;    // the next byte must start a frame
    std::uint64_t astray_ = 0;
    unsigned trouble_ = 0;
    unsigned good_ = 0;  // frames since the last trouble
    Tally tally_;
};

}  // namespace gantry::silion
