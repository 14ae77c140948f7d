#pragma once
#include <memory>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "event/event.hpp"

namespace gantry::presence {

// Which tag is where, by the rules of docs/presence.md. State is kept per zone and tag and is
// evaluated at each sighting and each deadline (>=) on the steady clock. No I/O, no clock of its own.

struct Rules {
    std::chrono::microseconds glimpse_timeout =
        2s;  // an unobserved tag is purged this long after its last sighting
    std::chrono::microseconds observe_after = 0s;  // last minus first sighting; 0 and no count: at once
    std::uint32_t observe_after_reads = 0;         // 0: not by count
    std::chrono::microseconds lose_after = 2s;     // since the last sighting
    std::chrono::microseconds purge_after = 1h;    // since it was lost
    std::optional<std::chrono::microseconds> offline_lose_after =
        {};                        // all its readers offline this long; default never
    bool glimpsed_events = false;  // also emit tag.glimpsed
    friend bool operator==(const Rules&, const Rules&) = default;
};

// Dense numbers the host gives out; the host knows their names.
using ZoneIndex = std::uint32_t;
using ReaderIndex = std::uint32_t;

enum class State : std::uint8_t { glimpsed = 1, observed = 2, lost = 3 };  // stored: append only

// One tag in one zone. What the host stores at every transition and refreshes now and then; after a restart
// it gives them back to restore().
struct Record {
    std::uint64_t id = 0;  // unique among all records of a store, for ever
    State state{};
    event::Technology technology{};
    bool first_is_new = true;  // a tag.new was sent for this life and no tag.lost or tag.purged has ended it
    ZoneIndex zone = 0;
    ReaderIndex reader = 0;  // of the last sighting, as are antenna and rssi
    std::uint16_t antenna = 0;
    event::Rssi rssi = {};
    std::uint16_t pc = 0;   // of the last sighting that said it; see event::TagWords
    std::uint32_t xpc = 0;  // the same
    std::uint64_t reads = 0;
    Wall first_seen{}, last_seen{};
    event::TagId tag = {};
};

struct Sighting {
    event::TagId tag = {};
    event::Technology technology{};
    ZoneIndex zone = 0;
    ReaderIndex reader = 0;
    std::uint16_t antenna = 0;
    event::Rssi rssi = {};
    std::optional<std::uint16_t> pc = {};
    std::optional<std::uint32_t> xpc = {};  // 0: the tag has none
    std::uint32_t reads = 1;
};

// Something that becomes an event. The record is as it was at that moment.
struct Transition {
    event::Type type{};
    Wall time{};  // of the sighting, or when the deadline fell
    Record record;
    std::string_view reason =
        {};              // tag.lost, tag.purged: "glimpse_timeout", "reader_offline", "capacity", or empty
    ZoneIndex from = 0;  // tag.moved; `to` is record.zone
};

class Presence {
public:
    // At most `max_records` tags and zones are remembered: at the bound lost tags are purged first, then the
    // one whose deadline is nearest is lost and purged, with reason "capacity". `first_id`: above all ids in
    // the store.
    explicit Presence(std::size_t max_records = 2'000'000, std::uint64_t first_id = 1);
    ~Presence();

    ZoneIndex add_zone(const Rules& rules);
    void set_rules(ZoneIndex zone, const Rules& rules);
    ReaderIndex add_reader();  // starts offline

    // Timers of a record freeze while all readers that saw it (in its zone, in this life) are offline.
    void reader_online(ReaderIndex reader, Now now);
    void reader_offline(ReaderIndex reader, Now now);

    // Puts back what was stored, with the readers that saw it. Counts as last seen at `now`; frozen until one
    // of its readers is online.
    void restore(const Record& record, std::span<const ReaderIndex> readers, Now now);

    void sighted(const Sighting& sighting, Now now, std::vector<Transition>& out);
    void time_passed(Now now, std::vector<Transition>& out);
    std::optional<Steady> deadline() const;

    // What changed in storage since the last call: records to store whole, and ids to delete.
    struct Changes {
        std::vector<std::uint64_t> stored;  // look up with find()
        std::vector<std::uint64_t> deleted;
    };
    void take_changes(Changes& out);
    // Up to `max` ids of records seen since they were last stored (the counts and times of still tags),
    // taking turns so that every record has its turn.
    void take_stale(std::size_t max, std::vector<std::uint64_t>& out);
    const Record* find(std::uint64_t id) const;
    void readers_of(std::uint64_t id, std::vector<ReaderIndex>& out) const;

    std::size_t size() const;     // records remembered
    std::size_t present() const;  // glimpsed or observed

private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace gantry::presence
