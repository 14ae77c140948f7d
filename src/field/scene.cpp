#include "field/scene.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <unordered_map>

#include "field/access_air.hpp"
#include "field/listening.hpp"

namespace gantry::field {

namespace {
// The setting of a virtual reader that an antenna's power_dbm is said for.
constexpr double usual_power_dbm = 27;
}  // namespace

// From the caller's time to the scene's.
struct SceneClock {
    Steady start;
    double speed;

    SceneTime scene(Steady at) const {
        auto since = (at - start).count();
        if (speed == 1) return SceneTime(since);
        return SceneTime(static_cast<std::int64_t>(std::floor(static_cast<long double>(since) * speed)));
    }
    Steady steady(SceneTime at) const {
        if (speed == 1) return start + at;
        auto since = std::floor(static_cast<long double>(at.count()) / speed);
        return start + std::chrono::nanoseconds(static_cast<std::int64_t>(since));
    }
};

using TagsById = std::unordered_multimap<event::TagId, std::uint32_t, event::TagIdHash>;

class SceneAir final : public AccessAir {
public:
    SceneAir(std::mutex& mutex, World& world, TagsById& by_id, const SceneClock& clock, std::size_t reader)
        : AccessAir(mutex),
          world_(world),
          by_id_(by_id),
          clock_(clock),
          spec_(world.scenario().readers[reader]),
          first_(world.first_antenna(reader)) {}

    void inventory(const Carrier& carrier, Steady from, Steady to, std::vector<AirSighting>& out) override {
        std::lock_guard lock(mutex());
        if (carrier.antenna == 0 || carrier.antenna > spec_.antennas.size()) return;
        if (carrier.dwell.count() > 0) from = std::max(from, to - carrier.dwell);
        if (from >= to || !std::isfinite(carrier.power_dbm)) return;
        Rounds rounds{.turned_db = carrier.power_dbm - usual_power_dbm,
                      .session = std::min<std::uint8_t>(carrier.session.value_or(spec_.session), 3),
                      .q = std::min<std::uint8_t>(carrier.q.value_or(spec_.q), 15),
                      .mode = spec_.mode,
                      .anticollision = spec_.anticollision && carrier.anticollision};
        heard_.clear();
        listening(carrier.antenna, rounds.session).hear(rounds, clock_.scene(from), clock_.scene(to), heard_);
        for (auto& read : heard_) {
            auto& memory = *world_.tags()[read.tag].memory;
            auto rssi = std::clamp(static_cast<double>(read.rssi_dbm), -120.0, 20.0);
            auto at = std::clamp(clock_.steady(read.at), from, to - std::chrono::nanoseconds{1});
            out.push_back({memory.id(), memory.technology(),
                           static_cast<std::int16_t>(std::lround(rssi * 10)), at, read.phase});
        }
    }

    std::vector<std::uint16_t> antennas() const override {
        std::vector<std::uint16_t> all(spec_.antennas.size());
        for (std::size_t i = 0; i < all.size(); ++i)
            all[i] = static_cast<std::uint16_t>(i + 1);
        return all;
    }
    bool anticollision() const override { return spec_.anticollision; }

private:
    TagMemory* reach(const AirAccess& access) override {
        auto antenna = access.carrier.antenna;
        if (antenna == 0 || antenna > spec_.antennas.size()) return nullptr;
        auto turned_db = access.carrier.power_dbm - usual_power_dbm;
        auto [from, to] = by_id_.equal_range(access.tag);
        for (auto it = from; it != to; ++it) {
            auto found =
                world_.powered(it->second, first_ + antenna - 1, turned_db, clock_.scene(access.now));
            // A tag that was heard is not lost to a hand's breadth of difference.
            static constexpr double benefit_db = 2;
            if (!found)
                found = world_.powered(it->second, first_ + antenna - 1, turned_db + benefit_db,
                                       clock_.scene(access.now));
            if (!found) continue;
            auto& memory = *world_.tags()[it->second].memory;
            memory.power_up(found->spare_db >= write_extra_db);
            return &memory;
        }
        return nullptr;
    }
    void renamed(const event::TagId& before, const TagMemory& memory) override {
        auto [from, to] = by_id_.equal_range(before);
        auto found = std::find_if(
            from, to, [&](auto& each) { return world_.tags()[each.second].memory.get() == &memory; });
        if (found == to) return;
        auto tag = found->second;
        by_id_.erase(found);
        by_id_.emplace(memory.id(), tag);
    }

    Listening& listening(std::uint16_t antenna, std::uint8_t session) {
        bool hf = spec_.antennas[antenna - 1U].band == Band::hf;
        auto& found = listenings_[{antenna, hf ? std::uint8_t{0} : session}];
        if (found) return *found;
        auto number = first_ + antenna - 1;
        if (hf) {
            found = listen_hf(world_, number);
        } else {
            auto& flags = flags_[session];
            if (session != 0 && !flags) flags = std::make_unique<SessionFlags>(session, world_.tags().size());
            found = listen_gen2(world_, number, flags.get());
        }
        return *found;
    }

    World& world_;
    TagsById& by_id_;
    const SceneClock& clock_;
    const ReaderSpec& spec_;
    std::size_t first_;  // its first antenna in the world
    std::unique_ptr<SessionFlags> flags_[4];
    std::map<std::pair<std::uint16_t, std::uint8_t>, std::unique_ptr<Listening>> listenings_;
    std::vector<SceneRead> heard_;
};

struct Scene::Impl {
    Impl(const Scenario& scenario, SceneClock its_clock) : world(scenario), clock(its_clock) {}

    mutable std::mutex mutex;
    World world;
    SceneClock clock;
    TagsById by_id;
    std::vector<std::unique_ptr<SceneAir>> airs;
};

Scene::Scene(const Scenario& scenario, Steady start, double speed)
    : impl_(std::make_unique<Impl>(scenario, SceneClock{start, std::clamp(speed, 0.001, 1000.0)})) {
    auto& world = impl_->world;
    for (std::uint32_t i = 0; i < world.tags().size(); ++i)
        impl_->by_id.emplace(world.tags()[i].memory->id(), i);
    for (std::size_t i = 0; i < world.scenario().readers.size(); ++i)
        impl_->airs.push_back(std::make_unique<SceneAir>(impl_->mutex, world, impl_->by_id, impl_->clock, i));
}
Scene::~Scene() = default;

const Scenario& Scene::scenario() const {
    return impl_->world.scenario();
}

Air& Scene::air(std::size_t reader) {
    return *impl_->airs[reader];
}
Air* Scene::air(std::string_view reader) {
    auto& readers = scenario().readers;
    auto found = std::ranges::find(readers, reader, &ReaderSpec::name);
    return found == readers.end() ? nullptr : &air(static_cast<std::size_t>(found - readers.begin()));
}

std::size_t Scene::tags() const {
    return impl_->world.tags().size();
}

std::vector<Scene::TagView> Scene::look(Steady at) const {
    std::lock_guard lock(impl_->mutex);
    auto& world = impl_->world;
    auto time = impl_->clock.scene(at);
    std::vector<TagView> views;
    for (std::uint32_t i = 0; i < world.tags().size(); ++i) {
        auto& tag = world.tags()[i];
        TagView view{tag.memory->id(), tag.group, {}, false};
        if (auto where = world.where(i, time)) view.place = tag.place + where->offset;
        views.push_back(view);
    }
    std::size_t antennas = 0;
    for (auto& reader : world.scenario().readers)
        antennas += reader.antennas.size();
    std::vector<Powered> powered;
    for (std::size_t antenna = 0; antenna < antennas; ++antenna) {
        world.still(antenna, 0, time, powered);
        world.moving(antenna, 0, time, powered);
    }
    for (auto& each : powered)
        views[each.tag].powered = true;
    return views;
}

}  // namespace gantry::field
