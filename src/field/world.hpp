#pragma once
#include <memory>
#include <vector>

#include "field/memory.hpp"
#include "field/propagation.hpp"

namespace gantry::field {

// A tag of a scenario.
struct SceneTag {
    std::unique_ptr<TagMemory> memory;
    std::uint64_t key = 0;  // all its chances come from it
    std::uint32_t group = 0;
    Vec place, axis;
    double sensitivity_dbm = -18, loss_db = 0;
    std::optional<Motion> motion;
};

// A tag that has power at an antenna.
struct Powered {
    std::uint32_t tag = 0;
    float rssi_dbm = 0;
    float spare_db = 0;  // above what it needs to answer
};

// The things of a scenario in space: what each antenna reaches at a time. Changes only in the tags' memories.
class World {
public:
    explicit World(const Scenario& scenario);

    const Scenario& scenario() const { return scenario_; }
    std::vector<SceneTag>& tags() { return tags_; }
    const std::vector<SceneTag>& tags() const { return tags_; }
    const Surroundings& air() const { return air_; }
    std::uint64_t seed() const { return scenario_.seed; }

    // Antennas are counted through all readers here, from 0.
    std::size_t first_antenna(std::size_t reader) const { return first_antennas_[reader]; }
    const Beam& beam(std::size_t antenna) const { return antennas_[antenna].beam; }

    std::optional<Whereabouts> where(std::uint32_t tag, SceneTime time) const;
    // Appends the tags that have power at an antenna, by number: those that never move, and those that may.
    // `turned_db`: how far the reader's power is turned up or down from its usual setting.
    void still(std::size_t antenna, double turned_db, SceneTime time, std::vector<Powered>& out) const;
    void moving(std::size_t antenna, double turned_db, SceneTime time, std::vector<Powered>& out) const;
    // One of them, with the same chances; nothing: it has no power there.
    std::optional<Powered> powered(std::uint32_t tag, std::size_t antenna, double turned_db,
                                   SceneTime time) const;
    // What a reader measures of one that has power.
    struct Signal {
        double rssi_dbm = 0;
        std::uint16_t phase = 0;
    };
    std::optional<Signal> signal(std::uint32_t tag, std::size_t antenna, double turned_db,
                                 SceneTime time) const;

private:
    // What can be said of a tag that stands still once and for all.
    struct Still {
        std::uint32_t tag;
        float way_db;             // HF: the coupling
        float spare_db;           // at the usual power, fading left out
        float least_db, most_db;  // the same with the worst and the best fading there may be
    };
    struct Antenna {
        Beam beam;
        std::vector<Still> still;           // those that it may ever reach, the best first
        std::vector<std::uint32_t> moving;  // the groups that it may ever reach
    };
    void add_group(std::uint32_t number);
    void add_antenna(const AntennaSpec& spec);
    double way(const SceneTag& tag, const Beam& beam, Vec place) const;
    double spare(const SceneTag& tag, const Beam& beam, double way_db) const;
    std::optional<Powered> fade(std::uint32_t tag, std::size_t antenna, double way_db, double spare_db,
                                double turned_db, const Whereabouts& where, SceneTime time) const;
    double rssi(const Beam& beam, double way_db, double turned_db) const;
    bool may_reach(const Antenna& antenna, std::uint32_t group) const;

    Scenario scenario_;
    Surroundings air_;
    std::vector<SceneTag> tags_;
    std::vector<std::uint32_t> group_starts_;  // number of each group's first tag, and one past the last
    std::vector<Antenna> antennas_;
    std::vector<std::size_t> first_antennas_;
};

bool is_hf(event::Technology technology);

}  // namespace gantry::field
