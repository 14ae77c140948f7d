#include "epc/epc.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cstring>
#include <vector>

#include <fmt/format.h>

#include "base/text.hpp"
#include "epc/bits.hpp"
#include "epc/scheme.hpp"

namespace gantry::epc {

namespace {

constexpr auto powers_of_ten = [] {
    std::array<std::uint64_t, 20> powers{};
    std::uint64_t power = 1;
    for (auto& each : powers) {
        each = power;
        power *= 10;
    }
    return powers;
}();

// The numbers of a keyed scheme: what the bits, the URIs and the element string all say.
struct Numbers {
    unsigned filter = 0, partition = 0;
    std::uint64_t prefix = 0, reference = 0, serial = 0;

    unsigned prefix_digits() const { return most_prefix_digits - partition; }
    unsigned reference_digits(const Keyed& keyed) const { return partition + keyed.reference_extra; }
};

// Longest text: a URI of the longest names with 12 + 6 + 20 digits, or the link with 18 + 20.
constexpr std::size_t text_room = 128;

class Text {
public:
    Text& operator<<(std::string_view text) {
        std::memcpy(buffer_.data() + size_, text.data(), text.size());
        size_ += text.size();
        return *this;
    }
    Text& operator<<(char c) {
        buffer_[size_++] = c;
        return *this;
    }
    Text& padded(std::uint64_t value, unsigned digits) {
        for (unsigned i = digits; i-- > 0; value /= 10)
            buffer_[size_ + i] = static_cast<char>('0' + value % 10);
        size_ += digits;
        return *this;
    }
    Text& number(std::uint64_t value) {
        unsigned digits = 1;
        while (digits < powers_of_ten.size() && value >= powers_of_ten[digits])
            ++digits;
        return padded(value, digits);
    }
    std::string_view view() const { return {buffer_.data(), size_}; }
    std::string string() const { return std::string(view()); }

private:
    std::size_t size_ = 0;
    std::array<char, text_room> buffer_;  // not cleared: it is on the way of every tag
};

// GS1 General Specifications 7.9: weights 3, 1, 3, … from the right; a sum that is a multiple of ten gives 0,
// never 10.
char check_digit(std::string_view digits) {
    unsigned sum = 0, weight = 3;
    for (std::size_t i = digits.size(); i-- > 0; weight = 4 - weight)
        sum += static_cast<unsigned>(digits[i] - '0') * weight;
    return static_cast<char>('0' + (10 - sum % 10) % 10);
}

Epc describe(const Scheme& scheme, const Numbers& n) {
    const Keyed& keyed = *scheme.keyed;
    bool has_serial = keyed.serial_bits > 0;
    Text prefix, reference, serial, body, key;
    prefix.padded(n.prefix, n.prefix_digits());
    reference.padded(n.reference, n.reference_digits(keyed));
    body << prefix.view() << '.' << reference.view();  // what both URIs end in
    if (has_serial) {
        serial.number(n.serial);
        body << '.' << serial.view();
    }
    key << reference.view().front() << prefix.view() << reference.view().substr(1);
    key << check_digit(key.view());

    Text uri, tag_uri, gs1, link;
    uri << "urn:epc:id:" << keyed.uri_name << ':' << body.view();
    tag_uri << "urn:epc:tag:" << scheme.name << ':' << static_cast<char>('0' + n.filter) << '.'
            << body.view();
    gs1 << '(' << keyed.key_ai << ')' << key.view();
    link << "https://id.gs1.org/" << keyed.key_ai << '/' << key.view();
    if (has_serial) {
        gs1 << '(' << keyed.serial_ai << ')' << serial.view();
        link << '/' << keyed.serial_ai << '/' << serial.view();
    }
    return {.scheme = scheme.name,
            .filter = n.filter,
            .uri = uri.string(),
            .tag_uri = tag_uri.string(),
            .gs1 = gs1.string(),
            .link = link.string(),
            .doubt = {}};
}

// A tag id that still has its PC word in front: the word's length field (its top five bits, in words) says
// exactly what follows. Such bytes can decode as a plausible SGTIN.
bool looks_like_pc_and_epc(ByteView bytes) {
    if (bytes.size() < 4 || bytes.size() % 2 != 0) return false;
    std::size_t words = bytes[0] >> 3;
    return bytes.size() == 2 + 2 * words && (bytes[0] & 0x07) == 0 && bytes[1] == 0;
}

Result<Epc> decode_keyed(const Scheme& scheme, ByteView bytes) {
    const Keyed& keyed = *scheme.keyed;
    if (bytes.size() * 8 < scheme.bits)
        return fail(fmt::format("{}: {} bits, {} are needed", scheme.title, bytes.size() * 8, scheme.bits));
    BitReader in(bytes);
    in.take(8);
    Numbers n;
    n.filter = static_cast<unsigned>(in.take(3));
    n.partition = static_cast<unsigned>(in.take(3));
    if (n.partition >= partitions) return fail(fmt::format("{}: partition 7 is invalid", scheme.title));
    n.prefix = in.take(prefix_bits[n.partition]);
    n.reference = in.take(keyed.reference_bits[n.partition]);
    n.serial = in.take(keyed.serial_bits);
    // The bit fields hold more than their digits can say (TDS 14.3.3: such bits are no EPC).
    if (n.prefix >= powers_of_ten[n.prefix_digits()])
        return fail(fmt::format("{}: {} {} does not fit into {} digits", scheme.title, keyed.prefix_name,
                                n.prefix, n.prefix_digits()));
    if (n.reference >= powers_of_ten[n.reference_digits(keyed)])
        return fail(fmt::format("{}: {} {} does not fit into {} digit{}", scheme.title, keyed.reference_name,
                                n.reference, n.reference_digits(keyed),
                                n.reference_digits(keyed) == 1 ? "" : "s"));
    if (in.take(keyed.zero_bits) != 0)
        return fail(fmt::format("{}: the last {} bits must be zero", scheme.title, keyed.zero_bits));
    auto epc = describe(scheme, n);
    if (looks_like_pc_and_epc(bytes))
        epc.doubt = fmt::format("{:02X}{:02X} looks like a PC word before an EPC of {} bits: leave it out",
                                bytes[0], bytes[1], (bytes.size() - 2) * 8);
    return epc;
}

// A decimal number written as the standard wants it; `exactly` digits, or any with no leading zero.
std::optional<std::uint64_t> parse_number(std::string_view text, std::optional<unsigned> exactly) {
    std::uint64_t value = 0;
    auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc{} || end != text.data() + text.size()) return {};
    if (exactly ? text.size() != *exactly : text.size() > 1 && text.front() == '0') return {};
    return value;
}

std::vector<std::string_view> split_at_dots(std::string_view text) {
    std::vector<std::string_view> parts;
    while (true) {
        auto dot = text.find('.');
        parts.push_back(text.substr(0, dot));
        if (dot == std::string_view::npos) return parts;
        text.remove_prefix(dot + 1);
    }
}

tl::unexpected<Error> fail_prefix_digits() {
    return fail(fmt::format("a company prefix has {} to {} digits", least_prefix_digits, most_prefix_digits));
}

Result<std::uint64_t> parse_serial(const Scheme& scheme, std::string_view text) {
    auto serial = parse_number(text, {});
    auto limit = std::uint64_t{1} << scheme.keyed->serial_bits;
    if (!serial || *serial >= limit)
        return fail(fmt::format("{}: serial \"{}\" does not fit", scheme.title, printable(text)),
                    fmt::format("it must be a number of 0 to {} with no leading zero", limit - 1));
    return *serial;
}

Bytes bits_of(const Scheme& scheme, const Numbers& n) {
    const Keyed& keyed = *scheme.keyed;
    BitWriter out;
    out.put(scheme.header, 8);
    out.put(n.filter, 3);
    out.put(n.partition, 3);
    out.put(n.prefix, prefix_bits[n.partition]);
    out.put(n.reference, keyed.reference_bits[n.partition]);
    out.put(n.serial, keyed.serial_bits);
    out.put(0, keyed.zero_bits);
    return std::move(out).take();
}

// "0614141.812345.6789": what both URIs end in.
Result<Bytes> encode_body(const Scheme& scheme, std::string_view body, unsigned filter) {
    const Keyed& keyed = *scheme.keyed;
    auto parts = split_at_dots(body);
    std::size_t expected = keyed.serial_bits > 0 ? 3 : 2;
    if (parts.size() != expected)
        return fail(fmt::format("{}: \"{}\" has {} parts between dots, {} are needed", scheme.title,
                                printable(body), parts.size(), expected));
    auto digits = parts[0].size();
    if (digits < least_prefix_digits || digits > most_prefix_digits) return fail_prefix_digits();
    Numbers n;
    n.filter = filter;
    n.partition = static_cast<unsigned>(most_prefix_digits - digits);
    auto prefix = parse_number(parts[0], n.prefix_digits());
    if (!prefix)
        return fail(
            fmt::format("{}: {} \"{}\" is no number", scheme.title, keyed.prefix_name, printable(parts[0])));
    auto reference = parse_number(parts[1], n.reference_digits(keyed));
    if (!reference)
        return fail(fmt::format("{}: {} \"{}\" must have {} digit{} with a company prefix of {}",
                                scheme.title, keyed.reference_name, printable(parts[1]),
                                n.reference_digits(keyed), n.reference_digits(keyed) == 1 ? "" : "s",
                                digits));
    n.prefix = *prefix;
    n.reference = *reference;
    if (keyed.serial_bits > 0) {
        auto serial = parse_serial(scheme, parts[2]);
        if (!serial) return tl::unexpected(serial.error());
        n.serial = *serial;
    }
    return bits_of(scheme, n);
}

tl::unexpected<Error> fail_unsupported(std::string_view name) {
    std::string known;
    for (auto& scheme : all_schemes())
        if (scheme.keyed != nullptr) known += fmt::format("{}{}", known.empty() ? "" : ", ", scheme.name);
    return fail(fmt::format("scheme \"{}\" is not encoded by this version", printable(name)),
                fmt::format("it encodes {}", known));
}

Result<Bytes> encode_tag_uri(std::string_view rest, std::optional<unsigned> filter) {
    auto colon = rest.find(':');
    auto* scheme = find_scheme(rest.substr(0, colon));
    if (scheme == nullptr || scheme->keyed == nullptr) return fail_unsupported(rest.substr(0, colon));
    auto body = colon == std::string_view::npos ? std::string_view{} : rest.substr(colon + 1);
    auto dot = body.find('.');
    auto own = parse_number(body.substr(0, dot), 1);
    if (!own || *own > 7 || dot == std::string_view::npos)
        return fail(fmt::format("{}: the filter before the first dot must be 0 to 7", scheme->title));
    if (filter && *filter != *own)
        return fail(fmt::format("the tag URI says filter {}, but filter {} was asked for", *own, *filter));
    return encode_body(*scheme, body.substr(dot + 1), static_cast<unsigned>(*own));
}

Result<Bytes> encode_id_uri(std::string_view rest, unsigned filter) {
    auto colon = rest.find(':');
    auto* scheme = find_uri_name(rest.substr(0, colon));
    if (scheme == nullptr) return fail_unsupported(rest.substr(0, colon));
    return encode_body(*scheme, colon == std::string_view::npos ? std::string_view{} : rest.substr(colon + 1),
                       filter);
}

// "(21)6789" at the front of `text`: its AI and value, removed.
struct Element {
    std::string_view ai, value;
};
std::optional<Element> take_element(std::string_view& text) {
    auto close = text.find(')');
    if (!text.starts_with('(') || close == std::string_view::npos) return {};
    Element element;
    element.ai = text.substr(1, close - 1);
    text.remove_prefix(close + 1);
    element.value = text.substr(0, text.find('('));
    text.remove_prefix(element.value.size());
    return element;
}

Result<Bytes> encode_gs1(std::string_view text, unsigned filter, std::optional<unsigned> prefix_digits) {
    auto key = take_element(text);
    auto* scheme = key ? find_key_ai(key->ai) : nullptr;
    if (scheme == nullptr)
        return fail(fmt::format("({}) is no key that this version encodes", key ? printable(key->ai) : "?"),
                    "write (01)…(21)… or (00)…");
    const Keyed& keyed = *scheme->keyed;
    auto digits = key->value;
    if (!parse_number(digits, keyed.key_digits()))
        return fail(fmt::format("({}) must have {} digits, not \"{}\"", key->ai, keyed.key_digits(),
                                printable(digits)));
    auto check = check_digit(digits.substr(0, digits.size() - 1));
    if (digits.back() != check)
        return fail(fmt::format("({}){}: the check digit is {}, it should be {}", key->ai, digits,
                                digits.back(), check));
    if (!prefix_digits)
        return fail("an element string does not say how long its company prefix is",
                    "give the number of digits of the company prefix, 6 to 12");
    if (*prefix_digits < least_prefix_digits || *prefix_digits > most_prefix_digits)
        return fail_prefix_digits();

    Numbers n;
    n.filter = filter;
    n.partition = most_prefix_digits - *prefix_digits;
    n.prefix = parse_number(digits.substr(1, *prefix_digits), *prefix_digits).value_or(0);
    auto rest = digits.substr(1 + *prefix_digits, n.reference_digits(keyed) - 1);
    n.reference = static_cast<std::uint64_t>(digits.front() - '0') * powers_of_ten[rest.size()];
    if (!rest.empty()) n.reference += parse_number(rest, static_cast<unsigned>(rest.size())).value_or(0);
    if (keyed.serial_bits > 0) {
        auto serial_text = take_element(text);
        if (!serial_text || serial_text->ai != keyed.serial_ai)
            return fail(fmt::format("({}) must follow ({}): {} is one thing, not a kind of thing",
                                    keyed.serial_ai, key->ai, scheme->title));
        auto serial = parse_serial(*scheme, serial_text->value);
        if (!serial) return tl::unexpected(serial.error());
        n.serial = *serial;
    }
    if (!text.empty()) return fail(fmt::format("{} has no room for \"{}\"", scheme->title, printable(text)));
    return bits_of(*scheme, n);
}

}  // namespace

Result<Epc> decode(ByteView bytes) {
    if (bytes.empty()) return fail("no bytes: the tag has no EPC");
    auto header = bytes[0];
    if (header == 0x00) return fail("unprogrammed (header 00)");
    if (header == 0xE2) return fail("looks like a TID, not an EPC (header E2)");
    auto* scheme = find_header(header);
    if (scheme == nullptr) return fail(fmt::format("header {:02X} belongs to no EPC scheme", header));
    if (scheme->keyed == nullptr) return fail(fmt::format("{}: not decoded by this version", scheme->title));
    return decode_keyed(*scheme, bytes);
}

Result<Bytes> encode(std::string_view text, std::optional<unsigned> filter,
                     std::optional<unsigned> prefix_digits) {
    static constexpr std::string_view tag = "urn:epc:tag:", id = "urn:epc:id:";
    if (filter && *filter > 7) return fail(fmt::format("filter {} is outside 0 to 7", *filter));
    if (text.starts_with(tag)) return encode_tag_uri(text.substr(tag.size()), filter);
    if (text.starts_with(id)) return encode_id_uri(text.substr(id.size()), filter.value_or(0));
    if (text.starts_with('(')) return encode_gs1(text, filter.value_or(0), prefix_digits);
    return fail(fmt::format("\"{}\" is no EPC", printable(text)),
                "write urn:epc:tag:…, urn:epc:id:… or an element string (01)…(21)…");
}

}  // namespace gantry::epc
