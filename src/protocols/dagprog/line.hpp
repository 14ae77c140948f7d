#pragma once
#include <array>
#include <optional>
#include <string>

#include "protocols/dagprog/tables.hpp"
#include "wire/error.hpp"

namespace gantry::dagprog {

// What stands between a command's code and its values: the manual's scan leaves it open (section 3.3).
enum class Separator : std::uint8_t { tab, none, space };
std::string_view to_text(Separator separator);
std::optional<Separator> parse_separator(std::string_view text);

// How the host writes its commands.
struct Forms {
    bool stx = false;
    Separator separator = Separator::tab;
    friend bool operator==(const Forms&, const Forms&) = default;
};

// One line without its STX and CR, taken apart. The views live as long as the line.
struct Line {
    static constexpr std::size_t max_parts = 2;

    const MessageRow* row = nullptr;  // nullptr: no row has its code
    std::string_view body;
    bool has_stx = false;
    Separator separator = Separator::tab;  // as it was written, where it has parts
    std::array<std::string_view, max_parts> parts{};
    std::optional<std::string_view> trailing = {};  // what follows the last known field, after a TAB
    std::optional<wire::Fault> fault = {};          // a field that is missing or is not what its row says

    bool is(Code code) const { return row != nullptr && row->code == code && !fault; }
    std::int64_t number(std::size_t part) const;  // of a decimal or hex part; the line must have no fault
};
Line parse_line(std::string_view body, wire::Direction direction);

// Hex digits of either case; nothing when it is not `size` bytes of them.
bool parse_hex(std::string_view text, std::uint8_t* out, std::size_t size);
std::optional<std::int64_t> parse_number(const PartRow& part, std::string_view text);

// The values that a serial number may be (section 5.2): leading zeros do not count.
struct Serial {
    enum class What : std::uint8_t { number, none, no_tag, write_error };
    What what = What::none;
    std::array<std::uint8_t, 8> bytes{};  // of a number, in the order of the text
};
std::optional<Serial> parse_serial(std::string_view text);  // nothing: neither a number nor a result
std::string_view to_text(Serial::What what);                // for people; empty for a number

// Appends a line. Values are as they stand in it.
void append_line(Bytes& out, bool with_stx, std::string_view word, std::span<const std::string> values,
                 Separator separator);
// A number as its row writes it.
std::string written(const PartRow& part, std::int64_t value);

// What stands at the front of a stream.
struct Look {
    enum class What : std::uint8_t { more, line, line_feed, wrong };
    What what = What::more;
    std::size_t size = 0;        // bytes it covers, unless `more`
    std::string_view body = {};  // of a line
    bool has_stx = false;        // of a line
    wire::Errc why{};            // of what is wrong
    std::size_t offset = 0;      // of the byte that is
    bool ends_in_line = false;   // of what is wrong: no CR ended it, so what follows is the rest of it
};
Look look_at(ByteView input, wire::Direction direction);

}  // namespace gantry::dagprog
