#pragma once
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "base/bytes.hpp"

namespace gantry::testkit {

// A row of a vectors.tsv: tab-separated id, direction, hex, meaning, origin; '#' starts a comment.
struct Vector {
    std::string id, direction, meaning, origin;
    Bytes bytes;
};
std::vector<Vector> read_vectors(std::string_view path);  // fails the test when the file cannot be read

// Calls `check` for the input whole, byte by byte, and split in two at every place.
void for_each_split(ByteView in, const std::function<void(const std::vector<ByteView>&)>& check);

// "FF 06 ..." to bytes; throws on a slip in the test.
Bytes hex(std::string_view text);

}  // namespace gantry::testkit
