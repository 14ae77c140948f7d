#pragma once
#include <array>
#include <cstring>
#include <optional>
#include <string>
#include <string_view>

#include "base/bytes.hpp"
#include "base/time.hpp"

namespace gantry::event {

// What can happen. The numbers are stored: append only.
enum class Type : std::uint8_t {
    tag_new = 1,
    tag_observed = 2,
    tag_lost = 3,
    tag_purged = 4,
    tag_moved = 5,
    tag_glimpsed = 6,
    tag_read = 7,
    reader_connected = 20,
    reader_disconnected = 21,
    reader_fault = 22,
    gpi_changed = 23,
    overflow = 24,
    clock_jumped = 25,
};
std::string_view to_text(Type type);  // "tag.new"
std::optional<Type> parse_type(std::string_view text);
inline bool is_tag(Type type) {
    return type < Type::reader_connected;
}
// All types with their names, for the store's tables and for completion.
struct TypeName {
    Type type;
    std::string_view name;
};
std::span<const TypeName> all_types();

// The air protocol of a tag. The numbers are stored: append only.
enum class Technology : std::uint8_t {
    unknown = 0,
    epc_gen2 = 1,
    iso18000_6b = 2,
    iso18000_6a = 3,
    epc_gen1 = 4,
    epc_1_19 = 5,
    iso15693 = 6,
    icode1 = 7,
};
std::string_view to_text(Technology technology);  // "epc-gen2"
std::optional<Technology> parse_technology(std::string_view text);
struct TechnologyName {
    Technology technology;
    std::string_view name;
};
std::span<const TechnologyName> all_technologies();

// A tag's identifier as read: EPC (without PC and CRC) or UID. At most 62 bytes, the longest a PC word can
// say.
struct TagId {
    static constexpr std::size_t max_size = 62;
    std::uint8_t size = 0;
    std::array<std::uint8_t, max_size> data{};

    TagId() = default;
    explicit TagId(ByteView bytes)  // bytes.size() must be at most max_size
        : size(static_cast<std::uint8_t>(bytes.size())) {
        if (!bytes.empty()) std::memcpy(data.data(), bytes.data(), bytes.size());
    }
    ByteView view() const { return {data.data(), size}; }
    friend bool operator==(const TagId& a, const TagId& b) {
        return a.size == b.size && std::memcmp(a.data.data(), b.data.data(), a.size) == 0;
    }
};
struct TagIdHash {
    using is_avalanching = void;
    std::size_t operator()(const TagId& tag) const noexcept;
};

// Signal strength in tenths of a dBm; absent when the reader gives none.
using Rssi = std::optional<std::int16_t>;

// The words that a Gen2 tag sends before its id. As numbers 0 is none: no tag with an id has a PC of 0, and a
// tag without XPC is reported with zeros. An XPC holds XPC_W1 in its upper half and XPC_W2 in its lower.
// As bytes, which events show in hex: empty for none, and without XPC_W2 where there is none.
struct TagWords {
    std::array<std::uint8_t, 4> data{};
    std::uint8_t size = 0;
    ByteView view() const { return {data.data(), size}; }
};
TagWords pc_words(std::uint16_t pc);
TagWords xpc_words(std::uint32_t xpc);

// One event, as README.md ("An event") prints it. What a reader did not give is empty and is left
// out.
struct Event {
    std::uint64_t seq = 0;  // given by the journal when the event is committed
    Type type{};
    Technology technology = Technology::unknown;  // tag events
    bool possible_repeat = false;                 // tag.read: a crash left open whether this is a repeat
    Wall time{};
    std::string reader, antenna, zone;
    TagId tag;  // empty: not about a tag
    std::string epc, gs1, link;
    std::uint16_t pc = 0;   // 0: not said
    std::uint32_t xpc = 0;  // 0: none, or not said
    Rssi rssi;
    std::uint64_t reads = 0;  // 0: not said
    std::optional<Wall> first_seen, last_seen, reader_time;
    std::string from, to;                // tag.moved: zones
    std::string reason;                  // reader.disconnected, tag.lost, tag.purged
    std::string text;                    // reader.fault
    std::optional<std::int64_t> code;    // reader.fault
    Bytes bytes;                         // reader.fault: the frame it is about
    std::optional<std::int64_t> input;   // gpi.changed
    std::optional<bool> state;           // gpi.changed
    std::string scope;                   // overflow
    std::optional<std::uint64_t> count;  // overflow; of a reader's own memory it may not be known
    std::optional<Wall> since;           // overflow
    std::string by;                      // clock.jumped: a signed duration, "+1h"
    Bytes tid, user;                     // memory bank data that came with the read: data.tid, data.user
};

}  // namespace gantry::event
