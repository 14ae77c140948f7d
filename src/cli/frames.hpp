#pragma once
#include <string>
#include <string_view>

#include "base/bytes.hpp"
#include "wire/message.hpp"

namespace gantry::cli {

// Cuts a stream of bytes, in any pieces, into messages, and prints each as one JSON line. Keeps no more than
// the frame that is still incomplete.
class Frames {
public:
    Frames(const wire::Codec& codec, std::string_view protocol, wire::Direction direction)
        : codec_(codec), protocol_(protocol), direction_(direction) {}

    // Appends a line for each message and each stretch that is none. With `end` no more bytes will come.
    void add(ByteView bytes, bool end, std::string& out);

    std::size_t bad_bytes() const { return bad_bytes_; }    // could not be decoded
    std::size_t bad_places() const { return bad_places_; }  // in so many error objects

private:
    std::size_t print_one(ByteView rest, bool end, std::string& out);

    const wire::Codec& codec_;
    std::string_view protocol_;
    wire::Direction direction_;
    Bytes kept_;              // the beginning of a frame
    std::size_t offset_ = 0;  // of kept_ in the stream
    std::size_t bad_bytes_ = 0, bad_places_ = 0;
};

}  // namespace gantry::cli
