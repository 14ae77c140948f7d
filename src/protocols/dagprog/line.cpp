#include "protocols/dagprog/line.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "base/text.hpp"

namespace gantry::dagprog {

using wire::Direction;
using wire::Errc;
using wire::Fault;

static constexpr std::array<std::string_view, 3> separator_names = {"tab", "none", "space"};

std::string_view to_text(Separator separator) {
    return separator_names[static_cast<std::size_t>(separator)];
}
std::optional<Separator> parse_separator(std::string_view text) {
    auto* found = std::ranges::find(separator_names, text);
    if (found == separator_names.end()) return {};
    return static_cast<Separator>(found - separator_names.begin());
}
static char character(Separator separator) {
    return separator == Separator::tab ? '\t' : ' ';
}

// --- values ------------------------------------------------------------------------------------------------

static int digit_of(char c) {
    if (c >= '0' && c <= '9') return c - '0';
    if (c >= 'A' && c <= 'F') return c - 'A' + 10;
    if (c >= 'a' && c <= 'f') return c - 'a' + 10;
    return -1;
}

bool parse_hex(std::string_view text, std::uint8_t* out, std::size_t size) {
    if (text.size() != 2 * size) return false;
    for (std::size_t i = 0; i < size; ++i) {
        int high = digit_of(text[2 * i]), low = digit_of(text[2 * i + 1]);
        if (high < 0 || low < 0) return false;
        out[i] = static_cast<std::uint8_t>(high << 4 | low);
    }
    return true;
}

std::optional<std::int64_t> parse_number(const PartRow& part, std::string_view text) {
    static constexpr std::size_t most_digits = 9;  // any number of digits is accepted (section 5.1)
    std::int64_t value = 0;
    if (part.kind == Kind::hex) {
        std::uint8_t byte = 0;
        if (!parse_hex(text, &byte, 1)) return {};
        return byte;
    }
    if (text.empty() || text.size() > most_digits) return {};
    for (char c : text) {
        if (c < '0' || c > '9') return {};
        value = value * 10 + (c - '0');
    }
    return value;
}

std::int64_t Line::number(std::size_t part) const {
    return parse_number(row->parts[part], parts[part]).value_or(0);
}

std::optional<Serial> parse_serial(std::string_view text) {
    Serial serial;
    auto significant = text;
    while (significant.starts_with('0'))
        significant.remove_prefix(1);
    if (text.empty()) return {};
    if (significant.empty()) return serial;
    if (significant == "1" || significant == "2") {
        serial.what = significant == "1" ? Serial::What::no_tag : Serial::What::write_error;
        return serial;
    }
    if (!parse_hex(text, serial.bytes.data(), serial.bytes.size())) return {};
    serial.what = Serial::What::number;
    return serial;
}

std::string_view to_text(Serial::What what) {
    switch (what) {
        case Serial::What::none:
            return "no valid number";
        case Serial::What::no_tag:
            return "no tag in the field";
        case Serial::What::write_error:
            return "write error";
        case Serial::What::number:
            break;
    }
    return {};
}

std::string written(const PartRow& part, std::int64_t value) {
    if (part.kind == Kind::hex) return fmt::format("{:02X}", value & 0xFF);
    return fmt::format("{:0{}}", value, part.size);
}

// --- one line ----------------------------------------------------------------------------------------------

static bool fits(const PartRow& part, std::string_view text) {
    std::array<std::uint8_t, 8> bytes{};
    switch (part.kind) {
        case Kind::decimal:
        case Kind::hex:
            return parse_number(part, text).has_value();
        case Kind::bytes:
            if (text.empty() || text.size() > part.size || (!part.shorter && text.size() != part.size))
                return false;
            return parse_hex(text, bytes.data(), text.size() / 2);
        case Kind::serial:
            return parse_serial(text).has_value();
        case Kind::text:
            return true;
    }
    return false;
}

static void check_parts(Line& line, std::size_t offset) {
    for (std::size_t i = 0; i < line.row->parts.size(); ++i) {
        auto& part = line.row->parts[i];
        if (line.parts[i].data() == nullptr) {
            line.fault = Fault{Errc::truncated, offset + line.body.size(), part.name, "the field is missing"};
            return;
        }
        if (fits(part, line.parts[i])) continue;
        auto at = offset + static_cast<std::size_t>(line.parts[i].data() - line.body.data());
        line.fault = Fault{Errc::bad_value, at, part.name,
                           fmt::format("\"{}\" is not what belongs there", printable(line.parts[i]))};
        return;
    }
}

// Values with something between them; what is left over is carried.
static void split(Line& line, std::string_view rest, char by) {
    auto count = line.row->parts.size();
    for (std::size_t i = 0; i < count; ++i) {
        bool takes_all = line.row->parts[i].kind == Kind::text;
        auto end = takes_all ? std::string_view::npos : rest.find(by);
        line.parts[i] = rest.substr(0, end);
        if (end == std::string_view::npos) return;
        rest = rest.substr(end + 1);
    }
    line.trailing = rest;
}

// Values without anything between them: each but the last has its whole size.
static void split(Line& line, std::string_view rest) {
    auto count = line.row->parts.size();
    for (std::size_t i = 0; i < count; ++i) {
        auto size = i + 1 < count ? line.row->parts[i].size : rest.size();
        if (rest.size() < size || rest.empty()) return;
        line.parts[i] = rest.substr(0, size);
        rest = rest.substr(size);
    }
}

static Line parse_command(std::string_view body) {
    Line line;
    line.body = body;
    auto tab_at = body.find('\t');
    auto head = body.substr(0, tab_at);
    if (auto* row = find_word(head, Direction::to_reader)) line.row = row;
    if (line.row == nullptr && body.size() > 2) {
        auto* row = find_word(body.substr(0, 2), Direction::to_reader);
        if (row != nullptr && row->sets()) line.row = row;
    }
    if (line.row == nullptr) return line;
    if (!line.row->sets()) {
        if (tab_at != std::string_view::npos) line.trailing = body.substr(tab_at + 1);
        return line;
    }
    auto rest = body.substr(2);
    if (rest.starts_with('\t') || rest.starts_with(' ')) {
        line.separator = rest[0] == '\t' ? Separator::tab : Separator::space;
        split(line, rest.substr(1), rest[0]);
    } else {
        line.separator = Separator::none;
        split(line, rest);
    }
    return line;
}

static Line parse_answer(std::string_view body) {
    Line line;
    line.body = body;
    auto tab_at = body.find('\t');
    line.row = find_word(body.substr(0, tab_at), Direction::to_host);
    if (line.row == nullptr || tab_at == std::string_view::npos) return line;
    auto rest = body.substr(tab_at + 1);
    if (line.row->parts.empty())
        line.trailing = rest;
    else
        split(line, rest, '\t');
    return line;
}

Line parse_line(std::string_view body, Direction direction) {
    auto line = direction == Direction::to_reader ? parse_command(body) : parse_answer(body);
    if (line.row != nullptr) check_parts(line, 0);
    return line;
}

void append_line(Bytes& out, bool with_stx, std::string_view word, std::span<const std::string> values,
                 Separator separator) {
    if (with_stx) out.push_back(byte_stx);
    out.insert(out.end(), word.begin(), word.end());
    for (auto& value : values) {
        if (separator != Separator::none) out.push_back(static_cast<std::uint8_t>(character(separator)));
        out.insert(out.end(), value.begin(), value.end());
    }
    out.push_back(byte_cr);
}

// --- a stream ----------------------------------------------------------------------------------------------

static bool may_stand_in_a_line(std::uint8_t byte) {
    return (byte >= 0x20 && byte <= 0x7E) || byte == byte_tab;
}

Look look_at(ByteView input, Direction direction) {
    Look look;
    if (input.empty()) return look;
    if (input[0] == byte_lf) return {.what = Look::What::line_feed, .size = 1};
    look.has_stx = input[0] == byte_stx;
    std::optional<std::size_t> bad;
    auto wrong = [&](std::size_t size, wire::Errc why, std::size_t offset, bool in_line) {
        look.what = Look::What::wrong;
        look.size = size;
        look.why = why;
        look.offset = offset;
        look.ends_in_line = in_line;
        return look;
    };
    auto start = look.has_stx ? std::size_t{1} : 0;
    for (auto at = start; at < input.size(); ++at) {
        auto byte = input[at];
        if (byte == byte_stx)  // a new message: this one was not finished
            return wrong(at, bad ? wire::Errc::bad_value : wire::Errc::truncated, bad.value_or(at), false);
        if (byte == byte_cr) {
            if (bad) return wrong(at + 1, wire::Errc::bad_value, *bad, false);
            look.body = as_text(input.subspan(start, at - start));
            look.size = at + 1;
            // Without STX only what begins with a known code is believed to be a line.
            if (!look.has_stx && parse_line(look.body, direction).row == nullptr &&
                direction == Direction::to_host)
                return wrong(at + 1, wire::Errc::unknown_code, 0, false);
            look.what = Look::What::line;
            return look;
        }
        if (at >= max_line) return wrong(at, wire::Errc::too_big, at, true);
        if (!bad && !may_stand_in_a_line(byte)) bad = at;
    }
    return look;
}

}  // namespace gantry::dagprog
