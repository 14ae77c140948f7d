#pragma once
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.hpp"
#include "reader/air.hpp"

// The virtual RF field: tags with memory, antennas, tags that enter, move and leave. Deterministic: the same
// seed and the same times give the same sightings. Time is an argument; thread-safe, because readers on
// several loops look into one field.
namespace gantry::field {

// A tag as a file or a scenario describes it; what is left out gets sensible values.
struct TagSpec {
    event::TagId id;
    event::Technology technology = event::Technology::epc_gen2;
    Bytes tid;  // Gen2; empty: one is made from the id
    // Empty: 32 zero bytes, ISO 15693: 112. Of ISO 18000-6B what follows the id, empty: 216 zero bytes. Of
    // ICODE1 all 16 blocks, though the first two hold the id.
    Bytes user;
    std::uint32_t access_password = 0;      // Gen2
    std::uint32_t kill_password = 0;        // Gen2; the lower half is the kill code of EPC Gen1
    std::optional<std::uint16_t> xpc = {};  // Gen2: XPC_W1; none: the tag has no such word
};

// The CSV of `gantry emulate --tags FILE`: any of epc,tid,user,access_password,kill_password,
// technology,antenna,rssi_dbm,xpc, with a header. Errors name file:line and the column.
struct PlacedTag {
    TagSpec tag;
    std::uint16_t antenna = 1;  // from 1
    // The mean strength at which a reader hears it that sends 27 dBm (0.5 W). Each dB more or less of power
    // is a dB more or less here. The tag answers from -75 dBm on, and in any case to 27 dBm or more: its
    // strength there is given, so it is heard there. Writing, locking, killing and programming need -72 dBm.
    // Traffic follows the same rule; the ends of a visit, where it sounds weaker, do not count.
    std::optional<double> rssi_dbm;
};
Result<std::vector<PlacedTag>> read_tags_csv(std::string_view text, std::string_view file_name);

// The handful of SGTIN-96 tags that a virtual reader has when nobody says otherwise; different ones per
// `reader`.
std::vector<PlacedTag> default_tags(std::uint32_t reader = 0);
// The same for a reader of HF tags, which reads one at a time: one tag with an id of that kind.
std::vector<PlacedTag> default_hf_tags(event::Technology technology, std::uint32_t reader = 0);
// HF tags with ids of their own for each seed, for TrafficSpec::pool.
std::vector<TagSpec> hf_tags(event::Technology technology, std::uint64_t seed, std::uint32_t count);

// Tags that come and go in front of one reader's antennas: each visits one antenna after another, then is
// away for a while. The defaults make a lively demo.
struct TrafficSpec {
    std::uint64_t seed = 1;
    std::uint32_t tags = 12;
    std::chrono::milliseconds stay_min = 3s, stay_max = 12s;  // on one antenna
    std::chrono::milliseconds away_min = 2s, away_max = 10s;
    std::uint32_t visits_max = 2;  // antennas one after another in one pass
    std::vector<TagSpec> pool;     // empty: SGTIN-96 tags are made from the seed
};

class Field {
public:
    Field();
    ~Field();

    // A reader's place in the field. Antennas count from 1 for each reader. The Air lives as long as the
    // field. `reads_per_second` bounds how often each antenna hears one tag while it is there.
    Air& add_reader(std::string_view name, std::uint16_t antennas, double reads_per_second_per_tag = 5.0);

    void place(Air& air, const PlacedTag& tag);  // stands still
    void remove(Air& air, const event::TagId& tag);
    void add_traffic(Air& air, const TrafficSpec& traffic, Steady start);

    std::size_t tags() const;

private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace gantry::field
