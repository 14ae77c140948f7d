#include "field/survey.hpp"

#include <algorithm>

namespace gantry::field {

// How long a reader stays on one of several antennas.
static constexpr std::chrono::milliseconds dwell{100};

static bool before(const std::pair<event::TagId, std::size_t>& a,
                   const std::pair<event::TagId, std::size_t>& b) {
    return std::ranges::lexicographical_compare(a.first.view(), b.first.view());
}

Survey::Survey(Scene& scene, Steady start, double turned_db)
    : scene_(scene), start_(start), now_(start), turned_db_(turned_db) {
    for (auto& reader : scene.scenario().readers) {
        readers_.push_back({0, 0, std::vector<std::uint64_t>(reader.antennas.size())});
        seen_.emplace_back(scene.tags());
    }
    tags_.resize(scene.tags());
    for (auto& view : scene.look(start)) {
        by_id_.emplace_back(view.id, by_id_.size());
        groups_.push_back(view.group);
    }
    std::ranges::stable_sort(by_id_, before);
}

void Survey::run_to(Steady to) {
    while (now_ < to) {
        auto turn = (now_ - start_) / dwell;
        auto until = std::min<Steady>(to, start_ + (turn + 1) * dwell);
        for (std::size_t reader = 0; reader < readers_.size(); ++reader) {
            auto antennas = readers_[reader].by_antenna.size();
            auto antenna = static_cast<std::size_t>(turn) % antennas + 1;
            hear(reader, static_cast<std::uint16_t>(antenna), now_, until);
        }
        now_ = until;
    }
}

void Survey::hear(std::size_t reader, std::uint16_t antenna, Steady from, Steady to) {
    static constexpr double usual_dbm = 27;
    heard_.clear();
    scene_.air(reader).inventory({.antenna = antenna, .power_dbm = usual_dbm + turned_db_}, from, to, heard_);
    for (auto& sighting : heard_) {
        auto found = std::ranges::lower_bound(by_id_, std::pair(sighting.tag, std::size_t{0}), before);
        if (found == by_id_.end() || !(found->first == sighting.tag)) continue;  // somebody writes ids
        auto& tag = tags_[found->second];
        ++tag.reads;
        tag.last = {reader, antenna, sighting.rssi / 10.0, sighting.at};
        ++readers_[reader].reads;
        ++readers_[reader].by_antenna[antenna - 1U];
        if (!seen_[reader][found->second]) ++readers_[reader].tags;
        seen_[reader][found->second] = true;
    }
}

std::size_t Survey::read_of(std::uint32_t group) const {
    std::size_t count = 0;
    for (std::size_t i = 0; i < tags_.size(); ++i)
        count += groups_[i] == group && tags_[i].reads > 0 ? 1 : 0;
    return count;
}

}  // namespace gantry::field
