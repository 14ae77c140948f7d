#include "cli/event_text.hpp"

#include <fmt/format.h>

#include "base/text.hpp"

namespace gantry::cli {

std::string for_people(const event::Event& event) {
    // "dock-1/Ant0 in dock"
    auto place = event.reader;
    if (!event.antenna.empty()) place += (place.empty() ? "" : "/") + event.antenna;
    if (!event.zone.empty()) place += (place.empty() ? "in " : " in ") + event.zone;
    auto line =
        fmt::format("{}  {:<19} {:<24}", to_rfc3339(event.time), to_text(event.type), printable(place));
    if (event.tag.size > 0) line += fmt::format(" {}", to_hex(event.tag.view()));
    if (!event.gs1.empty()) line += fmt::format("  {}", event.gs1);
    if (event.pc != 0) line += fmt::format("  pc {}", to_hex(event::pc_words(event.pc).view()));
    if (event.xpc != 0) line += fmt::format("  xpc {}", to_hex(event::xpc_words(event.xpc).view()));
    if (event.rssi) line += fmt::format("  {:.1f} dBm", *event.rssi / 10.0);
    if (event.reads > 0) line += fmt::format("  {} read{}", event.reads, event.reads == 1 ? "" : "s");
    if (!event.to.empty()) line += fmt::format("  {} -> {}", printable(event.from), printable(event.to));
    if (event.code) line += fmt::format("  code {}", *event.code);
    if (!event.text.empty()) line += fmt::format("  {}", printable(event.text));
    if (event.input)
        line += fmt::format("  input {} = {}", *event.input, event.state.value_or(false) ? 1 : 0);
    if (event.count)
        line += fmt::format("  {} of {}", *event.count, printable(event.scope));
    else if (!event.scope.empty())
        line += fmt::format("  {}", printable(event.scope));
    if (!event.by.empty()) line += fmt::format("  by {}", event.by);
    if (!event.reason.empty()) line += fmt::format("  ({})", printable(event.reason));
    return line;
}

}  // namespace gantry::cli
