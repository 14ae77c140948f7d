#include "sink/names.hpp"

#include <fmt/format.h>

#include "base/text.hpp"

namespace gantry::sink {

// U+FDD0 to U+FDEF and the last two of each plane are no characters; MQTT servers may refuse them.
static bool is_noncharacter(std::string_view utf8) {
    if (utf8.size() < 3) return false;
    auto byte = [&](std::size_t i) { return static_cast<unsigned char>(utf8[i]); };
    if (utf8.size() == 3 && byte(0) == 0xEF && byte(1) == 0xB7) return byte(2) >= 0x90 && byte(2) <= 0xAF;
    auto last = byte(utf8.size() - 1), before = byte(utf8.size() - 2);
    bool plane_end = utf8.size() == 3 ? byte(0) == 0xEF : (byte(1) & 0x0F) == 0x0F;
    return plane_end && before == 0xBF && last >= 0xBE;
}

std::string encode_name(std::string_view name, std::string_view special) {
    std::string out;
    out.reserve(name.size());
    while (!name.empty()) {
        auto first = static_cast<unsigned char>(name.front());
        std::size_t size = first < 0x80 ? 1 : first < 0xE0 ? 2 : first < 0xF0 ? 3 : 4;
        auto character = name.substr(0, size);
        bool plain = first < 0x80 ? first > 0x1F && first != 0x7F && first != '%' &&
                                        special.find(character.front()) == std::string_view::npos
                                  : is_utf8(character) && printable(character) == character &&
                                        !is_noncharacter(character);
        if (plain) {
            out += character;
            name.remove_prefix(size);
        } else {
            fmt::format_to(std::back_inserter(out), "%{:02X}", first);
            name.remove_prefix(1);
        }
    }
    return out;
}

}  // namespace gantry::sink
