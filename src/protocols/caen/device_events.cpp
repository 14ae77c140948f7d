#include "protocols/caen/device_events.hpp"

#include <algorithm>

namespace gantry::caen {

static std::uint64_t at_least_one(std::uint32_t threshold) {
    return std::max<std::uint64_t>(threshold, 1);
}

static std::uint64_t milliseconds(Steady::duration passed) {
    auto count = std::chrono::duration_cast<std::chrono::milliseconds>(passed).count();
    return static_cast<std::uint64_t>(std::max<std::int64_t>(count, 0));
}

void SourceEvents::see(const event::TagId& id, Steady now, const Rules& rules, std::vector<Item>& out) {
    auto known = tags_.find(id);
    if (known == tags_.end()) {
        if (tags_.size() >= max_tags) return;
        known = tags_.try_emplace(id).first;
        known->second.first = now;
        out.push_back({id, TagEvent::is_new});
    }
    auto& tag = known->second;
    if (tag.state == State::lost) {
        tag.state = State::glimpsed;
        tag.seen = 0;
        tag.first = now;
        out.push_back({id, TagEvent::glimpsed});
    }
    ++tag.seen;
    tag.last_cycle = cycle_;
    tag.last = now;
    if (tag.state == State::observed) return;
    bool enough = rules.mode == EventMode::time ? milliseconds(now - tag.first) >= rules.observed
                                                : tag.seen >= at_least_one(rules.observed);
    if (!enough) return;
    tag.state = State::observed;
    tag.was_observed = true;
    out.push_back({id, TagEvent::observed});
}

// True: it is forgotten.
bool SourceEvents::miss(const event::TagId& id, Tag& tag, Steady now, const Rules& rules,
                        std::vector<Item>& out) const {
    auto away = rules.mode == EventMode::time ? milliseconds(now - tag.last) : cycle_ - tag.last_cycle;
    auto threshold = at_least_one(rules.lost);
    if (away < threshold) return false;
    if (tag.state == State::glimpsed && !tag.was_observed) {
        out.push_back({id, TagEvent::purged});
        return true;
    }
    if (tag.state == State::observed) out.push_back({id, TagEvent::lost});
    tag.state = State::lost;
    if (away < 2 * threshold) return false;
    out.push_back({id, TagEvent::purged});
    return true;
}

void SourceEvents::cycle(const std::vector<event::TagId>& heard, Steady now, const Rules& rules,
                         std::vector<Item>& out) {
    if (rules.mode != mode_) tags_.clear();
    mode_ = rules.mode;
    ++cycle_;
    for (auto& id : heard) {
        if (rules.mode == EventMode::none)
            out.push_back({id, TagEvent::unknown});
        else
            see(id, now, rules, out);
    }
    for (auto each = tags_.begin(); each != tags_.end();) {
        bool missed = each->second.last_cycle != cycle_;
        each =
            missed && miss(each->first, each->second, now, rules, out) ? tags_.erase(each) : std::next(each);
    }
}

}  // namespace gantry::caen
