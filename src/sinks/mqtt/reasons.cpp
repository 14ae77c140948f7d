#include "sinks/mqtt/reasons.hpp"

#include <algorithm>
#include <array>

#include <fmt/format.h>

#include "base/text.hpp"

namespace gantry::sinks::mqtt {

namespace {
struct ReasonRow {
    std::uint8_t code;
    std::string_view name;
    Verdict puback = Verdict::kept;
    std::string_view advice = {};  // when a connection is refused or ended with it
};

// "Not authorized" and "quota exceeded" are kept: once the rights or the quota are there, the message goes.
constexpr auto reasons = std::to_array<ReasonRow>({
    {0x00, "success", Verdict::accepted},
    {0x10, "no matching subscribers", Verdict::accepted},
    {0x80, "unspecified error", Verdict::doubtful},
    {0x81, "malformed packet"},
    {0x82, "protocol error"},
    {0x83, "implementation specific error", Verdict::doubtful},
    {0x84, "unsupported protocol version", Verdict::kept, "write version = \"3.1.1\""},
    {0x85, "client identifier not valid", Verdict::kept, "set client_id to one that the broker takes"},
    {0x86, "bad user name or password", Verdict::kept, "check user and password_file"},
    {0x87, "not authorized", Verdict::kept, "check user, password_file and the broker's access list"},
    {0x88, "server unavailable"},
    {0x89, "server busy"},
    {0x8A, "banned"},
    {0x8B, "server shutting down"},
    {0x8C, "bad authentication method"},
    {0x8D, "keep alive timeout"},
    {0x8E, "session taken over", Verdict::kept, "another client has our client_id: give each its own"},
    {0x8F, "topic filter invalid"},
    {0x90, "topic name invalid", Verdict::rejected},
    {0x91, "packet identifier in use"},
    {0x93, "receive maximum exceeded"},
    {0x95, "packet too large", Verdict::rejected},
    {0x96, "message rate too high"},
    {0x97, "quota exceeded"},
    {0x98, "administrative action"},
    {0x99, "payload format invalid", Verdict::rejected},
    {0x9A, "retain not supported", Verdict::kept, "write status = false"},
    {0x9B, "QoS not supported"},
    {0x9C, "use another server"},
    {0x9D, "server moved"},
    {0x9F, "connection rate exceeded"},
    {0xA0, "maximum connect time"},
});

const ReasonRow* find_reason(std::uint8_t code) {
    auto row = std::ranges::find(reasons, code, &ReasonRow::code);
    return row == reasons.end() ? nullptr : &*row;
}

// MQTT 3.1.1, table 3.1, in the words of MQTT 5.
std::uint8_t as_version_5(std::uint8_t code) {
    constexpr std::uint8_t codes[] = {0x00, 0x84, 0x85, 0x88, 0x86, 0x87};
    return code < sizeof codes ? codes[code] : code;
}
}  // namespace

Verdict puback_verdict(std::uint8_t code) {
    auto* row = find_reason(code);
    if (row != nullptr) return row->puback;
    return code < 0x80 ? Verdict::accepted : Verdict::doubtful;
}

std::string_view reason_name(std::uint8_t code) {
    auto* row = find_reason(code);
    return row == nullptr ? std::string_view{} : row->name;
}

std::string reason_text(std::uint8_t code, std::string_view said) {
    auto name = reason_name(code);
    auto out = fmt::format("{} (0x{:02X})", name.empty() ? "a code of its own" : name, code);
    if (!said.empty()) out += fmt::format(": {}", printable(said.substr(0, 200)));
    return out;
}

static std::string with_advice(std::uint8_t code, std::string_view said) {
    auto* row = find_reason(code);
    auto text = reason_text(code, said);
    return row == nullptr || row->advice.empty() ? text : fmt::format("{}; {}", text, row->advice);
}

std::string connack_text(std::uint8_t code, bool version_5, std::string_view said) {
    return "the broker refuses the connection: " + with_advice(version_5 ? code : as_version_5(code), said);
}

std::string disconnect_text(std::uint8_t code, std::string_view said) {
    return "the broker ended the connection: " + with_advice(code, said);
}

}  // namespace gantry::sinks::mqtt
