#include "protocols/caen/walker.hpp"

#include <algorithm>
#include <cstring>

#include "protocols/caen/message.hpp"

namespace gantry::caen {

using event::TagId;

static std::uint16_t u16_at(const std::uint8_t* at) {
    return static_cast<std::uint16_t>(at[0] << 8 | at[1]);
}
static std::uint32_t u32_at(const std::uint8_t* at) {
    return static_cast<std::uint32_t>(u16_at(at)) << 16 | u16_at(at + 2);
}

std::uint16_t antenna_number(std::string_view read_point) {
    if (!read_point.starts_with("Ant")) return Observation::no_antenna;
    auto digits = read_point.substr(3);
    if (digits.empty() || digits.size() > 3 || (digits.size() > 1 && digits[0] == '0'))
        return Observation::no_antenna;
    std::uint16_t number = 0;
    for (auto digit : digits) {
        if (digit < '0' || digit > '9') return Observation::no_antenna;
        number = static_cast<std::uint16_t>(number * 10 + (digit - '0'));
    }
    return number;
}

static std::uint16_t antenna_of(const std::uint8_t* value, std::size_t size) {
    // "Ant0" to "Ant9" with the NUL, nearly always.
    if (size == 5 && std::memcmp(value, "Ant", 3) == 0 && value[4] == 0 && value[3] >= '0' && value[3] <= '9')
        return static_cast<std::uint16_t>(value[3] - '0');
    auto text = as_text(ByteView(value, size));
    return antenna_number(text.substr(0, text.find('\0')));
}

static void copy_id(TagId& id, const std::uint8_t* from, std::size_t size) {
    id.size = static_cast<std::uint8_t>(size);
    if (size == 12) {  // EPC-96, nearly always: one fixed copy
        std::memcpy(id.data.data(), from, 12);
    } else {
        std::memcpy(id.data.data(), from, size);
    }
}

// A word in two bytes, or in either half of four: which one is not published, and the sources differ in the
// size (section 12). Two words that are not 0 cannot be told apart.
static std::uint16_t pc_of(const std::uint8_t* value, std::size_t size) {
    if (size == 2) return u16_at(value);
    if (size != 4) return 0;
    auto first = u16_at(value), second = u16_at(value + 2);
    return first == 0 ? second : second == 0 ? first : std::uint16_t{0};
}

// XPC_W2 comes never alone, so a lone word is XPC_W1.
static std::uint32_t xpc_of(const std::uint8_t* value, std::size_t size) {
    if (size != 2 && size != 4) return Observation::no_xpc;
    auto words = size == 2 ? std::uint32_t{u16_at(value)} : u32_at(value);
    return words >> 16 == 0 ? words << 16 : words;
}

void TagWalker::restart() {
    has_type_ = false;
    antenna_ = Observation::no_antenna;
    time_us_ = 0;
    said_size_ = not_said;
    open_ = 0;
}

Walked TagWalker::walk(ByteView pairs, std::size_t base, std::vector<Observation>& out, Bytes& data,
                       std::vector<std::uint8_t>* events) {
    Walked walked;
    const auto* at = pairs.data();
    const auto* const end = at + pairs.size();
    auto* tag = open_ > 0 && open_ == out.size() ? &out.back() : nullptr;
    while (at != end) {
        auto left = static_cast<std::size_t>(end - at);
        std::size_t length = left >= avp_header_size ? u16_at(at + 2) : 0;
        if (length < avp_header_size || length > left) [[unlikely]] {
            auto done = static_cast<std::size_t>(at - pairs.data());
            AvpReader reader(pairs.subspan(done), base + done);
            reader.next();
            walked.fault = reader.fault();
            break;
        }
        const auto* value = at + avp_header_size;
        auto size = length - avp_header_size;
        auto type = static_cast<Attribute>(u16_at(at + 4));
        at += length;
        switch (type) {
            case Attribute::tag_id: {
                auto id_size = said_size_ == not_said ? size : said_size_;
                // Empty, longer than any tag's, or less than was said.
                if (id_size - 1 >= TagId::max_size || id_size > size) [[unlikely]] {
                    ++walked.unusable;
                    tag = nullptr;
                    break;
                }
                ++walked.tags;
                tag = &out.emplace_back();
                copy_id(tag->tag, value, id_size);
                tag->technology = has_type_ ? type_ : fallback_;
                tag->antenna = antenna_;
                tag->reader_time_us = time_us_;
                if (events != nullptr) events->push_back(0);
                break;
            }
            case Attribute::tag_id_len:
                if (size == 2) said_size_ = u16_at(value);
                break;
            case Attribute::rssi:
                if (tag != nullptr && size == 2) tag->rssi = static_cast<std::int16_t>(u16_at(value));
                break;
            case Attribute::read_point_name:
                antenna_ = antenna_of(value, size);
                break;
            case Attribute::time_stamp:
                if (size == 8) time_us_ = std::int64_t{u32_at(value)} * 1'000'000 + u32_at(value + 4);
                break;
            case Attribute::tag_type:
                if (size != 2) break;
                type_ = technology_of(u16_at(value));
                has_type_ = true;
                break;
            case Attribute::tag_value:
                if (tag == nullptr || size == 0) break;
                tag->data_size = static_cast<std::uint16_t>(size);
                tag->data_offset = static_cast<std::uint32_t>(data.size());
                tag->data_bank = Bank::tid;
                data.insert(data.end(), value, value + size);
                break;
            case Attribute::pc:
                if (tag != nullptr) tag->pc = pc_of(value, size);
                break;
            case Attribute::xpc:
                if (tag != nullptr) tag->xpc = xpc_of(value, size);
                break;
            case Attribute::event_type:
                if (tag != nullptr && events != nullptr && !events->empty() && size == 4)
                    events->back() = static_cast<std::uint8_t>(std::min<std::uint32_t>(u32_at(value), 255));
                break;
            case Attribute::result_code:
                if (size == 2) walked.result = u16_at(value);
                break;
            default:  // names and lengths that say nothing more, and what later firmware may add
                break;
        }
    }
    open_ = tag != nullptr ? out.size() : 0;
    return walked;
}

}  // namespace gantry::caen
