#include "protocols/silion/plugin.hpp"

#include <array>

#include <fmt/format.h>

#include "protocols/silion/codec.hpp"
#include "protocols/silion/device.hpp"
#include "protocols/silion/driver.hpp"
#include "protocols/silion/sample.hpp"  // made by CMake from sample.toml
#include "protocols/silion/settings.hpp"

namespace gantry::silion {

static constexpr std::array schemes = {Scheme{.name = "silion-listen", .kind = LinkKind::listen},
                                       Scheme{.name = "silion+serial", .kind = LinkKind::serial}};

static std::unique_ptr<Driver> make_driver(const DriverOptions& options) {
    return std::make_unique<SilionDriver>(options.settings, options.link);
}

static std::unique_ptr<Device> make_device(const DeviceOptions& options, Air& air) {
    return std::make_unique<SilionDevice>(options, air);
}

static std::string antenna_name(std::uint16_t antenna) {
    return antenna == Observation::no_antenna ? std::string{} : fmt::format("Ant{}", antenna);
}

constinit const Plugin plugin{
    .name = "silion",
    .title = "Silion active mode",
    .summary =
        "UHF readers (IF9A and its line) that dial in, or push over a serial line, optionally acknowledged",
    .schemes = schemes,
    .driver_settings = driver_settings,
    .device_settings = device_settings,
    .device_dials = true,
    .notifies = false,
    .models = {},
    .parameters = {},
    .sample_toml = sample_toml,
    .codec = &codec,
    .make_driver = &make_driver,
    .make_device = &make_device,
    .antenna_name = &antenna_name,
    .faults = &SilionDevice::faults,
};

}  // namespace gantry::silion
