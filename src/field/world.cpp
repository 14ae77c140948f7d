#include "field/world.hpp"

#include <algorithm>
#include <cmath>

#include "field/field.hpp"
#include "field/hash.hpp"
#include "field/tags.hpp"

namespace gantry::field {

namespace {
// What a chance is for, so that those of one tag are independent.
enum Purpose : std::uint64_t {
    place_x = 100,
    place_y,
    place_z,
    axis_z,
    axis_turn,
    sensitivity,
    pace,
    phase_of
};

// More than these a reader is never turned up, and echoes never help.
constexpr double most_turned_db = 9, best_fade_db = 8;

double even(std::uint64_t key, Purpose purpose) {
    return 2 * fraction(hash_of({key, purpose})) - 1;  // -1 to 1
}

Vec any_direction(std::uint64_t key) {
    auto z = even(key, axis_z), turn = M_PI * even(key, axis_turn);
    auto flat = std::sqrt(1 - z * z);
    return {flat * std::cos(turn), flat * std::sin(turn), z};
}

// Counts up from `first` in its last bytes.
event::TagId counted(Bytes first, std::uint32_t number) {
    std::uint64_t carry = number;
    for (auto byte = first.rbegin(); byte != first.rend() && carry != 0; ++byte) {
        carry += *byte;
        *byte = static_cast<std::uint8_t>(carry);
        carry >>= 8;
    }
    return event::TagId(first);
}

// As ISO/IEC 15693 has it: E0h, the maker's code (04h: NXP), then a serial number; here of seed, group, tag.
Bytes made_uid(std::uint64_t seed, std::uint32_t group) {
    auto byte = [](std::uint64_t value) { return static_cast<std::uint8_t>(value); };
    return {0xE0, 0x04, byte(hash_of({seed})), byte(group >> 8), byte(group), 0, 0, 0};
}

TagSpec spec_of(const TagGroup& group, std::uint32_t group_number, std::uint32_t number, std::uint64_t seed) {
    TagSpec spec;
    spec.technology = group.technology;
    if (!group.first_id.empty())
        spec.id = counted(group.first_id, number);
    else if (is_hf(group.technology))
        spec.id = counted(made_uid(seed, group_number), number);
    else
        spec.id = sgtin96(200'000 + group_number, (hash_of({seed}) & 0x3FFF) << 24 | number);
    return spec;
}
}  // namespace

bool is_hf(event::Technology technology) {
    return technology == event::Technology::iso15693 || technology == event::Technology::icode1;
}

World::World(const Scenario& scenario) : scenario_(scenario), air_(scenario_) {
    tags_.reserve(scenario_.tags());
    for (std::uint32_t i = 0; i < scenario_.groups.size(); ++i)
        add_group(i);
    group_starts_.push_back(static_cast<std::uint32_t>(tags_.size()));
    for (auto& reader : scenario_.readers) {
        first_antennas_.push_back(antennas_.size());
        for (auto& antenna : reader.antennas)
            add_antenna(antenna);
    }
}

void World::add_group(std::uint32_t number) {
    auto& group = scenario_.groups[number];
    group_starts_.push_back(static_cast<std::uint32_t>(tags_.size()));
    for (std::uint32_t i = 0; i < group.count; ++i) {
        auto key = hash_of({scenario_.seed, number, i});
        auto across = i % group.grid[0], along = i / group.grid[0] % group.grid[1],
             up = i / group.grid[0] / group.grid[1];
        Vec steps{group.spacing.x * across, group.spacing.y * along, group.spacing.z * up};
        Vec off{even(key, place_x), even(key, place_y), even(key, place_z)};
        SceneTag tag;
        tag.memory = make_memory(spec_of(group, number, i, scenario_.seed));
        tag.key = key;
        tag.group = number;
        tag.place = group.position + steps + off * group.jitter;
        tag.axis = group.axis ? unit(*group.axis) : any_direction(key);
        // Two even chances make a triangle of deviation 0.41 from -1 to 1.
        auto triangle =
            (fraction(hash_of({key, sensitivity})) - fraction(hash_of({key, sensitivity, 1}))) / 0.408;
        tag.sensitivity_dbm = group.sensitivity_dbm + group.spread_db * triangle;
        tag.loss_db = group.loss_db;
        if (group.motion) tag.motion.emplace(*group.motion, i, hash_of({key, pace}));
        tags_.push_back(std::move(tag));
    }
}

void World::add_antenna(const AntennaSpec& spec) {
    Antenna antenna{Beam(spec), {}, {}};
    for (std::uint32_t i = 0; i < tags_.size(); ++i) {
        auto& tag = tags_[i];
        if (tag.motion || is_hf(tag.memory->technology()) != (spec.band == Band::hf)) continue;
        auto way_db = way(tag, antenna.beam, tag.place);
        auto spare_db = spare(tag, antenna.beam, way_db);
        FadingBounds bounds;
        if (spec.band == Band::uhf) bounds = fading_bounds(air_, hash_of({tag.key, antennas_.size()}), {});
        if (spare_db + bounds.most + most_turned_db < 0) continue;
        antenna.still.push_back({i, static_cast<float>(way_db), static_cast<float>(spare_db),
                                 static_cast<float>(spare_db + bounds.least),
                                 static_cast<float>(spare_db + bounds.most)});
    }
    std::ranges::stable_sort(antenna.still, std::greater{}, &Still::most_db);
    for (std::uint32_t i = 0; i < scenario_.groups.size(); ++i)
        if (scenario_.groups[i].motion && may_reach(antenna, i)) antenna.moving.push_back(i);
    antennas_.push_back(std::move(antenna));
}

// Whether any point of the box in which a group moves is near enough.
bool World::may_reach(const Antenna& antenna, std::uint32_t group) const {
    auto& spec = *antenna.beam.spec;
    if (is_hf(scenario_.groups[group].technology) != (spec.band == Band::hf)) return false;
    Vec low{1e9, 1e9, 1e9}, high{-1e9, -1e9, -1e9};
    double keenest = 0;
    for (auto i = group_starts_[group]; i < tags_.size() && tags_[i].group == group; ++i) {
        keenest = std::min(keenest, tags_[i].sensitivity_dbm + tags_[i].loss_db);
        for (auto& offset : scenario_.groups[group].motion->path) {
            auto at = tags_[i].place + offset;
            low = {std::min(low.x, at.x), std::min(low.y, at.y), std::min(low.z, at.z)};
            high = {std::max(high.x, at.x), std::max(high.y, at.y), std::max(high.z, at.z)};
        }
    }
    auto at = spec.position;
    Vec nearest{std::clamp(at.x, low.x, high.x), std::clamp(at.y, low.y, high.y),
                std::clamp(at.z, low.z, high.z)};
    auto far = spec.band == Band::hf ? 4 * spec.reach
                                     : reach(air_, antenna.beam, antenna.beam.facing,
                                             spec.power_dbm + most_turned_db + best_fade_db, keenest);
    return length(nearest - at) <= far;
}

double World::way(const SceneTag& tag, const Beam& beam, Vec place) const {
    if (beam.spec->band == Band::hf) return coupling_db(beam, place, tag.axis);
    return way_db(air_, beam, place, tag.axis, tag.loss_db);
}

double World::spare(const SceneTag& tag, const Beam& beam, double way_db) const {
    if (beam.spec->band == Band::hf) return way_db;
    return beam.spec->power_dbm + way_db - tag.sensitivity_dbm;
}

std::optional<Whereabouts> World::where(std::uint32_t tag, SceneTime time) const {
    if (!tags_[tag].motion) return Whereabouts{};
    return tags_[tag].motion->at(time);
}

double World::rssi(const Beam& beam, double way_db, double turned_db) const {
    // Near fields do not fade; what an HF reader calls strength follows the coupling there and back.
    if (beam.spec->band == Band::hf) return std::min(-70 + 2 * (way_db + turned_db), -10.0);
    return beam.spec->power_dbm + turned_db + 2 * way_db - backscatter_loss_db;
}

std::optional<Powered> World::fade(std::uint32_t tag, std::size_t antenna, double way_db, double spare_db,
                                   double turned_db, const Whereabouts& where, SceneTime time) const {
    auto& beam = antennas_[antenna].beam;
    if (!(spare_db + turned_db + best_fade_db >= 0) || tags_[tag].memory->is_killed()) return {};
    double echoes = 0;
    if (beam.spec->band == Band::uhf)
        echoes = fading(air_, hash_of({tags_[tag].key, antenna}), where, time).db;
    auto spare = spare_db + turned_db + echoes;
    if (!(spare >= 0)) return {};
    return Powered{tag, static_cast<float>(rssi(beam, way_db + echoes, turned_db)),
                   static_cast<float>(spare)};
}

void World::still(std::size_t antenna, double turned_db, SceneTime time, std::vector<Powered>& out) const {
    auto& beam = antennas_[antenna].beam;
    for (auto& each : antennas_[antenna].still) {
        if (!(each.most_db + turned_db >= 0)) break;  // and so are all behind it
        if (each.least_db + turned_db >= 0) {
            if (tags_[each.tag].memory->is_killed()) continue;
            out.push_back({each.tag, static_cast<float>(rssi(beam, each.way_db, turned_db)),
                           each.least_db + static_cast<float>(turned_db)});
        } else if (auto found = fade(each.tag, antenna, each.way_db, each.spare_db, turned_db, {}, time)) {
            out.push_back(*found);
        }
    }
}

void World::moving(std::size_t antenna, double turned_db, SceneTime time, std::vector<Powered>& out) const {
    for (auto group : antennas_[antenna].moving)
        for (auto tag = group_starts_[group]; tag < group_starts_[group + 1]; ++tag)
            if (auto found = powered(tag, antenna, turned_db, time)) out.push_back(*found);
}

std::optional<Powered> World::powered(std::uint32_t tag, std::size_t antenna, double turned_db,
                                      SceneTime time) const {
    auto& beam = antennas_[antenna].beam;
    auto& each = tags_[tag];
    if (is_hf(each.memory->technology()) != (beam.spec->band == Band::hf)) return {};
    auto now = where(tag, time);
    if (!now) return {};
    auto way_db = way(each, beam, each.place + now->offset);
    return fade(tag, antenna, way_db, spare(each, beam, way_db), turned_db, *now, time);
}

std::optional<World::Signal> World::signal(std::uint32_t tag, std::size_t antenna, double turned_db,
                                           SceneTime time) const {
    auto& each = tags_[tag];
    auto& beam = antennas_[antenna].beam;
    auto now = where(tag, time);
    if (!now) return {};
    auto place = each.place + now->offset;
    Fading echoes;
    if (beam.spec->band == Band::uhf) echoes = fading(air_, hash_of({each.key, antenna}), *now, time);
    auto own_turn = 2 * M_PI * fraction(hash_of({each.key, phase_of}));
    return Signal{rssi(beam, way(each, beam, place) + echoes.db, turned_db),
                  phase_at(air_, length(place - beam.spec->position), 2 * echoes.radians + own_turn)};
}

}  // namespace gantry::field
