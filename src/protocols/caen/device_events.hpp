#pragma once
#include <unordered_map>
#include <vector>

#include "base/time.hpp"
#include "event/event.hpp"

namespace gantry::caen {

// Values of EventType and EventMode (section 4).
enum class TagEvent : std::uint32_t {
    unknown = 0,
    glimpsed = 1,
    is_new = 2,
    observed = 3,
    lost = 4,
    purged = 5
};
enum class EventMode : std::uint32_t { read_cycle = 0, time = 1, none = 2 };

// The events of one source's tags. What the manual leaves open is chosen after the EPCglobal draft that it
// names: first seen is new; seen for the observed threshold is observed; away for the lost threshold is lost
// (or purged, if it never was observed) and after the same time again purged; back from lost is glimpsed.
// Thresholds are read cycles, in time mode milliseconds; 0 counts as 1.
class SourceEvents {
public:
    struct Rules {
        EventMode mode = EventMode::read_cycle;
        std::uint32_t observed = 1, lost = 1;
    };
    struct Item {
        event::TagId tag;
        TagEvent event;
    };
    // One read cycle: who was heard, each once. Appends what happened.
    void cycle(const std::vector<event::TagId>& heard, Steady now, const Rules& rules,
               std::vector<Item>& out);

    std::size_t size() const { return tags_.size(); }

private:
    enum class State : std::uint8_t { glimpsed, observed, lost };
    struct Tag {
        State state = State::glimpsed;
        bool was_observed = false;
        std::uint64_t seen = 0, last_cycle = 0;
        Steady first{}, last{};
    };
    static constexpr std::size_t max_tags = 10'000;  // more at once are passed over

    void see(const event::TagId& id, Steady now, const Rules& rules, std::vector<Item>& out);
    bool miss(const event::TagId& id, Tag& tag, Steady now, const Rules& rules, std::vector<Item>& out) const;

    std::unordered_map<event::TagId, Tag, event::TagIdHash> tags_;
    EventMode mode_ = EventMode::read_cycle;
    std::uint64_t cycle_ = 0;
};

}  // namespace gantry::caen
