#pragma once
#include <string>
#include <string_view>

#include "event/event.hpp"

namespace gantry::cli {

// Events as CSV (RFC 4180, lines ended by \n): the columns of the store's view `events` but for `schema`.
enum class Cells {
    safe,  // for spreadsheets: text that one would take for a formula gets a ' in front, control characters
           // but tab and line ends become U+FFFD
    raw,   // bytes as they are
};
std::string csv_header();
void append_csv(std::string& out, const event::Event& event, std::string_view id_prefix, Cells cells);

}  // namespace gantry::cli
