#pragma once
#include <cstdint>
#include <string>
#include <string_view>

namespace gantry::sinks::mqtt {

// What a broker's answer to a message means for it.
enum class Verdict : std::uint8_t {
    accepted,
    rejected,  // the message itself will never be taken
    kept,      // the broker or our rights are not ready for it: nothing more is sent for now
    doubtful,  // the broker does not say whether it is the message
};

// MQTT 5, section 2.4 and the tables of CONNACK, PUBACK, SUBACK and DISCONNECT.
Verdict puback_verdict(std::uint8_t code);
std::string_view reason_name(std::uint8_t code);  // "not authorized"; empty: unknown
// "not authorized (0x87)", with what the broker says of it, if anything.
std::string reason_text(std::uint8_t code, std::string_view said = {});

// Why a broker refused a connection, and what to do. MQTT 3.1.1 has codes of its own, 1 to 5.
std::string connack_text(std::uint8_t code, bool version_5, std::string_view said);
std::string disconnect_text(std::uint8_t code, std::string_view said);  // MQTT 5

}  // namespace gantry::sinks::mqtt
