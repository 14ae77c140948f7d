#include "event/event.hpp"

#include <algorithm>

namespace gantry::event {

static constexpr std::array type_names = {
    TypeName{Type::tag_new, "tag.new"},
    TypeName{Type::tag_observed, "tag.observed"},
    TypeName{Type::tag_lost, "tag.lost"},
    TypeName{Type::tag_purged, "tag.purged"},
    TypeName{Type::tag_moved, "tag.moved"},
    TypeName{Type::tag_glimpsed, "tag.glimpsed"},
    TypeName{Type::tag_read, "tag.read"},
    TypeName{Type::reader_connected, "reader.connected"},
    TypeName{Type::reader_disconnected, "reader.disconnected"},
    TypeName{Type::reader_fault, "reader.fault"},
    TypeName{Type::gpi_changed, "gpi.changed"},
    TypeName{Type::overflow, "overflow"},
    TypeName{Type::clock_jumped, "clock.jumped"},
};

static constexpr std::array technology_names = {
    TechnologyName{Technology::unknown, "unknown"},
    TechnologyName{Technology::epc_gen2, "epc-gen2"},
    TechnologyName{Technology::iso18000_6b, "iso18000-6b"},
    TechnologyName{Technology::iso18000_6a, "iso18000-6a"},
    TechnologyName{Technology::epc_gen1, "epc-gen1"},
    TechnologyName{Technology::epc_1_19, "epc-1.19"},
    TechnologyName{Technology::iso15693, "iso15693"},
    TechnologyName{Technology::icode1, "icode1"},
};

std::span<const TypeName> all_types() {
    return type_names;
}
std::span<const TechnologyName> all_technologies() {
    return technology_names;
}

std::string_view to_text(Type type) {
    auto it = std::ranges::find(type_names, type, &TypeName::type);
    return it == type_names.end() ? "unknown" : it->name;
}

std::optional<Type> parse_type(std::string_view text) {
    auto it = std::ranges::find(type_names, text, &TypeName::name);
    if (it == type_names.end()) return {};
    return it->type;
}

std::string_view to_text(Technology technology) {
    auto it = std::ranges::find(technology_names, technology, &TechnologyName::technology);
    return it == technology_names.end() ? "unknown" : it->name;
}

std::optional<Technology> parse_technology(std::string_view text) {
    auto it = std::ranges::find(technology_names, text, &TechnologyName::name);
    if (it == technology_names.end()) return {};
    return it->technology;
}

TagWords pc_words(std::uint16_t pc) {
    auto byte = [pc](int shift) { return static_cast<std::uint8_t>(pc >> shift); };
    return {{byte(8), byte(0)}, static_cast<std::uint8_t>(pc == 0 ? 0 : 2)};
}
TagWords xpc_words(std::uint32_t xpc) {
    auto byte = [xpc](int shift) { return static_cast<std::uint8_t>(xpc >> shift); };
    bool second = (xpc & 0xFFFF) != 0;
    return {{byte(24), byte(16), byte(8), byte(0)}, static_cast<std::uint8_t>(xpc == 0 ? 0 : second ? 4 : 2)};
}

// Multiply and fold, eight bytes a step. Tag ids of one product differ in their last bytes only, so every
// byte must reach every bit of the result.
std::size_t TagIdHash::operator()(const TagId& tag) const noexcept {
    auto mix = [](std::uint64_t a, std::uint64_t b) {
        __extension__ using Wide = unsigned __int128;
        auto wide = static_cast<Wide>(a) * b;
        return static_cast<std::uint64_t>(wide) ^ static_cast<std::uint64_t>(wide >> 64);
    };
    std::uint64_t hash = 0x9E3779B97F4A7C15u ^ tag.size;
    for (std::size_t at = 0; at < tag.size; at += 8) {
        std::uint64_t chunk = 0;
        std::memcpy(&chunk, tag.data.data() + at, std::min<std::size_t>(8, tag.size - at));
        hash = mix(hash ^ chunk, 0xD6E8FEB86659FD93u);
    }
    return mix(hash, 0xA0761D6478BD642Fu);
}

}  // namespace gantry::event
