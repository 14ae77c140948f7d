#pragma once
#include <array>

#include "reader/plugin.hpp"

// The make's own settings, as rows.
namespace gantry::silion {

// Of a [[reader]] section.
inline constexpr std::array<std::string_view, 5> crc_choices = {"modbus", "modbus-swapped", "ccitt", "auto",
                                                                "off"};
inline constexpr std::array driver_settings = {
    SettingRow{
        .name = "heartbeat",
        .kind = SettingRow::Kind::duration,
        .fallback = "10s",
        .help = "heartbeat period as configured in the reader; three without a frame end the connection",
        .min = 1,
        .max = 65535},
    SettingRow{.name = "identify_within",
               .kind = SettingRow::Kind::duration,
               .fallback = "30s",
               .help = "time for the first frame of a connection; at least 5 s and one heartbeat period",
               .min = 1,
               .max = 131072},
    SettingRow{.name = "ack_wait",
               .kind = SettingRow::Kind::duration,
               .fallback = "5s",
               .help = "how long the reader waits for an acknowledgement before it repeats a frame; keep the "
                       "reader's batch period below it",
               .min = 1,
               .max = 3600},
    SettingRow{
        .name = "crc",
        .kind = SettingRow::Kind::choice,
        .fallback = "auto",
        .help = "how the reader computes its CRC, where its frames have one; auto learns it from the first",
        .choices = crc_choices},
};

// Of a virtual reader.
inline constexpr std::array<std::string_view, 2> generation_choices = {"1", "2"};
inline constexpr std::array<std::string_view, 7> device_crc_choices = {
    "auto", "off", "modbus", "modbus-swapped", "ccitt", "true", "false"};
inline constexpr std::array device_settings = {
    SettingRow{.name = "generation",
               .kind = SettingRow::Kind::choice,
               .fallback = "2",
               .help = "which firmware generation it behaves as",
               .choices = generation_choices},
    SettingRow{.name = "ack",
               .kind = SettingRow::Kind::boolean,
               .fallback = "true",
               .help = "asks for an acknowledgement of each tag frame and keeps the tags until it comes"},
    SettingRow{.name = "ack_wait",
               .kind = SettingRow::Kind::duration,
               .fallback = "5s",
               .help = "how long it waits for an acknowledgement before it sends the frame again",
               .min = 0.1,
               .max = 3600},
    SettingRow{.name = "batch",
               .kind = SettingRow::Kind::duration,
               .fallback = "",
               .help = "how long tags are gathered before a frame (generation 2: 2s, generation 1: 500ms)",
               .min = 0.05,
               .max = 86400},
    SettingRow{.name = "heartbeat",
               .kind = SettingRow::Kind::duration,
               .fallback = "10s",
               .help = "time between heartbeats",
               .min = 0.1,
               .max = 65535},
    SettingRow{.name = "redial",
               .kind = SettingRow::Kind::duration,
               .fallback = "2s",
               .help = "how long after a lost link or a failed try it dials again",
               .min = 0.01,
               .max = 3600},
    SettingRow{.name = "serial",
               .kind = SettingRow::Kind::boolean,
               .fallback = "false",
               .help = "it is at a serial line; --pty says so by itself"},
    SettingRow{.name = "crc",
               .kind = SettingRow::Kind::choice,
               .fallback = "auto",
               .help = "the CRC of its frames; auto: none over TCP, and on a serial line modbus or, of "
                       "generation 1, modbus-swapped; true is modbus",
               .choices = device_crc_choices},
    SettingRow{.name = "buffer",
               .kind = SettingRow::Kind::number,
               .fallback = "5000",
               .help = "tag records its memory holds; when it is full the oldest are dropped",
               .min = 1,
               .max = 1e6},
    SettingRow{.name = "antennas",
               .kind = SettingRow::Kind::number,
               .fallback = "4",
               .help = "antenna ports",
               .min = 1,
               .max = 16},
    SettingRow{.name = "bank_words",
               .kind = SettingRow::Kind::number,
               .fallback = "0",
               .help = "words of user memory read with each tag (generation 2)",
               .min = 0,
               .max = 16},
    SettingRow{.name = "first_seen",
               .kind = SettingRow::Kind::boolean,
               .fallback = "false",
               .help = "sends a frame of its own at once when a tag appears (generation 2)"},
};

}  // namespace gantry::silion
