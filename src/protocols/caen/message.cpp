#include "protocols/caen/message.hpp"

#include <algorithm>
#include <array>

#include <fmt/format.h>

#include "wire/cursor.hpp"

namespace gantry::caen {

using wire::Errc;
using wire::Fault;

static constexpr std::size_t max_message = 0xFFFF;

static std::uint16_t u16_at(ByteView bytes, std::size_t at) {
    return static_cast<std::uint16_t>(bytes[at] << 8 | bytes[at + 1]);
}
static std::uint32_t u32_at(ByteView bytes, std::size_t at) {
    return static_cast<std::uint32_t>(u16_at(bytes, at)) << 16 | u16_at(bytes, at + 2);
}

// --- reading -----------------------------------------------------------------------------------------------

std::optional<Header> read_header(ByteView bytes) {
    if (bytes.size() < header_size) return {};
    return Header{.fixed = u16_at(bytes, 0),
                  .id = u16_at(bytes, 2),
                  .vendor = u32_at(bytes, 4),
                  .length = u16_at(bytes, 8)};
}

bool plausible_header(ByteView bytes, std::uint16_t fixed) {
    const std::array<std::uint8_t, 8> start = {static_cast<std::uint8_t>(fixed >> 8),
                                               static_cast<std::uint8_t>(fixed),
                                               0,
                                               0,
                                               static_cast<std::uint8_t>(vendor >> 24),
                                               static_cast<std::uint8_t>(vendor >> 16 & 0xFF),
                                               static_cast<std::uint8_t>(vendor >> 8 & 0xFF),
                                               static_cast<std::uint8_t>(vendor & 0xFF)};
    for (std::size_t i = 0; i < std::min(start.size(), bytes.size()); ++i)
        if (bytes[i] != start[i] && i != 2 && i != 3) return false;
    if (bytes.size() < header_size) return true;
    auto length = u16_at(bytes, 8);
    return length == 0 || length >= header_size;
}

std::size_t find_header(ByteView bytes, std::size_t from, std::uint16_t fixed) {
    while (from < bytes.size() && !plausible_header(bytes.subspan(from), fixed))
        ++from;
    return from;
}

std::optional<std::uint32_t> Avp::number() const {
    switch (value.size()) {
        case 1:
            return value[0];
        case 2:
            return u16_at(value, 0);
        case 4:
            return u32_at(value, 0);
        default:
            return {};
    }
}

std::string_view Avp::text() const {
    auto all = as_text(value);
    return all.substr(0, all.find('\0'));
}

std::optional<Avp> AvpReader::next() {
    auto left = bytes_.size() - at_;
    if (left == 0 || fault_) return {};
    if (left < avp_header_size) {
        fault_ = Fault{Errc::truncated, offset(), "AVP",
                       fmt::format("{} bytes are left, too few for its header ({})", left, avp_header_size)};
        return {};
    }
    std::size_t size = u16_at(bytes_, at_ + 2);
    if (size < avp_header_size) {
        fault_ = Fault{Errc::bad_length, offset(), "AVP",
                       fmt::format("length {} is below its header ({})", size, avp_header_size)};
        return {};
    }
    if (size > left) {
        fault_ = Fault{Errc::truncated, offset(), "AVP",
                       fmt::format("length {} is more than the {} bytes that are left", size, left)};
        return {};
    }
    Avp avp{.reserved = u16_at(bytes_, at_),
            .type = u16_at(bytes_, at_ + 4),
            .value = bytes_.subspan(at_ + avp_header_size, size - avp_header_size),
            .offset = offset()};
    at_ += size;
    return avp;
}

const Avp* Parsed::find(Attribute attribute) const {
    for (auto& avp : avps)
        if (avp.is(attribute)) return &avp;
    return nullptr;
}

std::optional<std::uint32_t> Parsed::number(Attribute attribute) const {
    auto* avp = find(attribute);
    return avp != nullptr ? avp->number() : std::nullopt;
}

std::optional<std::string_view> Parsed::text(Attribute attribute) const {
    auto* avp = find(attribute);
    if (avp == nullptr) return {};
    return avp->text();
}

Parsed parse(ByteView message) {
    Parsed parsed;
    auto header = read_header(message);
    if (!header) {
        parsed.fault = Fault{
            Errc::truncated, message.size(), "header",
            fmt::format("{} bytes are too few for a message's header ({})", message.size(), header_size)};
        return parsed;
    }
    parsed.header = *header;
    AvpReader reader(message.subspan(header_size));
    while (auto avp = reader.next())
        parsed.avps.push_back(*avp);
    parsed.fault = reader.fault();
    auto& avps = parsed.avps;
    if (!avps.empty() && avps.back().is(Attribute::result_code) && avps.back().value.size() == 2) {
        parsed.result = u16_at(avps.back().value, 0);
        avps.pop_back();
    }
    if (!avps.empty() && avps.front().is(Attribute::command_name) && avps.front().value.size() == 2) {
        parsed.command = u16_at(avps.front().value, 0);
        avps.erase(avps.begin());
    }
    return parsed;
}

// --- writing -----------------------------------------------------------------------------------------------

// A value longer than a pair's length can say is cut: the message around it is then over its limit, too.
static void append_pair(Bytes& out, std::uint16_t type, ByteView value, bool nul = false) {
    value = value.first(std::min(value.size(), max_message - avp_header_size - (nul ? 1 : 0)));
    wire::Writer writer(out);
    writer.u16(0);
    writer.u16(avp_header_size + value.size() + (nul ? 1 : 0));
    writer.u16(type);
    writer.bytes(value);
    if (nul) writer.u8(0);
}

static constexpr std::uint16_t code_of(Attribute attribute) {
    return static_cast<std::uint16_t>(attribute);
}

void append_number(Bytes& out, Attribute attribute, std::uint64_t value) {
    auto size = row_of(attribute).size;
    wire::Writer writer(out);
    writer.u16(0);
    writer.u16(avp_header_size + size);
    writer.u16(code_of(attribute));
    writer.big_endian(value, size);
}

void append_text(Bytes& out, Attribute attribute, std::string_view text) {
    append_pair(out, code_of(attribute), as_bytes(text), true);
}

void append_bytes(Bytes& out, Attribute attribute, ByteView value) {
    append_pair(out, code_of(attribute), value);
}

void append_time(Bytes& out, Attribute attribute, std::int64_t micros) {
    auto since = static_cast<std::uint64_t>(std::max<std::int64_t>(micros, 0));
    auto seconds = std::min<std::uint64_t>(since / 1'000'000, 0xFFFFFFFF);
    wire::Writer writer(out);
    writer.u16(0);
    writer.u16(avp_header_size + 8);
    writer.u16(code_of(attribute));
    writer.u32(seconds);
    writer.u32(since % 1'000'000);
}

Builder::Builder(Bytes& out, std::uint16_t fixed, std::uint16_t id) : out_(out), start_(out.size()) {
    wire::Writer writer(out_);
    writer.u16(fixed);
    writer.u16(id);
    writer.u32(vendor);
    writer.u16(0);
}

Builder& Builder::command(std::uint16_t code) {
    return number(Attribute::command_name, code);
}

Builder& Builder::number(Attribute attribute, std::uint64_t value) {
    append_number(out_, attribute, value);
    return *this;
}

Builder& Builder::text(Attribute attribute, std::string_view text) {
    append_text(out_, attribute, text);
    return *this;
}

Builder& Builder::bytes(Attribute attribute, ByteView value) {
    append_bytes(out_, attribute, value);
    return *this;
}

Builder& Builder::time(Attribute attribute, std::int64_t micros) {
    append_time(out_, attribute, micros);
    return *this;
}

Builder& Builder::raw(std::uint16_t type, ByteView value) {
    append_pair(out_, type, value);
    return *this;
}

bool Builder::finish() {
    auto size = out_.size() - start_;
    if (size > max_message) {
        out_.resize(start_);
        return false;
    }
    out_[start_ + 8] = static_cast<std::uint8_t>(size >> 8);
    out_[start_ + 9] = static_cast<std::uint8_t>(size & 0xFF);
    return true;
}

}  // namespace gantry::caen
