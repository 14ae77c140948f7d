#include "wire/error.hpp"

#include <fmt/format.h>

namespace gantry::wire {

std::string_view to_text(Errc code) {
    switch (code) {
        case Errc::truncated:
            return "truncated";
        case Errc::trailing_bytes:
            return "trailing bytes";
        case Errc::bad_length:
            return "bad length";
        case Errc::bad_value:
            return "bad value";
        case Errc::bad_checksum:
            return "bad checksum";
        case Errc::unknown_code:
            return "unknown";
        case Errc::too_big:
            return "too big";
    }
    return "unknown";
}

std::string Fault::text() const {
    if (detail.empty()) return fmt::format("{} at {}: {}", field, offset, to_text(code));
    return fmt::format("{} at {}: {}", field, offset, detail);
}

}  // namespace gantry::wire
