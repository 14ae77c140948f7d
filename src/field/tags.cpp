#include "field/tags.hpp"

#include "field/hash.hpp"

namespace gantry::field {

static constexpr std::uint64_t serial_bits = 38;

// Tag Data Standard 2.3, table for SGTIN-96: header 8 bits, filter 3, partition 3, company prefix 24 and item
// reference 20 (partition 5: seven and six digits), serial 38. Put together here because it is all fixed but
// for two fields; epc::encode takes the general road through text.
event::TagId sgtin96(std::uint32_t item, std::uint64_t serial) {
    std::uint64_t high = 0x30;    // header
    high = high << 3 | 1;         // filter: point of sale
    high = high << 3 | 5;         // partition
    high = high << 24 | 614'141;  // company prefix 0614141
    high = high << 20 | item % 1'000'000;
    // So far 58 bits; the serial number fills up to 96.
    serial &= (std::uint64_t{1} << serial_bits) - 1;
    high = high << 6 | serial >> 32;
    Bytes bytes;
    for (int shift = 56; shift >= 0; shift -= 8)
        bytes.push_back(static_cast<std::uint8_t>(high >> shift));
    for (int shift = 24; shift >= 0; shift -= 8)
        bytes.push_back(static_cast<std::uint8_t>(serial >> shift));
    return event::TagId(bytes);
}

std::vector<PlacedTag> default_tags(std::uint32_t reader) {
    static constexpr std::uint32_t handful = 5;
    std::vector<PlacedTag> tags(handful);
    for (std::uint32_t i = 0; i < handful; ++i)
        tags[i].tag.id = sgtin96(812'345, std::uint64_t{reader} * 100 + 6'700 + i);
    return tags;
}

// ISO 15693: E0, 04 for the maker, 01 for ICODE SLI, and a number. ICODE1: a number that looks like one.
static event::TagId hf_id(event::Technology technology, std::uint64_t number) {
    std::uint64_t id =
        technology == event::Technology::icode1 ? 0x0100'0000'0000'0000u : 0xE004'0100'0000'0000u;
    id |= number & 0xFF'FFFF'FFFFu;
    Bytes bytes;
    for (int shift = 56; shift >= 0; shift -= 8)
        bytes.push_back(static_cast<std::uint8_t>(id >> shift));
    return event::TagId(bytes);
}

std::vector<TagSpec> hf_tags(event::Technology technology, std::uint64_t seed, std::uint32_t count) {
    std::vector<TagSpec> tags(count);
    for (std::uint32_t i = 0; i < count; ++i) {
        tags[i].technology = technology;
        tags[i].id = hf_id(technology, (hash_of({seed}) % 0xFFFF + 1) << 24 | (i & 0xFF'FFFF));
    }
    return tags;
}

std::vector<PlacedTag> default_hf_tags(event::Technology technology, std::uint32_t reader) {
    PlacedTag tag;
    tag.tag = hf_tags(technology, reader, 1).front();
    return {tag};
}

// The upper half of a serial number comes from the seed, the lower half counts.
std::vector<TagSpec> traffic_tags(std::uint64_t seed, std::uint32_t count) {
    std::vector<TagSpec> tags(count);
    auto series = hash_of({seed}) % (1u << 14);
    for (std::uint32_t i = 0; i < count; ++i) {
        auto item = static_cast<std::uint32_t>(100'000 + hash_of({seed, i}) % 900);
        tags[i].id = sgtin96(item, series << 24 | (i & 0xFF'FFFF));
    }
    return tags;
}

}  // namespace gantry::field
