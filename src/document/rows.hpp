#pragma once
#include <cstdint>
#include <limits>
#include <span>
#include <string_view>

// What a section of a TOML file may hold, one row a key. The check of a file is made from these rows, and so
// may be its schema and its example.
namespace gantry::document {

struct Row {
    enum class Kind : std::uint8_t {
        name,   // text that is not empty and has no control characters
        texts,  // a list of text
        boolean,
        count,  // a whole number
        number,
        point,              // [x, y, z]
        points,             // [[x, y, z], [x, y, z]]
        duration,           // "2s"
        duration_or_never,  // "2s" or "never"
        size,               // "8GiB"
        choice,
    };
    std::string_view key;
    Kind kind;
    std::string_view fallback;     // as in the file, without quotes; empty: none
    std::string_view help;         // one line
    std::string_view sample = {};  // for the example when there is no fallback
    bool required = false;
    std::int64_t min =
        0;  // count, number, each of a point: itself; name: characters; duration: microseconds; size: bytes
    std::int64_t max = std::numeric_limits<std::int64_t>::max();
    std::span<const std::string_view> choices = {};
};

struct SectionRows {
    std::string_view path;  // "presence", "reader", "reader.antenna"
    bool repeated;          // [[reader]] and not [reader]
    std::string_view help;
    std::span<const Row> rows;
};

}  // namespace gantry::document
