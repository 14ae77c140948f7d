#include "protocols/harting/plugin.hpp"

#include <array>

#include <fmt/format.h>

#include "protocols/harting/codec.hpp"
#include "protocols/harting/config.hpp"
#include "protocols/harting/device.hpp"
#include "protocols/harting/device_settings.hpp"
#include "protocols/harting/driver.hpp"
#include "protocols/harting/driver_settings.hpp"
#include "protocols/harting/sample.hpp"  // made by CMake from sample.toml
#include "protocols/harting/tables.hpp"

namespace gantry::harting {

// Section 1: the line is 38400 8E1 until somebody configures another.
static constexpr std::array schemes = {
    Scheme{.name = "harting", .kind = LinkKind::dial, .port = port},
    Scheme{.name = "harting-listen", .kind = LinkKind::listen, .anonymous = true},
    Scheme{.name = "harting+serial", .kind = LinkKind::serial, .line = "baud=38400&parity=even"}};

static std::unique_ptr<Driver> make_driver(const DriverOptions& options) {
    if (options.link == LinkKind::listen) return std::make_unique<HartingListener>(options);
    return std::make_unique<HartingDriver>(options);
}

static std::unique_ptr<Device> make_device(const DeviceOptions& options, Air& air) {
    return std::make_unique<HartingDevice>(options, air);
}

static std::string antenna_name(std::uint16_t antenna) {
    return antenna == Observation::no_antenna ? std::string{} : fmt::format("ANT{}", antenna);
}

// Section 7: what these do to a tag, or to reads that nobody has taken yet, cannot be undone.
constexpr std::array<std::string_view, 7> final_commands = {
    "Kill", "Lock", "BlockPermalock", "LockRegion", "Untraceable", "ClearDataBuffer", "InitializeBuffer"};

const Plugin plugin{
    .name = "harting",
    .title = "HARTING Ha-VIS RF-R400",
    .summary = "UHF readers with FEIG frames: host commands, buffered read, notification and scan mode",
    .schemes = schemes,
    .driver_settings = driver_settings,
    .device_settings = device_settings,
    .device_dials = false,
    .dial_setting = "connect",
    .notifies = true,
    .models = {},
    .parameters = parameter_rows(),
    .parse_parameter = &parse_parameter,
    .final_commands = final_commands,
    .sample_toml = sample_toml,
    .codec = &codec,
    .make_driver = &make_driver,
    .make_device = &make_device,
    .antenna_name = &antenna_name,
    .faults = &HartingDevice::faults,
};

}  // namespace gantry::harting
