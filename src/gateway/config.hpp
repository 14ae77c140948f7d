#pragma once
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.hpp"
#include "journal/journal.hpp"
#include "presence/presence.hpp"
#include "reader/plugin.hpp"
#include "sink/selection.hpp"
#include "sink/shape.hpp"
#include "sink/sink.hpp"

namespace gantry::gateway {

// A reader's address: "silion-listen://0.0.0.0:9055", "caen://192.168.0.125:1000",
// "dagprog:///dev/ttyUSB0?baud=38400".
struct Address {
    const Plugin* plugin = nullptr;
    const Scheme* scheme = nullptr;
    std::string host;                                          // dial, listen
    std::uint16_t port = 0;                                    // the scheme's default filled in
    std::string path;                                          // serial
    std::vector<std::pair<std::string, std::string>> options;  // ?name=value
    std::string text;                                          // as written
};
Result<Address> parse_address(std::string_view url);

struct AntennaConfig {
    std::string name;  // in the make's own terms, "Ant1"
    std::string zone;
};

struct ReaderConfig {
    std::string name;  // may hold * for readers that dial in
    Address address;
    std::string zone;  // empty: events of this reader have no zone
    std::vector<AntennaConfig> antennas;
    std::vector<std::string> from;  // networks a reader may dial in from; empty: any
    std::string model;              // empty: what the reader says
    std::string notify;             // "0.0.0.0:3000", where it dials in with notifications; empty: nowhere
    std::string advertise;          // what the reader is told that address is; empty: found out
    Settings settings;              // the make's own
};

struct ZoneConfig {
    std::string name;
    presence::Rules rules;
};

// A destination of events.
struct SinkConfig {
    std::string name;
    const sink::Kind* kind = nullptr;
    std::string url;           // empty where the kind takes none
    bool from_oldest = false;  // where a sink that is new begins: at the oldest event, or now
    sink::Selection selection;
    sink::Shape shape = sink::Shape::native;
    std::size_t batch = 1000;                 // the most events of one call
    std::uint64_t max_rate = 0;               // events a second; 0: as fast as it goes
    std::chrono::microseconds timeout = 30s;  // of one call
    std::chrono::microseconds retry_min = 1s, retry_max = 30s;
    std::uint64_t tries = 1;  // an event that is refused so often becomes a dead letter
    bool commands = false;    // requests of the API may come in over it
    Settings settings;        // the kind's own
};

struct Config {
    std::string gateway_id;  // empty: generated once and kept
    std::filesystem::path data_dir;
    std::vector<ReaderConfig> readers;
    presence::Rules presence;
    std::vector<ZoneConfig> zones;  // what differs from `presence`
    bool tag_read = false;
    bool tag_glimpsed = false;
    std::vector<SinkConfig> sinks;
    journal::Options store;             // path is data_dir / "gantry.db"
    std::vector<std::string> warnings;  // "gantry.toml:12:1: …": accepted, but the user should know
};

// What `gantry run` uses with no file: data in /var/lib/gantry for root, else $XDG_STATE_HOME/gantry (or
// ~/.local/state/gantry).
Config default_config();

// All errors found, each "file:line:column: what; hint", one a line.
Result<Config> parse_config(std::string_view toml, std::string_view file_name);
Result<Config> load_config(const std::filesystem::path& file);
// Where that gateway keeps its data. What the file says of the rest may be wrong or out of reach, as its
// secrets are for most users.
Result<std::filesystem::path> load_data_dir(const std::filesystem::path& file);

std::vector<std::string_view> sink_kind_names();
std::string config_schema();  // JSON Schema, from the same rows the checker reads
// Of a make or a kind of sink: its sample. Empty: the whole example.
Result<std::string> config_example(std::string_view name);

}  // namespace gantry::gateway
