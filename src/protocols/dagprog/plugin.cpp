#include "protocols/dagprog/plugin.hpp"

#include <array>

#include "protocols/dagprog/codec.hpp"
#include "protocols/dagprog/device.hpp"
#include "protocols/dagprog/driver.hpp"
#include "protocols/dagprog/sample.hpp"  // made by CMake from sample.toml
#include "protocols/dagprog/settings.hpp"

namespace gantry::dagprog {

static constexpr std::array schemes = {
    Scheme{.name = "dagprog", .kind = LinkKind::serial, .line = "baud=38400"}};

static std::unique_ptr<Driver> make_driver(const DriverOptions& options) {
    return std::make_unique<DagprogDriver>(options);
}

static std::unique_ptr<Device> make_device(const DeviceOptions& options, Air& air) {
    return std::make_unique<DagprogDevice>(options, air);
}

// A unit has one antenna, which has no name.
static std::string antenna_name(std::uint16_t) {
    return {};
}

static event::Technology tags_of(const Settings& settings) {
    return technology(settings.text("family") == "icode1" ? Family::icode1 : Family::iso15693);
}

const Plugin plugin{
    .name = "dagprog",
    .title = "DAGProg",
    .summary = "HF desk units for ICODE1 or ISO15693 race chips on a serial line, 38400 baud, plain ASCII",
    .schemes = schemes,
    .driver_settings = driver_settings,
    .device_settings = device_settings,
    .device_dials = false,
    .notifies = false,
    .models = {},
    .parameters = parameters(),
    .sample_toml = sample_toml,
    .codec = &codec,
    .make_driver = &make_driver,
    .make_device = &make_device,
    .antenna_name = &antenna_name,
    .device_tags = &tags_of,
    .faults = &DagprogDevice::faults,
};

}  // namespace gantry::dagprog
