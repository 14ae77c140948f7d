#include "field/field.hpp"

#include <algorithm>
#include <mutex>
#include <unordered_map>

#include "field/access_air.hpp"
#include "field/hash.hpp"
#include "field/memory.hpp"
#include "field/path.hpp"
#include "field/radio.hpp"
#include "field/tags.hpp"

namespace gantry::field {

// Not in an unnamed namespace: Field::Impl, which others name, holds them.
struct Tag {
    std::unique_ptr<TagMemory> memory;
    std::unique_ptr<Path> path;
    std::uint64_t key = 0;  // from the id it came with; writing another does not change its ways
};

// One reader's place. All readers of a field share its mutex: each call is short.
class ReaderAir : public AccessAir {
public:
    ReaderAir(std::mutex& mutex, std::string_view name, std::uint16_t antennas, double reads_per_second)
        : AccessAir(mutex),
          name_key_(hash_of(as_bytes(name))),
          antennas_(antennas),
          radio_(reads_per_second) {}

    void inventory(const Carrier& carrier, Steady from, Steady to, std::vector<AirSighting>& out) override {
        auto antenna = carrier.antenna;
        std::lock_guard lock(mutex());
        if (antenna == 0 || antenna > antennas_ || from >= to) return;
        auto before = out.size();
        for (auto& tag : tags_) {
            auto& memory = *tag->memory;
            if (memory.is_killed()) continue;
            visits_.clear();
            tag->path->visits(from, to, visits_);
            for (auto& visit : visits_)
                if (visit.antenna == antenna)
                    radio_.hear(visit, carrier.power_dbm, tag->key, memory.id(), memory.technology(), from,
                                to, out);
        }
        std::sort(out.begin() + static_cast<std::ptrdiff_t>(before), out.end(), earlier);
    }

    std::vector<std::uint16_t> antennas() const override {
        std::vector<std::uint16_t> all(antennas_);
        for (std::size_t i = 0; i < all.size(); ++i)
            all[i] = static_cast<std::uint16_t>(i + 1);
        return all;
    }

    // The rest is for the field, which holds the mutex.
    std::size_t size() const { return tags_.size(); }
    std::uint16_t antenna_count() const { return antennas_; }
    std::uint64_t key_of(const event::TagId& id) const { return hash_of({name_key_, hash_of(id.view())}); }

    void add(const TagSpec& spec, std::unique_ptr<Path> path, std::uint64_t key) {
        tags_.push_back(std::make_unique<Tag>(Tag{make_memory(spec), std::move(path), key}));
        by_id_.emplace(tags_.back()->memory->id(), tags_.back().get());
    }
    void remove(const event::TagId& id) {
        auto found = by_id_.find(id);
        if (found == by_id_.end()) return;
        std::erase_if(tags_, [tag = found->second](auto& each) { return each.get() == tag; });
        by_id_.erase(found);
    }

private:
    // At one instant the order must not depend on how the time was sliced, nor on who was placed first.
    static bool earlier(const AirSighting& a, const AirSighting& b) {
        if (a.at != b.at) return a.at < b.at;
        return std::ranges::lexicographical_compare(a.tag.view(), b.tag.view());
    }

    TagMemory* reach(const AirAccess& access) override {
        auto antenna = access.carrier.antenna;
        auto power_dbm = access.carrier.power_dbm;
        if (antenna == 0 || antenna > antennas_) return nullptr;
        auto [from, to] = by_id_.equal_range(access.tag);
        for (auto it = from; it != to; ++it) {
            auto& tag = *it->second;
            if (tag.memory->is_killed()) continue;
            visits_.clear();
            tag.path->visits(access.now, access.now + std::chrono::nanoseconds{1}, visits_);
            auto here = std::ranges::find(visits_, antenna, &Visit::antenna);
            if (here == visits_.end() || !Radio::answers(*here, power_dbm)) continue;
            tag.memory->power_up(Radio::can_write(*here, power_dbm));
            return tag.memory.get();
        }
        return nullptr;
    }
    void renamed(const event::TagId& before, const TagMemory& memory) override {
        auto [from, to] = by_id_.equal_range(before);
        auto found = std::find_if(from, to, [&](auto& each) { return each.second->memory.get() == &memory; });
        if (found == to) return;
        auto* tag = found->second;
        by_id_.erase(found);
        by_id_.emplace(memory.id(), tag);
    }

    std::uint64_t name_key_;
    std::uint16_t antennas_;
    Radio radio_;
    std::vector<std::unique_ptr<Tag>> tags_;
    std::unordered_multimap<event::TagId, Tag*, event::TagIdHash> by_id_;
    std::vector<Visit> visits_;
};

struct Field::Impl {
    mutable std::mutex mutex;
    std::vector<std::unique_ptr<ReaderAir>> readers;
};

Field::Field() : impl_(std::make_unique<Impl>()) {}
Field::~Field() = default;

Air& Field::add_reader(std::string_view name, std::uint16_t antennas, double reads_per_second_per_tag) {
    std::lock_guard lock(impl_->mutex);
    return *impl_->readers.emplace_back(
        std::make_unique<ReaderAir>(impl_->mutex, name, antennas, reads_per_second_per_tag));
}

void Field::place(Air& air, const PlacedTag& tag) {
    std::lock_guard lock(impl_->mutex);
    auto& reader = static_cast<ReaderAir&>(air);
    auto key = reader.key_of(tag.tag.id);
    auto rssi = tag.rssi_dbm.value_or(usual_rssi(key, tag.antenna));
    reader.add(tag.tag, stand(tag.antenna, rssi), key);
}

void Field::remove(Air& air, const event::TagId& tag) {
    std::lock_guard lock(impl_->mutex);
    static_cast<ReaderAir&>(air).remove(tag);
}

void Field::add_traffic(Air& air, const TrafficSpec& traffic, Steady start) {
    auto made = traffic.pool.empty() ? traffic_tags(traffic.seed, traffic.tags) : traffic.pool;
    if (made.size() > traffic.tags) made.resize(traffic.tags);
    std::lock_guard lock(impl_->mutex);
    auto& reader = static_cast<ReaderAir&>(air);
    for (std::size_t i = 0; i < made.size(); ++i) {
        auto key = hash_of({traffic.seed, i, reader.key_of(made[i].id)});
        reader.add(made[i], come_and_go(traffic, reader.antenna_count(), key, start), key);
    }
}

std::size_t Field::tags() const {
    std::lock_guard lock(impl_->mutex);
    std::size_t sum = 0;
    for (auto& reader : impl_->readers)
        sum += reader->size();
    return sum;
}

}  // namespace gantry::field
