#pragma once
#include <cstddef>
#include <string>
#include <string_view>

#include <tl/expected.hpp>

namespace gantry::wire {

enum class Errc : std::uint8_t {
    truncated,       // the bytes end inside a field
    trailing_bytes,  // bytes are left after the last field
    bad_length,      // a length field contradicts the bytes around it
    bad_value,       // a value outside its range or enumeration
    bad_checksum,
    unknown_code,  // no row of the table has this code or name
    too_big,       // over a limit of the protocol or of ours
};
std::string_view to_text(Errc code);

// Where and why a message was refused. `field` is always a string literal or a name in a table.
struct Fault {
    Errc code{};
    std::size_t offset = 0;  // from the start of the frame
    std::string_view field;
    std::string detail = {};  // more words for a person; often empty

    std::string text() const;
    friend bool operator==(const Fault&, const Fault&) = default;
};

template <class T>
using Result = tl::expected<T, Fault>;

}  // namespace gantry::wire
