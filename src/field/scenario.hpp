#pragma once
#include <chrono>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/bytes.hpp"
#include "base/error.hpp"
#include "document/document.hpp"
#include "event/event.hpp"
#include "field/geometry.hpp"

// A scene as a file describes it (docs/field.md): readers with antennas, tags that stand or move. Plain data,
// checked; Scene brings it to life.
namespace gantry::field {

struct Located {
    std::string text;
    document::Place at;  // in the file, for whoever finds fault with it
};

enum class Band : std::uint8_t { uhf, hf };

struct AntennaSpec {
    std::string name;
    Vec position, towards;  // where it is, and a point that it looks at
    Band band = Band::uhf;
    double gain_dbi = 8;
    double beam = 0;        // degrees between the half power points
    double power_dbm = 30;  // what the reader feeds it at its usual setting, see Carrier::power_dbm
    double reach = 0.3;     // HF: metres at which a tag that faces it still answers
};

// How fast a Gen2 reader and tags talk (gen2.hpp).
enum class LinkMode : std::uint8_t { fast, balanced, dense };

struct ReaderSpec {
    std::string name;
    document::Place at;
    std::string make = "any";
    std::optional<Located> connect, listen, pty;
    std::vector<std::pair<std::string, Located>> settings;  // of the virtual reader, as --set takes them
    std::uint8_t session = 0, q = 4;
    LinkMode mode = LinkMode::balanced;
    bool anticollision = true;
    std::vector<AntennaSpec> antennas;
};

// Along a path, at a steady pace, from tag to tag a little later.
struct MotionSpec {
    std::vector<Vec> path;  // offsets from a tag's own place
    std::chrono::microseconds lasts{}, starts{};
    std::chrono::microseconds interval{};  // each tag this much after the one before it
    double spread = 0;                     // the pace of one tag differs from another's by so much, 0.1: 10 %
    std::optional<std::chrono::microseconds> every;  // and all over again
    bool stays = false;  // before and after it waits at the ends of the path; else it is not there
};

struct TagGroup {
    std::string name;
    std::uint32_t count = 1;
    event::Technology technology = event::Technology::epc_gen2;
    Bytes first_id;                     // the others count up from it; empty: ids are made
    Vec position;                       // of the first
    std::uint32_t grid[3] = {1, 1, 1};  // so many along x, y and z
    Vec spacing{0.1, 0.1, 0.1};
    double jitter = 0;        // metres that each may be off its place, either way
    std::optional<Vec> axis;  // of the dipole, or across the coil; nothing: each its own way
    double sensitivity_dbm = -18, spread_db = 1.5, loss_db = 0;
    std::optional<MotionSpec> motion;
};

enum class Region : std::uint8_t { eu, us };

struct Scenario {
    std::string name, about;
    std::uint64_t seed = 1;
    std::chrono::microseconds lasts{};  // how much of it is worth looking at
    Region region = Region::eu;
    double path_loss = 2.2;  // exponent beyond the first metre
    double echo_db = 8;      // how much weaker than the direct way all echoes together are
    std::vector<ReaderSpec> readers;
    std::vector<TagGroup> groups;

    std::size_t tags() const;
};

// Errors are "file:line:column: what; hint", all of them at once. `makes`: the names that a reader's make may
// have.
Result<Scenario> parse_scenario(std::string_view toml, std::string_view file_name,
                                std::span<const std::string_view> makes);

std::string_view name_of(LinkMode mode);

}  // namespace gantry::field
