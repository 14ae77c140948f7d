#pragma once
#include <array>

#include "reader/plugin.hpp"

// The settings of a virtual reader, as rows.
namespace gantry::caen {

// Of models(), which a constant cannot be made of; a test holds the two together.
inline constexpr std::array<std::string_view, 33> model_choices = {
    "A928EU", "A948EU", "A828EU", "A828US",  "A829EU",  "A829US", "A946EU", "A949EU", "A528",
    "A941",   "A828A",  "A829A",  "A941M",   "R1230CB", "R1260I", "R1260U", "R1260E", "R4300P",
    "R4301P", "A528B",  "R1240I", "R1240IE", "R1240IU", "R1170I", "R1270",  "R1250I", "R1170INF",
    "R3100C", "R7100C", "R7101C", "R7104C",  "R4320P",  "all"};
inline constexpr std::array<std::string_view, 3> clock_choices = {"uptime", "set", "zero"};
inline constexpr std::array<std::string_view, 2> result_choices = {"none", "result"};
inline constexpr std::array<std::string_view, 3> status_choices = {"auto", "good_first", "good_last"};
inline constexpr std::array<std::string_view, 3> polarity_choices = {"auto", "true_is_1", "true_is_0"};
inline constexpr std::array<std::string_view, 2> pc_choices = {"2", "4"};
inline constexpr std::array<std::string_view, 2> order_choices = {"strict", "any"};

inline constexpr std::array device_settings = {
    SettingRow{.name = "model",
               .kind = SettingRow::Kind::choice,
               .fallback = "all",
               .help = "the model it behaves as; all: one that has every command",
               .choices = model_choices},
    SettingRow{.name = "serial",
               .kind = SettingRow::Kind::text,
               .fallback = "",
               .help = "serial number in its reader info; empty: one made from its seed",
               .max = 19},  // a known client keeps it in 20 bytes
    SettingRow{.name = "firmware",
               .kind = SettingRow::Kind::text,
               .fallback = "",
               .help = "firmware release it reports; empty: the model's",
               .max = 29},  // with its NUL 30, as known clients take it
    SettingRow{.name = "round",
               .kind = SettingRow::Kind::duration,
               .fallback = "50ms",
               .help = "how long an inventory stays on each read point where no dwell time is configured",
               .min = 0.001,
               .max = 60},
    SettingRow{.name = "clock",
               .kind = SettingRow::Kind::choice,
               .fallback = "uptime",
               .help = "its clock before SetDateTime: seconds since power on, the true time, or zero",
               .choices = clock_choices},
    SettingRow{.name = "stream_start",
               .kind = SettingRow::Kind::choice,
               .fallback = "none",
               .help = "what follows the head of a framed stream: its tags, or a result code first",
               .choices = result_choices},
    SettingRow{.name = "stream_end",
               .kind = SettingRow::Kind::choice,
               .fallback = "result",
               .help = "what ends a framed stream: a result code, or silence",
               .choices = result_choices},
    SettingRow{.name = "status_order",
               .kind = SettingRow::Kind::choice,
               .fallback = "auto",
               .help = "read point status: 0 means good, or 2 does; auto: by the model's manual revision",
               .choices = status_choices},
    SettingRow{.name = "check_polarity",
               .kind = SettingRow::Kind::choice,
               .fallback = "auto",
               .help =
                   "CheckSourceInTrigger and its two sisters say yes with 1 or with 0; auto: by the model's "
                   "manual revision",
               .choices = polarity_choices},
    SettingRow{.name = "pc_size",
               .kind = SettingRow::Kind::choice,
               .fallback = "2",
               .help = "bytes of the PC attribute in inventories",
               .choices = pc_choices},
    SettingRow{.name = "attribute_order",
               .kind = SettingRow::Kind::choice,
               .fallback = "strict",
               .help = "whether attributes of a command must come in the manual's order",
               .choices = order_choices},
    SettingRow{.name = "serial_line",
               .kind = SettingRow::Kind::boolean,
               .fallback = "false",
               .help = "its link is a serial line, which is there while it restarts, too"},
    SettingRow{.name = "byte_gap",
               .kind = SettingRow::Kind::duration,
               .fallback = "2s",
               .help = "a request that stops half way for this long is dropped without a word",
               .min = 0.01,
               .max = 60},
    SettingRow{.name = "boot",
               .kind = SettingRow::Kind::duration,
               .fallback = "2s",
               .help = "how long a restart takes; links are refused until then",
               .min = 0,
               .max = 600},
    SettingRow{.name = "redial",
               .kind = SettingRow::Kind::duration,
               .fallback = "2s",
               .help = "how long after a lost notification channel or a failed try it dials again",
               .min = 0.01,
               .max = 3600},
    SettingRow{.name = "channel_buffer",
               .kind = SettingRow::Kind::number,
               .fallback = "1000",
               .help = "events that each notification channel keeps for its next report; the oldest go first",
               .min = 1,
               .max = 100000},
};

}  // namespace gantry::caen
