#include "gateway/config_rows.hpp"

#include <algorithm>
#include <array>
#include <stdexcept>
#include <string>

namespace gantry::gateway {

namespace {
using Kind = ConfigRow::Kind;

constexpr std::int64_t ms = 1'000;  // durations are in microseconds
constexpr std::int64_t second = 1'000 * ms;
constexpr std::int64_t mib = 1 << 20;

constexpr std::array gateway_rows = {
    ConfigRow{"id", Kind::name, "",
              "The first part of every event's id. Left out: made at the first start and kept.", "site-7",
              false, 1, 64},
    ConfigRow{"data_dir", Kind::name, "",
              "Where gantry.db and gantry.sock lie. Left out: /var/lib/gantry for root, else "
              "$XDG_STATE_HOME/gantry.",
              "/var/lib/gantry", false, 1, 4000},
};

constexpr std::array reader_rows = {
    ConfigRow{"name", Kind::name, "",
              "How events call the reader. For readers that dial in: their own name, where * stands for any "
              "characters.",
              "dock-1", true, 1, 255},
    ConfigRow{"address", Kind::name, "", "How to reach it, or where it dials in.", "SCHEME://HOST:PORT", true,
              1, 1000},
    ConfigRow{"zone", Kind::name, "", "Where its tags are. Left out: its events have no zone.", "dock", false,
              1, 255},
    ConfigRow{"from", Kind::texts, "", "For readers that dial in: the networks that may. Left out: any.",
              "192.168.0.0/24"},
    ConfigRow{"model", Kind::name, "", "The reader's model. Left out: what the reader says.", "MODEL", false,
              1, 64},
    ConfigRow{"notify", Kind::name, "",
              "Where the reader dials in with notifications, for makes whose readers do.", "0.0.0.0:3000",
              false, 1, 300},
    ConfigRow{"advertise", Kind::name, "",
              "What the reader is told that address is. Left out: our address on the link to it.",
              "192.168.0.10:3000", false, 1, 300},
};

constexpr std::array antenna_rows = {
    ConfigRow{"name", Kind::name, "", "The antenna as the make calls it.", "Ant1", true, 1, 64},
    ConfigRow{"zone", Kind::name, "", "Where this antenna's tags are, if not in the reader's zone.",
              "dock/left", true, 1, 255},
};

constexpr ConfigRow glimpse_timeout{
    "glimpse_timeout",
    Kind::duration,
    "2s",
    "A tag that was never observed is forgotten this long after it was last seen.",
    "",
    false,
    ms};
constexpr ConfigRow observe_after{
    "observe_after", Kind::duration, "0s",
    "A tag is observed once it has been seen over this span; 0s: at once, or by the reads alone."};
constexpr ConfigRow observe_after_reads{"observe_after_reads",
                                        Kind::count,
                                        "0",
                                        "Or once it has been seen this often; 0: not by count.",
                                        "",
                                        false,
                                        0,
                                        1'000'000};
constexpr ConfigRow lose_after{
    "lose_after", Kind::duration, "2s", "An observed tag is lost this long after it was last seen.",
    "",           false,          ms};
constexpr ConfigRow purge_after{
    "purge_after", Kind::duration, "1h",
    "A lost tag that comes back within this time is no new tag, after it is one."};
constexpr ConfigRow offline_lose_after{
    "offline_lose_after",
    Kind::duration_or_never,
    "never",
    "Time stands still for tags whose readers are all offline, but after this long they are lost.",
    "",
    false,
    ms};

constexpr std::array presence_rows = {glimpse_timeout, observe_after, observe_after_reads,
                                      lose_after,      purge_after,   offline_lose_after};

constexpr ConfigRow zone_name{"name", Kind::name, "", "The zone, as readers and antennas name it.",
                              "dock", true,       1,  255};
// What a zone leaves out it has from [presence], so its rows have no fallback of their own.
constexpr ConfigRow inherited(ConfigRow row) {
    row.sample = row.fallback;
    row.fallback = {};
    return row;
}
constexpr std::array zone_rows = {zone_name,
                                  inherited(glimpse_timeout),
                                  inherited(observe_after),
                                  inherited(observe_after_reads),
                                  inherited(lose_after),
                                  inherited(purge_after),
                                  inherited(offline_lose_after)};

constexpr std::array event_rows = {
    ConfigRow{"tag_read", Kind::boolean, "false", "Keep every single read as an event, tag.read."},
    ConfigRow{"tag_glimpsed", Kind::boolean, "false", "Also say tag.glimpsed, at each first sighting."},
};

constexpr std::array<std::string_view, 2> on_full = {"hold_readers", "drop_oldest"};
constexpr std::array store_rows = {
    ConfigRow{"keep", Kind::duration, "30d", "Older events are deleted.", "", false, second},
    ConfigRow{"max_size", Kind::size, "8GiB", "How large the database file may grow.", "", false, mib},
    ConfigRow{"on_full", Kind::choice, "hold_readers",
              "At that size: take no more from the readers, or delete the oldest events and say so.", "",
              false, 0, 0, on_full},
};

constexpr std::array<std::string_view, 2> sink_start = {"now", "oldest"};
constexpr std::array<std::string_view, 2> sink_shapes = {"native", "cloudevents"};
constexpr std::array sink_rows = {
    ConfigRow{"name", Kind::name, "",
              "How it is called in `gantry sink list`; its place in the events hangs on it.", "broker", true,
              1, 64},
    ConfigRow{"type", Kind::name, "", "What kind of destination it is.", "mqtt", true, 1, 64},
    ConfigRow{"url", Kind::name, "", "Where it is, for kinds that are somewhere.", "mqtts://broker:8883",
              false, 1, 2000},
    ConfigRow{"start", Kind::choice, "now", "Where a new sink begins.", "", false, 0, 0, sink_start},
    ConfigRow{"types", Kind::texts, "",
              "Only these types of events, * stands for any characters. Left out: all.", "tag.*"},
    ConfigRow{"readers", Kind::texts, "", "Only events of these readers. Left out: all.", "dock-*"},
    ConfigRow{"zones", Kind::texts, "", "Only events in these zones. Left out: all.", "dock/*"},
    ConfigRow{"tags", Kind::texts, "",
              "Of events about tags only these: hex, or EPC URIs when they start with urn:. Left out: all.",
              "urn:epc:id:sgtin:0614141.*"},
    ConfigRow{"shape", Kind::choice, "native", "How events are written.", "", false, 0, 0, sink_shapes},
    ConfigRow{"batch", Kind::count, "", "The most events of one delivery. Left out: what suits the kind.",
              "1000", false, 1, 100'000},
    ConfigRow{"max_rate", Kind::count, "0", "The most events a second; 0: as fast as it goes.", "", false, 0,
              10'000'000},
    ConfigRow{"timeout", Kind::duration, "30s", "How long one delivery may take.", "", false, 100 * ms,
              3600 * second},
    ConfigRow{"retry_min", Kind::duration, "1s", "The first wait after a failure; it doubles with each.", "",
              false, ms, 3600 * second},
    ConfigRow{"retry_max", Kind::duration, "30s", "The longest wait.", "", false, ms, 86400 * second},
    ConfigRow{"tries", Kind::count, "1",
              "An event refused so often becomes a dead letter, and the next one goes.", "", false, 1, 1000},
    ConfigRow{"commands", Kind::boolean, "false", "Requests may come in over it, for kinds that have them."},
};

constexpr std::array api_rows = {
    ConfigRow{"listen", Kind::name, "",
              "Where the HTTP API answers. Not served by this version: it answers on gantry.sock only.",
              "127.0.0.1:8477", false, 1, 300},
};

constexpr std::array sections = {
    ConfigSection{"gateway", false, "This gateway.", gateway_rows},
    ConfigSection{"reader", true, "One reader, or all readers that dial in under a name.", reader_rows},
    ConfigSection{"reader.antenna", true, "An antenna with a zone of its own.", antenna_rows},
    ConfigSection{"presence", false, "When a tag counts as come and gone.", presence_rows},
    ConfigSection{"zone", true, "What is different in one zone; the rest is as in [presence].", zone_rows},
    ConfigSection{"events", false, "Events that are off unless asked for.", event_rows},
    ConfigSection{"store", false, "How long events are kept.", store_rows},
    ConfigSection{"sink", true, "A destination of events, beside the store.", sink_rows},
    ConfigSection{"api", false, "The API for programs and the page.", api_rows},
};
}  // namespace

std::span<const ConfigSection> config_sections() {
    return sections;
}

const ConfigSection& config_section(std::string_view path) {
    auto it = std::ranges::find(sections, path, &ConfigSection::path);
    if (it == sections.end()) throw std::logic_error("no section " + std::string(path));  // our own slip
    return *it;
}

}  // namespace gantry::gateway
