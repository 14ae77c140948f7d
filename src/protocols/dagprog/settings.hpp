#pragma once
#include <array>

#include "reader/plugin.hpp"

// The make's own settings, as rows.
namespace gantry::dagprog {

inline constexpr std::array<std::string_view, 3> family_choices = {"auto", "icode1", "iso15693"};
inline constexpr std::array<std::string_view, 5> mode_choices = {"auto", "ur", "sr", "rc", "as"};
inline constexpr std::array<std::string_view, 6> transmit_choices = {"auto", "keep",   "nothing",
                                                                     "data", "serial", "both"};
inline constexpr std::array<std::string_view, 3> stx_choices = {"auto", "yes", "no"};
inline constexpr std::array<std::string_view, 4> separator_choices = {"auto", "tab", "none", "space"};
inline constexpr std::array<std::string_view, 3> order_choices = {"auto", "msb", "lsb"};
// `auto` and the names of the candidates, which a constant cannot be made of; a test holds them together.
inline constexpr std::array<std::string_view, 13> crc8_choices = {
    "auto",  "i-code",    "maxim-dow", "smbus",   "mifare-mad", "hitag", "tech-3250",
    "gsm-a", "sae-j1850", "rohc",      "i-432-1", "nrsc-5",     "dvb-s2"};

// Of a [[reader]] section.
inline constexpr std::array driver_settings = {
    SettingRow{.name = "family",
               .kind = SettingRow::Kind::choice,
               .fallback = "auto",
               .help = "which tags the unit reads; auto asks it for its power-up mode, which only one has",
               .choices = family_choices},
    SettingRow{.name = "mode",
               .kind = SettingRow::Kind::choice,
               .fallback = "auto",
               .help =
                   "how tags are read: ur for ever, rc the same with CRC8 check, sr each tag once, as the "
                   "serial number again and again (ICODE1); auto is ur",
               .choices = mode_choices},
    SettingRow{.name = "transmit",
               .kind = SettingRow::Kind::choice,
               .fallback = "auto",
               .help = "what the unit sends of a tag; auto: all that it can, keep: as the unit has it",
               .choices = transmit_choices},
    SettingRow{.name = "first_block",
               .kind = SettingRow::Kind::number,
               .fallback = "",
               .help = "first block that is read with a tag; empty: as the unit has it",
               .min = 0,
               .max = 15},
    SettingRow{.name = "blocks",
               .kind = SettingRow::Kind::number,
               .fallback = "",
               .help = "how many blocks are read with a tag; empty: as the unit has it",
               .min = 1,
               .max = 16},
    SettingRow{.name = "reread",
               .kind = SettingRow::Kind::duration,
               .fallback = "1s",
               .help = "mode sr: how often the field goes off for 100 ms, which wakes the tags that were "
                       "read; 0: never",
               .min = 0,
               .max = 3600,
               .between_reads = true},
    SettingRow{.name = "poll",
               .kind = SettingRow::Kind::duration,
               .fallback = "200ms",
               .help = "mode as: time from one question for a serial number to the next",
               .min = 0.05,
               .max = 3600,
               .between_reads = true},
    SettingRow{.name = "stx",
               .kind = SettingRow::Kind::choice,
               .fallback = "auto",
               .help = "does the unit want STX before commands? auto tries both",
               .choices = stx_choices},
    SettingRow{.name = "separator",
               .kind = SettingRow::Kind::choice,
               .fallback = "auto",
               .help = "what stands between a command and its values; auto finds it out by setting the first "
                       "block to its neighbour and back",
               .choices = separator_choices},
    SettingRow{.name = "byte_order",
               .kind = SettingRow::Kind::choice,
               .fallback = "auto",
               .help = "of serial numbers as the unit writes them; auto: ISO15693 numbers begin with E0",
               .choices = order_choices},
    SettingRow{.name = "crc8",
               .kind = SettingRow::Kind::choice,
               .fallback = "auto",
               .help = "which CRC8 the unit puts into the last byte of a block; auto learns it from what it "
                       "writes",
               .choices = crc8_choices},
    SettingRow{.name = "check_crc8",
               .kind = SettingRow::Kind::boolean,
               .fallback = "false",
               .help = "the gateway itself refuses blocks whose last byte is not that CRC8; name it then"},
    SettingRow{.name = "force_system_blocks",
               .kind = SettingRow::Kind::boolean,
               .fallback = "false",
               .help = "allows to write blocks 0 to 3 of ICODE1 tags, which cannot be undone"},
    SettingRow{.name = "alive",
               .kind = SettingRow::Kind::duration,
               .fallback = "10s",
               .help = "after so long a silence the unit is asked for its version; no answer ends the link",
               .min = 1,
               .max = 3600},
};

// Of a virtual unit.
inline constexpr std::array<std::string_view, 2> device_family_choices = {"iso15693", "icode1"};
inline constexpr std::array<std::string_view, 3> insist_stx_choices = {"any", "yes", "no"};
inline constexpr std::array<std::string_view, 4> insist_separator_choices = {"any", "tab", "none", "space"};
inline constexpr std::array<std::string_view, 2> device_order_choices = {"msb", "lsb"};
inline constexpr auto device_crc8_choices = [] {
    std::array<std::string_view, crc8_choices.size() - 1> names{};
    for (std::size_t i = 0; i < names.size(); ++i)
        names[i] = crc8_choices[i + 1];
    return names;
}();
inline constexpr std::array device_settings = {
    SettingRow{.name = "family",
               .kind = SettingRow::Kind::choice,
               .fallback = "iso15693",
               .help = "which tags it reads",
               .choices = device_family_choices},
    SettingRow{.name = "stx",
               .kind = SettingRow::Kind::choice,
               .fallback = "any",
               .help = "does it insist on STX before commands, or on none?",
               .choices = insist_stx_choices},
    SettingRow{.name = "separator",
               .kind = SettingRow::Kind::choice,
               .fallback = "any",
               .help = "what it insists on between a command and its values",
               .choices = insist_separator_choices},
    SettingRow{.name = "byte_order",
               .kind = SettingRow::Kind::choice,
               .fallback = "msb",
               .help = "of the serial numbers that it writes",
               .choices = device_order_choices},
    SettingRow{.name = "crc8",
               .kind = SettingRow::Kind::choice,
               .fallback = "i-code",
               .help = "which CRC8 it computes",
               .choices = device_crc8_choices},
    SettingRow{.name = "banner_stx",
               .kind = SettingRow::Kind::boolean,
               .fallback = "true",
               .help = "its two messages at power-up begin with STX"},
    SettingRow{.name = "version",
               .kind = SettingRow::Kind::text,
               .fallback = "V1.00A",
               .help = "of its firmware",
               .min = 0,
               .max = 6},
    SettingRow{.name = "boot",
               .kind = SettingRow::Kind::duration,
               .fallback = "300ms",
               .help = "from power-up to its first message",
               .min = 0,
               .max = 60},
};

}  // namespace gantry::dagprog
