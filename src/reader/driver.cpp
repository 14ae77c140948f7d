#include "reader/driver.hpp"

namespace gantry {

std::string_view to_text(Count count) {
    static constexpr std::array<std::string_view, count_size> names = {
        "frames",       "bytes",      "reads",     "acknowledged", "repeats",
        "bad_checksum", "bad_length", "malformed", "unknown_code", "skipped_bytes",
        "resyncs",      "timeouts",   "departures"};
    return names.at(static_cast<std::size_t>(count));
}

}  // namespace gantry
