#pragma once
#include <cstdint>
#include <string_view>

#include "base/bytes.hpp"

namespace gantry::journal {

// CRC-32C over the members of a row. SQLite has no checksum over the pages of a database file; without one a
// flipped bit would come back as a tag that nobody read. The way of counting is stored: never change it.
class Checksum {
public:
    Checksum& add(std::uint64_t number);
    Checksum& add(std::int64_t number) { return add(static_cast<std::uint64_t>(number)); }
    Checksum& add(ByteView bytes);  // and their number
    Checksum& add(std::string_view text) { return add(as_bytes(text)); }
    std::uint32_t value() const { return ~state_; }

private:
    std::uint32_t state_ = 0xFFFFFFFF;
};

}  // namespace gantry::journal
