#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

namespace gantry::epc {

// The tables of the GS1 Tag Data Standard 2.3 (section 14). A scheme that is a header, a filter, a partition,
// a company prefix, a reference and at most one number is one row; it needs no code of its own.

inline constexpr unsigned partitions = 7;  // table 14-2 and its like: 0 to 6; 7 is invalid
inline constexpr std::array<std::uint8_t, partitions> prefix_bits = {40, 37, 34, 30, 27, 24, 20};
inline constexpr unsigned most_prefix_digits = 12;  // of partition 0; one digit less each step
inline constexpr unsigned least_prefix_digits = 6;

struct Keyed {
    std::string_view uri_name;                            // "sgtin"
    std::string_view key_ai;                              // application identifier of the key
    std::string_view serial_ai;                           // of the number after it; empty: none
    unsigned reference_extra;                             // reference digits = partition + this
    std::array<std::uint8_t, partitions> reference_bits;  // by partition
    unsigned serial_bits;                                 // 0: none
    unsigned zero_bits;                                   // at the end, must be zero
    std::string_view prefix_name, reference_name;         // for people

    // In the key the reference's first digit (indicator, extension) stands before the company prefix, and a
    // check digit ends it.
    unsigned key_digits() const { return most_prefix_digits + reference_extra + 1; }
};

struct Scheme {
    std::uint8_t header;
    std::string_view name;         // as interfaces print it: "sgtin-96"
    std::string_view title;        // as the standard writes it: "SGTIN-96"
    unsigned bits;                 // 0: variable
    const Keyed* keyed = nullptr;  // nullptr: not decoded by this version
};

std::span<const Scheme> all_schemes();
const Scheme* find_header(std::uint8_t header);
const Scheme* find_scheme(std::string_view name);        // "sgtin-96"
const Scheme* find_uri_name(std::string_view uri_name);  // "sgtin": the 96-bit scheme of that name
const Scheme* find_key_ai(std::string_view ai);          // "01"

}  // namespace gantry::epc
