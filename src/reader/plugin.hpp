#pragma once
#include <memory>
#include <optional>
#include <span>
#include <string_view>
#include <utility>

#include "base/error.hpp"
#include "base/text.hpp"
#include "reader/air.hpp"
#include "reader/device.hpp"
#include "reader/driver.hpp"
#include "reader/faults.hpp"
#include "wire/layout.hpp"
#include "wire/message.hpp"

namespace gantry {

// A setting of a make, for a [[reader]] section or for a virtual reader. The configuration's checker, its
// schema, its example, `--help` and the documents are all made from these rows.
struct SettingRow {
    enum class Kind : std::uint8_t { text, number, boolean, duration, choice, hex };
    std::string_view name;
    Kind kind;
    std::string_view fallback;                       // as the user would write it; empty: none
    std::string_view help;                           // one line
    std::span<const std::string_view> choices = {};  // Kind::choice
    // If min <= max: of a number; of a duration in seconds; the most characters of a text.
    double min = 0, max = -1;
    // A duration that may pass between two sightings of a tag that stands still: longer than presence waits
    // for the next one, and the tag comes and goes.
    bool between_reads = false;
    // Given as NAME_file (a file that holds it) or NAME_env (a variable of the environment), never itself.
    bool secret = false;
};

// Checked values by name; what the user left out is there with its fallback.
class Settings {
public:
    // Checks `given` against `rows`: unknown names, wrong kinds and values out of range are refused with a
    // hint.
    static Result<Settings> make(std::span<const SettingRow> rows,
                                 std::span<const std::pair<std::string, std::string>> given);
    std::string_view text(std::string_view name) const;  // the name must be a row
    double number(std::string_view name) const;
    bool boolean(std::string_view name) const;
    std::chrono::microseconds duration(std::string_view name) const;
    friend bool operator==(const Settings&, const Settings&) = default;

private:
    std::vector<std::pair<std::string, std::string>> values_;
};

enum class LinkKind : std::uint8_t { dial, listen, serial };  // who opens the link, seen from the gateway

// A URL scheme that reaches readers of a make: "caen" dial 1000, "silion-listen" listen, "dagprog" serial.
struct Scheme {
    std::string_view name;
    LinkKind kind;
    std::uint16_t port = 0;  // default; 0: must be given
    // Serial lines: what an address that does not say otherwise means, "baud=38400&parity=even".
    std::string_view line = {};
    // Readers that dial in do not say who they are: their section is found by their address alone.
    bool anonymous = false;
};

// A parameter of a reader that can be read, and perhaps set, while it works: "Power", "CFG1.MODE".
struct ParameterRow {
    std::string_view name;
    std::string_view unit;  // may be empty
    std::string_view help;
    bool writable = true;
    std::int64_t min = 0, max = -1;  // numbers, if min <= max
    const wire::Enumeration* enumeration = nullptr;
    bool permanent = false;      // SetParameter and GetParameter take `permanent` for it
    bool needs_restart = false;  // what is set takes effect only after `permanent` and a restart
    bool secret = false;         // can be set, is never read
    bool raw = false;            // the bytes behind other parameters: what is set there is seen here, too
    // Of several that are set together, the lower ones go first: what changes the reader's way of working
    // comes after that which the new way needs.
    std::int8_t order = 0;
};

// What a driver is made of.
struct DriverOptions {
    Settings settings;       // the make's own
    std::string name = {};   // of the reader in events; empty when it dials in and is not known yet
    std::string model = {};  // as configured; empty: what the reader says
    // "192.168.0.10:3000", what to tell the reader; empty: no notifications wanted.
    std::string notify_at = {};
    LinkKind link = LinkKind::dial;  // how the reader is reached
};

struct DeviceOptions {
    std::string name;        // the reader's own name
    std::uint64_t seed = 1;  // of whatever is random in it
    Settings settings;
};

// All that Gantry knows of a make. Each folder under protocols/ defines exactly one.
struct Plugin {
    std::string_view name;     // "silion"
    std::string_view title;    // "Silion active mode"
    std::string_view summary;  // one line for the table of makes
    std::span<const Scheme> schemes;
    std::span<const SettingRow> driver_settings;
    std::span<const SettingRow> device_settings;
    bool device_dials;  // the virtual reader dials out (else it listens)
    // Of a virtual reader that can do either: the setting that takes HOST:PORT and makes it dial there, with
    // no other link.
    std::string_view dial_setting = {};
    bool notifies;  // its readers can dial in with notifications beside the first link
    std::span<const std::string_view> models;  // known by name; empty: the make has no such choice
    std::span<const ParameterRow> parameters;  // of GetParameter and SetParameter
    // What GetParameter would show of `typed` once it is set, or why it cannot be. nullptr: numbers and names
    // of the row's enumeration are checked by the row, all else is taken as it is.
    Result<wire::Value> (*parse_parameter)(const ParameterRow& row, const std::string& typed) = nullptr;
    // Of Execute: what these do to a tag cannot be undone, so whoever sends one confirms it.
    std::span<const std::string_view> final_commands = {};
    std::string_view sample_toml;  // what `gantry config example MAKE` prints

    bool is_final(std::string_view command) const {
        for (auto& each : final_commands)
            if (alike(each, command)) return true;
        return false;
    }

    const wire::Codec& (*codec)();
    std::unique_ptr<Driver> (*make_driver)(const DriverOptions& options);
    std::unique_ptr<Device> (*make_device)(const DeviceOptions& options, Air& air);
    // The name of an antenna in the make's own terms, from Observation::antenna. Names must differ.
    std::string (*antenna_name)(std::uint16_t antenna);
    // The kind of tags that the virtual reader sees with these settings; nullptr: Gen2.
    event::Technology (*device_tags)(const Settings& device_settings) = nullptr;
    // What can go wrong with the virtual reader on request; nullptr: nothing.
    std::span<const FaultWord> (*faults)() = nullptr;
};

}  // namespace gantry
