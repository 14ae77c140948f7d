#pragma once
#include <array>

#include <fmt/format.h>

#include "reader/plugin.hpp"

// Two makes that exist only here: one that is dialled or has a serial line, one that dials in. The
// configuration needs their rows and names, never a driver.
namespace gantry::gateway::test {

inline constexpr std::array<Scheme, 2> acme_schemes = {Scheme{"acme", LinkKind::dial, 1000},
                                                       Scheme{"acme+serial", LinkKind::serial}};
inline constexpr std::array<std::string_view, 2> modes = {"polled", "pushed"};
inline constexpr std::array<std::string_view, 2> acme_models = {"A948EU", "A528"};
inline constexpr std::array<SettingRow, 4> acme_settings = {
    SettingRow{"power_mw", SettingRow::Kind::number, "100", "Power.", {}, 1, 2000},
    SettingRow{"mode", SettingRow::Kind::choice, "polled", "Mode.", modes},
    SettingRow{"poll_every", SettingRow::Kind::duration, "100ms", "Pause.", {}, 0.01, 60, true},
    SettingRow{"checked", SettingRow::Kind::boolean, "true", "Check sums."},
};
inline constexpr std::array<Scheme, 1> knock_schemes = {Scheme{"knock-listen", LinkKind::listen}};
inline constexpr std::array<SettingRow, 1> knock_settings = {
    SettingRow{"repeats", SettingRow::Kind::number, "3", "Tries.", {}, 0, 9}};

inline std::string antenna_name(std::uint16_t antenna) {
    return fmt::format("Ant{}", antenna);
}
inline std::string port_name(std::uint16_t antenna) {
    return fmt::format("Port{}", antenna);
}

inline constexpr Plugin acme{
    .name = "acme",
    .title = "Acme readers",
    .summary = "Dialled.",
    .schemes = acme_schemes,
    .driver_settings = acme_settings,
    .device_settings = {},
    .device_dials = false,
    .notifies = true,
    .models = acme_models,
    .parameters = {},
    .sample_toml = "[[reader]]\nname = \"acme-1\"\naddress = \"acme://192.0.2.7\"\npower_mw = 500\n",
    .codec = nullptr,
    .make_driver = nullptr,
    .make_device = nullptr,
    .antenna_name = antenna_name,
};
inline constexpr Plugin knock{
    .name = "knock",
    .title = "Knock readers",
    .summary = "They dial in.",
    .schemes = knock_schemes,
    .driver_settings = knock_settings,
    .device_settings = {},
    .device_dials = true,
    .notifies = false,
    .models = {},
    .parameters = {},
    .sample_toml = "[[reader]]\nname = \"knock-*\"\naddress = \"knock-listen://:9000\"\n",
    .codec = nullptr,
    .make_driver = nullptr,
    .make_device = nullptr,
    .antenna_name = port_name,
};
inline constexpr std::array<const Plugin*, 2> makes = {&acme, &knock};

}  // namespace gantry::gateway::test
