// The writer's other half: what was taken from the loops becomes sightings, and what came of them becomes
// events.
#include "base/log.hpp"
#include "base/text.hpp"
#include "gateway/writer.hpp"

namespace gantry::gateway {

event::Event& Writer::add_event(event::Type type, Wall time) {
    auto& event = batch_.events.emplace_back();
    event.seq = batch_.take_seq();
    event.type = type;
    event.time = time;
    return event;
}

presence::ReaderIndex Writer::seen_reader(std::string_view name) {
    auto [it, is_new] = seen_by_name_.try_emplace(std::string(name), 0);
    if (is_new) {
        it->second = presence_.add_reader();
        seen_readers_.resize(std::max<std::size_t>(seen_readers_.size(), it->second + 1));
        seen_readers_[it->second].name = name;
    }
    return it->second;
}

std::string_view Writer::antenna_name(presence::ReaderIndex reader, std::uint16_t antenna) const {
    for (auto& [number, name] : seen_readers_[reader].antennas)
        if (number == antenna) return name;
    return {};
}

void Writer::name_antenna(presence::ReaderIndex reader, std::uint16_t antenna, std::string_view name) {
    if (antenna_name(reader, antenna).empty() && !name.empty())
        seen_readers_[reader].antennas.emplace_back(antenna, name);
}

presence::ZoneIndex Writer::zone(std::string_view key, std::string_view name) {
    auto [it, is_new] = zone_by_key_.try_emplace(std::string(key), 0);
    if (is_new) {
        auto rules = options_.rules;
        for (auto& configured : options_.zones)
            if (configured.name == name) rules = configured.rules;
        it->second = presence_.add_zone(rules);
        zones_.resize(std::max<std::size_t>(zones_.size(), it->second + 1));
        zones_[it->second] = {std::string(key), std::string(name)};
    }
    return it->second;
}

Writer::ReaderState& Writer::reader(std::uint32_t index) {
    if (index >= readers_.size()) readers_.resize(index + 1);
    auto& state = readers_[index];
    if (state.entry == nullptr) {
        state.entry = &roster_.at(index);
        state.presence = seen_reader(state.entry->name);
    }
    return state;
}

Writer::Slot& Writer::slot(ReaderState& state, std::uint16_t antenna) {
    // Makes count antennas in a byte or two; whatever lies beyond 255 shares the place of "not said".
    std::size_t at = antenna < 256 ? antenna + 1u : 0u;
    if (at >= state.slots.size()) state.slots.resize(at + 1);
    auto& slot = state.slots[at];
    if (slot.known) return slot;
    auto& config = *state.entry->config;
    auto name = config.address.plugin->antenna_name(at == 0 ? Observation::no_antenna : antenna);
    auto zone_name = std::string_view(config.zone);
    for (auto& configured : config.antennas)
        if (configured.name == name && !configured.zone.empty()) zone_name = configured.zone;
    // Readers without a zone each are a place of their own.
    auto key = zone_name.empty() ? "reader:" + state.entry->name : "zone:" + std::string(zone_name);
    slot = {true, zone(key, zone_name), journal_->read_point(state.entry->name, name, zone_name)};
    name_antenna(state.presence, antenna, name);
    return slot;
}

void Writer::restore(const journal::PresenceRow& row, Now now) {
    presence::Record record;
    record.id = row.id;
    record.tag = row.tag;
    record.technology = row.technology;
    record.state = static_cast<presence::State>(row.state);
    record.zone = zone(row.zone_key, row.zone);
    record.reader = seen_reader(row.reader);
    record.antenna = row.antenna_number;
    record.rssi = row.rssi;
    record.pc = row.pc;
    record.xpc = row.xpc;
    record.reads = row.reads;
    record.first_seen = row.first_seen;
    // Reads that left no row of their own lie inside a presence that lasts up to the last commit.
    record.last_seen = record.state == presence::State::lost
                           ? row.last_seen
                           : std::max(row.last_seen, journal_->last_commit());
    record.first_is_new = row.first_is_new;
    name_antenna(record.reader, row.antenna_number, row.antenna);
    seen_by_.clear();
    for (auto& name : row.readers)
        seen_by_.push_back(seen_reader(name));
    presence_.restore(record, seen_by_, presence_time(now));
}

void Writer::store_presence(std::uint64_t id) {
    const auto* record = presence_.find(id);
    if (record == nullptr) return;
    auto& row = batch_.presence.emplace_back();
    row.id = record->id;
    row.tag = record->tag;
    row.technology = record->technology;
    row.state = static_cast<std::uint8_t>(record->state);
    row.zone_key = zones_[record->zone].key;
    row.zone = zones_[record->zone].name;
    row.reader = seen_readers_[record->reader].name;
    row.antenna = antenna_name(record->reader, record->antenna);
    row.antenna_number = record->antenna;
    row.rssi = record->rssi;
    row.pc = record->pc;
    row.xpc = record->xpc;
    row.reads = record->reads;
    row.first_seen = record->first_seen;
    row.last_seen = record->last_seen;
    row.first_is_new = record->first_is_new;
    seen_by_.clear();
    presence_.readers_of(id, seen_by_);
    for (auto each : seen_by_)
        row.readers.push_back(seen_readers_[each].name);
}

void Writer::take(Channel& channel, Item& item) {
    auto& state = reader(item.reader);
    if (item.kind == Item::Kind::report) {
        take_report(channel, state, item);
        return;
    }
    channel.taken_up_to_ = std::max(channel.taken_up_to_, item.at.steady);
    if (item.kind == Item::Kind::lost) {
        auto& event = add_event(event::Type::overflow, item.at.wall);
        event.reader = state.entry->name;
        event.scope = "gateway";
        event.count = item.lost;
        event.since = item.lost_since;
        return;
    }
    channel.pending_.push_back({item.kind, item.reader, item.session, 0, {}});
    if (item.kind == Item::Kind::ask_known) {
        read_mark(state);
        return;
    }
    bool up = item.kind == Item::Kind::reader_up;
    auto& event =
        add_event(up ? event::Type::reader_connected : event::Type::reader_disconnected, item.at.wall);
    event.reader = state.entry->name;
    if (up) {
        read_mark(state);
        presence_.reader_online(state.presence, presence_time(item.at));
    } else {
        event.reason = std::move(item.reason);
        presence_.reader_offline(state.presence, presence_time(item.at));
    }
}

// Once; from then on it is known from what is committed.
void Writer::read_mark(ReaderState& state) {
    if (std::exchange(state.known_read, true)) return;
    state.known.mark_from_disk = true;
    auto mark = journal_->mark(state.entry->name);
    if (mark) {
        state.known.mark = std::move(*mark);
        return;
    }
    state.known.mark_unreadable = true;
    log::error("store", "{}; if {} repeats its last reads they are kept and marked as possible repeats",
               mark.error().error.text(), state.entry->name);
}

void Writer::take_report(Channel& channel, ReaderState& state, Item& item) {
    auto& report = item.report;
    auto now = presence_time(report.received);
    for (auto& seen : report.observations) {
        take_observation(state, report, seen);
        auto& place = slot(state, seen.antenna);
        presence::Sighting sighting{.tag = seen.tag,
                                    .technology = seen.technology,
                                    .zone = place.zone,
                                    .reader = state.presence,
                                    .antenna = seen.antenna,
                                    .rssi = {},
                                    .reads = seen.reads};
        if (seen.rssi != Observation::no_rssi) sighting.rssi = seen.rssi;
        if (seen.pc != 0) sighting.pc = seen.pc;
        if (seen.xpc != Observation::no_xpc) sighting.xpc = seen.xpc;
        presence_.sighted(sighting, now, transitions_);
        if (!transitions_.empty()) take_transitions();
    }
    for (auto& notice : report.notices)
        take_notice(state, report.received, notice);
    if (report.mark) {
        batch_.marks.emplace_back(state.entry->name, *report.mark);
        new_marks_.emplace_back(item.reader, std::move(*report.mark));
    }
    channel.taken_up_to_ = std::max(channel.taken_up_to_, report.received.steady);
    // One answer a session and batch is enough: it stands for all earlier tickets.
    auto& pending = channel.pending_;
    if (!pending.empty() && pending.back().session == item.session &&
        pending.back().kind == Item::Kind::report)
        pending.back().ticket = report.ticket;
    else
        pending.push_back({Item::Kind::report, item.reader, item.session, report.ticket, {}});
}

void Writer::take_observation(ReaderState& state, const Report& report, const Observation& seen) {
    reads_ += seen.reads;
    if (!options_.tag_read) return;
    bool has_data =
        seen.data_size > 0 && std::size_t{seen.data_offset} + seen.data_size <= report.data.size();
    auto& place = slot(state, seen.antenna);
    if (!has_data) {
        batch_.reads.push_back(
            {batch_.take_seq(), report.received.wall, place.read_point, report.possible_repeat, seen});
        return;
    }
    auto& event = add_event(event::Type::tag_read, report.received.wall);
    event.technology = seen.technology;
    event.possible_repeat = report.possible_repeat;
    event.reader = state.entry->name;
    event.antenna = antenna_name(state.presence, seen.antenna);
    event.zone = zones_[place.zone].name;
    event.tag = seen.tag;
    event.pc = seen.pc;
    if (seen.xpc != Observation::no_xpc) event.xpc = seen.xpc;
    if (seen.rssi != Observation::no_rssi) event.rssi = seen.rssi;
    event.reads = seen.reads;
    if (seen.reader_time_us != 0) event.reader_time = from_us(seen.reader_time_us);
    auto data = ByteView(report.data).subspan(seen.data_offset, seen.data_size);
    auto tid = data.first(std::min<std::size_t>(seen.tid_size, data.size()));
    event.tid.assign(tid.begin(), tid.end());
    data = data.subspan(tid.size());
    auto& into = seen.data_bank == Bank::tid ? event.tid : event.user;
    into.insert(into.end(), data.begin(), data.end());
}

void Writer::take_notice(ReaderState& state, Now at, const Notice& notice) {
    if (const auto* fault = std::get_if<FaultNotice>(&notice)) {
        auto& event = add_event(event::Type::reader_fault, at.wall);
        event.reader = state.entry->name;
        event.code = fault->code;
        event.text = fault->text;
        event.bytes = fault->bytes;
    } else if (const auto* input = std::get_if<InputNotice>(&notice)) {
        auto& event = add_event(event::Type::gpi_changed, at.wall);
        event.reader = state.entry->name;
        event.input = input->input;
        event.state = input->state;
    } else if (const auto* overflow = std::get_if<OverflowNotice>(&notice)) {
        auto& event = add_event(event::Type::overflow, at.wall);
        event.reader = state.entry->name;
        event.scope = overflow->scope;
        event.count = overflow->count;
    } else if (const auto* clock = std::get_if<ClockNotice>(&notice)) {
        auto& event = add_event(event::Type::clock_jumped, at.wall);
        event.reader = state.entry->name;
        event.by = (clock->by < 0us ? "-" : "+") + to_text(clock->by < 0us ? -clock->by : clock->by);
    }
}

void Writer::take_transitions() {
    for (auto& transition : transitions_) {
        auto& record = transition.record;
        auto& place = zones_[record.zone];
        bool moved = transition.type == event::Type::tag_moved;
        // A move is between places that have names.
        if (moved && (place.name.empty() || zones_[transition.from].name.empty())) continue;
        auto& event = add_event(transition.type, transition.time);
        event.technology = record.technology;
        event.reader = seen_readers_[record.reader].name;
        event.antenna = antenna_name(record.reader, record.antenna);
        event.zone = place.name;
        event.tag = record.tag;
        event.pc = record.pc;
        event.xpc = record.xpc;
        event.rssi = record.rssi;
        event.reads = record.reads;
        event.first_seen = record.first_seen;
        event.last_seen = record.last_seen;
        event.reason = transition.reason;
        if (moved) {
            event.from = zones_[transition.from].name;
            event.to = place.name;
        }
    }
    transitions_.clear();
}

}  // namespace gantry::gateway
