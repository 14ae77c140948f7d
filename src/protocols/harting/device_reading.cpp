#include "protocols/harting/device_reading.hpp"

#include <algorithm>

namespace gantry::harting {

static constexpr std::size_t remembered = 10'000;  // tags whose times are kept
static constexpr auto at_most_late = 10min;        // a host process that slept longer has missed the rest
static constexpr auto unpowered = 2s;  // how long a tag keeps its flag in S2 and S3 out of the field

void Reading::refresh(Steady now) {
    bool active = reader_.reads_by_itself() && !reader_.antennas().empty();
    if (!active || !active_) {
        slot_start_ = now;
        turn_ = 0;
        cycle_.clear();
    }
    active_ = active;
}

void Reading::forget() {
    for (auto& times : reported_)
        times.clear();
    answered_.clear();
    cycle_.clear();
}

std::optional<Steady> Reading::deadline() const {
    if (!active_) return {};
    return slot_start_ + reader_.round;
}

bool Reading::step(Steady now, std::vector<TagRecord>& out) {
    if (!active_) return false;
    if (now - slot_start_ > at_most_late) slot_start_ = now - reader_.round;
    auto end = slot_start_ + reader_.round;
    if (end > now) return false;
    auto antennas = reader_.antennas();
    turn_ %= antennas.size();
    auto antenna = antennas[turn_];
    heard_.clear();
    reader_.listen(antenna, slot_start_, end, heard_);
    for (auto& sighting : heard_)
        hear(sighting, antenna);
    slot_start_ = end;
    turn_ = (turn_ + 1) % antennas.size();
    if (reader_.setup.pool && turn_ != 0) return true;  // the other antennas may hear the same tags
    for (auto& found : cycle_)
        out.push_back(std::move(found.record));
    cycle_.clear();
    return true;
}

// A round asks each tag once, and so does a cycle over all antennas of a pool: several sightings are one
// record.
void Reading::hear(const AirSighting& sighting, std::uint16_t antenna) {
    if (is_quiet(sighting, antenna)) return;
    auto identity = identity_of(sighting, antenna);
    if (!identity) return;
    auto known = std::ranges::find(cycle_, *identity, &Found::identity);
    if (known != cycle_.end()) {
        auto& antennas = known->record.antennas;
        auto same = std::ranges::find(antennas, antenna, &TagRecord::Antenna::number);
        auto now = reader_.antenna_of(sighting, antenna);
        if (same == antennas.end()) {
            antennas.push_back(now);
        } else {
            same->rssi = std::min(same->rssi, now.rssi);
            ++same->count;
        }
        return;
    }
    auto& times = reported_[reader_.setup.pool ? 0 : antenna - 1u];
    auto last = times.find(*identity);
    if (last != times.end() && sighting.at - last->second < reader_.setup.valid_time) return;
    auto record = reader_.identify(sighting, antenna);
    AirAccess access{reader_.carrier(antenna), sighting.tag, 0, sighting.at};
    // What cannot be read completely is not reported; the next sighting is another try.
    if (!record || ((reader_.setup.tr1 & tr1_blocks) != 0 && !read_blocks(access, *record))) return;
    if ((reader_.setup.tr2 & tr2_input) != 0)
        record->input = {reader_.inputs(), reader_.trigger.status(reader_.setup), to_us(record->time)};
    times[*identity] = sighting.at;
    if (times.size() > remembered) shrink(times, sighting.at);
    cycle_.push_back({*identity, std::move(*record)});
}

// In sessions S2 and S3 a tag answers once and then keeps silent as long as it is in the field; CFG16 says
// after which time the reader wakes it.
bool Reading::is_quiet(const AirSighting& sighting, std::uint16_t antenna) {
    auto& setup = reader_.setup;
    if (setup.session < 2) return false;
    auto [known, fresh] = answered_.try_emplace(sighting.tag, sighting.at);
    auto passed = sighting.at - known->second;
    bool quiet = !fresh && (setup.persistence_reset
                                ? passed < std::chrono::microseconds{setup.persistence[antenna - 1u]}
                                : passed < unpowered);
    // Without the reset the flag is kept up by the field itself.
    if (!quiet || !setup.persistence_reset) known->second = sighting.at;
    if (answered_.size() > remembered) shrink(answered_, sighting.at);
    return quiet;
}

void Reading::shrink(Times& times, Steady now) const {
    std::erase_if(times, [&](auto& each) {
        return now - each.second >= std::max<std::chrono::microseconds>(reader_.setup.valid_time, unpowered);
    });
    if (times.size() > 2 * remembered) times.clear();
}

// CFG12: what makes two reads the same tag, its id or some of its data.
std::optional<event::TagId> Reading::identity_of(const AirSighting& sighting, std::uint16_t antenna) const {
    auto& setup = reader_.setup;
    if (!setup.tell_by_data || setup.identity_blocks == 0) return sighting.tag;
    AirAccess access{reader_.carrier(antenna), sighting.tag, 0, sighting.at};
    auto data = reader_.air.read(access, setup.bank, setup.identity_block, setup.identity_blocks);
    if (!data) return {};
    if (data->size() > event::TagId::max_size) data->resize(event::TagId::max_size);
    return event::TagId(*data);
}

bool Reading::read_blocks(const AirAccess& access, TagRecord& record) const {
    auto& setup = reader_.setup;
    auto count = setup.complete_bank ? 0u : setup.blocks;
    auto first = setup.complete_bank ? 0u : setup.first_block;
    if (count == 0 && !setup.complete_bank) return true;
    auto data = reader_.air.read(access, setup.bank, first, count);
    if (!data) return false;
    // A record must fit into a frame.
    static constexpr std::size_t others = 350;
    auto room = (reader_.tx_buf - others) / 2 * 2;
    if (data->size() > room) {
        if (!setup.complete_bank) return false;
        data->resize(room);
    }
    record.blocks = std::move(*data);
    return true;
}

}  // namespace gantry::harting
