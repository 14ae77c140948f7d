#include "protocols/caen/plugin.hpp"

#include <array>
#include <vector>

#include <fmt/format.h>

#include "protocols/caen/codec.hpp"
#include "protocols/caen/device.hpp"
#include "protocols/caen/device_settings.hpp"
#include "protocols/caen/driver.hpp"
#include "protocols/caen/driver_settings.hpp"
#include "protocols/caen/sample.hpp"  // made by CMake from sample.toml
#include "protocols/caen/tables.hpp"

namespace gantry::caen {

static constexpr std::array schemes = {Scheme{"caen", LinkKind::dial, port},
                                       Scheme{"caen+serial", LinkKind::serial}};

static std::unique_ptr<Driver> make_driver(const DriverOptions& options) {
    return std::make_unique<CaenDriver>(options);
}

static std::unique_ptr<Device> make_device(const DeviceOptions& options, Air& air) {
    return std::make_unique<CaenDevice>(options, air);
}

static std::string antenna_name(std::uint16_t antenna) {
    return antenna == Observation::no_antenna ? std::string{} : fmt::format("Ant{}", antenna);
}

// The table of parameters as everybody sees it.
static std::vector<ParameterRow> parameter_rows() {
    std::vector<ParameterRow> rows;
    for (auto& binding : caen::parameters()) {
        auto& attribute = row_of(binding.argument);
        rows.push_back({.name = binding.name,
                        .unit = attribute.unit,
                        .help = binding.help,
                        .writable = binding.set != binding.get,
                        .min = attribute.min,
                        .max = attribute.max,
                        .enumeration = attribute.enumeration});
    }
    return rows;
}
static const std::vector<ParameterRow> all_parameters = parameter_rows();

// docs/protocols/caen.md, sections on tag commands: kills and locks, also the obsolete ones.
// By either name; those of later revisions are other words for the same.
constexpr std::array<std::string_view, 6> final_commands = {"G2Kill", "KillTag_EPC_C1G2", "KillTag",
                                                            "G2Lock", "LockTag_EPC_C1G2", "LockTag"};

const Plugin plugin{
    .name = "caen",
    .title = "CAEN UHF (easy2read)",
    .summary =
        "UHF readers that the gateway dials on TCP port 1000 or a serial line, from the A928 to the R4320P",
    .schemes = schemes,
    .driver_settings = driver_settings,
    .device_settings = device_settings,
    .device_dials = false,
    .notifies = true,
    .models = model_choices,
    .parameters = all_parameters,
    .final_commands = final_commands,
    .sample_toml = sample_toml,
    .codec = &codec,
    .make_driver = &make_driver,
    .make_device = &make_device,
    .antenna_name = &antenna_name,
    .faults = &CaenDevice::faults,
};

}  // namespace gantry::caen
